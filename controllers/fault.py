"""What may be wrong with the rover or with what measures it: one record for every part that notices it."""

from enum import Enum, StrEnum, auto
from typing import NamedTuple


class Severity(StrEnum):
    """What a fault requires.

    SYMPTOM: nothing yet, but distance driven meanwhile is no evidence that the cause is gone.
    WARNING: nothing but to be shown: it does not decide whether something is wrong.
    UNCERTAIN: stops nothing. It is shown, and the covariance is inflated by its bound: a healthy rover may
        show it, too, and nothing decides.
    STOP: stop; motion resumes when the fault is gone.
    RECOVERABLE: stop, also a healthy rover may show this. Motion resumes after a standstill, with a greater
        covariance, but only once: see `SafetySupervisor`.
    FINAL: stop until restart.
    """

    SYMPTOM = "symptom"
    WARNING = "warning"
    UNCERTAIN = "uncertain"
    STOP = "stop"
    RECOVERABLE = "recoverable"
    FINAL = "final"


class Cause(StrEnum):
    """What is wrong, by its fixed name; the source stands for the braces."""

    AREA = "area"
    BUMPER = "bumper"
    CONTRADICTED_ESTIMATE = "{}"
    DEAD_GYRO = "gyro dead"
    DEVICE_FAULT = "{}: fault"
    DIFFERENT_MOTION = "{} and wheels differ"
    DISPLACED_POSITION = "{} displaced"
    FLOOD = "{}: flood"
    FROZEN_POSITION = "{}: position stays"
    GROUND_AGAINST_WHEELS = "ground against wheels"
    GROUND_ASSUMPTION = "ground assumption"
    GYRO_APART = "gyro apart"
    GYRO_BEYOND_WHEELS = "gyro difference"
    GYRO_BIAS = "gyro bias"
    GYRO_DOES_NOT_FOLLOW = "gyro follows"
    GYRO_HEADING = "gyro heading"
    GYRO_JUMP = "gyro jump"
    GYRO_NOISE = "gyro noise"
    GYRO_OFFSET = "gyro rest"
    GYRO_RATE = "gyro rate"
    GYRO_SAMPLE_RATE = "gyro sample rate"
    GYRO_STUCK = "gyro stuck"
    GYRO_ZEROS = "gyro zeros"
    JUMPED_POSITION = "{} jumped"
    LINK_DOWN = "{}: link down"
    LOST_RESPONSE = "lost response"
    LOW_SUPPLY = "{}: supply"
    MAY_BE_STUCK = "may be stuck"
    MISSED_TURN = "missed turn"
    MOTION_AT_STANDSTILL = "motion at rest"
    NO_MOTION = "no motion"
    NO_MOTION_SEEN = "no motion seen"
    NOT_FINITE = "not finite"
    NOT_FRESH = "{}: not fresh"
    OPERATOR = "operator"
    REPEATS = "{}: repeats"
    RIG = "rig"
    SOURCE_CHECK = "source check"
    STANDING_WHEELS = "standing wheels"
    STEERING = "steering"
    STEERING_ANGLE = "{}: steering angle"
    STUCK = "entrapment"
    STUCK_ENCODER = "stuck encoder"
    TURN = "turn"
    UNCERTAIN_YAW = "yaw doubt"
    UNKNOWN_MOTION = "unknown motion"
    UNKNOWN_SUPPLY = "{}: supply unknown"
    UNOBSERVED_MOTION = "unseen {}"
    UNUSUAL_FORCE = "odd force"
    WHEEL_REVERSED = "reversed"
    WHEEL_RESPONSE = "response"
    WHEEL_STALL = "stall"


class ClearedBy(Enum):
    """What ends a fault that is not final; a final one ends by a restart."""

    ABSENCE = auto()
    OPERATOR = auto()


class Bound(NamedTuple):
    """Greatest errors of the estimate that a fault may have caused, not negative but for the wheels.

    Attributes:
        wheel_rad: Of the angle of each wheel, signed; empty for none.
        gyro_rad: Of the yaw by a wrong gyro, which has misled the slip compensation, too.
        path_m: Distance driven before, on which the yaw may have become wrong.
        position_m: Of the position along each axis.
        yaw_rad: Of the yaw by anything else.
        is_motion_unknown: Whether a sensor of the motion itself may be wrong, all the time.
    """

    wheel_rad: tuple[float, ...] = ()
    gyro_rad: float = 0.0
    path_m: float = 0.0
    position_m: float = 0.0
    yaw_rad: float = 0.0
    is_motion_unknown: bool = False


NO_ERROR = Bound()

WHEELS_CONTRADICTED = "wheels contradicted"
"""Stored name of what contradicts wheels that seem not to turn."""


class Fault(NamedTuple):
    """Something that is, or may be, wrong.

    Attributes:
        source: Device, wheel or part of the program that it is about.
        cause: What is wrong; with the source it identifies the fault.
        text: For the user: what happened, where, with the numbers.
        severity: What it requires.
        bound: Errors of the estimate by it.
        cleared_by: What ends it.
        since_ns: Time of the cycle in which it began; 0 where that does not matter.
    """

    source: str
    cause: Cause
    text: str
    severity: Severity = Severity.STOP
    bound: Bound = NO_ERROR
    cleared_by: ClearedBy = ClearedBy.ABSENCE
    since_ns: int = 0

    @property
    def key(self) -> tuple[str, Cause]:
        """What is the same when the same fault comes again."""
        return self.source, self.cause

    @property
    def adds_uncertainty(self) -> bool:
        """Whether it inflates the covariance; symptoms and warnings do not."""
        return self.severity not in (Severity.SYMPTOM, Severity.WARNING)

    @property
    def name(self) -> str:
        """The fixed name for logs and reports."""
        if self.cause in (Cause.MOTION_AT_STANDSTILL, Cause.STUCK_ENCODER):
            return WHEELS_CONTRADICTED
        return self.cause.value.replace("{}", self.source)
