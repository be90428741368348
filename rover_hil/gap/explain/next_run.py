"""Proposal of the next run: conditions under which undistinguished explanations differ most."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rover_hil.gap.data.problem import predict_rows
from rover_hil.gap.explain.candidates import Candidate
from rover_hil.gap.explain.parameters import EXPLAIN
from rover_hil.gap.explain.prepare import Prepared
from rover_hil.gap.explain.search import Explanation
from sim_backends.models.interface import Array, Run


def propose(prepared: Prepared, first: Explanation, second: Explanation) -> str:
    """Return the conditions within the used ranges that distinguish two explanations, as a sentence."""
    model = prepared.problem.model
    runs = _possible_runs(prepared)
    one, other = (predict_rows(model, runs, explanation.fit.point) for explanation in (first, second))
    sizes = [sum(values.size for values in run.measured.values()) for run in runs]
    sd = _typical_sd(prepared)
    ends = np.cumsum(sizes)
    best, best_distance = 0, -1.0
    for index, (end, size) in enumerate(zip(ends, sizes, strict=True)):
        gap = (one - other)[end - size : end]
        labels = _labels(prepared, runs[index])
        distance = math.sqrt(float(np.nansum((gap / sd[labels]) ** 2)))
        if distance > best_distance:
            best, best_distance = index, distance
    names = f"{' + '.join(first.names)} from {' + '.join(second.names)}"
    where = _words(prepared, runs[best])
    needed = math.ceil((EXPLAIN.next_run.clear_sd / max(best_distance, 1e-9)) ** 2)
    if needed > EXPLAIN.next_run.most_repetitions:
        hints = "; ".join(_experiments(prepared, (*first.names, *second.names)))
        return f"no run within the ranges used distinguishes {names}: {hints}"
    times = "once" if needed == 1 else f"{needed} times"
    return f"{where}, {times}: distinguishes {names} by {best_distance:.1f} standard deviations each time"


def watch(candidates: Sequence[Candidate]) -> str:
    """Return the run that shows the least visible effect."""
    if not candidates:
        return ""
    hardest = max(candidates, key=lambda item: item.score.standard_error / item.card.parameters[0].prior_sd)
    return f"to measure {hardest.card.name} better: {hardest.card.experiment}"


def _possible_runs(prepared: Prepared) -> list[Run]:
    observations = prepared.problem.observations
    sites = [group.site for group in observations.groups]
    if not observations.is_steady:
        return sites
    full = max(sites, key=lambda site: len(site.measured))
    levels = []
    for name in prepared.problem.model.condition_units:
        values = np.unique([site.conditions[name] for site in sites])
        levels.append(
            values
            if values.size <= EXPLAIN.next_run.most_levels
            else np.linspace(values[0], values[-1], EXPLAIN.next_run.most_levels)
        )
    return [
        replace(
            full,
            conditions={
                **full.conditions,
                **dict(zip(prepared.problem.model.condition_units, one, strict=True)),
            },
        )
        for one in itertools.product(*levels)
    ]


def _typical_sd(prepared: Prepared) -> Array:
    if prepared.scatter is not None:
        sd: Array = np.sqrt(prepared.scatter.covariance.diagonal(axis1=1, axis2=2).mean(axis=0))
        return sd
    observations = prepared.problem.observations
    return np.array(
        [
            float(prepared.noise.row_sd[observations.channel == index].mean())
            for index in range(len(observations.channels))
        ]
    )


def _labels(prepared: Prepared, run: Run) -> list[int]:
    steady = prepared.problem.observations.is_steady
    return [
        index
        for index, channel in enumerate(prepared.problem.model.channels)
        if channel.name in run.measured
        for _ in range(1 if steady else run.measured[channel.name].size)
    ]


def _words(prepared: Prepared, run: Run) -> str:
    units = prepared.problem.model.condition_units
    if not prepared.problem.observations.is_steady:
        return f"repeat run {run.name}"
    return ", ".join(f"{name} {run.conditions[name]:.4g}" for name in units)


def _experiments(prepared: Prepared, names: Sequence[str]) -> list[str]:
    cards = {card.name: card for card in prepared.problem.model.effects}
    return list(dict.fromkeys(f"{name}: {cards[name].experiment}" for name in names if name in cards))
