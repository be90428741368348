"""What an explanation leaves unexplained, carried over to runs that were not made.

The model error of a machine is a random force at its ports, of the size that the measured runs show with the
explanation in the equations. A machine without ports has it in its channels.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rover_hil.gap.data.problem import Observations, Point, Problem, cells
from rover_hil.gap.fit.descent import residual_of
from rover_hil.gap.noise.random_force import ForceBasis, random_force_noise
from rover_hil.gap.parameters import MACHINES
from rover_hil.gap.search.tracking import basis_of
from sim_backends.models.interface import Array
from sim_backends.state_model.model import has_ports


@dataclass(frozen=True, slots=True, kw_only=True)
class Discrepancy:
    """Model error that an explanation leaves.

    Attributes:
        sizes: Size and correlation of the force at each port, as in `RandomForceNoise`; empty without ports.
        channels: By channel: size of the error in its unit, and its correlation in samples; without ports.
        excess: Factor on the declared noise of the sensors.
    """

    sizes: tuple[tuple[float, float], ...]
    channels: tuple[tuple[float, float], ...]
    excess: float

    @property
    def is_negligible(self) -> bool:
        """True where nothing is left but noise."""
        return all(size <= MACHINES.decision.negligible for size, _ in self.sizes) and not any(
            size for size, _ in self.channels
        )


def learn_discrepancy(problem: Problem, point: Point, basis: ForceBasis | None) -> Discrepancy:
    """Return the model error that an explanation leaves in the measured runs."""
    residual = residual_of(problem.observations, problem.predict(point))
    if basis is None or not basis.ports:
        return Discrepancy(sizes=(), channels=_channel_errors(problem.observations, residual), excess=1.0)
    found = random_force_noise(problem.observations, residual, basis)
    return Discrepancy(sizes=found.sizes, channels=(), excess=found.excess)


def measured_basis(problem: Problem, point: Point) -> ForceBasis | None:
    """Return the responses of the measured runs to forces at the ports; None without ports."""
    machine = problem.model
    if not has_ports(machine):
        return None
    return basis_of(problem, machine, point)


def _channel_errors(observations: Observations, residual: Array) -> tuple[tuple[float, float], ...]:
    found = []
    for index, channel in enumerate(observations.channels):
        series = [residual[rows] for rows in cells(observations) if observations.channel[rows[0]] == index]
        series = [one[np.isfinite(one)] for one in series]
        series = [one for one in series if one.size]
        values = np.concatenate(series) if series else np.zeros(1)
        square = float(np.mean(values**2))
        is_noise = square <= (MACHINES.decision.noise_room * channel.noise_sd) ** 2
        size = 0.0 if is_noise else math.sqrt(square - channel.noise_sd**2)
        found.append((size, _correlation(series) if size else 1.0))
    return tuple(found)


def _correlation(series: Sequence[Array]) -> float:
    """Return the number of samples after which an error has lost two thirds of its correlation."""
    longest = max(one.size for one in series)
    for lag in range(1, longest // 2):
        pairs = [(one[:-lag], one[lag:]) for one in series if one.size > lag]
        product = sum(float(a @ b) for a, b in pairs)
        square = sum(float(a @ a) for a, _ in pairs)
        if product < square / math.e:
            return float(lag)
    return float(longest // 2)
