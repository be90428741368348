"""Angle turned, by a gyro."""

import math
from typing import NamedTuple

from controllers.estimation.parameters import ESTIMATION
from drivers.clock import nanoseconds, seconds


class GyroTurn(NamedTuple):
    """Turn by the readings of the gyro, its bias included.

    Attributes:
        covered_s: Time over which the angle is known.
        variance_rad2: Of what the rover may have turned beside the straight lines between the readings.
    """

    angle_rad: float = 0.0
    covered_s: float = 0.0
    variance_rad2: float = 0.0


class GyroIntegrator:
    """Integrates yaw rates by the trapezoid rule, except across long gaps.

    The error of the rule over a time T is T^3 / 12 times the second derivative of the rate. Its mean square
    is taken from the readings themselves, with a fading memory: readings that are lost leave more uncertainty
    while the rate oscillates, and none while it is constant.

    Args:
        greatest_gap_s: The turn between readings that are further apart is unknown.
        greatest_rate_rad_s: The rover cannot turn faster; greater readings are rejected.

    Attributes:
        rate_rad_s: Newest reading.
        t_ns: Its time; None before the first.
        greatest_rate_rad_s: As given, at most 100 rad/s.
        rejected_rad_s: Newest reading if it was rejected as too great; else None.
        turn: Turn since the last `take`.
        has_gap: Whether the angle was unknown for some time since the last `clear_gap`.
    """

    def __init__(self, greatest_gap_s: float, greatest_rate_rad_s: float = math.inf) -> None:
        self._greatest_gap_ns = nanoseconds(greatest_gap_s)
        self.greatest_rate_rad_s = min(greatest_rate_rad_s, ESTIMATION.pose.greatest_rate_rad_s)
        self.rejected_rad_s: float | None = None
        self.has_gap = False
        self.rate_rad_s = 0.0
        self.t_ns: int | None = None
        self.turn = GyroTurn()
        self._slope: tuple[float, float] | None = None
        self._curvature2 = 0.0

    def feed(self, t_ns: int, rate_rad_s: float) -> bool:
        """Take a reading; return False when it is not newer, not finite, or too great."""
        if math.isnan(rate_rad_s) or (self.t_ns is not None and t_ns <= self.t_ns):
            return False
        if abs(rate_rad_s) > self.greatest_rate_rad_s:
            self.rejected_rad_s = rate_rad_s
            return False
        self.rejected_rad_s = None
        if self.t_ns is not None and t_ns - self.t_ns <= self._greatest_gap_ns:
            self._add(rate_rad_s, seconds(t_ns - self.t_ns))
        elif self.t_ns is not None:
            self.has_gap = True
            self._slope = None
        self.rate_rad_s, self.t_ns = rate_rad_s, t_ns
        return True

    def is_fresh(self, now_ns: int) -> bool:
        """Return whether the newest reading is at most as old as the greatest gap."""
        return self.t_ns is not None and now_ns - self.t_ns <= self._greatest_gap_ns

    def _add(self, rate_rad_s: float, elapsed_s: float) -> None:
        angle_rad, covered_s, variance_rad2 = self.turn
        # Readings that arrive in one burst would divide noise by almost nothing.
        spacing_s = max(elapsed_s, ESTIMATION.pose.least_spacing_s)
        slope = (rate_rad_s - self.rate_rad_s) / spacing_s
        if self._slope is not None:
            before, before_s = self._slope
            curvature = 2.0 * (slope - before) / (spacing_s + before_s)
            kept = math.exp(-elapsed_s / ESTIMATION.pose.curvature_memory_s)
            self._curvature2 = kept * self._curvature2 + (1.0 - kept) * curvature**2
        self._slope = (slope, spacing_s)
        self.turn = GyroTurn(
            angle_rad + 0.5 * (self.rate_rad_s + rate_rad_s) * elapsed_s,
            covered_s + elapsed_s,
            variance_rad2 + (elapsed_s**3 / 12.0) ** 2 * self._curvature2,
        )

    def take(self) -> GyroTurn:
        """Return the turn since the last call."""
        taken, self.turn = self.turn, GyroTurn()
        return taken

    def clear_gap(self) -> None:
        """Forget that the angle was unknown for some time."""
        self.has_gap = False
