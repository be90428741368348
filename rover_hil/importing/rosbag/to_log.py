"""Write a bag as a log: its numbers pass through the codecs of a rover's devices, and replay like a run."""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from controllers.control_loop import StepOutput
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
from rover_hil.importing.rosbag.joints import Joint, JointSurvey, values_of
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
MOST_NOTES = 20
FRAME_RATE_HZ = 5.0


@dataclass
class Contents:
    """What of a bag was used.

    Attributes:
        used: Number of messages by section.
        left_out: Number of messages that held no usable numbers, by section.
        outside: Number of messages left out because the clock was not set when they were recorded.
        notes: What a user must know of the joints and of the estimate, one sentence each.
        end_ns: Time of the last cycle.
    """

    used: dict[str, int] = field(default_factory=dict)
    left_out: dict[str, int] = field(default_factory=dict)
    outside: int = 0
    notes: list[str] = field(default_factory=list)
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
        survey = _survey(bag, topics, rover)
        joints = (Joint(has_angle=True),) * kinematics.wheel_count if survey is None else survey.joints
        picture = next(bag.messages("camera"), None) if topics.camera is not None else None
        config = _config(topics, rover, Path(folder), joints, picture)
        clock = VirtualClock(START_NS)
        config_json = config.model_dump_json(by_alias=True).encode()
        with LogWriter(
            out, START_NS, config_json, collect_data_files(config), f"imported from {path.name}"
        ) as log:
            rig, links = build_replay_rig(config, clock, log)
            rig.connect(timeout_s=0.0)
            feeder = _Feeder(topics, links, kinematics, joints)
            feeder.contents.outside = bag.outside
            feeder.contents.notes.extend(() if survey is None else survey.notes)
            doubts = _Doubts(feeder.contents)
            for tick_ns, messages in _by_cycle(bag.messages(), nanoseconds(1.0 / config.loop.rate_hz)):
                truths = [record for message in messages for record in feeder.feed(message)]
                clock.sleep_until(tick_ns)
                samples = rig.poll()
                output = rig.loop.step(tick_ns, samples)
                log.samples(tick_ns, samples)
                log.estimate(output)
                doubts.take(output)
                for record in truths:
                    log.write_json(TRUTH, record["t_ns"], record)
                log.write_json(CYCLE, tick_ns, {"late_ns": 0, "work_ns": 0})
                feeder.contents.end_ns = tick_ns
                yield feeder.contents
    if not feeder.contents.used.keys() & {"wheels", "odometry"}:
        raise LogError(f"{path}: no message of the wheels holds numbers: name another topic")


def _check_wheels(topics: Topics, count: int) -> None:
    joints = () if topics.wheels is None else topics.wheels.joints
    if joints and len(joints) != count:
        raise LogError(
            f"[wheels] names {len(joints)} joints, but {topics.rover} has {count} wheels: name one for each"
        )


def _survey(bag: Bag, topics: Topics, rover: Config) -> JointSurvey | None:
    if topics.wheels is None:
        return None
    return JointSurvey(topics.wheels, rover.limits.wheel_speed_rad_s, bag.messages("wheels"), bag.duration_ns)


def _config(
    topics: Topics, rover: Config, folder: Path, joints: Sequence[Joint], picture: BagMessage | None
) -> Config:
    signs = () if topics.wheels is None else topics.wheels.signs
    mapping = write_mapping(folder, [joint.wrap_rad for joint in joints], _quantities(topics), signs)
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
    if picture is not None:
        height, width = _picture(picture).image.shape[:2]
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


def _quantities(topics: Topics) -> tuple[str, ...]:
    by_effort = topics.wheels is not None and topics.wheels.effort_is_current
    current = ("Current",) if by_effort or topics.currents is not None else ()
    return ("Position", *(() if topics.wheels is None else ("Speed",)), *current)


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


class _Doubts:
    """Notes when the estimate loses motion, and when something contradicts the wheels."""

    def __init__(self, contents: Contents) -> None:
        self._contents = contents
        self._rebases = 0
        self._known: set[str] = set()

    def take(self, output: StepOutput) -> None:
        """Take the output of one cycle."""
        t_s = (output.t_ns - START_NS) / NANOSECONDS_PER_SECOND
        if output.odometry_rebases > self._rebases:
            self._rebases = output.odometry_rebases
            self._note(
                f"odometry began anew at {t_s:.1f} s: the motion before is unknown, the estimate is wider"
            )
        if output.suspicion and output.suspicion not in self._known:
            self._known.add(output.suspicion)
            self._note(f"at {t_s:.1f} s: {output.suspicion}")

    def _note(self, text: str) -> None:
        notes = self._contents.notes
        if len(notes) < MOST_NOTES:
            notes.append(text)
        elif len(notes) == MOST_NOTES:
            notes.append("more of these follow")


class _Feeder:
    """Turns messages into what the devices would have sent."""

    def __init__(
        self, topics: Topics, links: ReplayLinks, kinematics: Kinematics, joints: Sequence[Joint]
    ) -> None:
        self.contents = Contents()
        self._joints = joints
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
        if topic is None:
            return False
        columns = zip(*(values_of(state, name) for name in topic.joints), strict=True)
        angles, speeds, efforts = columns
        angles_used = [
            angle if joint.has_angle else math.nan for angle, joint in zip(angles, self._joints, strict=True)
        ]
        used = self._put_wheels(t_ns, "Position", angles_used)
        used |= self._put_wheels(t_ns, "Speed", speeds)
        if topic.effort_is_current:
            used |= self._put_wheels(t_ns, "Current", efforts)
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
