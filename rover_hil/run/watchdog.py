"""Stops the rover when the loop itself hangs: set-points must not outlive the program that sends them."""

import threading
from collections.abc import Callable
from contextlib import suppress

from drivers.clock import Clock
from drivers.driver import WheelDrive
from drivers.errors import LogError

CHECK_PERIOD_S = 0.02


class Watchdog:
    """Commands the drive to stop when it has not been fed for longer than the limit.

    Args:
        drive: The drive to stop.
        clock: The host's clock.
        limit_ns: Longest time between two feeds.
        on_intervention: Called with the time at which each stop was sent, after the drive has been stopped,
            because a log that hangs may be what blocks the loop.
    """

    def __init__(
        self, drive: WheelDrive, clock: Clock, limit_ns: int, on_intervention: Callable[[int], None]
    ) -> None:
        self._drive = drive
        self._clock = clock
        self._limit_ns = limit_ns
        self._on_intervention = on_intervention
        self._fed_ns = clock.now_ns()
        self._stopped = threading.Event()
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run, name="watchdog", daemon=True)
        self.interventions = 0

    def start(self) -> None:
        """Start watching in a thread of its own."""
        self.feed()
        self._thread.start()

    def end(self) -> None:
        """Stop watching."""
        self._ending.set()
        self._thread.join()

    def feed(self) -> None:
        """Report that the loop is alive; called once per cycle."""
        self._fed_ns = self._clock.now_ns()
        self._stopped.clear()

    def check(self) -> None:
        """Stop the drive, once per pause, if the loop has not fed the watchdog for too long."""
        now_ns = self._clock.now_ns()
        if not self._stopped.is_set() and now_ns - self._fed_ns > self._limit_ns:
            self._stopped.set()
            self.interventions += 1
            with suppress(LogError):  # the loop meets the same error, and ends
                # Not the time of the check: a command may have gone out in between, and replay must know.
                self._on_intervention(self._drive.stop())

    def _run(self) -> None:
        while not self._ending.wait(CHECK_PERIOD_S):
            self.check()
