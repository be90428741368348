"""Write a bag as a log: its numbers pass through the codecs of a rover's devices, and replay like a run."""

import math
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from itertools import count
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from pymap3d import geodetic2enu

from controllers.motion.kinematics import Kinematics, make_kinematics
from drivers.angles import wrap_rad
from drivers.camera.settings import CameraSettings
from drivers.clock import NANOSECONDS_PER_SECOND
from drivers.errors import LogError
from drivers.link import CameraImage, Received
from drivers.samples import PoseFixSample
from rover_hil.config import Config
from rover_hil.drives.arrays import Array
from rover_hil.drives.formats.drive import (
    CAMERA,
    SILENT_S,
    START_NS,
    Contents,
    DriveLinks,
    InertialSensor,
    check_steering,
    check_straight,
    drive_config,
    write_drive,
)
from rover_hil.drives.formats.fixes import FixMaker, invented_poses
from rover_hil.drives.formats.rosbag.bag import Bag, BagMessage
from rover_hil.drives.formats.rosbag.joints import Joint, JointSurvey, values_of
from rover_hil.drives.formats.rosbag.topics import NAV_SAT_FIX, ODOMETRY, POINT, TWISTS, Topics
from rover_hil.drives.formats.wheel_frames import write_mapping
from rover_hil.drives.quality.oddities import REPAIRED, TOLD, Evidence, Oddity
from rover_hil.drives.quality.twist_check import twist_fault
from rover_hil.recording.images import decode_picture
from rover_hil.recording.schema import TruthRecord
from rover_hil.run.composition import ReplayLinks

LARGEST_PIXELS = 8192
LEAST_STAMPED_NS = 5 * NANOSECONDS_PER_SECOND
STAMPS_AGREE = 0.004
FRAME_RATE_HZ = 5.0


def write_bag_as_log(
    path: Path, topics: Topics, rover: Config, out: Path, *, with_estimate: bool = True
) -> Iterator[Contents]:
    """Write the log `out` of a bag, cycle by cycle; yields what was used so far.

    Args:
        path: The bag.
        topics: What of it is used.
        rover: Configuration of the rover; its devices and its mission are not used.
        out: The log; must not exist.
        with_estimate: As for `write_drive`.

    Raises:
        LogError: The bag cannot be read, or does not fit the rover.
    """
    kinematics = make_kinematics(rover.rover)
    _check_wheels(topics, kinematics.wheel_count)
    bag = Bag(path, topics)
    _check_joints(topics, kinematics, path)
    with TemporaryDirectory(prefix="rover_hil_") as folder:
        clock = _Stamps()
        survey = _survey(bag, topics, rover, clock)
        joints = (Joint(has_angle=True),) * kinematics.wheel_count if survey is None else survey.joints
        picture = next(bag.messages("camera"), None) if topics.camera is not None else None
        config = _config(topics, rover, Path(folder), joints, picture)
        contents = Contents(notes=[] if survey is None else survey.notes)
        if bag.outside:
            what = "recorded before the clock was set, at time 0 or far from the others"
            contents.oddities.append(Oddity(what=what, where="messages", count=bag.outside))
        if bag.is_unfinished:
            what = "metadata.yaml missing, as a killed recorder leaves it: read without it"
            contents.oddities.append(Oddity(what=what, count=1, done=REPAIRED))
        for name in bag.cut:
            what = "end of the file missing, as a killed recorder leaves it: read as far as it is intact"
            contents.oddities.append(Oddity(what=what, where=name, count=1, done=REPAIRED))
        if step := bag.set_back:
            what = (
                f"clock of the recorder set back by {step.by_ns / 1e9:.1f} s at {step.at_ns / 1e9:.1f} s: "
                "the times are those of the headers"
            )
            contents.oddities.append(Oddity(what=what, where="messages", count=1, done=REPAIRED))
        else:
            contents.oddities += clock.oddities()
        contents.oddities += _twist_oddities(bag, topics)
        lost = _lost_poses(bag, topics, contents)
        held = frozenset(section for section, _, _ in topics.mapped())
        contents.evidence = Evidence(sections=held, has_own_turn=topics.wheels is not None)
        origin = f"imported from {path.name}"

        def make_feed(links: ReplayLinks) -> Callable[[BagMessage], Iterator[TruthRecord | PoseFixSample]]:
            return _Feeder(topics, links, kinematics, joints, contents, lost).feed

        for _ in write_drive(
            out, origin, config, bag.messages(), make_feed, contents, with_estimate=with_estimate
        ):
            yield contents
    if not contents.used.keys() & {"wheels", "odometry"}:
        raise LogError(f"{path}: no message of the wheels holds numbers: name another topic")


