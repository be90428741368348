"""Latencies over ROS 2 in a run in real time.

Prints, for the simulated Robotino at 50 Hz: from the time of the wheel positions behind a /odom until a peer
has it; from a /cmd_vel of a commander in a process of its own, at any moment of a cycle, until the cycle is
over in which its setpoints are sent. With ROS2_PEER (the program that `make test-ros2` builds) the peer is
Fast DDS, else Cyclone DDS.

    python -m benchmarks.ros2.latency [SECONDS]
"""

import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from drivers.clock import PacedClock, SystemClock, wall_time_ns
from rover_hil.config import Config, load_config
from rover_hil.config.ros2_settings import Ros2Settings
from rover_hil.connect.ros2.connection import Ros2Connection
from rover_hil.connect.ros2.messages import Odometry
from rover_hil.connect.ros2.node import Node
from rover_hil.run.driving import run_virtual
from rover_hil.run.executive import CycleView
from rover_hil.run.operators import Operators

DOMAIN = 78
SECONDS = 30.0
RATE_HZ = 50.0
PEER = os.environ.get("ROS2_PEER", "")
MS = 1e-6


COMMANDER = f"""
import random, sys, time
from rover_hil.config.ros2_settings import Ros2Settings
from rover_hil.connect.ros2.messages import Twist, Vector3
from rover_hil.connect.ros2.node import Node

send, drawn, is_ahead = Node(Ros2Settings(domain={DOMAIN})).writer("cmd_vel", Twist), random.Random(1), False
while True:
    time.sleep(0.1 + 0.02 * drawn.random())
    is_ahead = not is_ahead
    sent_ns = time.monotonic_ns()
    send(Twist(Vector3(0.1 if is_ahead else 0.0)))
    print(sent_ns, int(is_ahead), flush=True)
"""


class Follower:
    """Notes when the rover begins and ceases to be driven; reads /odom."""

    def __init__(self, node: Node) -> None:
        self._odometry = node.reader("odom", Odometry, depth=100)
        self._clock = SystemClock()
        self._was_driven = False
        self.changes: list[tuple[int, bool]] = []
        self.odometry_ns: list[int] = []

    def wanted(self) -> None:
        """Want nothing."""

    def end(self) -> None:
        """End nothing."""

    def show(self, view: CycleView) -> None:
        """Look at the setpoints and at /odom."""
        is_driven = any(view.sent.speed_rad_s)
        if is_driven is not self._was_driven:
            self._was_driven = is_driven
            self.changes.append((self._clock.now_ns(), is_driven))
        for message, _, _ in self._odometry():
            self.odometry_ns.append(wall_time_ns() - message.header.stamp.time_ns)


def reactions_ns(changes: list[tuple[int, bool]], sent: list[str]) -> list[int]:
    """Return the times from commands to the changes of the setpoints that follow from them."""
    commands = [(int(time_ns), bool(int(is_ahead))) for time_ns, is_ahead in map(str.split, sent)]
    reactions = []
    for changed_ns, is_driven in changes:
        before = [time_ns for time_ns, is_ahead in commands if time_ns < changed_ns and is_ahead is is_driven]
        reactions += [changed_ns - before[-1]] if before else []
    return reactions


def config_of(domain: int = DOMAIN) -> Config:
    table = load_config("robotino").model_dump(by_alias=True, exclude={"mission", "slip"})
    return Config.model_validate(
        {
            **table,
            "mission": {"type": "by_hand", "speed_m_s": 0.2, "yaw_rate_limit_rad_s": 1.0},
            "ros2": {"domain": domain, "commands": True},
        }
    )


def quantiles(values_ns: list[int]) -> str:
    median, most = np.percentile(values_ns, [50, 99]) * MS
    return f"median {median:.2f} ms, 99 % {most:.2f} ms, of {len(values_ns)}"


def main() -> int:
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else SECONDS
    clock = PacedClock()
    with tempfile.TemporaryDirectory() as folder:
        read = Path(folder) / "odom.txt"
        with read.open("w") as output:
            line = [PEER, "read", str(DOMAIN), "reliable", "volatile", "rt/odom=Odometry"]
            peer = subprocess.Popen(line, stdin=subprocess.PIPE, stdout=output) if PEER else None
        commander = subprocess.Popen([sys.executable, "-c", COMMANDER], stdout=subprocess.PIPE, text=True)
        follower = Follower(Node(Ros2Settings(domain=DOMAIN)))
        with Ros2Connection(config_of(), lambda: clock.offset_ns) as connection:
            sides = Operators([connection, follower])
            run_virtual(config_of(), Path(folder) / "run.mcap", seconds, None, clock=clock, operator=sides)
        odometry_ns = follower.odometry_ns
        commander.kill()
        reaction_ns = reactions_ns(follower.changes, commander.communicate()[0].splitlines())
        if peer is not None:
            peer.communicate()
            rows = [row.split() for row in read.read_text().splitlines()[1:]]
            odometry_ns = [int(arrival) - int(stamp) for _, _, stamp, arrival in rows]
    print(f"sample to /odom at {'Fast DDS' if peer else 'a reader once per cycle'}: {quantiles(odometry_ns)}")
    print(f"/cmd_vel to setpoints: {quantiles(reaction_ns)}")
    period_ms = 1e3 / RATE_HZ
    is_good = (
        np.median(odometry_ns) * MS < period_ms + 2.0
        and np.percentile(odometry_ns, 99) * MS < 2 * period_ms
        and np.median(reaction_ns) * MS < period_ms + 2.0
    )
    print("within the bars" if is_good else "NOT within the bars")
    return 0 if is_good else 1


if __name__ == "__main__":
    sys.exit(main())
