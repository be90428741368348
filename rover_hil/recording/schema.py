"""What a log holds: its topics and the shape of the record on each, version `rover-hil-log/2`.

The writer and every reader take topics and shapes from here, so that a name in a controller may change and
old logs stay readable. `docs/reference/log_format.md` describes the same for people. Every time is in ns of
one monotonic clock.
"""

from collections.abc import Callable
from operator import attrgetter
from typing import Annotated, Literal, NotRequired, TypeAlias, TypeVar, cast

from pydantic import BaseModel, FailFast, Field, TypeAdapter
from typing_extensions import TypedDict

from controllers.operator import OperatorInput
from drivers.driver import Health
from drivers.link import LinkChange
from drivers.samples import (
    AccelerationSample,
    AttitudeSample,
    FrameSample,
    HeadingSample,
    PoseFixSample,
    RateSample,
    WheelSample,
)

LOG_SCHEMA = "rover-hil-log/2"
CONFIG_ATTACHMENT = "config.json"

RAW, SENT, UNSENT, LINK = "/raw/", "/sent/", "/unsent/", "/link/"
"""Followed by the name of a device. A reader makes the first three from `BYTES` and `CAMERA`."""
BYTES = "/bytes"
CAMERA = "/camera/"
"""Followed by the name of a device."""
VIEW = "/view/"
"""Repetitions of other records for viewers; no reader uses them."""
VIEW_POSE, VIEW_TRUE_POSE, VIEW_PATH, VIEW_LOG = "/view/pose", "/view/true_pose", "/view/path", "/view/log"
VIEW_DIAGNOSTICS = "/view/diagnostics"
SAMPLES = "/samples"
OPERATOR = "/operator"
ESTIMATE = "/estimate"
COMMAND = "/command"
SET_POINT = "/set_point"
TRUTH = "/truth"
HEALTH = "/health"
WATCHDOG = "/watchdog"
CYCLE = "/cycle"
END = "/end"
IMPORT = "/import"


# The errors of a million wrong items would take gigabytes.
Numbers: TypeAlias = Annotated[tuple[float, ...], FailFast()]
MaybeNumbers: TypeAlias = Annotated[tuple[float, ...] | None, FailFast()]


class PoseRecord(TypedDict):
    """A pose in the local frame."""

    x_m: float
    y_m: float
    yaw_rad: float


class PoseEstimateRecord(TypedDict):
    """The filter's pose, body velocity and covariance (xx, xy, x yaw, yy, y yaw, yaw yaw)."""

    t_ns: int
    x_m: float
    y_m: float
    yaw_rad: float
    velocity_x_m_s: float
    velocity_y_m_s: float
    yaw_rate_rad_s: float
    gyro_bias_rad_s: float
    covariance: Numbers
    yaw_source: str


class InnovationRecord(TypedDict):
    """A measurement against the estimate."""

    name: str
    residual: float | None
    variance: float | None
    nis: float | None
    accepted: bool


class WheelCommandRecord(TypedDict):
    """Setpoints of a cycle and until when they hold."""

    t_ns: int
    expires_ns: int
    speed_rad_s: Numbers
    steering_rad: NotRequired[MaybeNumbers]


class WheelSlipRecord(TypedDict):
    """Effort and slip of one wheel."""

    current_a: float
    paper_torque_nm: float
    wheel_torque_nm: float
    slip: float
    valid: bool
    reason: str


class RoverSlipRecord(TypedDict):
    """Slip of the rover with its uncertainty and source, and why that is larger than it could be."""

    slip: float
    sd: float
    source: str
    reason: str
    unsure: NotRequired[str]


class SlipRecord(TypedDict):
    """Slip of all wheels by their effort."""

    map: str
    surface: str | None
    drift_rad: float
    wheels: Annotated[tuple[WheelSlipRecord, ...], FailFast()]
    rover: NotRequired[RoverSlipRecord | None]


class TraceRecord(TypedDict):
    """The trace angle in one frame."""

    t_ns: int
    detected: bool
    theta_rad: float | None
    confidence: float
    source: NotRequired[str]
    theta_sd_rad: NotRequired[float | None]


class DriftRecord(TypedDict):
    """Slip and slip angle of the rover by trace and tilt."""

    slip: float
    slip_angle_rad: float
    trace: TraceRecord | None
    reason: str


class ContradictionRecord(TypedDict):
    """How far redundant wheels contradict each other."""

    scaled: float
    wheel: int | None
    rolling_m: Numbers
    side_m: Numbers


class CrabRecord(TypedDict):
    """Slip angle against which a rover that crabs turns its wheels, and what it comes from."""

    drift_rad: float
    source: str


class GroundRecord(TypedDict):
    """Motion over the ground by the camera; None for what is not measured, with the reason."""

    t_ns: int
    velocity_x_m_s: float | None
    velocity_y_m_s: float | None
    slip: float | None
    slip_sd: float | None
    drift_rad: float | None
    reason: str
    unconfirmed: NotRequired[str]


class DeadReckonedRecord(TypedDict):
    """The pose without corrections by fixes, and its covariance."""

    x_m: float
    y_m: float
    yaw_rad: float
    covariance: Numbers


