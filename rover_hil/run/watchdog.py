"""Stops the rover when the loop itself hangs: set-points must not outlive the program that sends them."""

import threading
from collections.abc import Callable
from contextlib import suppress

from drivers.clock import Clock
from drivers.driver import WheelDrive
from drivers.errors import LogError

CHECK_PERIOD_S = 0.02


class Watchdog:
    """Commands the drive to stop when nobody has fed it for longer than the limit.

    Args:
        drive: What to stop.
        clock: The host's clock.
        limit_ns: How long the loop may stay silent.
        on_intervention: Told the time of each intervention. The drive has been stopped by then, because a log
            that hangs may be what keeps the loop silent.
    """

    def __init__(
        self, drive: WheelDrive, clock: Clock, limit_ns: int, on_intervention: Callable[[int], None]
    ) -> None:
        self._drive = drive
        self._clock = clock
        self._limit_ns = limit_ns
        self._on_intervention = on_intervention
        self._fed_ns = clock.now_ns()
        self._has_stopped = False
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
        """Say that the loop is alive; called once per cycle."""
        self._fed_ns = self._clock.now_ns()
        self._has_stopped = False

    def check(self) -> None:
        """Stop the drive, once per silence, if the loop has been silent for too long."""
        now_ns = self._clock.now_ns()
        if not self._has_stopped and now_ns - self._fed_ns > self._limit_ns:
            self._has_stopped = True
            self.interventions += 1
            with suppress(LogError):  # the loop meets the same error, and ends
                self._drive.stop()
                self._on_intervention(now_ns)

    def _run(self) -> None:
        while not self._ending.wait(CHECK_PERIOD_S):
            self.check()
