"""Jitter of a loop that is connected with ROS 2, with and without readers that trouble it.

The simulated Robotino runs at 50 Hz in real time, under SCHED_FIFO as `run --realtime`, for pairs of phases
in an order that is drawn: one without readers; one with a reader that is stopped, one that is killed,
one that is stopped for half of each second, and damaged datagrams to the ports of the rover. Prints the
difference of the 99 % jitter with and without, and the upper 95 % bound of its mean. Needs ROS2_PEER, the
program that `make test-ros2` builds, and the right to use SCHED_FIFO.

    python -m benchmarks.ros2.jitter [PAIRS]
"""

import random
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from benchmarks.ros2.latency import MS, PEER, config_of
from drivers.clock import PacedClock, SystemClock, nanoseconds
from rover_hil.connect.ros2.connection import Ros2Connection
from rover_hil.run.driving import run_virtual
from rover_hil.run.executive import CycleView, End
from rover_hil.run.operators import Operators
from rover_hil.run.real_time import enter_realtime

DOMAIN = 79
PAIRS = 20
PHASE_S, PAUSE_S, WARM_S = 10.0, 1.0, 3.0
DATAGRAMS = 2500
"""Damaged ones in a phase: 50 000 in 20 pairs."""
BAR_MS = 0.2
MEASURED = "measured"
READY, OVER, ROWS = "ready", "over", "rows.txt"
STUDENT_95 = 1.729
"""Of Student's distribution of 19 degrees of freedom, one-sided."""
SEED = 36
DAMAGE = f"""
import random, socket, struct, sys, time
first_port = 7400 + 250 * int(sys.argv[1])
drawn = random.Random(int(sys.argv[2]))
listener = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEPORT, 1)
listener.bind(("", first_port))
group = struct.pack("4s4s", socket.inet_aton("239.255.0.1"), socket.inet_aton("127.0.0.1"))
listener.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, group)
listener.settimeout(1.0)
genuine = []
try:
    while len(genuine) < 8:
        genuine.append(listener.recv(65536))
except TimeoutError:
    pass
header = b"RTPS" + bytes([2, 3, 1, 16])
genuine.append(header + drawn.randbytes(12) + bytes([0x15, 5, 200, 0]) + bytes(200))
sender = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
begin = time.monotonic()
for number in range({DATAGRAMS}):
    data = bytearray(drawn.choice(genuine))
    for _ in range(drawn.randint(1, 20)):
        data[drawn.randrange(4 if drawn.random() < 0.9 else 0, len(data))] = drawn.randrange(256)
    data = data[: drawn.randint(1, len(data))] if drawn.random() < 0.3 else data
    sender.sendto(data, ("127.0.0.1", first_port + 10 + number % 4))
    time.sleep(max(0.0, begin + number * {PHASE_S - 2.0} / {DATAGRAMS} - time.monotonic()))
print(len(genuine))
"""


def damage_line(domain: int, seed: int) -> list[str]:
    """Return the command line of what sends damaged datagrams to the first two programs in a domain."""
    return [sys.executable, "-S", "-c", DAMAGE, str(domain), str(seed)]


class Jitter:
    """Notes how late each cycle begins.

    Args:
        clock: Of the run.
        ready: A file that is made in the first cycle.
        over: A file after which the run ends.
    """

    def __init__(self, clock: PacedClock, ready: Path, over: Path) -> None:
        self._ready, self._over = ready, over
        self._clock = clock
        self._real = SystemClock()
        self.rows: list[tuple[int, int]] = []

    def wanted(self) -> None:
        """Note the time; nothing is wanted."""
        now_ns = self._real.now_ns()
        self.rows.append((now_ns, now_ns - self._clock.now_ns() - self._clock.offset_ns))

    def end(self) -> tuple[End, str] | None:
        """End after the file to wait for is there."""
        return (End.STOPPED_BY_USER, MEASURED) if self._over.exists() else None

    def show(self, view: CycleView) -> None:
        """Say that the run has begun."""
        if len(self.rows) == 1:
            self._ready.touch()


