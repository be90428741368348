"""Write a bag as a log: its numbers pass through the codecs of a rover's devices, and replay like a run."""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from controllers.motion.kinematics import Kinematics, make_kinematics
from drivers.angles import wrap_rad
from drivers.camera.settings import CameraSettings
from drivers.can_wheels.settings import CanWheelsSettings
from drivers.clock import NANOSECONDS_PER_SECOND, VirtualClock, nanoseconds
from drivers.errors import LogError
from drivers.link import CameraImage, Received
from drivers.registry import AnyDeviceSettings
from drivers.xsens.settings import XsensSettings
from rover_hil.config import Config, RoleSettings
from rover_hil.importing.rosbag.bag import Bag, BagMessage
from rover_hil.importing.rosbag.imu_message import imu_bytes
from rover_hil.importing.rosbag.topics import ODOMETRY, Topics
from rover_hil.importing.rosbag.wheel_frames import wheel_frame, write_mapping
from rover_hil.recording.data_files import collect_data_files
from rover_hil.recording.images import decode_picture
from rover_hil.recording.schema import CYCLE, TRUTH, TruthRecord
from rover_hil.recording.writer import LogWriter
from rover_hil.run.composition import ReplayLinks, build_replay_rig

WHEELS, IMU, CAMERA = "wheels", "imu", "camera"
"""Names of the devices."""
START_NS = NANOSECONDS_PER_SECOND
"""Time given to the first message: not zero, so that an unset time stamp cannot pass for a real one."""
SILENT_S = 2.0
"""Other programs record slower than our drivers."""
LONGEST_GAP_NS = NANOSECONDS_PER_SECOND
"""In a longer gap of the bag no cycles run."""
LARGEST_PIXELS = 8192
FRAME_RATE_HZ = 5.0


@dataclass
class Contents:
    """What of a bag was used.

    Attributes:
        used: Number of messages by section.
        left_out: Number of messages that held no usable numbers, by section.
        end_ns: Time of the last cycle.
    """

    used: dict[str, int] = field(default_factory=dict)
    left_out: dict[str, int] = field(default_factory=dict)
    end_ns: int = START_NS

    def count(self, section: str, *, is_used: bool) -> None:
        """Count a message."""
        counts = self.used if is_used else self.left_out
        counts[section] = counts.get(section, 0) + 1


def write_bag_as_log(path: Path, topics: Topics, rover: Config, out: Path) -> Iterator[Contents]:
    """Write the log `out` of a bag, cycle by cycle; yields what was used so far.

    Args:
        path: The bag.
        topics: What of it is used.
        rover: Configuration of the rover; its devices and its mission are not used.
        out: The log; must not exist.

    Raises:
        LogError: The bag cannot be read, or does not fit the rover.
    """
    kinematics = make_kinematics(rover.rover)
    _check_wheels(topics, kinematics.wheel_count)
    bag = Bag(path, topics)
    with TemporaryDirectory(prefix="rover_hil_") as folder:
        first = _first_messages(bag)
        config = _config(topics, rover, Path(folder), first, kinematics.wheel_count)
        clock = VirtualClock(START_NS)
        config_json = config.model_dump_json(by_alias=True).encode()
        with LogWriter(
            out, START_NS, config_json, collect_data_files(config), f"imported from {path.name}"
        ) as log:
            rig, links = build_replay_rig(config, clock, log)
            rig.connect(timeout_s=0.0)
            feeder = _Feeder(topics, links, kinematics)
            for tick_ns, messages in _by_cycle(bag.messages(), nanoseconds(1.0 / config.loop.rate_hz)):
                truths = [record for message in messages for record in feeder.feed(message)]
                clock.sleep_until(tick_ns)
                samples = rig.poll()
                output = rig.loop.step(tick_ns, samples)
                log.samples(tick_ns, samples)
                log.estimate(output)
                for record in truths:
                    log.write_json(TRUTH, record["t_ns"], record)
                log.write_json(CYCLE, tick_ns, {"late_ns": 0, "work_ns": 0})
                feeder.contents.end_ns = tick_ns
                yield feeder.contents
    if not feeder.contents.used.keys() & {"wheels", "odometry"}:
        _check_joints(path, topics, feeder.joints)
        raise LogError(f"{path}: no message of the wheels holds numbers: name another topic")


def _check_joints(path: Path, topics: Topics, joints: Sequence[str]) -> None:
    named = () if topics.wheels is None else topics.wheels.joints
    missing = ", ".join(name for name in named if name not in joints)
    if topics.wheels is not None and joints and missing:
        raise LogError(
            f"{path}: {topics.wheels.topic} has no joints {missing}; its joints are {', '.join(joints)}: "
            "correct [wheels]"
        )


