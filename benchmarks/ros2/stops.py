"""How soon a rover that is driven over ROS 2 rests when something fails, its stops without need, its motion.

The simulated Robotino in real time, with a commander in a process of its own that drives it ahead. Prints the
greatest time from the event until setpoints are zero; false stops: cycles at rest before the event, or after
one that is none; and motion that nobody commands: setpoints against the command, or after the rest.

Payloads that are too short or too long come from Fast DDS: they need ROS2_PEER, the program that
`make test-ros2` builds. The network is taken away in a namespace of its own:

    unshare --net sh -c "ip link set lo up; python -m benchmarks.ros2.stops [RUNS_OF_EACH] [CASE]..."
"""

import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks.ros2.jitter import damage_line
from benchmarks.ros2.latency import DOMAIN, PEER, config_of
from drivers.clock import PacedClock, SystemClock, nanoseconds, seconds
from rover_hil.connect.ros2.connection import Ros2Connection
from rover_hil.run.driving import run_virtual
from rover_hil.run.executive import CycleView, End, Operator
from rover_hil.run.operators import Operators

RUNS = 10
DRIVE_S, WATCHED_S = 2.0, 1.0
LIMIT_S = 60.0
CYCLE_S = 0.02
SPEED_M_S = 0.1
POLICIES = {os.SCHED_OTHER: "no real-time class", os.SCHED_FIFO: "SCHED_FIFO", os.SCHED_RR: "SCHED_RR"}
COMMANDER = f"""
import itertools, math, signal, sys, time
from rover_hil.config.ros2_settings import Ros2Settings
from rover_hil.connect.ros2.messages import Header, Time, Twist, TwistStamped, Vector3
from rover_hil.connect.ros2.node import Node

kind, speed_m_s, node, is_struck = sys.argv[1], float(sys.argv[2]), Node(Ros2Settings(domain={DOMAIN})), []
signal.signal(signal.SIGUSR1, lambda *_: is_struck.append(True))
send = node.writer("cmd_vel", Twist if kind == "plain" else TwistStamped)

def send_stamped(speed_m_s, offset_s=0.0):
    stamp = Time.of(time.time_ns() + round(1e9 * offset_s))
    send(TwistStamped(Header(stamp), Twist(Vector3(speed_m_s))))

for sent in itertools.count():
    if kind == "plain":
        send(Twist(Vector3(math.nan if is_struck else speed_m_s)))
    elif kind == "late":
        send_stamped(speed_m_s, -1.0 if is_struck else 0.0)
    elif kind == "disordered":
        send_stamped(speed_m_s)
        time.sleep(0.025)
        if sent > 3:
            send_stamped(-speed_m_s, -0.4)
    else:
        send_stamped(speed_m_s, float(kind) if is_struck else 0.0)
    time.sleep(0.05)
"""
Commander = subprocess.Popen[bytes]
Strike = Callable[[Commander, Ros2Connection], None]
LOOPBACK = "lo"
SEED = 36


class Case(NamedTuple):
    """Something that happens to a rover that is driven.

    Attributes:
        strike: Makes it happen.
        bar_s: Longest time until the rover rests; None where it must drive on.
        kind: Of the commander.
        longer_bytes: By how much the payloads of Fast DDS become longer; None for another commander.
        has_rival: Whether another one drives backwards meanwhile.
        is_damaged: Whether damaged datagrams arrive meanwhile.
        needs_network: Whether the network is taken away, which must be that of this benchmark alone.
    """

    strike: Strike
    bar_s: float | None
    kind: str = "plain"
    longer_bytes: int | None = None
    has_rival: bool = False
    is_damaged: bool = False
    needs_network: bool = False

    def hindrance(self) -> str:
        """Return why it cannot be measured here; "" where it can."""
        if self.longer_bytes is not None and not PEER:
            return "needs ROS2_PEER"
        is_alone = [name for _, name in socket.if_nameindex()] == [LOOPBACK]
        return "needs a network of its own" if self.needs_network and not is_alone else ""

    def line(self) -> list[str]:
        """Return the command line of the commander."""
        if self.longer_bytes is None:
            return commander_line(self.kind, SPEED_M_S)
        return [PEER, "drive", str(DOMAIN), str(SPEED_M_S), str(self.longer_bytes)]


