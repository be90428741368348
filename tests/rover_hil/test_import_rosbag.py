"""`rover-hil import rosbag` on bags of ROS 1 and ROS 2 that the library wrote, and on damaged ones."""

import math
import re
import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import cv2
import lz4.frame
import numpy as np
import pytest
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Ros2Writer
from rosbags.typesys import Stores, get_typestore

from drivers.errors import LogError
from rover_hil.config import load_config
from rover_hil.drives.drive import read_drive
from rover_hil.drives.files.csv_table import read_csv
from rover_hil.drives.formats.rosbag import bag as bag_module
from rover_hil.drives.formats.rosbag.topics import read_topics
from rover_hil.run.driving import run_virtual
from tests.cases import first_often
from tests.rover_hil.command import Command, assert_one_sentence

START_NS = 1_700_000_000_000_000_000
PERIOD_S = 0.02
CYCLES = 100
END_S = (CYCLES - 1) * PERIOD_S
RADIUS_M, BASE_M = 0.040, 0.125
SPEED_M_S, TURN_RAD_S = 0.2, 0.5
CIRCLE_M = SPEED_M_S / TURN_RAD_S
WHEEL_ANGLES = (math.radians(60.0), math.radians(180.0), math.radians(300.0))
"""Where the wheels of a Robotino stand; each rolls at a right angle to that, counter-clockwise."""
SPEEDS_RAD_S = [(TURN_RAD_S * BASE_M - math.sin(angle) * SPEED_M_S) / RADIUS_M for angle in WHEEL_ANGLES]