def _check_wheels(topics: Topics, count: int) -> None:
    joints = () if topics.wheels is None else topics.wheels.joints
    if joints and len(joints) != count:
        raise LogError(
            f"[wheels] names {len(joints)} joints, but {topics.rover} has {count} wheels: name one for each"
        )


def _first_messages(bag: Bag) -> dict[str, BagMessage]:
    """Return the first message of each section; those of the wheels and of the camera decide the devices."""
    wanted = bag.sections & {"wheels", "camera"}
    first: dict[str, BagMessage] = {}
    for message in bag.messages():
        if wanted <= first.keys():
            break
        first.setdefault(message.section, message)
    return first


def _config(
    topics: Topics, rover: Config, folder: Path, first: dict[str, BagMessage], wheel_count: int
) -> Config:
    mapping = write_mapping(
        folder, wheel_count, _quantities(topics, first), () if topics.wheels is None else topics.wheels.signs
    )
    devices: dict[str, AnyDeviceSettings] = {
        WHEELS: CanWheelsSettings(
            interface="virtual", channel="bag", mapping=str(mapping), max_age_s=SILENT_S
        )
    }
    headings: tuple[str, ...] = ()
    if topics.imu is not None:
        devices[IMU] = XsensSettings(
            port="bag", max_age_s=SILENT_S, heading_reference=topics.imu.heading_reference
        )
        headings = (IMU,) if topics.imu.use_orientation else ()
    if "camera" in first:
        height, width = _picture(first["camera"]).image.shape[:2]
        if not 0 < max(width, height) <= LARGEST_PIXELS:
            raise LogError("[camera]: the first picture of the topic cannot be decoded: name another topic")
        devices[CAMERA] = CameraSettings(
            type="camera",
            source="folder",
            path="bag",
            width=width,
            height=height,
            frame_rate_hz=FRAME_RATE_HZ,
            max_age_s=SILENT_S,
        )
    roles = RoleSettings(wheels=WHEELS, gyro=IMU if IMU in devices else None, headings=headings)
    none = dict.fromkeys(("mission", "slip", "scomp", "simulation", "tune"))
    return rover.model_copy(update={"devices": devices, "roles": roles, **none})


def _quantities(topics: Topics, first: dict[str, BagMessage]) -> tuple[str, ...]:
    current = ("Current",) if topics.currents is not None else ()
    if topics.wheels is None:
        return ("Position", *current)
    if "wheels" not in first:
        raise LogError(f"topic {topics.wheels.topic} holds no message: name another topic")
    state = first["wheels"].content
    found = [
        name
        for name, values in (("Position", state.position), ("Speed", state.velocity))
        if len(values) and np.isfinite(values).any()
    ]
    if not found:
        raise LogError(f"topic {topics.wheels.topic} holds neither angles nor speeds: name another topic")
    return (*found, *(("Current",) if topics.wheels.effort_is_current else current))


def _by_cycle(messages: Iterable[BagMessage], period_ns: int) -> Iterator[tuple[int, list[BagMessage]]]:
    """Yield the time of each cycle and the messages that have come since the one before."""
    tick_ns = START_NS
    waiting: list[BagMessage] = []
    for message in messages:
        t_ns = START_NS + message.t_ns
        if t_ns - tick_ns > LONGEST_GAP_NS:
            if waiting:
                yield tick_ns, waiting
            waiting, tick_ns = [], t_ns
        while t_ns > tick_ns:
            yield tick_ns, waiting
            waiting, tick_ns = [], tick_ns + period_ns
        waiting.append(message)
    if waiting:
        yield tick_ns, waiting


