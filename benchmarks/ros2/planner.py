"""A simple planner drives the simulated Robotino to ten goals over ROS 2, on ground on which it slips.

The planner knows /odom and /cmd_vel, nothing else. It drives towards each goal and takes it for reached when
/odom says so. How far the rover then really is from the goal is printed for odometry that a ground camera
corrects, for odometry that the yaw excitation corrects, and for that of wheels and gyro alone. Each runs in
real time for about a minute.

    python -m benchmarks.ros2.planner ["ground camera" | "yaw excitation" | "wheels and gyro"]...
"""

import math
import sys
import tempfile
from pathlib import Path

from drivers.clock import PacedClock
from rover_hil.config import Config, load_config
from rover_hil.config.ros2_settings import Ros2Settings
from rover_hil.connect.ros2.connection import Ros2Connection
from rover_hil.connect.ros2.mapping import yaw_of
from rover_hil.connect.ros2.messages import Odometry, Twist, Vector3
from rover_hil.connect.ros2.node import Node
from rover_hil.recording.data_files import restore_config
from rover_hil.recording.reader import LogReader
from rover_hil.run.driving import run_virtual
from rover_hil.run.executive import CycleView, End
from rover_hil.run.operators import Operators
from rover_hil.run.replay import replay
from sim_backends.world.plant import Truth

DOMAIN = 77
GOALS_M = (
    (0.4, 0.0), (0.4, 0.3), (0.0, 0.3), (0.0, 0.0), (0.3, 0.2),
    (0.5, -0.1), (0.2, -0.3), (-0.2, -0.1), (-0.2, 0.2), (0.0, 0.0),
)  # fmt: skip
BEST, INFERRED, PLAIN = "ground camera", "yaw excitation", "wheels and gyro"
CONFIGS = {BEST: "robotino-camera", INFERRED: "robotino", PLAIN: "robotino"}
"""What corrects the odometry, and the shipped configuration of it."""
REACHED_M = 0.02
BAR_M = 0.1
SPEED_M_S, SLOWEST_M_S, GAIN_PER_S, TURN_GAIN_PER_S = 0.15, 0.08, 1.5, 1.5
LIMIT_S = 600.0
PERIOD_CYCLES = 5
"""The planner sends at 10 Hz."""


class Planner:
    """Goes to the goals one by one; an operator only to see the truth, which it does not use to drive.

    Attributes:
        errors_m: True distances from the goals that it took for reached.
    """

    def __init__(self, node: Node) -> None:
        self._odometry = node.reader("odom", Odometry)
        self._velocity = node.writer("cmd_vel", Twist)
        self._pose: tuple[float, float, float] | None = None
        self._first: Truth | None = None
        self._cycle = 0
        self.errors_m: list[float] = []

    def wanted(self) -> None:
        """Want nothing: it commands over the network."""

    def end(self) -> tuple[End, str] | None:
        """End after the last goal."""
        done = len(self.errors_m) == len(GOALS_M)
        return (End.STOPPED_BY_USER, "all goals were reached") if done else None

    def show(self, view: CycleView) -> None:
        """Read /odom and send /cmd_vel."""
        self._cycle += 1
        for message, _, _ in self._odometry():
            place = message.pose.pose.position
            self._pose = place.x, place.y, yaw_of(message.pose.pose.orientation)
        if view.truth is None or self.end() is not None:
            return
        self._first = self._first or view.truth
        if self._pose is None or self._cycle % PERIOD_CYCLES:
            return
        x_m, y_m, yaw_rad = self._pose
        goal_x_m, goal_y_m = GOALS_M[len(self.errors_m)]
        way_m = complex(goal_x_m - x_m, goal_y_m - y_m)
        if abs(way_m) < REACHED_M:
            true_x_m, true_y_m = since(self._first, view.truth)
            self.errors_m.append(math.hypot(goal_x_m - true_x_m, goal_y_m - true_y_m))
            return
        speed_m_s = min(SPEED_M_S, max(SLOWEST_M_S, GAIN_PER_S * abs(way_m)))
        course_rad = math.atan2(way_m.imag, way_m.real) - yaw_rad
        ahead = Vector3(speed_m_s * math.cos(course_rad), speed_m_s * math.sin(course_rad))
        self._velocity(Twist(ahead, Vector3(z=-TURN_GAIN_PER_S * yaw_rad)))


def since(first: Truth, now: Truth) -> tuple[float, float]:
    """Return the true place from where the rover was at first."""
    x_m, y_m = now.x_m - first.x_m, now.y_m - first.y_m
    cosine, sine = math.cos(first.yaw_rad), math.sin(first.yaw_rad)
    return cosine * x_m + sine * y_m, -sine * x_m + cosine * y_m


def config_of(name: str) -> Config:
    """Return a shipped configuration under a planner; without slip compensation for wheels and gyro alone."""
    left_out = {"mission", "slip"} if name == PLAIN else {"mission"}
    table = load_config(CONFIGS[name]).model_dump(by_alias=True, exclude=left_out)
    return Config.model_validate(
        {
            **table,
            "mission": {"type": "by_hand", "speed_m_s": SPEED_M_S, "yaw_rate_limit_rad_s": 1.0},
            "ros2": {"domain": DOMAIN, "commands": True},
        }
    )


def drive(node: Node, path: Path, name: str) -> list[float]:
    """Drive to all goals; return the true distances from them in m, and check that the run replays."""
    config, clock, planner = config_of(name), PacedClock(), Planner(node)
    with Ros2Connection(config, lambda: clock.offset_ns) as connection:
        result = run_virtual(
            config, path, LIMIT_S, None, clock=clock, operator=Operators([connection, planner])
        )
    log = LogReader(path)
    with restore_config(log) as logged:
        differences = replay(log, logged, lambda: None).differences
    assert not differences, f"{path}: {len(differences)} fields differ in a replay"
    print(
        f"{name}: {len(planner.errors_m)} goals taken for reached in {result.duration_s:.0f} s, true "
        f"distances in cm {' '.join(f'{100 * each:.1f}' for each in planner.errors_m)}; {result.reason}; "
        "replay exact"
    )
    return planner.errors_m


def main() -> int:
    node = Node(Ros2Settings(domain=DOMAIN))
    names = sys.argv[1:] or list(CONFIGS)
    with tempfile.TemporaryDirectory() as folder:
        results = {
            name: drive(node, Path(folder) / f"{number}.mcap", name) for number, name in enumerate(names)
        }
    best_m = results.get(BEST, [])
    is_good = len(best_m) == len(GOALS_M) and max(best_m) <= BAR_M
    print("all within" if is_good else "NOT all within", f"{BAR_M:g} m of the goals by the {BEST}")
    return 0 if is_good else 1


if __name__ == "__main__":
    sys.exit(main())
