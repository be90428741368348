"""Write any recorded drive as a log: the loop runs over what the devices would have sent, as in a run."""

import math
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Literal, NamedTuple, Protocol, TypeVar

from controllers.control_loop import StepOutput
from controllers.motion.kinematics import Kinematics, make_kinematics
from controllers.motion.planar import wrap_angle
from controllers.operator import OperatorInput
from drivers.camera.settings import CameraSettings
from drivers.can_wheels.settings import CanWheelsSettings
from drivers.clock import NANOSECONDS_PER_SECOND, VirtualClock, nanoseconds
from drivers.errors import LogError
from drivers.link import Received
from drivers.registry import AnyDeviceSettings
from drivers.samples import PoseFixSample
from drivers.xsens.settings import XsensSettings
from rover_hil.config import Config, RoleSettings
from rover_hil.config.ros2_settings import Ros2Settings
from rover_hil.drives.formats.imu_message import imu_bytes
from rover_hil.drives.formats.wheel_frames import wheel_frame
from rover_hil.drives.quality.oddities import Evidence, Oddity, merged, unseen
from rover_hil.drives.quality.position_use import PositionUse
from rover_hil.recording.data_files import collect_data_files
from rover_hil.recording.findings import FindingList, FoundFinding
from rover_hil.recording.schema import CYCLE, IMPORT, OPERATOR, TRUTH, TruthRecord, operator_record
from rover_hil.recording.writer import LogWriter
from rover_hil.run.composition import ReplayLinks, build_replay_rig

WHEELS, IMU, CAMERA = "wheels", "imu", "camera"
"""Names of the devices."""
START_NS = NANOSECONDS_PER_SECOND
"""Time given to the first message: not zero, so that an unset time stamp cannot pass for a real one."""
SILENT_S = 2.0
"""Other programs record slower than our drivers."""
LONGEST_GAP_NS = NANOSECONDS_PER_SECOND
"""In a longer gap of the drive no cycles run."""
MOST_NOTES = 20
PATHS = ("increments", "odometry")
"""Sections from which the angles of the wheels are computed."""


class Message(Protocol):
    """Anything recorded at a time.

    Attributes:
        t_ns: Since the first one.
    """

    @property
    def t_ns(self) -> int: ...  # noqa: D102


MessageT = TypeVar("MessageT", bound=Message)


@dataclass
class Contents:
    """What of a drive was used.

    Attributes:
        used: Number of messages by section.
        oddities: Data-quality findings, and what was done about each.
        notes: What a user must know of the joints and of the estimate, one sentence each.
        findings: What the rules have found wrong with the drive.
        doubts: What widened the estimate although it may happen to a healthy rover.
        end_ns: Time of the last cycle.
        has_estimate: Whether the estimate was made; without it no rule has judged the drive.
    """

    used: dict[str, int] = field(default_factory=dict)
    oddities: list[Oddity] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    findings: list[FoundFinding] = field(default_factory=list)
    doubts: list[FoundFinding] = field(default_factory=list)
    end_ns: int = START_NS
    has_estimate: bool = True

    def __post_init__(self) -> None:
        self._unusable: Counter[tuple[str, str]] = Counter()
        self.evidence = Evidence(sections=frozenset())

    def count(self, section: str, *, is_used: bool, why_not: str = "no usable numbers") -> None:
        """Count a message; of one that is not used `why_not`."""
        if is_used:
            self.used[section] = self.used.get(section, 0) + 1
        else:
            self._unusable[why_not, section] += 1

    def finish(self, kinematics: Kinematics, turned_rad: float) -> None:
        """Count what was left out, and equal findings together; add what the drive cannot show.

        Without an estimate it is not known how far the rover turned, and thus what the drive shows.
        """
        if self.has_estimate:
            self.oddities += unseen(kinematics, self.evidence, turned_rad)
        unusable = [
            Oddity(what=what, where=name, count=count) for (what, name), count in self._unusable.items()
        ]
        self.oddities = merged([*self.oddities, *unusable])