def commander_line(kind: str, speed_m_s: float) -> list[str]:
    return [sys.executable, "-c", COMMANDER, kind, str(speed_m_s)]


def strike_commander(number: signal.Signals) -> Strike:
    return lambda commander, connection: commander.send_signal(number)


def strike_process(number: signal.Signals) -> Strike:
    return lambda commander, connection: os.kill(connection.pid or 0, number)


def set_network(state: str) -> None:
    subprocess.run([shutil.which("ip") or "ip", "link", "set", LOOPBACK, state], check=True)


def do_nothing(commander: Commander, connection: Ros2Connection) -> None:
    """Strike with what goes on from the beginning."""


TIMEOUT_S = 0.5 + CYCLE_S
KILL, STOP, CHANGE = signal.SIGKILL, signal.SIGSTOP, signal.SIGUSR1
CASES = {
    "commander killed": Case(strike_commander(KILL), TIMEOUT_S),
    "commander stopped": Case(strike_commander(STOP), TIMEOUT_S),
    "network gone": Case(lambda commander, connection: set_network("down"), TIMEOUT_S, needs_network=True),
    "process of ROS 2 killed": Case(strike_process(KILL), 0.5),
    "process of ROS 2 stopped": Case(strike_process(STOP), 0.5),
    "two commanders, the first stopped": Case(strike_commander(STOP), TIMEOUT_S, has_rival=True),
    "commander's clock an hour ahead": Case(strike_commander(CHANGE), None, "3600"),
    "commander's clock an hour back": Case(strike_commander(CHANGE), TIMEOUT_S, "-3600"),
    "NaN": Case(strike_commander(CHANGE), TIMEOUT_S),
    "payloads too short": Case(strike_commander(CHANGE), TIMEOUT_S, longer_bytes=-12),
    "payloads too long": Case(strike_commander(CHANGE), None, longer_bytes=8),
    "commands a second late": Case(strike_commander(CHANGE), TIMEOUT_S, "late"),
    "commands out of order": Case(do_nothing, None, "disordered"),
    "damaged datagrams": Case(do_nothing, None, is_damaged=True),
}


class Watcher:
    """Strikes after a while of driving, and notes what the rover does for a while afterwards.

    Attributes:
        false_stops: Cycles at rest without need.
        uncommanded: Cycles of motion that the commander does not command.
        rest_s: Time from the event to setpoints of zero.
        late_s: How late that cycle was over: since the time at which it should have begun.
    """

    def __init__(self, case: Case, strike: Callable[[], None], simulated: PacedClock) -> None:
        self._case, self._strike, self._simulated = case, strike, simulated
        self._clock = SystemClock()
        self._ahead: np.ndarray = np.zeros(0)
        self._driven_ns: int | None = None
        self._struck_ns: int | None = None
        self._is_over = False
        self.false_stops = self.uncommanded = 0
        self.rest_s: float | None = None
        self.late_s = 0.0

    def wanted(self) -> None:
        """Want nothing."""

    def end(self) -> tuple[End, str] | None:
        """End a while after the event."""
        return (End.STOPPED_BY_USER, "measured") if self._is_over else None

    def show(self, view: CycleView) -> None:
        """Follow the run."""
        now_ns, speed_rad_s = self._clock.now_ns(), np.array(view.sent.speed_rad_s)
        is_driven = bool(speed_rad_s.any())
        if self._driven_ns is None:
            if is_driven:
                self._driven_ns, self._ahead = now_ns, speed_rad_s
            return
        is_struck, is_back = self._struck_ns is not None, float(speed_rad_s @ self._ahead) < 0.0
        if not is_struck or self._case.bar_s is None:
            self.false_stops += not is_driven
        # After the time-out of the first commander its rival may drive.
        is_rival = is_struck and self._case.has_rival
        self.uncommanded += not is_rival and (is_back or (self.rest_s is not None and is_driven))
        if self._struck_ns is None:
            if now_ns - self._driven_ns > nanoseconds(DRIVE_S):
                self._strike()
                self._struck_ns = self._clock.now_ns()
            return
        # From a command of the rival on setpoints turn round through zero, but need not meet it in a cycle.
        wanted = None if view.wanted is None else view.wanted.motion
        is_over = not is_driven or (is_rival and wanted is not None and wanted[0] < 0.0)
        if self.rest_s is None and is_over:
            self.rest_s = seconds(now_ns - self._struck_ns)
            self.late_s = seconds(now_ns - self._simulated.now_ns() - self._simulated.offset_ns)
        self._is_over = now_ns - self._struck_ns > nanoseconds(WATCHED_S)


