"""Unstable records in pieces, each with a start of its own (multiple shooting without continuity).

Where errors grow exponentially, a simulation of the whole record says nothing of the machine: the last digit
of the start decides its end. The growth is that of the model itself, linearised along short pieces that begin
at measured values: a simulation of the whole record would leave the measured motion.
"""

from collections.abc import Sequence

import numpy as np

from drivers.errors import ConfigError
from rover_hil.gap.data.cut import cut_runs
from rover_hil.gap.data.parameters import DATA
from sim_backends.models.interface import Array, Machine, Run
from sim_backends.state_model.model import StateModel
from sim_backends.state_model.sample_times import mean_step_s


def stable_pieces(machine: Machine, runs: Sequence[Run]) -> tuple[list[Run], list[str]]:
    """Return runs in which an error at the start does not grow exponentially, and what was cut.

    Machines that cannot begin in the middle of a record, or whose start is not fitted, keep their runs,
    unexamined.

    Args:
        machine: Its growth is that of the nominal parameters.
        runs: Measured.
    """
    found: list[Run] = []
    told: list[str] = []
    for run in runs:
        try:
            pieces = _pieces(machine, run) if isinstance(machine, StateModel) else [run]
        except ConfigError:
            pieces = [run]
        found += pieces
        if len(pieces) > 1:
            told.append(
                f"run {run.name} is unstable, an error at its start grows exponentially: it is compared in "
                f"{len(pieces)} pieces, each with a start of its own"
            )
    return found, told


def _pieces(machine: StateModel, run: Run) -> list[Run]:
    """Return the pieces of a run, as long as an error does not grow exponentially in them.

    An error at a start that is not fitted is none.

    Raises:
        ConfigError: The machine cannot begin in the middle of a record.
    """
    if not machine.run_parameters:
        return [run]
    short_s = DATA.runs.least_samples * mean_step_s(run, machine.step_s)
    sizes = error_sizes(machine, cut_runs(machine, [run], short_s))
    count = 1
    while 2 * count <= sizes.size:
        if not sizes[: 2 * count].max() <= DATA.runs.most_growth * sizes[:count].max():
            return cut_runs(machine, [run], count * short_s)
        count *= 2
    return [run]


def error_sizes(machine: StateModel, pieces: Sequence[Run]) -> Array:
    """Return the size of an error at the start of the first piece at the end of each, by linearisation.

    Size is that of all states, each over its variation in the pieces, of the error that grows most.
    """
    base = machine.trajectories(pieces, {}, {})
    moved = []
    for item in machine.run_parameters:
        step = DATA.fit.step_share * item.prior_sd
        point = {item.key_in(one).text: item.nominal_in(one) + step for one in pieces}
        moved.append(machine.trajectories(pieces, point, {}))
    scale = np.array([np.std(np.concatenate([one[name] for one in base])) or 1.0 for name in machine.states])
    error, sizes = np.eye(scale.size), []
    for index, before in enumerate(base):
        changes = np.array(
            [[one[index][name][[0, -1]] - before[name][[0, -1]] for one in moved] for name in machine.states]
        )
        changes = changes / scale[:, None, None]
        if not np.isfinite(changes).all():
            sizes.append(np.inf)
            break
        error = changes[:, :, 1] @ np.linalg.pinv(changes[:, :, 0]) @ error
        sizes.append(float(np.linalg.norm(error, 2)))
    return np.array(sizes)