class FindingRecord(TypedDict):
    """What begins to be wrong with a drive that somebody else controls."""

    cause: str
    text: str


class SourceCheckRecord(TypedDict):
    """What the check manoeuvre shows about one quantity of one source; None for what is not known."""

    device: str
    quantity: str
    against: str
    verdict: str
    slope: float | None
    slope_low: float | None
    slope_high: float | None
    correlation: float | None
    text: str


class EstimateRecord(TypedDict):
    """All that a cycle computed, on `ESTIMATE`."""

    t_ns: int
    mode: str
    reason: str
    estimate: PoseEstimateRecord
    odometry: PoseRecord
    odometry_rebases: int
    innovations: Annotated[tuple[InnovationRecord, ...], FailFast()]
    command: WheelCommandRecord
    limit: str
    cross_track_m: float | None
    slip: NotRequired[SlipRecord | None]
    drift: NotRequired[DriftRecord | None]
    contradiction: NotRequired[ContradictionRecord | None]
    steering_rad: NotRequired[MaybeNumbers]
    crab: NotRequired[CrabRecord | None]
    ground: NotRequired[GroundRecord | None]
    suspicion: NotRequired[str | None]
    dead_reckoned: NotRequired[DeadReckonedRecord | None]
    findings: NotRequired[tuple[FindingRecord, ...] | None]
    waits_for_operator: NotRequired[bool]
    is_ground_contradicted: NotRequired[bool]
    checks: NotRequired[Annotated[tuple[SourceCheckRecord, ...], FailFast()]]
    exact: NotRequired[str]


class TracesRecord(TypedDict):
    """What `ESTIMATE` holds of trace and steering; the rest of the record may be that of another version."""

    drift: NotRequired[DriftRecord | None]
    steering_rad: NotRequired[MaybeNumbers]


class CommandRecord(TypedDict):
    """What `ESTIMATE` holds of the setpoints; the rest of the record may be that of another version."""

    command: WheelCommandRecord


class SetPointRecord(TypedDict):
    """Wheel setpoints: sent ones on `COMMAND`, those of an imported run on `SET_POINT`."""

    t_ns: NotRequired[int]
    speed_rad_s: Numbers
    delivered: NotRequired[bool]
    steering_rad: NotRequired[MaybeNumbers]


class TruthRecord(TypedDict):
    """The ground truth on `TRUTH`; `is_new` is false where an overhead camera repeats itself.

    The yaw is missing where only positions were measured.
    """

    t_ns: int
    x_m: float
    y_m: float
    yaw_rad: NotRequired[float]
    is_new: NotRequired[bool]
    roll_rad: NotRequired[float]
    pitch_rad: NotRequired[float]
    velocity_x_m_s: NotRequired[float]
    velocity_y_m_s: NotRequired[float]
    yaw_rate_rad_s: NotRequired[float]
    wheel_position_rad: NotRequired[Numbers]
    wheel_speed_rad_s: NotRequired[Numbers]
    motor_current_a: NotRequired[Numbers]
    slip: NotRequired[Numbers]
    battery_v: NotRequired[float]
    bumper_pressed: NotRequired[bool]
    steering_rad: NotRequired[MaybeNumbers]


class CycleRecord(TypedDict):
    """How late a cycle began and how long it took, on `CYCLE`."""

    late_ns: int
    work_ns: int


class FixRecord(TypedDict):
    """A pose measured from outside, as a `PoseFixSample`."""

    device: str
    t_ns: int
    x_m: float
    y_m: float
    yaw_rad: float
    position_std_m: float
    yaw_std_rad: float
    t_capture_ns: int
    arm_x_m: NotRequired[float]
    arm_y_m: NotRequired[float]


class OperatorRecord(TypedDict):
    """What an operator wants from a cycle on, on `OPERATOR`; only in such cycles.

    `motion` is the body velocity by hand: forward and to the left in m/s, counter-clockwise in rad/s. `gains`
    has new values of keys of [mission]. `stop_reason` is why the operator's side must not let the rover move;
    "" where it may move again. `fixes` are poses that arrived over ROS 2, or in a recorded drive.
    `is_confirmed` is there and true where the operator confirms that the rover may move.
    """

    is_paused: bool | None
    motion: MaybeNumbers
    gains: dict[str, float]
    stop_reason: NotRequired[str | None]
    fixes: NotRequired[Annotated[list[FixRecord], FailFast()]]
    is_confirmed: NotRequired[bool]


class EndRecord(TypedDict):
    """How a run ended, on `END`."""

    end: str | None
    reason: str
    mode: str | None
    cycles: int
    skipped: int
    duration_s: float
    watchdog_interventions: int


class OddityRecord(TypedDict):
    """A data-quality finding of a recorded drive: what, where, how often, and what was done about it."""

    what: str
    where: str
    count: int | None
    done: str


class ImportRecord(TypedDict):
    """Data-quality findings of a recorded drive, on `IMPORT`, once at the end.

    `computed_wheels`: the angles of the wheels are no measurement, but computed from a path.
    """

    oddities: Annotated[list[OddityRecord], FailFast()]
    computed_wheels: NotRequired[bool]