def write_drive(
    out: Path,
    origin: str,
    config: Config,
    messages: Iterable[MessageT],
    make_feed: Callable[[ReplayLinks], Callable[[MessageT], Iterable[TruthRecord | PoseFixSample]]],
    contents: Contents,
    *,
    with_estimate: bool,
    wall_start_ns: int | None = None,
) -> Iterator[None]:
    """Write the log `out`, cycle by cycle; yields after each.

    Args:
        out: The log; must not exist.
        origin: Where the drive comes from.
        config: With the devices that the messages are fed into, and nothing that moves the rover.
        messages: In the order of their times.
        make_feed: Returns what feeds a message into links, and gives the true poses and fixes in it.
        contents: Gets notes of the estimate and the time of the last cycle.
        with_estimate: Whether the loop runs; without it the log holds what the devices sent, and its samples.
        wall_start_ns: When the drive was recorded, in ns since 1970; the present where it is not known.
    """
    contents.has_estimate = with_estimate
    clock = VirtualClock(START_NS)
    config_json = config.model_dump_json(by_alias=True).encode()
    with LogWriter(
        out, START_NS, config_json, collect_data_files(config), origin, wall_start_ns=wall_start_ns
    ) as log:
        rig, links = build_replay_rig(config, clock, log)
        rig.connect(timeout_s=0.0)
        feed = make_feed(links)
        doubts, positions = _Doubts(contents), PositionUse()
        for tick_ns, waiting in _by_cycle(messages, nanoseconds(1.0 / config.loop.rate_hz)):
            given = [record for message in waiting for record in feed(message)]
            truths = [record for record in given if not isinstance(record, PoseFixSample)]
            fixes = tuple(record for record in given if isinstance(record, PoseFixSample))
            clock.sleep_until(tick_ns)
            positions.give(fixes)
            if fixes:
                log.write_json(OPERATOR, tick_ns, operator_record(OperatorInput(fixes=fixes)))
            samples = [*rig.poll(), *fixes]
            log.samples(tick_ns, samples)
            if with_estimate:
                output = rig.loop.step(tick_ns, samples)
                log.estimate(output)
                doubts.take(output)
                positions.take(output)
            for record in truths:
                log.write_json(TRUTH, record["t_ns"], record)
            log.write_json(CYCLE, tick_ns, {"late_ns": 0, "work_ns": 0})
            contents.end_ns = tick_ns
            yield
        contents.finish(make_kinematics(config.rover), doubts.turned_rad)
        if with_estimate and (text := positions.fault()):
            contents.notes.insert(0, text)
        oddities = [asdict(oddity) for oddity in contents.oddities]
        is_path = not contents.used.keys().isdisjoint(PATHS)
        log.write_json(IMPORT, contents.end_ns, {"oddities": oddities, "computed_wheels": is_path})


class InertialSensor(NamedTuple):
    """What the inertial sensor of a recorded drive measures."""

    has_rate: bool
    has_heading: bool = False
    heading_reference: Literal["magnetic", "true"] = "magnetic"


def drive_config(
    rover: Config,
    source: str,
    mapping: Path,
    sensor: InertialSensor | None,
    *,
    has_fixes: bool,
    cameras: Mapping[str, CameraSettings] | None = None,
) -> Config:
    """Return the configuration of a rover with the devices of a recorded drive, and nothing that moves it.

    Args:
        rover: Its own configuration.
        source: Kind of the file, as the channel of the devices.
        mapping: Of the frames of the wheels.
        sensor: None without one.
        has_fixes: Whether positions are measured.
        cameras: By name.
    """
    devices: dict[str, AnyDeviceSettings] = {
        WHEELS: CanWheelsSettings(
            interface="virtual", channel=source, mapping=str(mapping), max_age_s=SILENT_S
        )
    }
    if sensor is not None:
        reference = sensor.heading_reference
        devices[IMU] = XsensSettings(port=source, max_age_s=SILENT_S, heading_reference=reference)
    roles = RoleSettings(
        wheels=WHEELS,
        gyro=IMU if sensor is not None and sensor.has_rate else None,
        headings=(IMU,) if sensor is not None and sensor.has_heading else (),
    )
    ros2 = Ros2Settings(pose_fixes=True) if has_fixes else None
    none = dict.fromkeys(("mission", "slip", "scomp", "simulation", "tune"))
    devices |= cameras or {}
    return rover.model_copy(update={"devices": devices, "roles": roles, "ros2": ros2, **none})


def check_straight(kinematics: Kinematics, source: object) -> None:
    """Check that the wheels of a rover can be given the angles of a path.

    Args:
        kinematics: Of the rover.
        source: The file with the path.

    Raises:
        LogError: Some steer: their steering angles are not in the path.
    """
    if kinematics.steering_rates_rad_s:
        raise LogError(
            f"{source}: it gives a path instead of the wheels, but wheels of the rover steer: describe in "
            "[rover] two wheels that do not, left and right of the place that the path is of"
        )


