"""A heartbeat of another process, and what watches it: without new ones the rover must not move."""

import ctypes
from collections.abc import Sequence
from multiprocessing.sharedctypes import RawValue
from typing import Protocol

from drivers.clock import nanoseconds


class Counted(Protocol):
    """Heartbeats that are counted."""

    @property
    def count(self) -> int:
        """Number of heartbeats so far."""
        ...


class Heartbeat:
    """Counts the heartbeats that one process gives and others look at.

    The count is in shared memory: neither side waits for the other, however long that hangs. It reaches
    another process as an argument of `multiprocessing.Process`.
    """

    def __init__(self) -> None:
        self._count = RawValue(ctypes.c_uint64, 0)

    def give(self) -> None:
        """Give a heartbeat; by one process only."""
        self._count.value += 1

    @property
    def count(self) -> int:
        """Number of heartbeats so far."""
        return int(self._count.value)


class LifeWatch:
    """Watches the heartbeats of another process, by the time at which their count was seen to change.

    The time is the watcher's own: a wrong clock on the other side cannot make an old heartbeat look new.

    Args:
        heartbeat: Its heartbeats.
        limit_s: Longest time in s without a new one.
        reason: What is wrong when there is none for longer.
        forgives_pauses: Whether of the time between two checks no more than half the limit counts: where the
            watcher itself did not run, the other side often did not either, as on a machine that was paused.

    Attributes:
        silent_ns: Time without a new one at the last check, as far as it counts.
    """

    def __init__(
        self, heartbeat: Counted, limit_s: float, reason: str, *, forgives_pauses: bool = False
    ) -> None:
        self._heartbeat = heartbeat
        self._forgives_pauses = forgives_pauses
        self._limit_ns = nanoseconds(limit_s)
        self._reason = reason
        self._count: int | None = None
        self._checked_ns = 0
        self.silent_ns = 0

    def check(self, now_ns: int) -> str:
        """Return the reason to stop at `now_ns` of the watcher's clock; "" for none.

        The limit counts from the first call on.
        """
        count, passed_ns = self._heartbeat.count, now_ns - self._checked_ns
        self._checked_ns = now_ns
        if count != self._count:
            self._count = count
            self.silent_ns = 0
        else:
            self.silent_ns += min(passed_ns, self._limit_ns // 2) if self._forgives_pauses else passed_ns
        return self._reason if self.silent_ns > self._limit_ns else ""


class LossLatch:
    """Keeps a rover stopped after a loss, until an operator confirms that it may move.

    That what was lost is back is not enough: nobody may have seen what happened meanwhile.

    Args:
        watches: Each of them reports a loss. Where several report the same loss, the first of them gives the
            reason: without a server no page answers.

    Attributes:
        reason: Why the rover must not move; "" where it may.
        losses: Number of losses so far.
    """

    def __init__(self, watches: Sequence[LifeWatch]) -> None:
        self._watches = watches
        self._lost: int | None = None
        self.reason = ""
        self.losses = 0

    def check(self, now_ns: int) -> str:
        """Return `reason` after a look at all watches at `now_ns` of their clock."""
        reasons = [watch.check(now_ns) for watch in self._watches]
        lost = next((number for number, reason in enumerate(reasons) if reason), None)
        if lost is None:
            self._lost = None
        elif self._lost is None or lost < self._lost:
            self.losses += self._lost is None
            self._lost = lost
            self.reason = reasons[lost]
        return self.reason

    def release(self) -> bool:
        """Release the stop; return False, and keep it, while something is lost."""
        if self._lost is None:
            self.reason = ""
        return self._lost is None