def measure(case: Case, path: Path) -> Watcher:
    """Return what was seen in a run."""
    clock = PacedClock()
    with Ros2Connection(config_of(), lambda: clock.offset_ns) as connection, ExitStack() as started:

        def start(line: list[str]) -> Commander:
            # Cyclone writes a line there for each damaged datagram.
            errors = subprocess.DEVNULL if case.is_damaged else None
            process = started.enter_context(subprocess.Popen(line, stdout=subprocess.DEVNULL, stderr=errors))
            started.callback(process.kill)
            return process

        if case.is_damaged:
            start(damage_line(DOMAIN, SEED))
        if case.needs_network:
            started.callback(set_network, "up")
        commander = start(case.line())
        watcher = Watcher(case, lambda: case.strike(commander, connection), clock)
        sides: list[Operator] = [connection, watcher]
        if case.has_rival:
            sides.append(Rival(lambda: start(commander_line("plain", -SPEED_M_S))))
        run_virtual(config_of(), path, LIMIT_S, None, clock=clock, operator=Operators(sides))
    assert watcher.rest_s is not None or case.bar_s is None, "the rover did not rest"
    return watcher


class Rival:
    """Starts the other commander when the first one is followed.

    Args:
        start: Starts it.
    """

    def __init__(self, start: Callable[[], Commander]) -> None:
        self._start = start
        self._is_there = False

    def wanted(self) -> None:
        """Want nothing."""

    def end(self) -> None:
        """End nothing."""

    def show(self, view: CycleView) -> None:
        """Start it once."""
        if not self._is_there and any(view.sent.speed_rad_s):
            self._is_there = True
            self._start()


def main() -> int:
    runs = int(sys.argv[1]) if len(sys.argv) > 1 else RUNS
    is_good, count = True, 0
    with tempfile.TemporaryDirectory() as folder:
        for name in sys.argv[2:] or CASES:
            case = CASES[name]
            hindrance = case.hindrance()
            if hindrance:
                print(f"{name}: not measured, {hindrance}", flush=True)
                is_good = False
                continue
            results = [measure(case, Path(folder) / "run.mcap") for _ in range(runs)]
            count += runs
            rests = sorted((each.rest_s, each.late_s) for each in results if each.rest_s is not None)
            false_stops = sum(each.false_stops for each in results)
            uncommanded = sum(each.uncommanded for each in results)
            is_good &= not false_stops and not uncommanded
            is_good &= not rests or case.bar_s is None or rests[-1][0] <= case.bar_s
            rested = "drives on"
            if rests:
                last_s, late_s = rests[-1]
                rested = f"at rest after {rests[0][0]:.3f} to {last_s:.3f} s (cycle late by {late_s:.3f} s)"
            bar = "drives on" if case.bar_s is None else f"{case.bar_s:g} s"
            print(
                f"{name}: {rested} (bar: {bar}), {false_stops} cycles of false stops, {uncommanded} of "
                f"motion that nobody commands, {runs} runs",
                flush=True,
            )
    print(f"{count} runs, {POLICIES[os.sched_getscheduler(0)]}, load {os.getloadavg()[0]:.0f} at the end")
    print("within the bars" if is_good else "NOT within the bars")
    return 0 if is_good else 1


if __name__ == "__main__":
    sys.exit(main())