class _Feeder:
    """Turns messages into what the devices would have sent."""

    def __init__(self, topics: Topics, links: ReplayLinks, kinematics: Kinematics) -> None:
        self.contents = Contents()
        self.joints: tuple[str, ...] = ()
        self._topics = topics
        self._links = links
        self._kinematics = kinematics
        self._pose: tuple[float, float, float] | None = None
        self._angles_rad = [0.0] * kinematics.wheel_count

    def feed(self, message: BagMessage) -> Iterator[TruthRecord]:
        """Feed one message into the links; yields the true pose that it holds, if any."""
        t_ns = START_NS + message.t_ns
        content, is_used = message.content, False
        match message.section:
            case "wheels":
                is_used = self._feed_wheels(t_ns, content)
            case "odometry":
                is_used = self._feed_odometry(t_ns, content)
            case "currents":
                is_used = self._put_wheels(t_ns, "Current", np.asarray(content.data, np.float64).tolist())
            case "imu":
                is_used = self._feed_imu(t_ns, content)
            case "camera":
                is_used = self._feed_picture(t_ns, message)
            case "truth":
                pose = plane_pose(message.kind, content)
                is_used = pose is not None
                if pose is not None:
                    x_m, y_m, yaw_rad = pose
                    yield {"t_ns": t_ns, "x_m": x_m, "y_m": y_m, "yaw_rad": yaw_rad, "is_new": True}
        self.contents.count(message.section, is_used=is_used)

    def _feed_wheels(self, t_ns: int, state: Any) -> bool:
        topic = self._topics.wheels
        self.joints = tuple(state.name)
        if topic is None or any(name not in state.name for name in topic.joints):
            return False
        places = [list(state.name).index(name) for name in topic.joints]
        used = False
        for quantity, values in (
            ("Position", state.position),
            ("Speed", state.velocity),
            ("Current", state.effort if topic.effort_is_current else ()),
        ):
            if len(values) == len(state.name):
                used |= self._put_wheels(t_ns, quantity, [float(values[place]) for place in places])
        return used

    def _feed_odometry(self, t_ns: int, content: Any) -> bool:
        pose = plane_pose(ODOMETRY, content)
        if pose is None:
            return False
        if self._pose is not None:
            middle_rad = self._pose[2] + 0.5 * wrap_rad(pose[2] - self._pose[2])
            x_m, y_m = pose[0] - self._pose[0], pose[1] - self._pose[1]
            cos, sin = math.cos(middle_rad), math.sin(middle_rad)
            turned = self._kinematics.wheel_speeds(
                cos * x_m + sin * y_m, cos * y_m - sin * x_m, wrap_rad(pose[2] - self._pose[2])
            )
            self._angles_rad = [angle + step for angle, step in zip(self._angles_rad, turned, strict=True)]
        self._pose = pose
        return self._put_wheels(t_ns, "Position", self._angles_rad)

    def _put_wheels(self, t_ns: int, quantity: str, values: Sequence[float]) -> bool:
        if len(values) != len(self._angles_rad):
            return False
        used = False
        for wheel, value in enumerate(values):
            if math.isfinite(value):
                frame = wheel_frame(quantity, wheel, value)
                self._links.bytes_links[WHEELS].feed(Received(t_ns, frame))
                used = True
        return used

    def _feed_imu(self, t_ns: int, content: Any) -> bool:
        rate, acceleration, turned = (
            content.angular_velocity,
            content.linear_acceleration,
            content.orientation,
        )
        rates = (rate.x, rate.y, rate.z)
        if not all(map(math.isfinite, rates)) or content.angular_velocity_covariance[0] == -1.0:
            return False
        accelerations = (acceleration.x, acceleration.y, acceleration.z)
        has_acceleration = content.linear_acceleration_covariance[0] != -1.0
        topic = self._topics.imu
        has_orientation = (
            topic is not None and topic.use_orientation and content.orientation_covariance[0] != -1.0
        )
        data = imu_bytes(
            rates,
            accelerations if has_acceleration else None,
            (turned.w, turned.x, turned.y, turned.z) if has_orientation else None,
        )
        self._links.bytes_links[IMU].feed(Received(t_ns, data))
        return True

    def _feed_picture(self, t_ns: int, message: BagMessage) -> bool:
        image = _picture(message)
        self._links.image_links[CAMERA].feed(Received(t_ns, image))
        return bool(image.image.size)


def plane_pose(kind: str, content: Any) -> tuple[float, float, float] | None:
    """Return x and y in m and yaw in rad of a message with a pose; None where it holds no finite one."""
    if kind.endswith("TransformStamped"):
        place, turned = content.transform.translation, content.transform.rotation
    else:
        pose = content.pose if kind.endswith("PoseStamped") else content.pose.pose
        place, turned = pose.position, pose.orientation
    w, x, y, z = turned.w, turned.x, turned.y, turned.z
    numbers = (place.x, place.y, w, x, y, z)
    # A quaternion of zeros is what a message holds whose orientation nobody filled in.
    if not all(map(math.isfinite, numbers)) or not 0.5 < w * w + x * x + y * y + z * z < 2.0:
        return None
    yaw_rad = math.atan2(2.0 * (w * z + x * y), w * w + x * x - y * y - z * z)
    return place.x, place.y, yaw_rad


def _picture(message: BagMessage) -> CameraImage:
    """Return the picture of a message; one without pixels where it cannot be decoded."""
    stamp_ns = None if message.stamp_ns is None else START_NS + message.stamp_ns
    return decode_picture(stamp_ns, message.content.data.tobytes())
