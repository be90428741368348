"""Compares the speed that a drive reports with the change of the position that it reports."""

from drivers.clock import NANOSECONDS_PER_SECOND
from drivers.driver import Rejection
from drivers.position_counter import LONGEST_BUNCHING_NS

SPEED_CONTRADICTS_POSITION = Rejection("speed_contradicts_position")

_WINDOW_NS = 2 * LONGEST_BUNCHING_NS
_LEAST_POSITIONS = 3
_ALLOWANCE_RAD = 0.1
"""What the position may be off by whatever its resolution; 0.5 rad/s over the window."""


class SpeedCheck:
    """Decides whether the reported speeds of a wheel can have caused the change of its position.

    The mean speed over a time lies between the least and the greatest speed in it. The time itself is known
    but for the bunching of messages: speeds that are 1.5 times too small or twice too large contradict, over
    windows of 0.2 s or, of slow messages, three positions. After a pause nothing is compared for 0.1 s.

    Args:
        resolution_rad: Step of the position at the wheel; 0 where it is negligible.
        resolution_rad_s: Step of the speed.
    """

    def __init__(self, resolution_rad: float, resolution_rad_s: float) -> None:
        self._margin_rad = _ALLOWANCE_RAD + 2 * abs(resolution_rad)
        self._margin_rad_s = abs(resolution_rad_s)
        self.reset()

    def reset(self) -> None:
        """Begin anew, after a break or a jump of the position."""
        self._begin: tuple[int, float] | None = None
        self._count = 0
        self._newest_ns: int | None = None
        self._interval_ns = 0
        self._quiet_until_ns = 0
        self._least = self._greatest = 0.0
        self._last_speed: float | None = None

    def note_speed(self, speed_rad_s: float) -> None:
        """Take a reported speed."""
        self._last_speed = speed_rad_s
        if speed_rad_s < self._least:
            self._least = speed_rad_s
        elif speed_rad_s > self._greatest:
            self._greatest = speed_rad_s

    def contradicts(self, t_ns: int, position_rad: float) -> bool:
        """Take a position; return whether it contradicts the speeds, which is judged once in a window."""
        if self._is_after_pause(t_ns):
            # What waited comes in one bunch: its times mean nothing.
            self._begin, self._quiet_until_ns = None, t_ns + LONGEST_BUNCHING_NS
        is_wrong = False
        if self._begin is not None:
            self._count += 1
            elapsed_ns = t_ns - self._begin[0]
            if elapsed_ns < _WINDOW_NS or self._count < _LEAST_POSITIONS:
                return False
            is_wrong = not self._can_cause(elapsed_ns, position_rad - self._begin[1])
            self._begin = None
        if self._last_speed is not None and t_ns >= self._quiet_until_ns:
            self._begin, self._count = (t_ns, position_rad), 1
            self._least = self._greatest = self._last_speed
        return is_wrong

    def _is_after_pause(self, t_ns: int) -> bool:
        last_ns, self._newest_ns = self._newest_ns, t_ns
        if last_ns is None:
            return False
        usual_ns, self._interval_ns = self._interval_ns, t_ns - last_ns
        return self._interval_ns > max(LONGEST_BUNCHING_NS, 2 * usual_ns)

    def _can_cause(self, elapsed_ns: int, change_rad: float) -> bool:
        times_s = [
            (elapsed_ns + error_ns) / NANOSECONDS_PER_SECOND
            for error_ns in (-LONGEST_BUNCHING_NS, LONGEST_BUNCHING_NS)
        ]
        least, greatest = self._least - self._margin_rad_s, self._greatest + self._margin_rad_s
        low = min(least * time_s for time_s in times_s) - self._margin_rad
        high = max(greatest * time_s for time_s in times_s) + self._margin_rad
        return low <= change_rad <= high
