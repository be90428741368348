"""Forces of a wheel that slips longitudinally and laterally, and the slip required for a force.

Source: Reina, Ishigami, Nagatani and Yoshida, "Odometry correction using visual slip angle estimation for
planetary exploration rovers" (paper 000), eqs 3-11, table 3. Misprints in the paper: C_y reads "20 | 0"
and is 200 N; sigma_x and sigma_y of eqs 8 and 9 are s_x and tan(beta); eq 10 is not the limit of eq 8 (28.1 N
against 38.8 N for table 3), so eq 11 with it is no ellipse of this model.
"""

import math
from collections.abc import Callable
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from drivers.safety_event import Outcome, SafetyEvent
from drivers.settings import Settings

Array = NDArray[np.float64]

TOLERANCE = 1e-13
MOST_STEPS = 100


LARGEST_SIGMA = 1.5
LARGEST_DRIFT_RAD = math.pi / 3.0

EVENTS = (
    SafetyEvent(
        Outcome.CONTINUES,
        "The trace behind the wheel is lost.",
        "The slip is marked unsure, and its variance grows.",
        ("tests/controllers/test_scomp_compensator.py::test_a_trace_that_is_lost_is_missed_after_a_while",),
    ),
)
"""Rows of the reference page of safety."""


class _Curve(NamedTuple):
    """A pure-slip curve, eqs 5 and 6: limit mu W, stiffness C, decline A W, all in N."""

    limit_n: float
    stiffness_n: float
    decline_n: float

    def force_n(self, sigma: float) -> float:
        return self.limit_n * -math.expm1(-self.stiffness_n * sigma / self.limit_n) - self.decline_n * sigma

    @property
    def peak(self) -> float:
        """The total slip at which the curve is highest; infinity when it only rises."""
        if self.decline_n <= 0.0:
            return math.inf
        return self.limit_n / self.stiffness_n * max(0.0, math.log(self.stiffness_n / self.decline_n))


