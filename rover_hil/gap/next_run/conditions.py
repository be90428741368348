"""The next run of a model that can only be called: the experiment in which two explanations differ most.

Of steady experiments the conditions are chosen; of series a measured run is repeated.
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rover_hil.gap.data.problem import predict_points
from rover_hil.gap.decision.analysis import MachineFindings
from rover_hil.gap.evidence.evidence import MachineFit
from rover_hil.gap.parameters import MACHINES
from rover_hil.gap.search.search import best_shapes
from rover_hil.gap.verdict import Answer
from sim_backends.models.interface import Run


def propose_conditions(findings: MachineFindings, answer: Answer) -> str:
    """Return the experiment that distinguishes the explanations that are left, as a sentence.

    Args:
        findings: Of the model.
        answer: The verdict on them; a name that is decided has no rival.
    """
    decision = findings.decision
    ranked = [] if decision is None or answer is Answer.NAMED else decision.ranked()
    others = [one.fit for _, one in ranked if one.names != findings.best.names]
    if findings.best.names and others:
        return _between(findings, findings.best, others[0])
    scores = best_shapes(findings.scores)
    if not scores:
        return ""
    hardest = max(scores, key=lambda one: one.standard_error / one.direction.size).direction.name
    experiments = {card.name: card.experiment for card in findings.machine.effects}
    return f"to measure {hardest} better: {experiments[hardest]}"


def _between(findings: MachineFindings, first: MachineFit, second: MachineFit) -> str:
    """Return the conditions within the used ranges that distinguish two explanations."""
    machine, runs = findings.machine, _possible_runs(findings)
    distances = []
    for run in runs:
        one, other = (predict_points(machine, [run], [fit.fit.point])[0] for fit in (first, second))
        seen = [channel for channel in machine.channels if channel.name in run.measured]
        sd = np.repeat([at.noise_sd for at in seen], [run.measured[at.name].size for at in seen])
        distances.append(math.sqrt(float(np.nansum(((one - other) / sd) ** 2))))
    best = int(np.argmax(distances))
    names = f"{' + '.join(first.names)} from {' + '.join(second.names)}"
    needed = math.ceil((MACHINES.conditions.clear_sd / max(float(distances[best]), 1e-9)) ** 2)
    if needed > MACHINES.conditions.most_repetitions:
        experiments = {card.name: card.experiment for card in machine.effects}
        hints = [f"{name}: {experiments[name]}" for name in dict.fromkeys((*first.names, *second.names))]
        return f"no run within the ranges used distinguishes {names}: {'; '.join(hints)}"
    where = f"repeat run {runs[best].name}"
    if findings.problem.observations.is_steady:
        where = ", ".join(f"{name} {runs[best].conditions[name]:.4g}" for name in machine.condition_units)
    times = "once" if needed == 1 else f"{needed} times"
    return f"{where}, {times}: distinguishes {names} by {distances[best]:.1f} standard deviations each time"


def _possible_runs(findings: MachineFindings) -> list[Run]:
    sites = findings.problem.sites
    if not findings.problem.observations.is_steady:
        return sites
    full = max(sites, key=lambda site: len(site.measured))
    names = list(findings.machine.condition_units)
    levels = [_levels([site.conditions[name] for site in sites]) for name in names]
    return [
        replace(
            full, name=f"next {number}", conditions={**full.conditions, **dict(zip(names, one, strict=True))}
        )
        for number, one in enumerate(itertools.product(*levels))
    ]


def _levels(values: Sequence[float]) -> list[float]:
    found = np.unique(values)
    most = MACHINES.conditions.most_levels
    chosen = found if found.size <= most else np.linspace(found[0], found[-1], most)
    return [float(one) for one in chosen]
