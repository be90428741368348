"""Angle turned, by a gyro."""

import math

from controllers.estimation.parameters import ESTIMATION
from drivers.clock import nanoseconds, seconds


class GyroIntegrator:
    """Integrates yaw rates by the trapezoid rule, except across long gaps.

    Args:
        greatest_gap_s: The turn between readings that are further apart is unknown.
        greatest_rate_rad_s: The rover cannot turn faster; greater readings are rejected.

    Attributes:
        rate_rad_s: Newest reading.
        t_ns: Its time; None before the first.
        greatest_rate_rad_s: As given, at most 100 rad/s.
        rejected_rad_s: Newest reading if it was rejected as too great; else None.
        covered_s: Time since the last `take` over which the angle is known.
        has_gap: Whether the angle was unknown for some time since the last `clear_gap`.
    """

    def __init__(self, greatest_gap_s: float, greatest_rate_rad_s: float = math.inf) -> None:
        self._greatest_gap_ns = nanoseconds(greatest_gap_s)
        self.greatest_rate_rad_s = min(greatest_rate_rad_s, ESTIMATION.pose.greatest_rate_rad_s)
        self.rejected_rad_s: float | None = None
        self.has_gap = False
        self.rate_rad_s = 0.0
        self.t_ns: int | None = None
        self._angle_rad = 0.0
        self.covered_s = 0.0

    def feed(self, t_ns: int, rate_rad_s: float) -> bool:
        """Take a reading; return False when it is not newer, not finite, or too great."""
        if math.isnan(rate_rad_s) or (self.t_ns is not None and t_ns <= self.t_ns):
            return False
        if abs(rate_rad_s) > self.greatest_rate_rad_s:
            self.rejected_rad_s = rate_rad_s
            return False
        self.rejected_rad_s = None
        if self.t_ns is not None and t_ns - self.t_ns <= self._greatest_gap_ns:
            elapsed_s = seconds(t_ns - self.t_ns)
            self._angle_rad += 0.5 * (self.rate_rad_s + rate_rad_s) * elapsed_s
            self.covered_s += elapsed_s
        elif self.t_ns is not None:
            self.has_gap = True
        self.rate_rad_s, self.t_ns = rate_rad_s, t_ns
        return True

    def is_fresh(self, now_ns: int) -> bool:
        """Return whether the newest reading is at most as old as the greatest gap."""
        return self.t_ns is not None and now_ns - self.t_ns <= self._greatest_gap_ns

    def take(self) -> tuple[float, float]:
        """Return the angle in rad turned since the last call, bias included, and the time in s it covers."""
        taken = (self._angle_rad, self.covered_s)
        self._angle_rad = self.covered_s = 0.0
        return taken

    def clear_gap(self) -> None:
        """Forget that the angle was unknown for some time."""
        self.has_gap = False
