"""How sure an angle is, from signs that go with errors: a logistic regression on development drives.

Fitted on drives of `sim_backends/rear_scene` (seeds 0 to 2 and 10 to 12) and of another renderer; each half
tested on the other one.
"""

from dataclasses import dataclass

import numpy as np

from controllers.ftrace.rig_geometry import Floats

FAINTEST_M, STRAIGHTEST_RAD = 0.001, 0.02
COEFFICIENTS = (-15.06, -2.41, -0.96, -1.47)
"""Constant, then one for each sign."""


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


def confidence(signs: Signs) -> float:
    """Return the probability, 0..1, that the angle is right within 5 deg."""
    constant, *slopes = COEFFICIENTS
    return float(1 / (1 + np.exp(-constant - np.dot(slopes, signs.logarithms))))