class CombinedSlip(Settings):
    """The model with its parameters; the defaults are those of table 3, lunar soil simulant.

    Attributes:
        mu: Largest coefficient of soil adhesion.
        c_x_n: Longitudinal stiffness, N. The slope of eq 5 at zero slip is c_x_n - load_n * a_x.
        c_y_n: Lateral stiffness, N.
        a_x: Slope of the longitudinal curve at high slip.
        a_y: Slope of the lateral curve at high slip.
        load_n: Vertical load of one wheel, N; default 6.6 kg at 9.81 m/s2 (rover of paper 000).
    """

    mu: Annotated[float, Field(ge=0.05, le=2.0)] = 0.6
    c_x_n: Annotated[float, Field(ge=1.0, le=1e4)] = 55.0
    c_y_n: Annotated[float, Field(ge=1.0, le=1e4)] = 200.0
    a_x: Annotated[float, Field(ge=-1.0, le=1.0)] = 0.02
    a_y: Annotated[float, Field(ge=-1.0, le=1.0)] = 0.04
    load_n: Annotated[float, Field(gt=0.0, le=1e4)] = 64.746

    def pure_x_n(self, total_slip: Array) -> Array:
        """Return the longitudinal force in N on a wheel without side slip (eq 5), slip from 0."""
        return self._curve(total_slip, self.c_x_n, self.a_x)

    def pure_y_n(self, total_slip: Array) -> Array:
        """Return the lateral force in N on a freely rolling wheel (eq 6), tan(slip angle) from 0."""
        return self._curve(total_slip, self.c_y_n, self.a_y)

    def forces_n(self, slip: Array, slip_angle_rad: Array) -> tuple[Array, Array]:
        """Return the longitudinal and the lateral force in N (eqs 7-9).

        Args:
            slip: Slip ratio, eq 3, in [-1, 1]; negative when the wheel skids.
            slip_angle_rad: Eq 4, in (-pi/2, pi/2). A positive angle gives a positive number here; the
                force on the wheel points against the sideways velocity.
        """
        tangent = np.tan(slip_angle_rad)
        sigma = np.hypot(slip, tangent)
        share = np.divide(1.0, sigma, out=np.zeros_like(sigma), where=sigma > 0.0)
        return slip * share * self.pure_x_n(sigma), tangent * share * self.pure_y_n(sigma)

    def greatest_x_n(self, slip_angle_rad: Array) -> Array:
        """Return F_x,max in N as printed in eq 10; the force at s_x = 1 by eq 8 is smaller."""
        return self.mu * self.load_n * np.cos(slip_angle_rad)

    def greatest_y_n(self, slip_angle_rad: Array) -> Array:
        """Return F_y,max in N of eq 11: the lateral force of a freely rolling wheel, odd in the angle."""
        return self.forces_n(np.zeros_like(slip_angle_rad), slip_angle_rad)[1]

    def slip_at(self, traction: float, slip_angle_rad: float, c_x_n: float | None = None) -> float:
        """Return the slip ratio in [-1, 1] at which a wheel delivers a traction (eqs 7 and 8, figure 12).

        Args:
            traction: R_x / W: the required force over the load.
            slip_angle_rad: In (-pi/2, pi/2).
            c_x_n: Longitudinal stiffness in N instead of the model's own.

        Returns:
            The smallest such slip, with the sign of the traction; where the ground cannot give the traction,
            the slip of the greatest one, at most 1.
        """
        tangent = abs(math.tan(slip_angle_rad))
        force_n = abs(traction) * self.load_n
        if force_n == 0.0:
            return 0.0
        curve = _Curve(self.mu * self.load_n, c_x_n or self.c_x_n, self.a_x * self.load_n)
        # With s_x = sigma F_x / F_x,0(sigma) eqs 7 and 8 are one equation in sigma.
        low, high = tangent, min(math.hypot(1.0, tangent), curve.peak)

        def reserve(sigma: float) -> float:
            return 1.0 / math.hypot(force_n / curve.force_n(sigma), tangent / sigma) - 1.0

        if high <= low or reserve(high) < 0.0:
            return math.copysign(math.sqrt(max(0.0, high**2 - tangent**2)), traction)
        sigma = _root(low, high, reserve)
        return math.copysign(min(1.0, sigma * force_n / curve.force_n(sigma)), traction)

    def drift_at(self, traction: float, side_pull: float) -> float:
        """Return the slip angle in rad at which the wheel delivers both forces at once.

        Eqs 7-9 solved for slip and slip angle together: (F_x / F_x,0)^2 + (F_y / F_y,0)^2 = 1.

        Args:
            traction: R_x / W.
            side_pull: Required lateral force over the load; its sign is that of the angle.

        Returns:
            The angle; where the ground cannot give both, that of the greatest force, at most 60 deg.
        """
        if side_pull == 0.0:
            return 0.0
        force_x_n, force_y_n = abs(traction) * self.load_n, abs(side_pull) * self.load_n
        limit_n = self.mu * self.load_n
        ahead = _Curve(limit_n, self.c_x_n, self.a_x * self.load_n)
        aside = _Curve(limit_n, self.c_y_n, self.a_y * self.load_n)

        def reserve(sigma: float) -> float:
            return 1.0 / math.hypot(force_x_n / ahead.force_n(sigma), force_y_n / aside.force_n(sigma)) - 1.0

        high = min(LARGEST_SIGMA, ahead.peak, aside.peak)
        sigma = _root(0.0, high, reserve) if reserve(high) > 0.0 else high
        tangent = sigma * force_y_n / aside.force_n(sigma)
        return math.copysign(min(math.atan(tangent), LARGEST_DRIFT_RAD), side_pull)

    def _curve(self, sigma: Array, stiffness_n: float, decline: float) -> Array:
        limit_n = self.mu * self.load_n
        curve: Array = limit_n * -np.expm1(-stiffness_n * sigma / limit_n) - decline * self.load_n * sigma
        return curve


def _root(low: float, high: float, reserve: Callable[[float], float]) -> float:
    """Return the root of `reserve`, by false position with the Illinois step.

    Args:
        low: The least total slip, at which the wheel cannot deliver the forces.
        high: A total slip at which it can.
        reserve: Share by which the wheel could deliver more; rises with the total slip.
    """
    below, above = reserve(low) if low > 0.0 else -1.0, reserve(high)
    kept_side = 0
    for _ in range(MOST_STEPS):
        middle = high - above * (high - low) / (above - below)
        at = reserve(middle)
        if abs(at) < TOLERANCE:
            return middle
        # An end that is kept for a second time counts half, or it would never move.
        if at > 0.0:
            high, above, below = middle, at, 0.5 * below if kept_side < 0 else below
            kept_side = -1
        else:
            low, below, above = middle, at, 0.5 * above if kept_side > 0 else above
            kept_side = 1
    return high