class Messages:
    """Messages of a drive on a circle, the nose ahead."""

    def __init__(self, store: Stores) -> None:
        self.store = get_typestore(store)
        self.types: Any = self.store.types
        self.is_ros1 = store is Stores.ROS1_NOETIC

    def header(self, t_ns: int) -> Any:
        stamp = self.types["builtin_interfaces/msg/Time"](sec=t_ns // 10**9, nanosec=t_ns % 10**9)
        more = {"seq": 0} if self.is_ros1 else {}
        return self.types["std_msgs/msg/Header"](stamp=stamp, frame_id="base_link", **more)

    def wheels(self, t_ns: int, t_s: float) -> Any:
        first, second, third = SPEEDS_RAD_S
        return self.types["sensor_msgs/msg/JointState"](
            header=self.header(t_ns),
            name=["third", "first", "second", "arm"],
            position=np.array([third * t_s, first * t_s, second * t_s, 9.0]),
            velocity=np.array([third, first, second, 9.0]),
            effort=np.array([0.3, 0.1, 0.2, 9.0]),
        )

    def pose(self, t_s: float) -> Any:
        yaw_rad = TURN_RAD_S * t_s
        return self.types["geometry_msgs/msg/Pose"](
            position=self.types["geometry_msgs/msg/Point"](
                x=CIRCLE_M * math.sin(yaw_rad), y=CIRCLE_M * (1.0 - math.cos(yaw_rad)), z=0.0
            ),
            orientation=self.quaternion(yaw_rad),
        )

    def quaternion(self, yaw_rad: float) -> Any:
        return self.types["geometry_msgs/msg/Quaternion"](
            x=0.0, y=0.0, z=math.sin(yaw_rad / 2), w=math.cos(yaw_rad / 2)
        )

    def truth(self, t_ns: int, t_s: float) -> Any:
        return self.types["geometry_msgs/msg/PoseStamped"](header=self.header(t_ns), pose=self.pose(t_s))

    def point(self, t_ns: int, t_s: float) -> Any:
        point = self.pose(t_s).position
        return self.types["geometry_msgs/msg/PointStamped"](header=self.header(t_ns), point=point)

    def odometry(self, t_ns: int, t_s: float) -> Any:
        zero = self.vector(0.0, 0.0, 0.0)
        twist = self.types["geometry_msgs/msg/Twist"](linear=zero, angular=zero)
        return self.types["nav_msgs/msg/Odometry"](
            header=self.header(t_ns),
            child_frame_id="base_link",
            pose=self.types["geometry_msgs/msg/PoseWithCovariance"](
                pose=self.pose(t_s), covariance=np.zeros(36)
            ),
            twist=self.types["geometry_msgs/msg/TwistWithCovariance"](twist=twist, covariance=np.zeros(36)),
        )

    def vector(self, x: float, y: float, z: float) -> Any:
        return self.types["geometry_msgs/msg/Vector3"](x=x, y=y, z=z)

    def imu(self, t_ns: int, t_s: float) -> Any:
        return self.types["sensor_msgs/msg/Imu"](
            header=self.header(t_ns),
            orientation=self.quaternion(TURN_RAD_S * t_s),
            orientation_covariance=np.zeros(9),
            angular_velocity=self.vector(0.01, -0.02, TURN_RAD_S),
            angular_velocity_covariance=np.zeros(9),
            linear_acceleration=self.vector(0.0, 0.1, 9.8),
            linear_acceleration_covariance=np.zeros(9),
        )

    def picture(self, t_ns: int, t_s: float) -> Any:
        image = np.full((48, 64, 3), 40 + int(20 * t_s), np.uint8)
        data = cv2.imencode(".jpg", image)[1].ravel()
        return self.types["sensor_msgs/msg/CompressedImage"](
            header=self.header(t_ns), format="jpeg", data=data
        )

    def currents(self, t_ns: int, t_s: float) -> Any:
        layout = self.types["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0)
        return self.types["std_msgs/msg/Float64MultiArray"](layout=layout, data=np.array([0.5, 0.6, 0.7]))

    def bytes(self, message: Any) -> Any:
        kind = message.__msgtype__
        if self.is_ros1:
            return self.store.serialize_ros1(message, kind)
        return self.store.serialize_cdr(message, kind)


TOPICS: dict[str, Callable[[Messages, int, float], Any]] = {
    "/joints": Messages.wheels,
    "/pose": Messages.truth,
    "/point": Messages.point,
    "/odom": Messages.odometry,
    "/imu/data": Messages.imu,
    "/camera/compressed": Messages.picture,
    "/currents": Messages.currents,
}
PLUGINS = {"mcap": StoragePlugin.MCAP, "sqlite3": StoragePlugin.SQLITE3}


def write_bag(path: Path, *, plugin: StoragePlugin | None = None, gap_s: float = 0.0) -> Path:
    """Write a bag with a message per topic and cycle, pictures every tenth; of ROS 1 without a plug-in."""
    messages = Messages(Stores.ROS1_NOETIC if plugin is None else Stores.ROS2_HUMBLE)
    writer: Any = Ros1Writer(path) if plugin is None else Ros2Writer(path, version=9, storage_plugin=plugin)
    with writer:
        connections: dict[str, Any] = {}
        for cycle in range(CYCLES):
            t_s = cycle * PERIOD_S
            t_ns = START_NS + round(1e9 * (t_s + (gap_s if cycle > CYCLES // 2 else 0.0)))
            for topic, make in TOPICS.items():
                if topic.startswith("/camera") and cycle % 10:
                    continue
                message = make(messages, t_ns, t_s)
                if topic not in connections:
                    connections[topic] = writer.add_connection(
                        topic, message.__msgtype__, typestore=messages.store
                    )
                writer.write(connections[topic], t_ns, messages.bytes(message))
    return path


WHEELS = """rover = "robotino"
[wheels]
topic = "/joints"
joints = ["first", "second", "third"]
"""
ALL = (
    WHEELS
    + """
[imu]
topic = "/imu/data"
use_orientation = true
[currents]
topic = "/currents"
[truth]
topic = "/pose"
[camera]
topic = "/camera/compressed"
"""
)
OF_AN_EXPORT = """rover = "robotino"
[wheels]
topic = "/joint_states"
joints = ["wheel1", "wheel2", "wheel3"]
[imu]
topic = "/imu/imu"
[truth]
topic = "/ground_truth"
"""


@pytest.fixture(scope="module", params=["ros1", *PLUGINS])
def any_bag(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp(request.param)
    name = "drive.bag" if request.param == "ros1" else "drive"
    return write_bag(folder / name, plugin=PLUGINS.get(request.param))


@pytest.fixture(scope="module")
def bag1(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_bag(tmp_path_factory.mktemp("bag1") / "drive.bag")


def import_it(command: Command, bag: Path, topics: str, *options: str) -> int:
    Path("topics.toml").write_text(topics, "utf-8")
    return command("import", "rosbag", str(bag), "--topics", "topics.toml", "--out", "drive.mcap", *options)


def test_every_kind_of_bag_becomes_a_log_that_replays(command: Command, any_bag: Path) -> None:
    assert import_it(command, any_bag, ALL) == 0, command.error
    assert "truth: 100 messages" in command.out
    assert "camera: 10 messages" in command.out
    drive = read_drive(Path("drive.mcap"))
    rows = drive.channels
    for wheel, speed_rad_s in enumerate(SPEEDS_RAD_S, start=1):
        assert rows[f"position{wheel}_rad"].value[-1] == pytest.approx(speed_rad_s * END_S, abs=1e-8)
        assert rows[f"speed{wheel}_rad_s"].value == pytest.approx(speed_rad_s, abs=1e-8)
        assert rows[f"current{wheel}_a"].value == pytest.approx(0.4 + 0.1 * wheel)
    assert rows["gyro_z_rad_s"].value == pytest.approx(TURN_RAD_S)
    assert rows["gyro_y_rad_s"].value == pytest.approx(-0.02)
    assert rows["heading_rad"].value[-1] == pytest.approx(TURN_RAD_S * END_S)
    true = drive.true_poses()
    assert len(true.t_ns) == CYCLES
    assert true.x_m[-1] == pytest.approx(CIRCLE_M * math.sin(TURN_RAD_S * END_S))
    assert true.yaw_rad[-1] == pytest.approx(TURN_RAD_S * END_S)
    assert drive.seconds(true.t_ns)[-1] == pytest.approx(END_S)
    assert command("replay", "drive.mcap") == 0
    assert "every output identical" in command.out


def test_points_are_ground_truth_without_yaw(command: Command, bag1: Path) -> None:
    assert import_it(command, bag1, WHEELS + '[truth]\ntopic = "/point"\n') == 0, command.error
    drive = read_drive(Path("drive.mcap"))
    assert drive.channels["x_m"].value[-1] == pytest.approx(CIRCLE_M * math.sin(TURN_RAD_S * END_S))
    assert "yaw_rad" not in drive.channels
    with pytest.raises(LogError, match="no yaw"):
        drive.true_poses()


def test_the_estimate_follows_the_circle(command: Command, bag1: Path) -> None:
    topics = WHEELS + '[imu]\ntopic = "/imu/data"\n[truth]\ntopic = "/pose"\n'
    assert import_it(command, bag1, topics) == 0
    assert command("export", "drive.mcap", "--csv") == 0
    table = read_csv(Path("drive_csv/estimate.csv"))
    last = {name: table.numbers(name)[-1] for name in ("estimate_x_m", "estimate_y_m")}
    yaw_rad = TURN_RAD_S * END_S
    assert last["estimate_x_m"] == pytest.approx(CIRCLE_M * math.sin(yaw_rad), abs=0.02)
    assert last["estimate_y_m"] == pytest.approx(CIRCLE_M * (1.0 - math.cos(yaw_rad)), abs=0.02)


def test_odometry_becomes_the_angles_that_give_it(command: Command, bag1: Path) -> None:
    assert import_it(command, bag1, 'rover = "robotino"\n[odometry]\ntopic = "/odom"\n') == 0
    rows = read_drive(Path("drive.mcap")).channels
    for wheel, speed_rad_s in enumerate(SPEEDS_RAD_S, start=1):
        # Chords of 0.57 degrees are shorter than their arcs by 4e-6.
        assert rows[f"position{wheel}_rad"].value[-1] == pytest.approx(speed_rad_s * END_S, rel=1e-4)


def test_effort_may_be_a_current_and_a_joint_may_count_backwards(command: Command, bag1: Path) -> None:
    assert import_it(command, bag1, WHEELS + "effort_is_current = true\nsigns = [1, 1, -1]\n") == 0
    rows = read_drive(Path("drive.mcap")).channels
    assert [rows[f"current{wheel}_a"].value[0] for wheel in (1, 2, 3)] == pytest.approx([0.1, 0.2, -0.3])
    assert rows["speed3_rad_s"].value[0] == pytest.approx(-SPEEDS_RAD_S[2])


def test_in_a_gap_of_the_bag_no_cycles_run(command: Command, tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "gap.bag", gap_s=50_000.0)
    assert import_it(command, bag, WHEELS) == 0
    assert command("replay", "drive.mcap") == 0
    assert int(command.out.split()[0]) <= CYCLES + 2


@pytest.mark.usefixtures("unrendered")
def test_a_run_survives_export_and_import(command: Command) -> None:
    run_virtual(load_config("robotino"), Path("run.mcap"), 6.0, None)
    assert command("export", "run.mcap", "--rosbag2") == 0
    assert import_it(command, Path("run_rosbag2"), OF_AN_EXPORT) == 0
    before, after = read_drive(Path("run.mcap")), read_drive(Path("drive.mcap"))
    for name in ("position1_rad", "position3_rad", "speed2_rad_s", "gyro_z_rad_s"):
        assert after.channels[name].value == pytest.approx(before.channels[name].value, abs=1e-9)
    was, now = before.true_poses(), after.true_poses()
    assert now.x_m == pytest.approx(was.x_m)
    assert now.yaw_rad == pytest.approx(was.yaw_rad)
    assert np.diff(now.t_ns) == pytest.approx(np.diff(was.t_ns))
    assert command("compare", "run.mcap", "drive.mcap", "--out", "compare.html") == 0


@pytest.mark.parametrize(
    ("topics", "words"),
    [
        (WHEELS.replace("/joints", "/nothing"), ("/nothing", "[wheels]", "/joints")),
        (WHEELS + '[imu]\ntopic = "/pose"\n', ("/pose", "PoseStamped", "sensor_msgs/msg/Imu")),
        (WHEELS.replace(', "third"', ""), ("2 joints", "3 wheels")),
        (WHEELS.replace("third", "fourth"), ("/joints has no joints fourth", "third", "[wheels]")),
        ('rover = "robotino"\n', ("[wheels]", "[odometry]")),
        (WHEELS + '[odometry]\ntopic = "/odom"\n', ("[wheels]", "[odometry]")),
        (WHEELS + '[gps]\ntopic = "/fix"\n', ("gps",)),
        (WHEELS + '[truth]\ntopic = "/joints"\n', ("two sections", "/joints")),
        (WHEELS + "signs = [1]\n", ("1 signs", "3 joints")),
        (WHEELS.replace("robotino", "nobody"), ("nobody",)),
    ],
)
def test_wrong_topics_are_one_sentence(
    command: Command, bag1: Path, topics: str, words: tuple[str, ...]
) -> None:
    assert import_it(command, bag1, topics) == 2
    assert_one_sentence(command.error, *words)
    assert not Path("drive.mcap").exists()


def test_the_files_of_topics_in_the_how_to_are_valid(tmp_path: Path) -> None:
    page = (Path(__file__).parents[2] / "docs" / "how-to" / "import_a_bag.md").read_text("utf-8")
    blocks = re.findall(r"^```toml\n(.*?)^```", page, re.MULTILINE | re.DOTALL)
    assert len(blocks) == 2
    for block in blocks:
        (tmp_path / "topics.toml").write_text(block, "utf-8")
        read_topics(tmp_path / "topics.toml")


def test_a_missing_bag_and_other_files_are_one_sentence(command: Command, tmp_path: Path) -> None:
    assert import_it(command, tmp_path / "nowhere.bag", WHEELS) == 2
    assert_one_sentence(command.error, "nowhere.bag")
    (tmp_path / "text.txt").write_text("no bag", "utf-8")
    (tmp_path / "empty").mkdir()
    for name in ("text.txt", "empty"):
        assert import_it(command, tmp_path / name, WHEELS) == 2
        assert_one_sentence(command.error, name, "no bag")


@pytest.mark.parametrize("share", [0.0, 0.3, 0.9])
def test_a_bag_that_was_cut_off_is_one_sentence(command: Command, any_bag: Path, share: float) -> None:
    cut = Path("cut.bag" if any_bag.is_file() else "cut")
    if any_bag.is_file():
        data = any_bag.read_bytes()
        cut.write_bytes(data[: int(share * len(data))])
    else:
        cut.mkdir()
        for part in any_bag.iterdir():
            data = part.read_bytes()
            keep = len(data) if part.suffix == ".yaml" else int(share * len(data))
            (cut / part.name).write_bytes(data[:keep])
    if share > 0.0 and any(cut.glob("*.mcap")):
        assert import_it(command, cut, WHEELS) == 0, command.error
        assert "read as far as it is intact" in command.out
        return
    assert import_it(command, cut, WHEELS) == 2
    assert_one_sentence(command.error, "cut")
    assert not Path("drive.mcap").exists()


@pytest.mark.parametrize("seed", first_often(range(6)))
def test_overwritten_bytes_never_end_in_a_traceback(command: Command, any_bag: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    folder = Path("broken")
    folder.mkdir()
    for part in [any_bag] if any_bag.is_file() else sorted(any_bag.iterdir()):
        data = bytearray(part.read_bytes())
        for place in rng.integers(0, len(data), 30):
            data[place] = rng.integers(0, 256)
        (folder / part.name).write_bytes(data)
    code = import_it(command, folder / any_bag.name if any_bag.is_file() else folder, ALL)
    assert code in (0, 2)
    if code == 2:
        assert_one_sentence(command.error)


def test_a_large_message_is_refused(command: Command, bag1: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bag_module, "MOST_MESSAGE_BYTES", 100)
    assert import_it(command, bag1, WHEELS) == 2
    assert_one_sentence(command.error, "100 are allowed")


def test_a_bag_that_unpacks_to_more_than_the_memory_is_refused(
    command: Command, bag1: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its chunks hold zeros: packed 2 MB each, unpacked 400."""
    packed = lz4.frame.compress(bytes(400 * 2**20))
    unpack = {"none": lambda data: lz4.frame.decompress(packed)}
    monkeypatch.setattr("rosbags.rosbag1.reader.decompressors", unpack)
    assert import_it(command, bag1, WHEELS, "--most-memory-gb", "0.15") == 2
    assert_one_sentence(command.error, "0.15 GB of memory", "--most-memory-gb")


@pytest.mark.parametrize("time", ["yesterday", 1.5])
def test_a_ros2_bag_whose_time_is_no_number_is_one_sentence(
    command: Command, tmp_path: Path, time: object
) -> None:
    """SQLite stores a text in a column of numbers."""
    bag = write_bag(tmp_path / "drive", plugin=StoragePlugin.SQLITE3)
    with closing(sqlite3.connect(next(bag.glob("*.db3")))) as database:
        database.execute("UPDATE messages SET timestamp = ? WHERE id > 20", (time,))
        database.commit()
    assert import_it(command, bag, WHEELS) == 2
    assert_one_sentence(command.error, "is damaged")
    assert not Path("drive.mcap").exists()
