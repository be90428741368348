"""Parameters fitted under their priors, with derivatives."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rover_hil.gap.data.derivatives import Derivatives, in_full
from rover_hil.gap.data.problem import DerivativeRequest, Free, Point, Problem
from rover_hil.gap.noise.sensor_noise import SensorNoise
from sim_backends.models.interface import Array
from sim_backends.models.parameter_key import ParameterKey

RIDGE = 1e-12
"""Added to the normal matrix, over its largest diagonal, where rounding would make it singular."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Fit:
    """Parameters fitted to observations.

    Attributes:
        free: Fitted parameters, in the order of the columns of `jacobian`.
        point: Fitted values.
        residual: Whitened: measured minus predicted.
        jacobian: Whitened: change of the prediction per prior deviation of each parameter.
        pull: Distance of each parameter from its prior mean, in prior deviations.
        cost: Sum of squares of `residual` and `pull`: minus two log-posterior.
    """

    free: tuple[Free, ...]
    point: Point
    residual: Array
    jacobian: Derivatives
    pull: Array
    cost: float

    @property
    def covariance(self) -> Array:
        """Of the pulls, by linearisation at the fit."""
        normal = self.jacobian.gram() + np.eye(len(self.free))
        return np.linalg.inv(normal).astype(np.float64)

    def shape_information(self, shapes: Sequence[ParameterKey]) -> float:
        """Return the gain of free shape parameters in minus two log-likelihood (Laplace)."""
        normal = self.jacobian.gram() + np.eye(len(self.free))
        others = [index for index, item in enumerate(self.free) if item.key not in shapes]
        return float(np.linalg.slogdet(normal)[1] - np.linalg.slogdet(normal[np.ix_(others, others)])[1])


def whitened_jacobian(
    problem: Problem, noise: SensorNoise, free: Sequence[Free], point: Point
) -> Derivatives:
    """Return the change of the whitened prediction per prior deviation of each parameter."""
    if not free:
        return in_full(np.zeros((noise.site.size, 0)))
    request = DerivativeRequest(problem, point, free)
    problem.prepare_points(request.points)
    found = request.matrix([problem.predict(one) for one in request.points])
    return found.scaled(np.array([item.sd for item in free])).mapped(noise.whiten, noise.site)
