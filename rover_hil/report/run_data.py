"""A run from its log: times in s since the start of the run, everything else in SI units."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from controllers.estimation.filter.measurement_model import Measured
from controllers.motion.limits import Limit
from controllers.safety import Mode
from drivers.driver import Health
from rover_hil.config import Config
from rover_hil.drives.arrays import Array
from rover_hil.recording.findings import FoundFinding
from rover_hil.recording.schema import EndRecord, OddityRecord, SourceCheckRecord
from rover_hil.report.tracks import Series, Track


@dataclass(frozen=True, slots=True, kw_only=True)
class Cycles:
    """What the loop did in each cycle; times of work and lateness in microseconds."""

    t_s: Array
    mode: Sequence[Mode]
    reason: Sequence[str]
    suspicion: Sequence[str]
    findings: Sequence[FoundFinding]
    limit: Sequence[Limit]
    late_us: Array
    work_us: Array


@dataclass(frozen=True, slots=True, kw_only=True)
class WheelData:
    """One wheel over time; None for what the log does not hold.

    Attributes:
        name: Its index and, where the kinematics gives it one, its place.
        set_point: As really sent, rad/s.
        speed: Measured, rad/s.
        current: As measured, A; a magnitude where the device knows no sign.
        slip: The true slip ratio.
        true_speed: The true speed, rad/s.
    """

    name: str
    set_point: Series | None
    speed: Series | None
    current: Series | None
    slip: Series | None
    true_speed: Series | None


@dataclass(frozen=True, slots=True, kw_only=True)
class EstimatedSlip:
    """Slip of one wheel as estimated by slip compensation, in n cycles.

    Attributes:
        slip: Slip ratio that the odometry used.
        paper_torque_nm: M of paper 003, at the motor.
        wheel_torque_nm: Torque at the wheel.
        reasons: Why the slip was not valid; empty where it was.
    """

    slip: Series
    paper_torque_nm: Series
    wheel_torque_nm: Series
    reasons: Sequence[str]


@dataclass(frozen=True, slots=True, kw_only=True)
class SlipData:
    """Slip as estimated by slip compensation, in n cycles.

    Attributes:
        map: Name of the map in use.
        t_s: Times of the cycles.
        surfaces: The recognised surface; empty where it was unknown.
        wheels: One after the other.
    """

    map: str
    t_s: Array
    surfaces: Sequence[str]
    wheels: Sequence[EstimatedSlip]


@dataclass(frozen=True, slots=True, kw_only=True)
class DriftData:
    """Slip of the whole rover as estimated in n cycles; angles in rad, left positive.

    Attributes:
        slip: Slip ratio.
        angle: Slip angle.
        reasons: Why the two were not sure; empty where they were.
        trace: Direction of the rear wheel's velocity, from the frames in which its trace was found.
        true_slip: NaN where the wheels hardly turn; None where it was not recorded. Likewise `true_angle`.
    """

    slip: Series
    angle: Series
    reasons: Sequence[str]
    trace: Series
    true_slip: Series | None
    true_angle: Series | None


@dataclass(frozen=True, slots=True, kw_only=True)
class GroundData:
    """Motion over the ground as a camera measured it, in n cycles.

    Attributes:
        slip: Slip ratio of the rover; NaN where there was none.
        slip_sd: Its standard deviation; NaN likewise.
        reasons: Why the motion was not measured; empty where it was.
        unconfirmed: What the run has not confirmed about the camera by its end; empty for nothing.
    """

    slip: Series
    slip_sd: Array
    reasons: Sequence[str]
    unconfirmed: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class CrabData:
    """Steering of a rover that crabs, while it drives; angles in rad, means over its wheels.

    Attributes:
        set_point: Commanded steering angle.
        steering: Measured or assumed one.
        drift: Slip angle of the wheels against which they are turned.
        sources: What that slip angle comes from, one for each value of `drift`.
        true_left_of_line: True distance to the left of the line; None where unknown, or for a path with
            corners.
    """

    set_point: Series
    steering: Series
    drift: Series
    sources: Sequence[str]
    true_left_of_line: Series | None


@dataclass(frozen=True, slots=True, kw_only=True)
class InnovationData:
    """One measurement against the estimate: residual and its expected deviation (SI), 1 if accepted."""

    t_s: Array
    residual: Array
    deviation: Array
    is_accepted: Array


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkEvent:
    """A link went down or came up."""

    t_s: float
    device: str
    up: bool
    reason: str


@dataclass(frozen=True, slots=True, kw_only=True)
class RunData:
    """A run from its log.

    Attributes:
        is_complete: False when the log was cut off.
        cut_off_by: Why the watchdog ended the run, where the log was cut off and it did; else empty.
        end: How the run ended by its own account; None when it was killed or imported.
        oddities: Data-quality findings of a recorded drive.
        checks: What the check manoeuvre showed about each source; empty where it was not driven.
        duration_s: By the run's own account, else up to the last message.
        estimate: The filter's pose at the time of the wheel positions that it is based on.
        covariance: Its covariance, in rows xx, xy, x yaw, yy, y yaw, yaw yaw.
        encoders: The pose of the wheels alone.
        truth: The true pose as seen from its own first one; None where it was not recorded.
        computed: Every number of a cycle's record on `/estimate` over time, by its key; the keys of records
            inside it and the index of a wheel are joined by dots: `cross_track_m`, `slip.wheels.0.slip`.
        headings: Yaw in the local frame, by device and reference.
        gyro: The integrated gyro, its bias taken off; None without one.
        odometry_rebases: How often the odometry lost its base, together with the motion in between.
        uncompared: How many measurements could not be compared with the estimate, by name.
        slip: By slip compensation; None without it.
        drift: By compensation with trace and tilt; None without it.
        crab: Steering against the slip angle; None where the rover does not crab.
        ground: By a camera that measures the motion over the ground; None without.
        health: The last health facts of each device.
        watchdog_s: When the watchdog stopped the drive.
    """

    path: Path
    origin: str
    config: Config
    config_json: bytes
    is_complete: bool
    cut_off_by: str
    end: EndRecord | None
    oddities: Sequence[OddityRecord]
    checks: Sequence[SourceCheckRecord]
    duration_s: float
    cycles: Cycles
    estimate: Track
    covariance: Array
    encoders: Track
    truth: Track | None
    computed: Mapping[str, Series]
    headings: Mapping[str, Series]
    gyro: Series | None
    innovations: Mapping[Measured, InnovationData]
    odometry_rebases: int
    uncompared: Mapping[str, int]
    wheels: Sequence[WheelData]
    slip: SlipData | None
    drift: DriftData | None
    crab: CrabData | None
    ground: GroundData | None
    health: Sequence[Health]
    link_events: Sequence[LinkEvent]
    watchdog_s: Sequence[float]
