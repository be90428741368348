"""Pauses of the program and of devices: what waited in buffers meanwhile has no known time."""

from controllers.estimation.parameters import ESTIMATION
from drivers.clock import nanoseconds


class PauseWatch:
    """Notices by the time between two cycles that the program was paused.

    Drivers stamp data when they read them. After a pause all that waited has the stamp of the end of the
    pause, and what no buffer could hold is lost: turns and distances between such samples are wrong.

    Args:
        longest_cycle_s: A longer time between two cycles is a pause, unless the loop is that slow.
    """

    def __init__(self, longest_cycle_s: float) -> None:
        self._longest_ns = nanoseconds(longest_cycle_s)
        self._usual_ns: int | None = None
        self._cycle_ns: int | None = None
        self._until_ns = 0

    def begin_cycle(self, now_ns: int) -> bool:
        """Return whether the stamps of this cycle's samples are known."""
        if self._cycle_ns is not None:
            cycle_ns = max(0, now_ns - self._cycle_ns)  # in a damaged log, times may run back
            usual_ns = self._usual_ns or cycle_ns
            if cycle_ns > max(self._longest_ns, ESTIMATION.pose.pause_cycles * usual_ns):
                self._until_ns = now_ns + nanoseconds(ESTIMATION.pose.backlog_s)
            # A pause must not become usual at once, nor one short cycle make a slow loop one of pauses.
            self._usual_ns = min(cycle_ns, round(ESTIMATION.pose.usual_cycle_growth * usual_ns))
        self._cycle_ns = now_ns
        return now_ns >= self._until_ns


class SilenceWatch:
    """Notices that a device was silent: what it then sends at once may have waited in a buffer.

    Args:
        longest_s: A longer time between two samples is a silence.
    """

    def __init__(self, longest_s: float) -> None:
        self._longest_ns = nanoseconds(longest_s)
        self._newest_ns: int | None = None
        self._until_ns = 0

    def take(self, t_ns: int) -> bool:
        """Return whether the time of a sample with this stamp is known."""
        newest_ns = t_ns if self._newest_ns is None else self._newest_ns
        if t_ns - newest_ns > self._longest_ns:
            self._until_ns = t_ns + nanoseconds(ESTIMATION.pose.backlog_s)
        self._newest_ns = max(newest_ns, t_ns)
        return t_ns >= self._until_ns

    def begin_anew(self) -> None:
        """Forget the past, as after a break of the link: nothing waits in a buffer that is new."""
        self._newest_ns = None
