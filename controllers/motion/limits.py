"""Limits of the wheel setpoints, applied to every command of the controller."""

import math
from collections.abc import Sequence
from enum import StrEnum

from controllers.motion.settings import LimitSettings
from drivers.clock import nanoseconds, seconds
from drivers.safety_event import Outcome, SafetyEvent

EVENTS = (
    SafetyEvent(
        Outcome.CONTINUES,
        "A setpoint is not finite.",
        "Zero setpoints in the same cycle.",
        ("tests/controllers/test_limits.py::test_a_target_that_is_not_finite_stops_all_wheels",),
    ),
    SafetyEvent(
        Outcome.CONTINUES,
        "Setpoints are too fast, or jump.",
        "All wheels are scaled by one factor.",
        ("tests/controllers/test_limits.py::test_no_set_point_ever_exceeds_the_limits",),
        settings=("limits.wheel_speed_rad_s", "limits.wheel_acceleration_rad_s2"),
    ),
)
"""Rows of the reference page of safety."""


class Limit(StrEnum):
    """Which limit a command met; the later one where several did."""

    NONE = "none"
    SPEED = "speed"
    ACCELERATION = "acceleration"
    NOT_FINITE = "not_finite"


class WheelLimiter:
    """Limits wheel setpoints in speed and acceleration, all wheels by one factor to keep the direction.

    Args:
        settings: The limits.
        expiry_s: Setpoints older than this have expired: the wheels have been let go.
    """

    def __init__(self, settings: LimitSettings, expiry_s: float) -> None:
        self._settings = settings
        self._expiry_ns = nanoseconds(expiry_s)
        self._last: tuple[int, tuple[float, ...]] | None = None

    def limit(
        self, now_ns: int, target_rad_s: Sequence[float], measured_rad_s: Sequence[float]
    ) -> tuple[tuple[float, ...], Limit]:
        """Return the setpoints in rad/s to send at `now_ns`, and which limit acted.

        The ramp goes on from the last setpoints; after `stop` or a pause it starts from
        `measured_rad_s`, so that motion resumes without a jump. A target that is not finite gives zeros.
        """
        if not all(map(math.isfinite, target_rad_s)):
            self.stop()
            return (0.0,) * len(target_rad_s), Limit.NOT_FINITE
        if self._last is None or now_ns - self._last[0] > self._expiry_ns:
            self._last = now_ns, self._scale(measured_rad_s)
        last_ns, last = self._last
        wanted = self._scale(target_rad_s)
        limit = Limit.NONE if wanted == tuple(target_rad_s) else Limit.SPEED
        pairs = list(zip(wanted, last, strict=True))
        greatest = max(abs(new - old) for new, old in pairs)
        allowed = self._settings.wheel_acceleration_rad_s2 * seconds(max(0, now_ns - last_ns))
        if greatest > allowed:
            share = allowed / greatest
            wanted = tuple(old + share * (new - old) for new, old in pairs)
            limit = Limit.ACCELERATION
        self._last = now_ns, wanted
        return wanted, limit

    def stop(self) -> None:
        """Forget the last setpoints: the wheels are commanded to rest."""
        self._last = None

    def _scale(self, speed_rad_s: Sequence[float]) -> tuple[float, ...]:
        greatest, limit = max(map(abs, speed_rad_s)), self._settings.wheel_speed_rad_s
        if greatest <= limit:
            return tuple(speed_rad_s)
        # Divided first: the quotient is at most 1, so no rounding lifts the product over the limit.
        return tuple(speed / greatest * limit for speed in speed_rad_s)
