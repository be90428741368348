"""Bags with positions, poses with covariance, steering, and trackers that lose the rover."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pymap3d import enu2geodetic
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Ros2Writer
from rosbags.typesys import Stores

from rover_hil.drives.drive import read_drive
from rover_hil.drives.files.csv_table import read_csv
from rover_hil.drives.formats.fixes import lost_poses
from tests.rover_hil.command import Command, assert_one_sentence
from tests.rover_hil.test_import_rosbag import START_NS, Messages

RADIUS_M, BASE_M = 0.1, 0.6
SPEED_M_S, TURN_RAD_S = 0.5, 0.1
STEER_RAD = math.atan2(TURN_RAD_S * BASE_M, SPEED_M_S)
RATE_HZ, END_S = 20, 60.0
ORIGIN_DEG = (48.1, 11.6)
TOO_FAR = 1.05
"""The wheel seems to turn so much more than the rover drives."""
ROVER = f"""schema = "rover-hil-config/1"
[rover]
kinematics = "wheels"
wheels = [
  {{ x_m = 0.0, y_m = 0.0, radius_m = {RADIUS_M} }},
  {{ x_m = {BASE_M}, y_m = 0.0, radius_m = {RADIUS_M}, driven = false, measured = false, steering = {{ low_deg = -60, high_deg = 60 }} }},
]
[loop]
rate_hz = 20
[limits]
wheel_speed_rad_s = 30
wheel_acceleration_rad_s2 = 100
[roles]
wheels = "bus"
[devices.bus]
type = "can_wheels"
interface = "virtual"
channel = "bag"
mapping = "MAPPING"
"""  # noqa: E501
TOPICS = """rover = "rover.toml"
[wheels]
topic = "/joint_states"
joints = ["rear", ""]
steering = ["", "steer"]
[truth]
topic = "/mocap"
"""
Change = Callable[[float, Any], Any]


def true_pose(t_s: float) -> tuple[float, float, float]:
    yaw_rad, radius_m = TURN_RAD_S * t_s, SPEED_M_S / TURN_RAD_S
    return radius_m * math.sin(yaw_rad), radius_m * (1.0 - math.cos(yaw_rad)), yaw_rad


class Drive(Messages):
    """Messages of a bicycle on a circle of 5 m."""

    def __init__(self) -> None:
        super().__init__(Stores.ROS2_HUMBLE)
        self.rng = np.random.default_rng(7)

    def joints(self, t_ns: int, t_s: float) -> Any:
        return self.types["sensor_msgs/msg/JointState"](
            header=self.header(0),
            name=["steer", "rear"],
            position=np.array([STEER_RAD, math.nan]),
            velocity=np.array([0.0, TOO_FAR * SPEED_M_S / RADIUS_M]),
            effort=np.array([]),
        )

    def pose_of(self, x_m: float, y_m: float, yaw_rad: float) -> Any:
        point = self.types["geometry_msgs/msg/Point"](x=x_m, y=y_m, z=0.0)
        return self.types["geometry_msgs/msg/Pose"](position=point, orientation=self.quaternion(yaw_rad))

    def mocap(self, t_ns: int, t_s: float) -> Any:
        x_m, y_m, yaw_rad = true_pose(t_s)
        noise_m = 1e-4 * self.rng.standard_normal(2)
        pose = self.pose_of(x_m + noise_m[0], y_m + noise_m[1], yaw_rad)
        return self.types["geometry_msgs/msg/PoseStamped"](header=self.header(t_ns), pose=pose)

    def covariance_pose(self, t_ns: int, t_s: float, std_m: float = 0.02) -> Any:
        covariance = np.zeros(36)
        covariance[[0, 7, 35]] = std_m**2, std_m**2, 0.02**2
        pose = self.types["geometry_msgs/msg/PoseWithCovariance"](
            pose=self.pose_of(*true_pose(t_s)), covariance=covariance
        )
        return self.types["geometry_msgs/msg/PoseWithCovarianceStamped"](header=self.header(0), pose=pose)

    def satellites(self, t_ns: int, t_s: float, arm_m: tuple[float, float] = (0.3, 0.2)) -> Any:
        x_m, y_m, yaw_rad = true_pose(t_s)
        x_m += math.cos(yaw_rad) * arm_m[0] - math.sin(yaw_rad) * arm_m[1]
        y_m += math.sin(yaw_rad) * arm_m[0] + math.cos(yaw_rad) * arm_m[1]
        # The rover starts to the north-east.
        east_m, north_m = 2**-0.5 * (x_m - y_m), 2**-0.5 * (x_m + y_m)
        latitude, longitude, _ = enu2geodetic(east_m, north_m, 0.0, *ORIGIN_DEG, 0.0)
        return self.types["sensor_msgs/msg/NavSatFix"](
            header=self.header(0),
            status=self.types["sensor_msgs/msg/NavSatStatus"](status=0, service=1),
            latitude=float(latitude),
            longitude=float(longitude),
            altitude=0.0,
            position_covariance=np.diag((4e-4, 4e-4, 1.0)).ravel(),
            position_covariance_type=2,
        )


def write_bag(path: Path, topics: dict[str, tuple[int, Callable[[int, float], Any]]], drive: Drive) -> None:
    """Write a bag; each topic has every n-th message."""
    with Ros2Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connections: dict[str, Any] = {}
        for cycle in range(int(END_S * RATE_HZ) + 1):
            t_s = cycle / RATE_HZ
            t_ns = START_NS + round(1e9 * t_s)
            for topic, (every, make) in topics.items():
                if cycle % every:
                    continue
                message = make(t_ns, t_s)
                if topic not in connections:
                    connections[topic] = writer.add_connection(
                        topic, message.__msgtype__, typestore=drive.store
                    )
                writer.write(connections[topic], t_ns, drive.bytes(message))


def import_it(command: Command, topics: str, more: dict[str, tuple[int, Callable[[int, float], Any]]]) -> int:
    drive = Drive()
    write_bag(Path("bag"), {"/joint_states": (1, drive.joints), "/mocap": (2, drive.mocap), **more}, drive)
    mapping = Path("mapping")
    mapping.mkdir()
    examples = Path(__file__).parents[2] / "docs" / "examples" / "can"
    for file in examples.glob("differential.*"):
        (mapping / file.name).write_bytes(file.read_bytes())
    text = (mapping / "differential.toml").read_text("utf-8")
    head, last = text.rsplit("[[wheel]]", 1)
    (mapping / "differential.toml").write_text(f"{head}[[wheel]]\nmeasured = false{last}", "utf-8")
    Path("rover.toml").write_text(ROVER.replace("MAPPING", str(mapping / "differential.toml")), "utf-8")
    Path("topics.toml").write_text(topics, "utf-8")
    return command("import", "rosbag", "bag", "--topics", "topics.toml", "--out", "drive.mcap")


def errors_m(command: Command, source: str = "estimate") -> np.ndarray:
    """Return the distances of the estimate, or of the wheels, from the true places, from their beginning."""
    assert command("replay", "drive.mcap", "--out", f"report_{source}") == 0, command.error
    assert "every output identical" in command.out
    assert command("export", "drive.mcap", "--csv", "--force") == 0, command.error
    table = read_csv(Path("drive_csv/estimate.csv"))
    t_s, x_m, y_m = (table.numbers(name) for name in (table.names[0], f"{source}_x_m", f"{source}_y_m"))
    true = np.array([true_pose(t) for t in t_s - t_s[0]])
    errors: np.ndarray = np.hypot(x_m - true[:, 0], y_m - true[:, 1])
    return errors


@pytest.mark.usefixtures("unrendered")
def test_steering_and_a_wheel_with_a_speed_only(command: Command) -> None:
    assert import_it(command, TOPICS, {}) == 0, command.error
    rows = read_drive(Path("drive.mcap")).channels
    assert rows["steer2_rad"].value == pytest.approx(STEER_RAD)
    assert rows["speed1_rad_s"].value == pytest.approx(TOO_FAR * SPEED_M_S / RADIUS_M)
    # Half of the circle too far; the stamps of the headers are zero.
    assert 0.5 < errors_m(command).max() < 2.0


@pytest.mark.usefixtures("unrendered")
def test_poses_with_covariance_correct_the_estimate(command: Command) -> None:
    fixes = '[fixes]\ntopic = "/pose"\n'
    assert import_it(command, TOPICS + fixes, {"/pose": (10, Drive().covariance_pose)}) == 0, command.error
    assert "fixes: 121 messages" in command.out
    assert errors_m(command)[200:].max() < 0.1
    # Two a second that err alike for 3 s count as one in twelve.
    table = read_csv(Path("drive_csv/pose_fixes.csv"))
    assert table.numbers("position_std_m")[1:] == pytest.approx(0.02 * math.sqrt(12.0))


@pytest.mark.slow
@pytest.mark.usefixtures("unrendered")
def test_positions_of_a_receiver_correct_the_estimate(command: Command) -> None:
    fixes = '[fixes]\ntopic = "/fix"\nmarker = { x_m = 0.3, y_m = 0.2 }\n'
    assert import_it(command, TOPICS + fixes, {"/fix": (10, Drive().satellites)}) == 0, command.error
    assert errors_m(command)[-400:].max() < 0.5 * errors_m(command, "odometry")[-400:].max()


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('steering = ["", "steer"]\n', "", ("wheel 1 steers", "wheels.steering")),
        ('"", "steer"', '"", "stear"', ("no joints stear", "rear")),
        ('"", "steer"', '"", "rear"', ("no angles of rear", "wheels.steering")),
        ('"", "steer"', '"steer"', ("1 names in steering for 2 joints",)),
        ('"rear", ""', '"rear", "steer"', ("no encoder has wheel 1", "measured = false")),
    ],
)
def test_wrong_steering_is_one_sentence(command: Command, old: str, new: str, words: tuple[str, ...]) -> None:
    assert import_it(command, TOPICS.replace(old, new), {}) == 2
    assert_one_sentence(command.error, *words)
    assert not Path("drive.mcap").exists()


def lost(kind: str) -> Callable[[Drive], Callable[[int, float], Any]]:
    def make(drive: Drive) -> Callable[[int, float], Any]:
        def mocap(t_ns: int, t_s: float) -> Any:
            if not 20.0 < t_s < 25.0:
                return drive.mocap(t_ns, t_s)
            pose = drive.pose_of(*(true_pose(20.0) if kind == "repeats" else (0.0, 0.0, 0.0)))
            return drive.types["geometry_msgs/msg/PoseStamped"](header=drive.header(t_ns), pose=pose)

        return mocap

    return make


@pytest.mark.parametrize(("kind", "words"), [("repeats", "repeat one before"), ("unit", "unit poses")])
def test_a_tracker_that_has_lost_the_rover_is_no_truth(command: Command, kind: str, words: str) -> None:
    drive = Drive()
    assert import_it(command, TOPICS, {"/mocap": (2, lost(kind)(drive))}) == 0, command.error
    assert words in command.out
    poses = read_drive(Path("drive.mcap")).true_poses()
    t_s = (poses.t_ns - poses.t_ns[0]) / 1e9
    true = np.array([true_pose(t) for t in t_s])
    assert np.hypot(poses.x_m - true[:, 0], poses.y_m - true[:, 1]).max() < 0.06
    # The first pose that is held differs from the one before.
    assert len(t_s) == (553 if kind == "repeats" else 552)
    assert command("replay", "drive.mcap", "--json") == 0


def test_a_rest_and_a_start_at_zero_are_not_lost() -> None:
    x_m = np.concatenate(
        (np.zeros(50), np.linspace(0.0, 5.0, 200), np.full(100, 5.0), np.linspace(5.0, 6.0, 40))
    )
    repeats, units = lost_poses(x_m, np.zeros_like(x_m), np.zeros_like(x_m))
    assert not repeats.any()
    assert not units.any()
