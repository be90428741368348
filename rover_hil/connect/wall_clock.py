"""Wall-clock time of monotonic stamps, for other computers."""

from collections.abc import Callable

from drivers.clock import NANOSECONDS_PER_SECOND, SystemClock, wall_time_ns

RENEWAL_NS = NANOSECONDS_PER_SECOND
STEP_NS = NANOSECONDS_PER_SECOND // 10
"""A change of the offset by more is a step of the clock; less is its drift."""


class WallOffset:
    """The offset from monotonic time to the wall clock, renewed each second.

    A fixed offset would drift from other computers. After a step of the wall clock stamps follow it, as those
    of every other program on this computer do; `step_s` says so for a while.

    Args:
        read_wall_ns: Reads the wall clock.

    Attributes:
        step_s: Size of the last step; 0 before any.
    """

    def __init__(self, read_wall_ns: Callable[[], int] = wall_time_ns) -> None:
        self._read_wall_ns = read_wall_ns
        self._clock = SystemClock()
        self._offset_ns: int | None = None
        self._due_ns = 0
        self.step_s = 0.0

    def at(self, now_ns: int) -> int:
        """Return the offset in ns at `now_ns` of real monotonic time."""
        if self._offset_ns is None or now_ns >= self._due_ns:
            before_ns = self._clock.now_ns()
            wall_ns = self._read_wall_ns()
            offset_ns = wall_ns - (before_ns + self._clock.now_ns()) // 2
            if self._offset_ns is not None and abs(offset_ns - self._offset_ns) > STEP_NS:
                self.step_s = (offset_ns - self._offset_ns) / NANOSECONDS_PER_SECOND
            self._offset_ns = offset_ns
            self._due_ns = now_ns + RENEWAL_NS
        return self._offset_ns
