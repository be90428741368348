"""What an error follows: a state, an input or the time, where several runs agree."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rover_hil.gap.data.problem import Indices
from rover_hil.gap.decision.analysis import MachineFindings
from rover_hil.gap.output.series import ForceTrace, Trace, trajectories
from rover_hil.gap.parameters import MACHINES
from sim_backends.models.interface import Array

TIME = "the time in the run"


@dataclass(frozen=True, slots=True, kw_only=True)
class ErrorSource:
    """A quantity that predicts the error of runs from that of the others.

    Attributes:
        error: What follows: a channel, or the force at a port.
        source: A state, an input or the time.
        unit: Of the source.
        share: Of the energy above the noise that the other runs predict from the source.
        agreeing: Runs in which it is a quarter or more.
        count: All runs.
        low: Where the error is largest, lower end.
        high: Upper end.
        is_constant: It is about the same over the whole range of the source.
    """

    error: str
    source: str
    unit: str
    share: float
    agreeing: int
    count: int
    low: float
    high: float
    is_constant: bool

    def sentence(self) -> str:
        """Return it in words."""
        if self.is_constant:
            return (
                f"{self.error}: {min(self.share, 1.0):.0%} of the energy above the noise is a constant, in "
                f"{self.agreeing} of {self.count} runs."
            )
        return (
            f"{self.error}: {min(self.share, 1.0):.0%} of the energy above the noise follows "
            f"{self.source}, in {self.agreeing} of {self.count} runs; it is largest from {self.low:.3g} to "
            f"{self.high:.3g} {self.unit}."
        )


def channel_sources(findings: MachineFindings, shown: Sequence[Trace]) -> list[str]:
    """Return one sentence for each channel: what its error before follows."""
    states = dict(zip([site.name for site in findings.problem.sites], trajectories(findings), strict=True))
    sentences = []
    for channel in findings.problem.observations.channels:
        own = [one for one in shown if one.channel is channel and not one.is_locked]
        if not own:
            continue
        errors = [one.measured - one.before for one in own]
        noise = [channel.noise_sd**2 * int(np.isfinite(one).sum()) for one in errors]
        sources = [{**states[one.run], TIME: one.times_s} for one in own]
        sentences.append(_sentence(findings, channel.name, errors, noise, sources))
    return sentences


def force_sources(findings: MachineFindings, shown: Sequence[ForceTrace]) -> list[str]:
    """Return one sentence for each port: what the unknown force follows."""
    sentences = []
    for port in dict.fromkeys(one.port for one in shown):
        own = [one for one in shown if one.port == port]
        noise = [float(np.sum(one.sd**2)) for one in own]
        sources = [{**one.sources, TIME: one.times_s} for one in own]
        name = f"force at {port}"
        sentences.append(_sentence(findings, name, [one.force for one in own], noise, sources))
    return sentences


def _sentence(
    findings: MachineFindings,
    error: str,
    errors: Sequence[Array],
    noise: Sequence[float],
    sources: Sequence[Mapping[str, Array]],
) -> str:
    machine = findings.machine
    units = {**machine.states, **machine.inputs, TIME: "s"}
    found = find_source(error, errors, noise, sources, units)
    if found is not None:
        return found.sentence()
    return f"{error}: no state, no input and no time explains it in at least two runs."


def find_source(
    error: str,
    errors: Sequence[Array],
    noise: Sequence[float],
    sources: Sequence[Mapping[str, Array]],
    units: Mapping[str, str],
) -> ErrorSource | None:
    """Return the source that explains most of an error; None where fewer than two runs agree.

    In ten ranges of a source, the mean error of the other runs predicts the error of each run. Errors are NaN
    where values are missing, noise is the energy in each run, sources come in the order of preference.
    """
    best: ErrorSource | None = None
    for name in units:
        if any(name not in one for one in sources):
            continue
        found = _explained(error, errors, noise, [one[name] for one in sources], (name, units[name]))
        if found is not None and (best is None or found.share > best.share + MACHINES.source.simpler):
            best = found
    return best


def _explained(
    error: str,
    errors: Sequence[Array],
    noise: Sequence[float],
    source: Sequence[Array],
    label: tuple[str, str],
) -> ErrorSource | None:
    edges = np.unique(np.quantile(np.concatenate(source), np.linspace(0.0, 1.0, MACHINES.source.bins + 1)))
    if len(errors) < MACHINES.source.least_runs or edges.size <= MACHINES.source.least_runs:
        return None
    bins = [np.clip(np.searchsorted(edges, one, "right") - 1, 0, edges.size - 2) for one in source]
    counts = np.stack(
        [_sums(where, np.isfinite(one), edges.size - 1) for where, one in zip(bins, errors, strict=True)]
    )
    sums = np.stack(
        [_sums(where, np.nan_to_num(one), edges.size - 1) for where, one in zip(bins, errors, strict=True)]
    )
    gains, excesses = [], []
    for run, (where, one) in enumerate(zip(bins, errors, strict=True)):
        others = (sums.sum(axis=0) - sums[run]) / np.maximum(counts.sum(axis=0) - counts[run], 1.0)
        predicted = np.where(np.isfinite(one), others[where], 0.0)
        values = np.nan_to_num(one)
        gains.append(float(np.sum(values**2) - np.sum((values - predicted) ** 2)))
        excesses.append(max(float(np.sum(values**2)) - noise[run], 0.0))
    total = sum(excesses)
    agreeing = sum(
        gain >= MACHINES.source.least_share * own > 0.0 for gain, own in zip(gains, excesses, strict=True)
    )
    explained = sum(max(gain, 0.0) for gain in gains)
    if (
        total <= 0.0
        or agreeing < MACHINES.source.least_runs
        or explained < MACHINES.source.least_share * total
    ):
        return None
    low, high = _largest(sums.sum(axis=0) / np.maximum(counts.sum(axis=0), 1.0), edges)
    return ErrorSource(
        error=error,
        source=label[0],
        unit=label[1],
        share=explained / total,
        agreeing=agreeing,
        count=len(errors),
        low=low,
        high=high,
        is_constant=low == edges[0] and high == edges[-1],
    )


def _sums(where: Indices, values: Array, size: int) -> Array:
    return np.bincount(where, weights=values.astype(np.float64), minlength=size).astype(np.float64)


def _largest(means: Array, edges: Array) -> tuple[float, float]:
    """Return the range around the largest mean in which it stays above half of it, with one sign."""
    top = int(np.argmax(np.abs(means)))
    first = last = top
    inside = means / means[top] > 0.5
    while first > 0 and inside[first - 1]:
        first -= 1
    while last < means.size - 1 and inside[last + 1]:
        last += 1
    return float(edges[first]), float(edges[last + 1])
