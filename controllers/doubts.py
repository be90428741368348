"""Doubts that no single sample raises: a sensor that is always refused, a wheel that does not follow."""

from collections.abc import Sequence

from controllers.estimation.guarded_filter import Innovation
from drivers.clock import nanoseconds

REFUSALS_IN_A_ROW = 20
COMMANDED_SHARE = 0.1
FOLLOWED_SHARE = 0.1
FOLLOW_S = 1.0


class RefusalCounter:
    """Counts how often in a row the filter has refused each measurement.

    A filter that is sure of itself and wrong refuses every good reading: it would go on driving, blind.
    """

    def __init__(self) -> None:
        self._refusals: dict[str, int] = {}

    def note(self, innovations: Sequence[Innovation]) -> None:
        """Take the innovations of a cycle."""
        for innovation in innovations:
            count = 0 if innovation.accepted else self._refusals.get(innovation.name, 0) + 1
            self._refusals[innovation.name] = count

    @property
    def doubt(self) -> str:
        """What is in doubt, naming the measurement; empty while nothing is."""
        for name, count in self._refusals.items():
            if count >= REFUSALS_IN_A_ROW:
                return f"{name}: contradicts the estimate, refused {count} times in a row"
        return ""


class FollowMonitor:
    """Watches whether wheels turn when they are told to.

    A wheel is in doubt when its set-point has been above a tenth of the limit for a second and it has turned
    with less than a tenth of that: it is jammed, not powered, or its encoder stands.

    Args:
        wheel_count: Number of wheels.
        wheel_speed_limit_rad_s: Greatest set-point.
    """

    def __init__(self, wheel_count: int, wheel_speed_limit_rad_s: float) -> None:
        self._least_rad_s = COMMANDED_SHARE * wheel_speed_limit_rad_s
        self._since_ns: list[int | None] = [None] * wheel_count

    def find_doubt(
        self, now_ns: int, commanded_rad_s: Sequence[float], measured_rad_s: Sequence[float]
    ) -> str:
        """Return which wheel does not follow the set-points of the last cycle; empty while all do."""
        for wheel, (commanded, measured) in enumerate(zip(commanded_rad_s, measured_rad_s, strict=True)):
            if abs(commanded) < self._least_rad_s or abs(measured) > FOLLOWED_SHARE * abs(commanded):
                self._since_ns[wheel] = None
                continue
            since_ns = self._since_ns[wheel]
            if since_ns is None:
                self._since_ns[wheel] = now_ns
            elif now_ns - since_ns > nanoseconds(FOLLOW_S):
                return f"wheel {wheel}: told to turn with {commanded:.2f} rad/s and stands"
        return ""