class PayloadRecord(TypedDict):
    """Bytes as they were received from a device, sent to it, or could not be sent, in hexadecimal."""

    device: str
    kind: Literal["received", "sent", "unsent"]
    t_ns: int
    hex: str


class BytesRecord(TypedDict):
    """Payloads in the order in which they were noted, on `BYTES`."""

    payloads: Annotated[list[PayloadRecord], FailFast()]


class TimestampRecord(TypedDict):
    """Wall-clock time as Foxglove's schemas have it."""

    sec: int
    nsec: int


class PictureRecord(TypedDict):
    """Foxglove's `CompressedImage` and the camera's own time, on `CAMERA`.

    `data` is the picture file in base64, empty for a frame that could not be decoded.
    """

    timestamp: TimestampRecord
    frame_id: str
    data: str
    format: str
    t_capture_ns: int | None


class WatchdogRecord(TypedDict):
    """When the watchdog stopped the drive, on `WATCHDOG`."""

    t_ns: int


class HealthRecord(TypedDict):
    """Facts of all devices, on `HEALTH`."""

    devices: list[Health]


class SamplesRecord(BaseModel):
    """The samples of a cycle that readers use, by kind, on `SAMPLES`."""

    wheels: Annotated[list[WheelSample], FailFast()] = Field(default_factory=list, alias="WheelSample")
    headings: Annotated[list[HeadingSample], FailFast()] = Field(default_factory=list, alias="HeadingSample")
    rates: Annotated[list[RateSample], FailFast()] = Field(default_factory=list, alias="RateSample")
    accelerations: Annotated[list[AccelerationSample], FailFast()] = Field(
        default_factory=list, alias="AccelerationSample"
    )
    attitudes: Annotated[list[AttitudeSample], FailFast()] = Field(
        default_factory=list, alias="AttitudeSample"
    )
    fixes: Annotated[list[PoseFixSample], FailFast()] = Field(default_factory=list, alias="PoseFixSample")


SAMPLES_SHAPE = TypeAdapter(SamplesRecord)
ESTIMATE_SHAPE = TypeAdapter(EstimateRecord)
TRACES_SHAPE = TypeAdapter(TracesRecord)
COMMAND_SHAPE = TypeAdapter(CommandRecord)
SET_POINT_SHAPE = TypeAdapter(SetPointRecord)
TRUTH_SHAPE = TypeAdapter(TruthRecord)
CYCLE_SHAPE = TypeAdapter(CycleRecord)
HEALTH_SHAPE = TypeAdapter(Annotated[list[Health], FailFast()])
LINK_SHAPE = TypeAdapter(LinkChange)
END_SHAPE = TypeAdapter(EndRecord)
IMPORT_SHAPE = TypeAdapter(ImportRecord)
BYTES_SHAPE = TypeAdapter(BytesRecord)
PICTURE_SHAPE = TypeAdapter(PictureRecord)
OPERATOR_SHAPE = TypeAdapter(OperatorRecord)


RecordT = TypeVar("RecordT")


def _copy(shape: type[RecordT], *, without: tuple[str, ...] = ()) -> Callable[[object], RecordT]:
    """Return a function that makes a record from the attributes of an object named as its keys.

    Where an attribute is renamed, an explicit mapping takes the place of the copy: the key stays.
    """
    names = tuple(name for name in shape.__annotations__ if name not in without)
    values = attrgetter(*names)
    return lambda source: cast("RecordT", dict(zip(names, values(source), strict=True)))


set_point_record = _copy(SetPointRecord)
"""From a `SentCommand`."""
truth_record = _copy(TruthRecord, without=("is_new",))
"""From the `Truth` of a simulated rover."""
end_record = _copy(EndRecord)
"""From a `RunResult`."""
_operator = _copy(OperatorRecord, without=("fixes", "is_confirmed"))
_fix = _copy(FixRecord)


def operator_record(wanted: OperatorInput) -> OperatorRecord:
    """Return the record of an operator's input; without fixes or a confirmation it has no such key."""
    record = _operator(wanted)
    if wanted.fixes:
        record["fixes"] = list(map(_fix, wanted.fixes))
    if wanted.is_confirmed:
        record["is_confirmed"] = True
    return record


def frame_record(frame: FrameSample) -> dict[str, object]:
    """Return what surrounds the pixels of a camera frame."""
    return {
        "device": frame.device,
        "t_ns": frame.t_ns,
        "t_capture_ns": frame.t_capture_ns,
        "index": frame.index,
        "shape": frame.image.shape,
    }


def health_record(health: Health) -> dict[str, object]:
    """Return the record of a device's health, one of the list on `HEALTH`."""
    return {
        "device": health.device,
        "state": health.state,
        "rate_hz": health.rate_hz,
        "age_s": health.age_s,
        "accepted": health.accepted,
        "rejected": dict(health.rejected),
        "breaks": health.breaks,
        "sent": health.sent,
        "send_failures": health.send_failures,
        "last_link_reason": health.last_link_reason,
        "lost": health.lost,
    }
