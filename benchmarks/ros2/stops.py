"""How soon a rover that is driven over ROS 2 rests when something fails, and its stops without need.

The simulated Robotino in real time, with a commander in a process of its own. Prints the greatest time from
the event until set-points are zero, and the false stops of all runs: cycles at rest before the event.

    python -m benchmarks.ros2.stops [RUNS]
"""

import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

from benchmarks.ros2.latency import DOMAIN, config_of
from drivers.clock import PacedClock, SystemClock, nanoseconds, seconds
from rover_hil.app.run import run_virtual
from rover_hil.connect.ros2.connection import Ros2Connection
from rover_hil.run.executive import CycleView, End
from rover_hil.run.operators import Operators

RUNS = 5
DRIVE_S = 2.0
LIMIT_S = 60.0
CYCLE_S = 0.02
COMMANDER = f"""
import time
from rover_hil.config.ros2_settings import Ros2Settings
from rover_hil.connect.ros2.messages import Twist, Vector3
from rover_hil.connect.ros2.node import Node

send = Node(Ros2Settings(domain={DOMAIN})).writer("cmd_vel", Twist)
while True:
    send(Twist(Vector3(0.1)))
    time.sleep(0.05)
"""
Strike = Callable[[subprocess.Popen[bytes], Ros2Connection], None]


def strike_commander(number: signal.Signals) -> Strike:
    return lambda commander, connection: commander.send_signal(number)


def strike_process(number: signal.Signals) -> Strike:
    return lambda commander, connection: os.kill(connection.pid or 0, number)


CASES: dict[str, tuple[Strike, float]] = {
    "commander killed": (strike_commander(signal.SIGKILL), 0.5 + CYCLE_S),
    "commander stopped": (strike_commander(signal.SIGSTOP), 0.5 + CYCLE_S),
    "process of ROS 2 killed": (strike_process(signal.SIGKILL), 0.5),
    "process of ROS 2 stopped": (strike_process(signal.SIGSTOP), 0.5),
}


class Watcher:
    """Strikes after a while of driving, and notes when the rover rests."""

    def __init__(self, strike: Callable[[], None]) -> None:
        self._strike = strike
        self._clock = SystemClock()
        self._driven_ns: int | None = None
        self._struck_ns: int | None = None
        self.false_stops = 0
        self.rest_s: float | None = None

    def wanted(self) -> None:
        """Want nothing."""

    def end(self) -> tuple[End, str] | None:
        """End when the rover rests."""
        return None if self.rest_s is None else (End.STOPPED_BY_USER, "measured")

    def show(self, view: CycleView) -> None:
        """Follow the run."""
        now_ns, is_driven = self._clock.now_ns(), any(view.sent.speed_rad_s)
        if self._driven_ns is None:
            self._driven_ns = now_ns if is_driven else None
        elif self._struck_ns is None:
            self.false_stops += not is_driven
            if now_ns - self._driven_ns > nanoseconds(DRIVE_S):
                self._strike()
                self._struck_ns = self._clock.now_ns()
        elif not is_driven and self.rest_s is None:
            self.rest_s = seconds(now_ns - self._struck_ns)


def measure(strike: Strike, path: Path) -> tuple[float, int]:
    """Return the time until the rover rested in s, and the number of false stops."""
    clock = PacedClock()
    line = [sys.executable, "-c", COMMANDER]
    with (
        Ros2Connection(config_of(), lambda: clock.offset_ns) as connection,
        subprocess.Popen(line) as commander,
    ):
        watcher = Watcher(lambda: strike(commander, connection))
        try:
            run_virtual(
                config_of(), path, LIMIT_S, None, clock=clock, operator=Operators([connection, watcher])
            )
        finally:
            commander.kill()
    assert watcher.rest_s is not None, "the rover did not rest"
    return watcher.rest_s, watcher.false_stops


def main() -> int:
    runs = int(sys.argv[1]) if len(sys.argv) > 1 else RUNS
    is_good = True
    with tempfile.TemporaryDirectory() as folder:
        for name, (strike, bar_s) in CASES.items():
            found = [measure(strike, Path(folder) / "run.mcap") for _ in range(runs)]
            rests = sorted(rest_s for rest_s, _ in found)
            false_stops = sum(false for _, false in found)
            is_good &= rests[-1] <= bar_s and not false_stops
            print(
                f"{name}: at rest after {rests[0]:.3f} to {rests[-1]:.3f} s (bar {bar_s:g} s), "
                f"{false_stops} false stops, {runs} runs"
            )
    return 0 if is_good else 1


if __name__ == "__main__":
    sys.exit(main())