def _check_wheels(topics: Topics, count: int) -> None:
    joints = () if topics.wheels is None else topics.wheels.joints
    if joints and len(joints) != count:
        raise LogError(
            f"[wheels] names {len(joints)} joints, but {topics.rover} has {count} wheels: name one for each"
        )


def _check_joints(topics: Topics, kinematics: Kinematics, path: Path) -> None:
    wheels = topics.wheels
    if wheels is None:
        check_straight(kinematics, path)
        return
    without = {place for place, name in enumerate(wheels.joints) if not name}
    if without != kinematics.unmeasured:
        raise LogError(
            f"[wheels] names no joint for wheel {_listed(without)}, but by [rover] no encoder has wheel "
            f'{_listed(kinematics.unmeasured)}: give "" for a wheel with measured = false, and only then'
        )
    steered = [place for place, name in enumerate(wheels.steering) if name]
    check_steering(kinematics, steered, path, "name its joint in wheels.steering")


def _listed(wheels: Collection[int]) -> str:
    return ", ".join(map(str, sorted(wheels))) or "-"


def _lost_poses(bag: Bag, topics: Topics, contents: Contents) -> frozenset[int]:
    """Return the numbers of the true poses that a tracker has invented."""
    if topics.truth is None:
        return frozenset()
    poses = [plane_pose(message.kind, message.content) for message in bag.messages("truth")]
    x_m, y_m, yaw_rad = (
        np.array([(math.nan,) * 3 if pose is None else pose for pose in poses]).reshape(-1, 3).T
    )
    return invented_poses(x_m, y_m, yaw_rad, contents.oddities)


def _twist_oddities(bag: Bag, topics: Topics) -> Iterator[Oddity]:
    """Yield which topics of poses have a twist that contradicts them."""
    for section, topic, _ in topics.mapped():
        if section not in ("odometry", "fixes", "truth"):
            continue
        rows: list[tuple[float, ...]] = []
        for message in bag.messages(section):
            pose = plane_pose(message.kind, message.content) if message.kind == ODOMETRY else None
            if pose is not None:
                twist = message.content.twist.twist
                t_ns = message.t_ns if message.stamp_ns is None else message.stamp_ns
                rows.append((t_ns / 1e9, *pose, twist.linear.x, twist.linear.y, twist.angular.z))
        table = np.array(rows).reshape(-1, 7)
        table = table[np.isfinite(table).all(axis=1)]
        table = table[np.concatenate(([True], np.diff(table[:, 0]) > 0.0))[: len(table)]]
        if fault := twist_fault(table[:, 0], table[:, 1:4], table[:, 4:]):
            yield Oddity(what=fault, where=topic.topic, count=1, done=TOLD)


class _Stamps:
    """Compares the stamps in the headers of the wheels with the times of recording."""

    def __init__(self) -> None:
        self._first: BagMessage | None = None
        self._last: BagMessage | None = None

    def noted(self, messages: Iterable[BagMessage]) -> Iterator[BagMessage]:
        """Yield the messages."""
        for message in messages:
            if message.stamp_ns is not None:
                self._first, self._last = self._first or message, message
            yield message

    def oddities(self) -> list[Oddity]:
        """Return that the stamps run faster or slower than the recording, if they do."""
        first, last = self._first, self._last
        if first is None or last is None or first.stamp_ns is None or last.stamp_ns is None:
            return []
        recorded_ns, stamped_ns = last.t_ns - first.t_ns, last.stamp_ns - first.stamp_ns
        if recorded_ns < LEAST_STAMPED_NS or stamped_ns <= 0:
            return []
        factor = stamped_ns / recorded_ns
        if abs(factor - 1.0) <= STAMPS_AGREE:
            return []
        what = f"stamps of the headers run {factor:.4g} times as fast as the recording, whose times are used"
        return [Oddity(what=what, where="wheels", count=1, done=TOLD)]


def _survey(bag: Bag, topics: Topics, rover: Config, clock: "_Stamps") -> JointSurvey | None:
    if topics.wheels is None:
        return None
    messages = clock.noted(bag.messages("wheels"))
    return JointSurvey(topics.wheels, rover.limits.wheel_speed_rad_s, messages, bag.duration_ns)


