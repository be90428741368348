"""A machine with its experiment, and how much a change of its outputs amounts to."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tests.nature.machines.case import Array
from tests.nature.machines.family import Family, Plan
from tests.nature.machines.integrator import TOLERANCE

Records = Sequence[Mapping[str, Array]]

PROBE = 0.02
"""Step of the sensitivities, as a share of the spread."""
PROBE_TOLERANCE = 1e-8


@dataclass(frozen=True)
class Machine:
    """A machine and its experiment before anything is hidden in it.

    Attributes:
        family: Of the machine.
        parameters: True parameters of the base law, before the scatter.
        plans: What is done in each run.
        run_parameters: True parameters of each run.
        starts: True start of each run.
        disturbances: Smooth random series of each run, of unit size over all runs.
    """

    family: Family
    parameters: Mapping[str, float]
    plans: tuple[Plan, ...]
    run_parameters: tuple[Mapping[str, float], ...]
    starts: tuple[Mapping[str, float], ...]
    disturbances: tuple[Array, ...]

    def record(
        self, hidden: Mapping[str, float], force: float = 0.0, tolerance: float = TOLERANCE
    ) -> list[dict[str, Array]]:
        """Return each run without noise, with constants of hidden effects and a size of the disturbance."""
        nothing = self.family.nothing_hidden()
        return [
            self.family.run(
                plan, nothing | dict(parameters) | dict(hidden), start, force * disturbance, tolerance
            )
            for plan, parameters, start, disturbance in zip(
                self.plans, self.run_parameters, self.starts, self.disturbances, strict=True
            )
        ]

    def snr(self, plain: Records, other: Records) -> float:
        """Return the rms change of the output divided by sigma, in the channel where it is largest."""
        return _largest_rms(self._changes(plain, other))

    def sensitivities(self, plain: Records) -> Array:
        """Return the change of the outputs in units of sigma per spread of each unknown, one column each.

        The unknowns are the uncertain parameters, common to all runs, and the uncertain states at each start.
        """
        return np.column_stack([*self._parameter_columns(plain), *self._start_columns(plain)])

    def snr_after_refit(self, plain: Records, other: Records, sensitivities: Array) -> float:
        """Return `snr` of what the base law, fitted to the change within its spread, leaves of it."""
        changes = self._changes(plain, other)
        unknowns = sensitivities.shape[1]
        # The spread is one more measurement of each unknown.
        rows = np.vstack((sensitivities, np.eye(unknowns)))
        fitted = np.linalg.lstsq(rows, np.concatenate((changes.ravel(), np.zeros(unknowns))), rcond=None)[0]
        return _largest_rms(changes - (sensitivities @ fitted).reshape(changes.shape))

    def _changes(self, plain: Records, other: Records) -> Array:
        """Return changes in units of sigma: channels by runs by samples."""
        return np.array(
            [
                [
                    (after[channel.name] - before[channel.name]) / channel.sigma
                    for before, after in zip(plain, other, strict=True)
                ]
                for channel in self.family.channels
            ]
        )

    def _parameter_columns(self, plain: Records) -> list[Array]:
        """Return the change of the outputs per spread of each uncertain parameter."""
        columns = []
        for one in self.family.parameters:
            if one.spread > 0.0:
                step = PROBE * one.spread * one.nominal
                moved = tuple({**run, one.name: run[one.name] + step} for run in self.run_parameters)
                probed = replace(self, run_parameters=moved).record({}, tolerance=PROBE_TOLERANCE)
                columns.append(self._changes(plain, probed).ravel() / PROBE)
        return columns

    def _start_columns(self, plain: Records) -> list[Array]:
        """Return the change of the outputs per spread of each uncertain state at the start of each run."""
        columns = []
        for state in self.family.states:
            if state.spread > 0.0:
                step = PROBE * state.spread
                moved = tuple({**start, state.name: start[state.name] + step} for start in self.starts)
                probed = replace(self, starts=moved).record({}, tolerance=PROBE_TOLERANCE)
                changes = self._changes(plain, probed) / PROBE
                for index in range(len(self.plans)):
                    alone = np.zeros_like(changes)
                    alone[:, index] = changes[:, index]
                    columns.append(alone.ravel())
        return columns


def _largest_rms(changes: Array) -> float:
    return float(np.sqrt(np.mean(changes**2, axis=(1, 2))).max())
