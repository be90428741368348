"""The only module that reads a clock or sleeps (a lint rule bans it everywhere else)."""

import datetime as dt
import time
from typing import Protocol

NANOSECONDS_PER_SECOND = 1_000_000_000
MOST_BEHIND_NS = 50_000_000
"""Simulated time that is further behind real time does not catch up."""


class Clock(Protocol):
    """Monotonic time of the host, and a way to wait for it."""

    def now_ns(self) -> int:
        """Return monotonic time in nanoseconds."""
        ...

    def sleep_until(self, deadline_ns: int) -> None:
        """Return at `deadline_ns` or later; at once when it has passed."""
        ...


class SystemClock:
    """The host's monotonic clock.

    Args:
        spin_s: Busy-wait this long (0..0.005 s) before each deadline. Worth it only under a real-time
            scheduler; under the default one it makes lateness worse.
    """

    def __init__(self, spin_s: float = 0.0) -> None:
        self._spin_ns = int(spin_s * NANOSECONDS_PER_SECOND)

    def now_ns(self) -> int:
        """Return monotonic time in nanoseconds."""
        return time.monotonic_ns()

    def sleep_until(self, deadline_ns: int) -> None:
        """Sleep until `deadline_ns`."""
        remaining_ns = deadline_ns - self._spin_ns - time.monotonic_ns()
        if remaining_ns > 0:
            time.sleep(remaining_ns / NANOSECONDS_PER_SECOND)
        if self._spin_ns:
            while time.monotonic_ns() < deadline_ns:
                pass


class VirtualClock:
    """A clock that moves only by `sleep_until`: simulated time, deterministic.

    Args:
        start_ns: First reading. Not zero, so that an unset time stamp cannot pass for a real one.
    """

    def __init__(self, start_ns: int = NANOSECONDS_PER_SECOND) -> None:
        self._now_ns = start_ns

    def now_ns(self) -> int:
        """Return simulated time in nanoseconds."""
        return self._now_ns

    def sleep_until(self, deadline_ns: int) -> None:
        """Move simulated time forward to `deadline_ns`; never backwards."""
        self._now_ns = max(self._now_ns, deadline_ns)


class PacedClock(VirtualClock):
    """Simulated time that passes like real time, for someone who watches.

    A computer that is too slow for a while does not hurry afterwards: the time is lost.

    Args:
        start_ns: First reading.

    Attributes:
        lost_ns: Real time by which simulated time has fallen behind for good.
    """

    def __init__(self, start_ns: int = NANOSECONDS_PER_SECOND) -> None:
        super().__init__(start_ns)
        self._offset_ns: int | None = None
        self.lost_ns = 0

    @property
    def offset_ns(self) -> int:
        """Real time minus simulated time; 0 before the first sleep."""
        return self._offset_ns or 0

    def sleep_until(self, deadline_ns: int) -> None:
        """Sleep until real time has come as far, and move simulated time forward to `deadline_ns`."""
        if self._offset_ns is None:
            self._offset_ns = time.monotonic_ns() - self.now_ns()
        remaining_ns = deadline_ns + self._offset_ns - time.monotonic_ns()
        if remaining_ns > 0:
            time.sleep(remaining_ns / NANOSECONDS_PER_SECOND)
        elif remaining_ns < -MOST_BEHIND_NS:
            self._offset_ns -= remaining_ns
            self.lost_ns -= remaining_ns
        super().sleep_until(deadline_ns)


def wall_time_ns() -> int:
    """Return wall-clock time in nanoseconds since 1970: for the header of a log, never for control."""
    return time.time_ns()


def date_of(wall_ns: int) -> dt.date:
    """Return the date of a wall-clock reading in UTC."""
    return dt.datetime.fromtimestamp(wall_ns / NANOSECONDS_PER_SECOND, tz=dt.UTC).date()


def wall_time_text() -> str:
    """Return local date and time as `20260102-030405`, for names of folders."""
    return time.strftime("%Y%m%d-%H%M%S")


def stopwatch_ns() -> int:
    """Return elapsed real time in nanoseconds from an arbitrary start: for measuring how long code takes.

    Time in which other programs had the processor counts too.
    """
    return time.perf_counter_ns()


def wall_to_monotonic_ns(wall_s: float) -> int:
    """Convert a recent wall-clock stamp in seconds since 1970 to monotonic nanoseconds.

    The two clocks are read as a bracketed pair at the call, so the result follows steps of the wall clock.
    """
    before_ns = time.monotonic_ns()
    now_wall_ns = time.time_ns()
    after_ns = time.monotonic_ns()
    return (before_ns + after_ns) // 2 - (now_wall_ns - round(wall_s * NANOSECONDS_PER_SECOND))


def seconds(duration_ns: int) -> float:
    """Convert nanoseconds to seconds."""
    return duration_ns / NANOSECONDS_PER_SECOND


def nanoseconds(duration_s: float) -> int:
    """Convert seconds to nanoseconds, rounded to the nearest."""
    return round(duration_s * NANOSECONDS_PER_SECOND)
