"""Write a bag as a log: its numbers pass through the codecs of a rover's devices, and replay like a run."""

import math
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from controllers.motion.kinematics import Kinematics, make_kinematics
from drivers.angles import wrap_rad
from drivers.camera.settings import CameraSettings
from drivers.can_wheels.settings import CanWheelsSettings
from drivers.errors import LogError
from drivers.link import CameraImage, Received
from drivers.registry import AnyDeviceSettings
from drivers.xsens.settings import XsensSettings
from rover_hil.config import Config, RoleSettings
from rover_hil.importing.drive import (
    CAMERA,
    IMU,
    SILENT_S,
    START_NS,
    WHEELS,
    Contents,
    DriveLinks,
    write_drive,
)
from rover_hil.importing.rosbag.bag import Bag, BagMessage
from rover_hil.importing.rosbag.joints import Joint, JointSurvey, values_of
from rover_hil.importing.rosbag.topics import ODOMETRY, Topics
from rover_hil.importing.wheel_frames import write_mapping
from rover_hil.recording.images import decode_picture
from rover_hil.recording.schema import TruthRecord
from rover_hil.run.composition import ReplayLinks

LARGEST_PIXELS = 8192
FRAME_RATE_HZ = 5.0


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
        contents = Contents(outside=bag.outside, notes=[] if survey is None else survey.notes)
        origin = f"imported from {path.name}"

        def make_feed(links: ReplayLinks) -> Callable[[BagMessage], Iterator[TruthRecord]]:
            return _Feeder(topics, links, kinematics, joints, contents).feed

        for _ in write_drive(out, origin, config, bag.messages(), make_feed, contents):
            yield contents
    if not contents.used.keys() & {"wheels", "odometry"}:
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


class _Feeder:
    """Turns messages into what the devices would have sent."""

    def __init__(
        self,
        topics: Topics,
        links: ReplayLinks,
        kinematics: Kinematics,
        joints: Sequence[Joint],
        contents: Contents,
    ) -> None:
        self._contents = contents
        self._joints = joints
        self._topics = topics
        self._links = links
        self._drive = DriveLinks(links, kinematics)
        self._pose: tuple[float, float, float] | None = None

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
                is_used = self._drive.put_wheels(
                    t_ns, "Current", np.asarray(content.data, np.float64).tolist()
                )
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
        self._contents.count(message.section, is_used=is_used)

    def _feed_wheels(self, t_ns: int, state: Any) -> bool:
        topic = self._topics.wheels
        if topic is None:
            return False
        columns = zip(*(values_of(state, name) for name in topic.joints), strict=True)
        angles, speeds, efforts = columns
        angles_used = [
            angle if joint.has_angle else math.nan for angle, joint in zip(angles, self._joints, strict=True)
        ]
        used = self._drive.put_wheels(t_ns, "Position", angles_used)
        used |= self._drive.put_wheels(t_ns, "Speed", speeds)
        if topic.effort_is_current:
            used |= self._drive.put_wheels(t_ns, "Current", efforts)
        return used

    def _feed_odometry(self, t_ns: int, content: Any) -> bool:
        pose = plane_pose(ODOMETRY, content)
        if pose is None:
            return False
        x_m, y_m, turn_rad = 0.0, 0.0, 0.0
        if self._pose is not None:
            turn_rad = wrap_rad(pose[2] - self._pose[2])
            east_m, north_m = pose[0] - self._pose[0], pose[1] - self._pose[1]
            middle_rad = self._pose[2] + 0.5 * turn_rad
            cos, sin = math.cos(middle_rad), math.sin(middle_rad)
            x_m, y_m = cos * east_m + sin * north_m, cos * north_m - sin * east_m
        self._pose = pose
        return self._drive.move(t_ns, x_m, y_m, turn_rad)

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
        self._drive.put_imu(
            t_ns,
            rates,
            accelerations if has_acceleration else None,
            (turned.w, turned.x, turned.y, turned.z) if has_orientation else None,
        )
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