def rover(folder: Path) -> int:
    """Run the rover until the benchmark is over; write times and jitter in ns."""
    clock = PacedClock()
    jitter = Jitter(clock, folder / READY, folder / OVER)
    with Ros2Connection(config_of(DOMAIN), lambda: clock.offset_ns) as connection:
        enter_realtime()
        sides = Operators([jitter, connection])
        result = run_virtual(config_of(DOMAIN), folder / "run.mcap", 1e5, None, clock=clock, operator=sides)
    np.savetxt(folder / ROWS, np.array(jitter.rows), fmt="%d")
    print(f"the run ended: {result.reason}", flush=True)
    return 0


def trouble(seed: int) -> None:
    """Trouble the rover for a phase."""
    clock = SystemClock()
    begin_ns = clock.now_ns()
    topics = ["rt/odom=Odometry", "rt/tf=TFMessage"]
    line = [PEER, "read", str(DOMAIN), "reliable", "volatile", *topics]
    damage = subprocess.Popen(damage_line(DOMAIN, seed), stdout=subprocess.DEVNULL)
    stopped, killed, slow = (
        subprocess.Popen(line, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL) for _ in range(3)
    )
    try:
        for half in range(1, round(2 * PHASE_S)):
            clock.sleep_until(begin_ns + nanoseconds(half / 2))
            slow.send_signal(signal.SIGSTOP if half % 2 else signal.SIGCONT)
            if half == 4:
                stopped.send_signal(signal.SIGSTOP)
            if half == 6:
                killed.kill()
        clock.sleep_until(begin_ns + nanoseconds(PHASE_S))
    finally:
        for each in (stopped, killed, slow, damage):
            each.kill()
            each.wait()


def phases_of(process: subprocess.Popen[bytes], pairs: int) -> list[tuple[bool, int, int]]:
    """Return whether the rover was troubled, begin and end in ns of each phase, until its run ends."""
    clock, drawn = SystemClock(), random.Random(SEED)
    phases: list[tuple[bool, int, int]] = []
    for pair in range(pairs):
        for is_troubled in drawn.sample([False, True], 2):
            if process.poll() is not None:
                return phases
            begin_ns = clock.now_ns()
            if is_troubled:
                trouble(pair)
            clock.sleep_until(begin_ns + nanoseconds(PHASE_S))
            phases.append((is_troubled, begin_ns, clock.now_ns()))
            clock.sleep_until(clock.now_ns() + nanoseconds(PAUSE_S))
    return phases


def main() -> int:
    if len(sys.argv) > 1 and sys.argv[1] == "--rover":
        return rover(Path(sys.argv[2]))
    if not PEER:
        print("ROS2_PEER is not set: `make test-ros2` builds that program")
        return 2
    clock = SystemClock()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        line = [sys.executable, "-m", "benchmarks.ros2.jitter", "--rover", name]
        with subprocess.Popen(line) as process:
            while not (folder / READY).exists() and process.poll() is None:
                clock.sleep_until(clock.now_ns() + nanoseconds(PAUSE_S))
            clock.sleep_until(clock.now_ns() + nanoseconds(WARM_S))
            phases = phases_of(process, int(sys.argv[1]) if len(sys.argv) > 1 else PAIRS)
            (folder / OVER).touch()
        if process.returncode:
            return 1
        times_ns, late_ns = np.loadtxt(folder / ROWS).T
    by_load: dict[bool, list[float]] = {False: [], True: []}
    for is_troubled, begin_ns, end_ns in phases:
        inside = late_ns[(times_ns >= begin_ns) & (times_ns < end_ns)]
        if end_ns <= times_ns[-1]:
            by_load[is_troubled].append(float(np.percentile(inside, 99)) * MS)
    pairs = min(map(len, by_load.values()))
    if pairs < 2:
        print("the run ended before two pairs of phases were over")
        return 1
    without_ms, with_ms = np.array(by_load[False][:pairs]), np.array(by_load[True][:pairs])
    difference_ms = with_ms - without_ms
    bound_ms = difference_ms.mean() + STUDENT_95 * difference_ms.std(ddof=1) / pairs**0.5
    print(
        f"99 % jitter: {without_ms.mean():.3f} ms without, {with_ms.mean():.3f} with; difference "
        f"{difference_ms.mean():+.3f} ms (median {np.median(difference_ms):+.3f}), upper 95 % bound "
        f"{bound_ms:+.3f} ms (bar {BAR_MS:g} ms), {pairs} pairs, {pairs * DATAGRAMS} damaged datagrams"
    )
    return 0 if bound_ms < BAR_MS and pairs >= PAIRS else 1


if __name__ == "__main__":
    sys.exit(main())
