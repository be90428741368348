"""Requirements on data before anything is computed from it."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from rover_hil.gap.data.parameters import DATA
from rover_hil.gap.data.problem import Group, group_runs, is_steady
from rover_hil.gap.noise.parameters import STATISTICS
from rover_hil.gap.noise.replicates import pooled_freedom
from sim_backends.models.interface import Array, DrivenModel, Machine, Model, Run

SHOWN = 3
"""Series with gaps that a sentence lists."""


@dataclass(frozen=True, slots=True)
class Objection:
    """Reason why no verdict on effects is possible.

    Attributes:
        is_identifiability: The data is sound, but does not decide; otherwise it is bad.
        reason: What is wrong and what to do, one sentence.
    """

    is_identifiability: bool
    reason: str


@dataclass(frozen=True, slots=True, kw_only=True)
class MissingValues:
    """Gaps in one series of one run.

    Attributes:
        run: Name of the run.
        series: Name of the channel, input or column of the record.
        count: Values that are missing or infinite.
        total: Values that there should be.
        is_input: A model is fed with it, so that no gap can be left out.
    """

    run: str
    series: str
    count: int
    total: int
    is_input: bool = False

    def sentence(self) -> str:
        """Return it in words."""
        return f"run {self.run}: {self.count} of {self.total} values of {self.series} are missing"


def missing_values(model: Model, runs: Sequence[Run]) -> list[MissingValues]:
    """Return every series of every run that has gaps."""
    return [one for run in runs for one in _gaps_of(model, run) if one.count]


def _gaps_of(model: Model, run: Run) -> Iterator[MissingValues]:
    for name, (count, total) in run.missing.items():
        yield MissingValues(run=run.name, series=name, count=count, total=total)
    first, last = run.overlap
    for channel in model.channels:
        if channel.name in run.measured:
            values = run.measured[channel.name]
            values = values[first : values.size - last]
            every = samples_per_value(values) if isinstance(model, Machine) else 1
            count, total = _missing(values, every)
            yield MissingValues(run=run.name, series=channel.name, count=count, total=total)
    for name, values in run.inputs.items():
        count = int(np.sum(~np.isfinite(values)))
        yield MissingValues(run=run.name, series=name, count=count, total=values.size, is_input=True)


def samples_per_value(values: Array) -> int:
    """Return 2 or more where a series has a value at about every second sample, or at fewer; 1 otherwise.

    Two clocks that run beside each other let a value come a sample earlier or later.
    """
    good = np.flatnonzero(np.isfinite(values))
    if good.size < DATA.checks.least_slow_samples:
        return 1
    between = np.diff(good)
    every = int(np.median(between))
    is_regular = np.mean(np.abs(between - every) <= 1) >= DATA.checks.regular_share
    return every if is_regular else 1


def _missing(values: Array, every: int) -> tuple[int, int]:
    """Return how many values are missing, and how many there should be, one in so many samples."""
    good = np.flatnonzero(np.isfinite(values))
    if not good.size:
        return values.size, values.size
    between = np.maximum(np.round(np.diff(good) / every), 1.0) - 1.0
    count = int(between.sum()) + int(good[0]) // every + (values.size - 1 - int(good[-1])) // every
    return count, good.size + count


def slower_channels(model: Model, runs: Sequence[Run]) -> list[str]:
    """Return a sentence for each channel of a machine that is measured less often than its inputs."""
    if not isinstance(model, Machine):
        return []
    sentences = []
    for channel in model.channels:
        every = max(
            (samples_per_value(run.measured[channel.name]) for run in runs if channel.name in run.measured),
            default=1,
        )
        if every > 1:
            sentences.append(
                f"channel {channel.name} has a value at every {_ordinal(every)} sample of the inputs; the "
                "samples between are not compared"
            )
    return sentences


def _ordinal(number: int) -> str:
    ending = "th" if number % 100 in (11, 12, 13) else {1: "st", 2: "nd", 3: "rd"}.get(number % 10, "th")
    return f"{number}{ending}"


def object_to(model: Model, runs: Sequence[Run]) -> Objection | None:
    """Return the first objection to data, or None."""
    tests = (_units, _names, _conditions, _inputs, _complete, _lengths)
    for test in tests:
        reason = test(model, runs)
        if reason:
            return Objection(is_identifiability=False, reason=reason)
    if is_steady(runs):
        reason = _noise_known(model, runs) or _replicates_agree(model, runs)
        if reason:
            return Objection(is_identifiability=False, reason=reason)
        reason = _conditions_vary(model, runs)
    else:
        reason = _separable(model, runs) or _inputs_vary(model, runs)
    return Objection(is_identifiability=True, reason=reason) if reason else None


def _units(model: Model, runs: Sequence[Run]) -> str:
    owners = [(f"channel {item.name}", item.unit) for item in model.channels]
    owners += [(f"condition {name}", unit) for name, unit in model.condition_units.items()]
    owners += [(f"parameter {item.name}", item.unit) for item in model.parameters]
    owners += [
        (f"parameter {item.name} of {card.name}", item.unit)
        for card in model.effects
        for item in card.parameters
    ]
    if isinstance(model, DrivenModel):
        owners += [(f"input {name}", unit) for name, unit in model.input_units.items()]
    missing = [owner for owner, unit in owners if not unit.strip()]
    return f'{missing[0]} of the model has no unit: write it, "1" for a pure number' if missing else ""


def _names(model: Model, runs: Sequence[Run]) -> str:
    if not runs:
        return "there are no runs in the data"
    names = [run.name for run in runs]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        return f"run {twice[0]} appears {names.count(twice[0])} times: give each run its own name"
    for channel in model.channels:
        if not any(channel.name in run.measured for run in runs):
            return f"channel {channel.name} is in no run: measure it, or take it out of the model"
    return ""


def _conditions(model: Model, runs: Sequence[Run]) -> str:
    for run in runs:
        for name in model.condition_units:
            if name not in run.conditions:
                return f"run {run.name} has no condition {name}"
            if not math.isfinite(run.conditions[name]):
                return f"run {run.name}: {name} is {run.conditions[name]}: write what was set"
    return ""


def _inputs(model: Model, runs: Sequence[Run]) -> str:
    needed = model.input_units if isinstance(model, DrivenModel) else ()
    for run in runs:
        for name in needed:
            if name not in run.inputs:
                return f"run {run.name} has no input {name}"
    return ""


def _lengths(model: Model, runs: Sequence[Run]) -> str:
    if is_steady(runs):
        return ""
    for run in runs:
        for channel in model.channels:
            size = (
                run.measured[channel.name].size if channel.name in run.measured else DATA.runs.least_samples
            )
            if size < DATA.runs.least_samples:
                return (
                    f"run {run.name}: {channel.name} has {size} samples, fewer than {DATA.runs.least_samples}"
                )
    return ""


def _complete(model: Model, runs: Sequence[Run]) -> str:
    """Return which runs lack more values than can be left out."""
    steady = is_steady(runs)
    unusable = [
        one
        for one in missing_values(model, runs)
        if steady or one.is_input or one.count > DATA.checks.missing_share * one.total
    ]
    if not unusable:
        return ""
    shown = "; ".join(one.sentence() for one in unusable[:SHOWN])
    more = f"; and {len(unusable) - SHOWN} more" if len(unusable) > SHOWN else ""
    rule = (
        "a steady run needs every value"
        if steady
        else f"at most {DATA.checks.missing_share:.0%} of the values of a series may be missing, and none of "
        "an input"
    )
    return f"{shown}{more}; {rule}: repair the record or take the run out"


def _noise_known(model: Model, runs: Sequence[Run]) -> str:
    groups = group_runs(model, runs)
    for item, freedom in zip(model.channels, pooled_freedom(groups, model.channels), strict=True):
        known = bool(item.sigma) or item.quantum > 0.0
        if freedom < STATISTICS.replicates.least_freedom and not known:
            return (
                f"channel {item.name} has no noise estimate: repeat runs under equal conditions "
                f"({STATISTICS.replicates.least_freedom} repetitions or more in all), or give the "
                "sensor's deviation in the model"
            )
        values = [run.measured[item.name][0] for run in runs if item.name in run.measured]
        within = _within(groups, item.name)
        if not known and freedom >= STATISTICS.replicates.least_freedom and not np.any(within):
            return (
                f"channel {item.name} has no noise estimate: all repetitions are equal to the last digit"
                if np.ptp(values) > 0.0
                else f"channel {item.name} never changes: the sensor seems dead"
            )
    return ""


def _within(groups: Sequence[Group], name: str) -> Array:
    """Return the differences between consecutive replicates of one channel."""
    parts = [
        np.diff([run.measured[name][0] for run in group.runs if name in run.measured]) for group in groups
    ]
    return np.concatenate(parts) if parts else np.zeros(0)


def _replicates_agree(model: Model, runs: Sequence[Run]) -> str:
    groups = group_runs(model, runs)
    far: dict[str, list[str]] = {}
    loose = []
    judged = 0
    for channel in model.channels:
        within = _within(groups, channel.name)
        spread = 1.4826 * float(np.median(np.abs(within))) / math.sqrt(2.0) if within.size else 0.0
        spread = max(spread, channel.sigma or 0.0, channel.quantum)
        if within.size < STATISTICS.replicates.least_freedom or spread <= 0.0:
            continue
        judged += 1
        means = np.array(
            [group.site.measured[channel.name][0] for group in groups if channel.name in group.site.measured]
        )
        noise = float(np.mean(within**2)) / 2.0
        if means.size >= DATA.checks.least_groups and noise > DATA.checks.irreproducible_share * (
            noise + float(np.var(means))
        ):
            loose.append(channel.name)
        for group in groups:
            values = np.array(
                [run.measured[channel.name][0] for run in group.runs if channel.name in run.measured]
            )
            if values.size > 1 and np.ptp(values) > DATA.checks.contradiction_sd * spread:
                far.setdefault(", ".join(run.name for run in group.runs), []).append(channel.name)
    contradicting = [(names, channels) for names, channels in far.items() if len(channels) > 1]
    if contradicting:
        names, channels = contradicting[0]
        return (
            f"runs {names} were made under equal conditions and contradict each other in "
            f"{' and '.join(channels)}: find out which is wrong and take it out"
        )
    if judged > 1 and len(loose) == judged:
        return (
            "repetitions under equal conditions differ as much as runs under different ones, in every "
            "channel: the data contradicts itself, check what was set in each run"
        )
    return ""


def _conditions_vary(model: Model, runs: Sequence[Run]) -> str:
    groups = group_runs(model, runs)
    if len(groups) >= DATA.checks.least_groups:
        return ""
    names = list(model.condition_units)
    constant = [name for name in names if len({run.conditions[name] for run in runs}) == 1]
    return (
        f"all runs were made under {len(groups)} set{'s' if len(groups) > 1 else ''} of conditions, which "
        f"cannot distinguish effects: vary {', '.join(constant or names)}"
    )


def _separable(model: Model, runs: Sequence[Run]) -> str:
    """Return which channel of a machine has no scale that its misfit can be compared with."""
    if not isinstance(model, Machine):
        return ""
    for channel in model.channels:
        if channel.noise_sd <= 0.0 and any(channel.name in run.measured for run in runs):
            return (
                f"channel {channel.name}: sensor noise and model error are not separable: declare sigma or "
                "quantum of its sensor in the model"
            )
    return ""


def _inputs_vary(model: Model, runs: Sequence[Run]) -> str:
    if not isinstance(model, DrivenModel):
        return ""
    for name in model.input_units:
        if name != "t_s" and any(np.ptp(run.inputs[name]) > 0.0 for run in runs):
            return ""
    levels = {
        tuple(float(run.inputs[name][0]) for name in model.input_units if name != "t_s") for run in runs
    }
    if len(levels) > 1 or all(name == "t_s" for name in model.input_units):
        return ""
    names = ", ".join(name for name in model.input_units if name != "t_s")
    return f"the inputs never change, which cannot distinguish effects: vary {names}"
