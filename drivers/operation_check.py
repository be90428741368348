"""Decides when a drive that does not operate is at fault."""

from drivers.clock import NANOSECONDS_PER_SECOND

START_TIME_NS = NANOSECONDS_PER_SECOND
"""Time for a drive to begin to operate after the first setpoint."""


class OperationCheck:
    """Remembers whether a drive gets setpoints, and whether it has obeyed them.

    A drive that gets none may rest in any state. One that gets them must operate within a second, and then
    until it is stopped; a fault lasts until it operates again.
    """

    def __init__(self) -> None:
        self.note_stop()

    def note_set_point(self) -> None:
        """Note that a setpoint is sent."""
        self._is_commanded = True

    def note_stop(self) -> None:
        """Note that the drive was switched off, or that its link broke."""
        self._is_commanded = False
        self._has_operated = False
        self._waits_since_ns: int | None = None

    def is_at_fault(self, t_ns: int, *, is_operating: bool) -> bool:
        """Take the state that a drive reports, and return whether it is a fault."""
        if is_operating or not self._is_commanded:
            self._has_operated = is_operating and self._is_commanded
            self._waits_since_ns = None
            return False
        if self._waits_since_ns is None:
            self._waits_since_ns = t_ns
        return self._has_operated or t_ns - self._waits_since_ns >= START_TIME_NS