def check_steering(kinematics: Kinematics, steered: Collection[int], source: object, fix: str) -> None:
    """Check that the steering of every wheel that steers is measured.

    Args:
        kinematics: Of the rover.
        steered: Wheels with a measured steering angle.
        source: The file with the drive.
        fix: How to give the others.

    Raises:
        LogError: It is not, so that the rover would seem to drive straight on.
    """
    missing = [
        str(wheel)
        for wheel, rate_rad_s in enumerate(kinematics.steering_rates_rad_s)
        if rate_rad_s > 0.0 and wheel not in steered
    ]
    if missing:
        raise LogError(
            f"{source}: wheel {', '.join(missing)} steers, but its steering angle is not measured: {fix}"
        )


class DriveLinks:
    """Feeds numbers of a drive into the links of its devices, exactly.

    Args:
        links: Of a rig whose wheels have the mapping of `wheel_frames`.
        kinematics: Of the rover.
    """

    def __init__(self, links: ReplayLinks, kinematics: Kinematics) -> None:
        self._links = links
        self._kinematics = kinematics
        self._angles_rad = [0.0] * kinematics.wheel_count

    def put_wheels(self, t_ns: int, quantity: str, values: Sequence[float]) -> bool:
        """Feed one quantity of all wheels, NaN for none; returns whether there was any."""
        if len(values) != len(self._angles_rad):
            return False
        used = False
        for wheel, value in enumerate(values):
            if math.isfinite(value):
                frame = wheel_frame(quantity, wheel, value)
                self._links.bytes_links[WHEELS].feed(Received(t_ns, frame))
                used = True
        return used

    def move(self, t_ns: int, x_m: float, y_m: float, yaw_rad: float) -> bool:
        """Turn the wheels as an increment of the pose does; x ahead in the middle of its turn."""
        turned = self._kinematics.wheel_speeds(x_m, y_m, yaw_rad)
        self._angles_rad = [angle + step for angle, step in zip(self._angles_rad, turned, strict=True)]
        return self.put_wheels(t_ns, "Position", self._angles_rad)

    def put_imu(
        self,
        t_ns: int,
        rates_rad_s: Sequence[float] | None,
        accelerations_m_s2: Sequence[float] | None,
        orientation_wxyz: Sequence[float] | None,
    ) -> None:
        """Feed what an inertial sensor measured at one time."""
        data = imu_bytes(rates_rad_s, accelerations_m_s2, orientation_wxyz)
        self._links.bytes_links[IMU].feed(Received(t_ns, data))


def _by_cycle(messages: Iterable[MessageT], period_ns: int) -> Iterator[tuple[int, list[MessageT]]]:
    """Yield the time of each cycle and the messages that have come since the one before."""
    tick_ns = START_NS
    waiting: list[MessageT] = []
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
    """Notes when the estimate loses motion, and what the rules find."""

    def __init__(self, contents: Contents) -> None:
        self._contents = contents
        self._rebases = 0
        self._yaw_rad = self._least_rad = self._greatest_rad = 0.0
        self._findings = FindingList()
        contents.findings, contents.doubts = self._findings.found, self._findings.doubts

    def take(self, output: StepOutput) -> None:
        """Take the output of one cycle."""
        t_s = (output.t_ns - START_NS) / NANOSECONDS_PER_SECOND
        self._yaw_rad += wrap_angle(output.odometry.yaw_rad - self._yaw_rad)
        self._least_rad, self._greatest_rad = (
            min(self._least_rad, self._yaw_rad),
            max(self._greatest_rad, self._yaw_rad),
        )
        if output.odometry_rebases > self._rebases:
            self._rebases = output.odometry_rebases
            self._note(
                f"odometry began anew at {t_s:.1f} s: the motion before is unknown, the estimate is wider"
            )
        self._findings.take(t_s, output.findings or (), output.suspicion)

    @property
    def turned_rad(self) -> float:
        """Greatest turn to one side by the wheels."""
        return self._greatest_rad - self._least_rad

    def _note(self, text: str) -> None:
        notes = self._contents.notes
        if len(notes) < MOST_NOTES:
            notes.append(text)
        elif len(notes) == MOST_NOTES:
            notes.append("more of these follow")