def _config(
    topics: Topics, rover: Config, folder: Path, joints: Sequence[Joint], picture: BagMessage | None
) -> Config:
    signs = () if topics.wheels is None else topics.wheels.signs
    mapping = write_mapping(folder, [joint.wrap_rad for joint in joints], _quantities(topics), signs)
    imu = topics.imu
    sensor = None if imu is None else InertialSensor(True, imu.use_orientation, imu.heading_reference)
    cameras: dict[str, CameraSettings] = {}
    if picture is not None:
        height, width = _picture(picture).image.shape[:2]
        if not 0 < max(width, height) <= LARGEST_PIXELS:
            raise LogError("[camera]: the first picture of the topic cannot be decoded: name another topic")
        cameras[CAMERA] = CameraSettings(
            type="camera",
            source="folder",
            path="bag",
            width=width,
            height=height,
            frame_rate_hz=FRAME_RATE_HZ,
            max_age_s=SILENT_S,
        )
    return drive_config(rover, "bag", mapping, sensor, has_fixes=topics.fixes is not None, cameras=cameras)


def _quantities(topics: Topics) -> tuple[str, ...]:
    by_effort = topics.wheels is not None and topics.wheels.effort_is_current
    current = ("Current",) if by_effort or topics.currents is not None else ()
    steering = ("Steering",) if topics.wheels is not None and topics.wheels.steering else ()
    return ("Position", *(() if topics.wheels is None else ("Speed",)), *current, *steering)


class _Feeder:
    """Turns messages into what the devices would have sent."""

    def __init__(
        self,
        topics: Topics,
        links: ReplayLinks,
        kinematics: Kinematics,
        joints: Sequence[Joint],
        contents: Contents,
        lost: frozenset[int],
    ) -> None:
        self._contents = contents
        self._lost = lost
        self._places = count()
        self._fixes = None if topics.fixes is None else FixMaker(topics.fixes, topics.fixes.marker)
        self._origin_deg: tuple[float, float] | None = None
        self._joints = joints
        self._topics = topics
        self._links = links
        self._drive = DriveLinks(links, kinematics)
        self._pose: tuple[float, float, float] | None = None
        self._twist: tuple[int, Array] | None = None

    def feed(self, message: BagMessage) -> Iterator[TruthRecord | PoseFixSample]:
        """Feed one message into the links; yields the true pose or the fix that it holds, if any."""
        t_ns = START_NS + message.t_ns
        content, is_used = message.content, False
        match message.section:
            case "wheels":
                is_used = self._feed_wheels(t_ns, content)
            case "odometry":
                feed = self._feed_twist if message.kind in TWISTS else self._feed_odometry
                is_used = feed(t_ns, content)
            case "currents":
                is_used = self._drive.put_wheels(
                    t_ns, "Current", np.asarray(content.data, np.float64).tolist()
                )
            case "imu" | "camera":
                is_used = self._feed_sensor(t_ns, message)
            case "fixes":
                for fix in self._fix(t_ns, message):
                    is_used = True
                    yield fix
            case "truth":
                if next(self._places) in self._lost:
                    return
                for record in _truth(t_ns, message):
                    is_used = True
                    yield record
        self._contents.count(message.section, is_used=is_used, why_not=_why_not(message))

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
        if topic.steering:
            angles_rad = [values_of(state, name)[0] if name else math.nan for name in topic.steering]
            used |= self._drive.put_wheels(t_ns, "Steering", angles_rad)
        if topic.effort_is_current:
            used |= self._drive.put_wheels(t_ns, "Current", efforts)
        return used

    def _fix(self, t_ns: int, message: BagMessage) -> Iterator[PoseFixSample]:
        if self._fixes is not None and (numbers := self._measured(message)) is not None:
            fix = self._fixes.make(t_ns, *numbers)
            if fix is not None:
                yield fix

    def _measured(self, message: BagMessage) -> tuple[float, float, float, float, float] | None:
        """Return x, y, yaw and their deviations, NaN for what is not there; None without a place."""
        content = message.content
        if message.kind == NAV_SAT_FIX:
            place_deg = content.latitude, content.longitude
            if (
                content.status.status < 0
                or not all(map(math.isfinite, place_deg))
                or abs(place_deg[0]) > 90.0
                or place_deg == (0.0, 0.0)  # the receiver had none
            ):
                return None
            self._origin_deg = self._origin_deg or place_deg
            x_m, y_m, _ = geodetic2enu(*place_deg, 0.0, *self._origin_deg, 0.0)
            is_known = content.position_covariance_type != 0
            std_m = position_std_m(content.position_covariance, 3) if is_known else math.nan
            return float(x_m), float(y_m), math.nan, std_m, math.nan
        pose = plane_pose(message.kind, content)
        if pose is None:
            return None
        covariance = getattr(getattr(content, "pose", None), "covariance", None)
        if covariance is None:
            return (*pose, math.nan, math.nan)
        std_m, yaw_rad2 = position_std_m(covariance, 6), float(covariance[35])
        return (*pose, std_m, math.sqrt(yaw_rad2) if yaw_rad2 > 0.0 else math.nan)

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

    def _feed_twist(self, t_ns: int, content: Any) -> bool:
        """Turn the wheels as speeds that go evenly from those of the message before to these."""
        twist = getattr(content.twist, "twist", content.twist)
        rates = np.array((twist.linear.x, twist.linear.y, twist.angular.z))
        if not np.isfinite(rates).all():
            return False
        before_ns, before = self._twist or (t_ns, rates)
        self._twist = t_ns, rates
        moved = 0.5 * (rates + before) * ((t_ns - before_ns) / NANOSECONDS_PER_SECOND)
        return self._drive.move(t_ns, *moved.tolist())

    def _feed_sensor(self, t_ns: int, message: BagMessage) -> bool:
        if message.section == "imu":
            return self._feed_imu(t_ns, message.content)
        return self._feed_picture(t_ns, message)

    def _feed_imu(self, t_ns: int, content: Any) -> bool:
        rate, acceleration, turned = (
            content.angular_velocity,
            content.linear_acceleration,
            content.orientation,
        )
        rates = (rate.x, rate.y, rate.z)
        has_rates = all(map(math.isfinite, rates)) and content.angular_velocity_covariance[0] != -1.0
        accelerations = (acceleration.x, acceleration.y, acceleration.z)
        has_acceleration = (
            all(map(math.isfinite, accelerations)) and content.linear_acceleration_covariance[0] != -1.0
        )
        topic = self._topics.imu
        has_orientation = (
            topic is not None and topic.use_orientation and content.orientation_covariance[0] != -1.0
        )
        if not (has_rates or has_acceleration or has_orientation):
            return False
        self._drive.put_imu(
            t_ns,
            rates if has_rates else None,
            accelerations if has_acceleration else None,
            (turned.w, turned.x, turned.y, turned.z) if has_orientation else None,
        )
        return True

    def _feed_picture(self, t_ns: int, message: BagMessage) -> bool:
        image = _picture(message)
        self._links.image_links[CAMERA].feed(Received(t_ns, image))
        return bool(image.image.size)


