"""What the connection with ROS 2 costs the process of the loop, in processor time.

The simulated Robotino at 50 Hz in real time, with a commander in a process of its own. For a second the
connection is called, for a second it is not, in turns. Prints the time in its calls, the part of it that
reading the clock takes, and the time of a whole cycle with the calls and without.

    python -m benchmarks.ros2.cost [SECONDS]
"""

import subprocess
import sys
import tempfile
from pathlib import Path
from time import thread_time_ns

import numpy as np

from benchmarks.ros2.latency import COMMANDER, config_of
from controllers.operator import OperatorInput
from drivers.clock import PacedClock
from rover_hil.connect.ros2.connection import Ros2Connection
from rover_hil.run.driving import run_virtual
from rover_hil.run.executive import CycleView, End

SECONDS = 60.0
TURN_CYCLES = 50
FIRST_CYCLES = 100
"""Not counted: compiling, and what is read for the first time."""
CHANGE_CYCLES = 3
BAR_US = 50.0


class InTurns:
    """A connection that is called for a while, and left alone for a while.

    Attributes:
        calls_ns: Time in its calls, by whether they were made; else it is that of reading the clock.
        cycles_ns: Time of whole cycles, likewise.
    """

    def __init__(self, connection: Ros2Connection) -> None:
        self._connection = connection
        self._cycle = self._wanted_ns = self._before_ns = 0
        self.calls_ns: dict[bool, list[int]] = {True: [], False: []}
        self.cycles_ns: dict[bool, list[int]] = {True: [], False: []}

    def _is_called(self) -> bool:
        return self._cycle // TURN_CYCLES % 2 == 0

    def wanted(self) -> OperatorInput | None:
        """Pass on in its turn."""
        is_called = self._is_called()
        begin_ns = thread_time_ns()
        wanted = self._connection.wanted() if is_called else None
        self._wanted_ns = thread_time_ns() - begin_ns
        return wanted

    def end(self) -> tuple[End, str] | None:
        """Pass on."""
        return self._connection.end()

    def show(self, view: CycleView) -> None:
        """Pass on in its turn."""
        is_called = self._is_called()
        begin_ns = thread_time_ns()
        if is_called:
            self._connection.show(view)
        now_ns = thread_time_ns()
        if self._cycle > FIRST_CYCLES and self._cycle % TURN_CYCLES >= CHANGE_CYCLES:
            self.calls_ns[is_called].append(self._wanted_ns + now_ns - begin_ns)
            self.cycles_ns[is_called].append(now_ns - self._before_ns)
        self._before_ns = now_ns
        self._cycle += 1


def main() -> int:
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else SECONDS
    clock = PacedClock()
    with tempfile.TemporaryDirectory() as folder:
        commander = subprocess.Popen([sys.executable, "-c", COMMANDER], stdout=subprocess.DEVNULL)
        with Ros2Connection(config_of(), lambda: clock.offset_ns) as connection:
            sides = InTurns(connection)
            run_virtual(config_of(), Path(folder) / "run.mcap", seconds, None, clock=clock, operator=sides)
        commander.kill()
    call_us, most_us = np.percentile(sides.calls_ns[True], [50, 99]) / 1e3
    clock_us = np.median(sides.calls_ns[False]) / 1e3
    with_us, without_us = (np.median(sides.cycles_ns[is_called]) / 1e3 for is_called in (True, False))
    print(
        f"calls: median {call_us:.0f} us, 99 % {most_us:.0f} us a cycle; reading the clock {clock_us:.0f} us"
    )
    print(
        f"a cycle: median {with_us:.0f} us with them, {without_us:.0f} us without, of "
        f"{len(sides.cycles_ns[True])} and {len(sides.cycles_ns[False])}"
    )
    print("within the bar" if call_us <= BAR_US else "NOT within the bar")
    return 0 if call_us <= BAR_US else 1


if __name__ == "__main__":
    sys.exit(main())
