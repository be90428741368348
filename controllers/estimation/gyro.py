"""Angle turned, by a gyro."""

from controllers.estimation.parameters import ESTIMATION
from drivers.clock import nanoseconds, seconds


class GyroIntegrator:
    """Integrates yaw rates by the trapezoid rule, except across long gaps.

    Args:
        greatest_gap_s: The turn between readings that are further apart is unknown.

    Attributes:
        rate_rad_s: Newest reading.
        t_ns: Its time; None before the first.
    """

    def __init__(self, greatest_gap_s: float) -> None:
        self._greatest_gap_ns = nanoseconds(greatest_gap_s)
        self.rate_rad_s = 0.0
        self.t_ns: int | None = None
        self._angle_rad = 0.0
        self._covered_s = 0.0

    def feed(self, t_ns: int, rate_rad_s: float) -> bool:
        """Take a reading; return False when it is not newer, not finite, or exceeds 100 rad/s."""
        is_old = self.t_ns is not None and t_ns <= self.t_ns
        if is_old or not abs(rate_rad_s) <= ESTIMATION.pose.greatest_rate_rad_s:
            return False
        if self.t_ns is not None and t_ns - self.t_ns <= self._greatest_gap_ns:
            elapsed_s = seconds(t_ns - self.t_ns)
            self._angle_rad += 0.5 * (self.rate_rad_s + rate_rad_s) * elapsed_s
            self._covered_s += elapsed_s
        self.rate_rad_s, self.t_ns = rate_rad_s, t_ns
        return True

    def is_fresh(self, now_ns: int) -> bool:
        """Return whether the newest reading is at most as old as the greatest gap."""
        return self.t_ns is not None and now_ns - self.t_ns <= self._greatest_gap_ns

    def take(self) -> tuple[float, float]:
        """Return the angle in rad turned since the last call, bias included, and the time in s it covers."""
        taken = (self._angle_rad, self._covered_s)
        self._angle_rad = self._covered_s = 0.0
        return taken
