"""The cycles of a log follow each other as the executive ran them: none may be missing between two."""

from drivers.clock import nanoseconds, seconds
from drivers.errors import LogError
from rover_hil.recording.reader import LogMessage, LogReader
from rover_hil.recording.schema import CYCLE_SHAPE

DRIVEN = ("virtual", "real")
"""Origins of logs whose cycles the executive ran; those of an imported run follow its readings."""


class RecordedCycles:
    """Counts the cycles of a log, and notices where some are missing.

    A cycle notes how late it began, and thus its deadline. The next deadline is a period later, and as many
    more as a late cycle skipped. A gap in the deadlines is a cycle that ran and is not there.

    Args:
        log: The log.
        rate_hz: Cycles per second of its loop.

    Attributes:
        count: Cycles so far.
        skipped: Cycles that the loop skipped because one was late.
    """

    def __init__(self, log: LogReader, rate_hz: float) -> None:
        self.count = 0
        self.skipped = 0
        self._log = log
        self._period_ns = nanoseconds(1.0 / rate_hz)
        self._start_ns = 0
        self._last_ns = 0
        self._next_deadline_ns: int | None = None

    @property
    def duration_s(self) -> float:
        """Time from the start of the loop to its last cycle so far."""
        return seconds(self._last_ns - self._start_ns)

    def take(self, message: LogMessage) -> None:
        """Count one more cycle.

        Raises:
            LogError: It is damaged, or cycles before it are missing.
        """
        self.count += 1
        self._last_ns = message.t_ns
        if self._log.origin not in DRIVEN:
            return
        late_ns = self._log.parse(message, CYCLE_SHAPE)["late_ns"]
        deadline_ns = message.t_ns - late_ns
        if self._next_deadline_ns is None:
            self._start_ns = deadline_ns - self._period_ns
        elif deadline_ns != self._next_deadline_ns:
            after_s = seconds(self._next_deadline_ns - self._period_ns - self._log.start_ns)
            raise LogError(
                f"log {self._log.path} is damaged: cycles are missing or not in order after {after_s:.3f} s; "
                "what follows cannot be computed again"
            )
        missed = max(late_ns // self._period_ns, 0)
        self.skipped += missed
        self._next_deadline_ns = deadline_ns + (1 + missed) * self._period_ns
