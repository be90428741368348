"""Unstable records in pieces, each with a start of its own (multiple shooting without continuity).

Where errors grow exponentially, a simulation of the whole record says nothing of the machine: the last digit
of the start decides its end. The growth is that of the model itself, linearised along short pieces that begin
at measured values: a simulation of the whole record would leave the measured motion.
"""

from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace

import numpy as np

from rover_hil.gap.data.cut import begins_anywhere, parts_of
from rover_hil.gap.data.parameters import DATA
from sim_backends.models.interface import Array, Machine, Run, RunParameter
from sim_backends.state_model.model import StateModel
from sim_backends.state_model.sample_times import mean_step_s


def stable_pieces(machine: Machine, runs: Sequence[Run]) -> tuple[list[Run], list[str]]:
    """Return runs in which an error at the start does not grow exponentially, and what was found.

    Runs of a machine whose start is not fitted stay whole. The growth is that of the nominal parameters,
    around the start that the machine has.
    """
    if not isinstance(machine, StateModel) or not machine.states:
        return list(runs), []
    is_cut = bool(machine.run_parameters) and begins_anywhere(machine)
    found: list[Run] = []
    names: list[str] = []
    for run in runs:
        pieces = _pieces(machine, run)
        found += pieces if is_cut else [run]
        names += [run.name] if len(pieces) > 1 else []
    if not names:
        return found, []
    so = (
        "they are compared in pieces, each with a start of its own"
        if is_cut
        else "their ends say little of the machine; let start() take every state from a RunParameter, and "
        "they are compared in pieces"
    )
    return found, [f"in runs {', '.join(names)} an error at the start grows exponentially: {so}"]


def _pieces(machine: StateModel, run: Run) -> list[Run]:
    """Return the pieces of a run, as long as an error does not grow exponentially in them."""
    short_s = DATA.runs.least_samples * mean_step_s(run, machine.step_s)
    sizes = error_sizes(machine, parts_of(machine, run, short_s))
    count = 1
    while 2 * count <= sizes.size:
        if not sizes[: 2 * count].max() <= DATA.runs.most_growth * sizes[:count].max():
            return parts_of(machine, run, count * short_s)
        count *= 2
    return [run]


def error_sizes(machine: StateModel, pieces: Sequence[Run]) -> Array:
    """Return the size of an error at the start of the first piece at the end of each, by linearisation.

    Size is that of all states, each over its variation in the pieces, of the error that grows most.
    """
    errors = [
        RunParameter(name=f"error of {name}", unit=unit, prior_sd=1.0)
        for name, unit in machine.states.items()
    ]

    def start(p: SimpleNamespace, u: SimpleNamespace) -> dict[str, Array | float]:
        begin = machine.start(p, u)
        return {
            name: begin[name] + getattr(p, item.name)
            for name, item in zip(machine.states, errors, strict=True)
        }

    moving = replace(machine, start=start, run_parameters=(*machine.run_parameters, *errors))
    base = moving.trajectories(pieces, {}, {})
    scale = [np.std(np.concatenate([one[name] for one in base])) or 1.0 for name in machine.states]
    steps = DATA.fit.step_share * np.array(scale)
    moved = [
        moving.trajectories(pieces, {item.key_in(one).text: float(step) for one in pieces}, {})
        for item, step in zip(errors, steps, strict=True)
    ]
    error, sizes = np.eye(steps.size), []
    for index, before in enumerate(base):
        change = np.array(
            [[one[index][name][-1] - before[name][-1] for one in moved] for name in machine.states]
        )
        if not np.isfinite(change).all():
            sizes.append(np.inf)
            break
        error = change / steps[:, None] @ error
        sizes.append(float(np.linalg.norm(error, 2)))
    return np.array(sizes)