def _truth(t_ns: int, message: BagMessage) -> Iterator[TruthRecord]:
    pose = plane_pose(message.kind, message.content)
    if pose is not None:
        x_m, y_m, yaw_rad = pose
        record: TruthRecord = {"t_ns": t_ns, "x_m": x_m, "y_m": y_m, "is_new": True}
        if math.isfinite(yaw_rad):
            record["yaw_rad"] = yaw_rad
        yield record


def _why_not(message: BagMessage) -> str:
    """Return why a message is not used, where it is not."""
    if message.kind == NAV_SAT_FIX:
        return "the receiver had no position"
    if message.section in ("odometry", "fixes", "truth"):
        return "no finite pose with an orientation"
    return "no usable numbers"


def plane_pose(kind: str, content: Any) -> tuple[float, float, float] | None:
    """Return x and y in m and yaw in rad of a message with a pose; None where it holds no finite one.

    The yaw of a point is NaN.
    """
    if kind == POINT:
        point = content.point.x, content.point.y
        return (*point, math.nan) if all(map(math.isfinite, point)) else None
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


def position_std_m(covariance: Sequence[float], size: int) -> float:
    """Return the deviation along the most uncertain axis of x and y; NaN where there is none."""
    xx, xy, yy = (float(covariance[place]) for place in (0, 1, size + 1))
    variance = 0.5 * (xx + yy) + math.hypot(0.5 * (xx - yy), xy)
    return math.sqrt(variance) if min(xx, yy) > 0.0 and math.isfinite(variance) else math.nan


def _picture(message: BagMessage) -> CameraImage:
    """Return the picture of a message; one without pixels where it cannot be decoded."""
    stamp_ns = None if message.stamp_ns is None else START_NS + message.stamp_ns
    return decode_picture(stamp_ns, message.content.data.tobytes())
