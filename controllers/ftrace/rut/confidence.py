"""How sure an angle is, from signs that go with errors: a logistic regression on development drives.

Fitted on drives of `sim_backends/rear_scene` (seeds 0 to 2 and 10 to 12) and of another renderer; each half
tested on the other one.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from controllers.ftrace.rig_geometry import Floats

RutMethod = Literal["rut", "memory", "fused"]

FAINTEST_M, STRAIGHTEST_RAD = 0.001, 0.02
COEFFICIENTS: dict[RutMethod, tuple[float, float, float, float]] = {
    "rut": (-10.39, -2.11, -0.65, -0.81),
    "memory": (-15.06, -2.41, -0.96, -1.47),
    "fused": (-15.06, -2.41, -0.96, -1.47),
}
"""Constant, then one for each sign. `fused` made no errors to learn from: it has those of `memory`."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Signs:
    """What tells a wrong curve from a right one.

    Attributes:
        spread_m: How far curves that fit about as well lie from each other.
        residual_m: How far the places of single blocks lie from the curve.
        bend_rad: By how much the direction changes along the curve.
    """

    spread_m: float
    residual_m: float
    bend_rad: float

    @property
    def logarithms(self) -> Floats:
        """Logarithms of the signs, in the order above."""
        least = np.array([FAINTEST_M, FAINTEST_M, STRAIGHTEST_RAD])
        signs = np.array([self.spread_m, self.residual_m, self.bend_rad])
        return np.asarray(np.log(signs + least), np.float64)


def confidence(signs: Signs, method: RutMethod) -> float:
    """Return the probability, 0..1, that the angle is right within 5 deg."""
    constant, *slopes = COEFFICIENTS[method]
    return float(1 / (1 + np.exp(-constant - np.dot(slopes, signs.logarithms))))
