"""Measurements of devices in SI units, with their time of arrival.

Conventions of every sample: x forward, y left, z up; angles and rates counter-clockwise positive; yaw is
measured from east towards north (ENU), so a compass that reads clockwise from north is converted once, in
its codec. `t_ns` is host monotonic time at the arrival of the last byte; `t_device_ns` is the device's own
time where it has one and is never compared with `t_ns`.
"""

import math
from enum import StrEnum
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from drivers.record import record

Image: TypeAlias = NDArray[np.uint8]

UNKNOWN_YAW_STD_RAD = math.pi
"""From this standard deviation on a fix of the pose holds no yaw."""


@record(frozen=True, slots=True, kw_only=True)
class Sample:
    """Common part of all samples.

    Attributes:
        device: Name of the device in the configuration.
        t_ns: Host monotonic time of arrival in nanoseconds.
        t_device_ns: The device's own time in nanoseconds, or None.
    """

    device: str
    t_ns: int
    t_device_ns: int | None = None


@record(frozen=True, slots=True, kw_only=True)
class WheelSample(Sample):
    """Measurements of one wheel in one message; None for what the message does not contain.

    Attributes:
        wheel: Index of the wheel, from 0.
        position_rad: Angle turned since start at the wheel, unwrapped, forward positive.
        speed_rad_s: Speed of the wheel as the device reports it (often coarse: prefer positions).
        current_a: Motor current.
        current_is_signed: False where the device reports a magnitude only; the sign must then be inferred.
        voltage_v: Voltage at the motor's terminals where the device measures it, never the bus voltage.
        steering_rad: Steering angle, counter-clockwise from straight ahead.
    """

    wheel: int
    position_rad: float | None = None
    speed_rad_s: float | None = None
    current_a: float | None = None
    current_is_signed: bool = True
    voltage_v: float | None = None
    steering_rad: float | None = None


@record(frozen=True, slots=True, kw_only=True)
class PowerSample(Sample):
    """Supply of the rover: bus or battery voltage in V and current in A."""

    voltage_v: float
    current_a: float | None = None


@record(frozen=True, slots=True, kw_only=True)
class BumperSample(Sample):
    """State of a bumper or emergency-stop contact."""

    pressed: bool


class HeadingReference(StrEnum):
    """What a heading is measured against; the two are never mixed."""

    MAGNETIC = "magnetic"
    TRUE = "true"


@record(frozen=True, slots=True, kw_only=True)
class HeadingSample(Sample):
    """Yaw in rad, counter-clockwise from east, in [-pi, pi), and what it is measured against."""

    heading_rad: float
    reference: HeadingReference


@record(frozen=True, slots=True, kw_only=True)
class AttitudeSample(Sample):
    """Roll (left side up positive) and pitch (nose down positive) in rad; None where not measured."""

    roll_rad: float | None = None
    pitch_rad: float | None = None


@record(frozen=True, slots=True, kw_only=True)
class RateSample(Sample):
    """Angular rates in rad/s about the body axes; None where the device has no such axis."""

    rate_z_rad_s: float
    rate_x_rad_s: float | None = None
    rate_y_rad_s: float | None = None


@record(frozen=True, slots=True, kw_only=True)
class AccelerationSample(Sample):
    """Specific force in m/s2 along the body axes; at rest on level ground z reads +9.81."""

    x_m_s2: float
    y_m_s2: float
    z_m_s2: float


@record(frozen=True, slots=True, kw_only=True)
class FrameSample(Sample):
    """One camera frame.

    Attributes:
        image: Pixels, shape (height, width) or (height, width, 3) in BGR.
        t_capture_ns: Host monotonic time of exposure, or None where the camera does not report it.
        index: Running number of the frame.
    """

    image: Image
    t_capture_ns: int | None
    index: int


@record(frozen=True, slots=True, kw_only=True)
class PoseFixSample(Sample):
    """Pose of the rover measured from outside: position in m and yaw in rad in [-pi, pi) on the floor.

    The floor frame is that of the device's calibration, not that of the pose at start.

    Attributes:
        position_std_m: Standard deviation of x and of y.
        yaw_std_rad: Standard deviation of the yaw; from `UNKNOWN_YAW_STD_RAD` on the yaw is not measured.
        t_capture_ns: Host monotonic time at which the rover was there, not later than `t_ns`.
        arm_x_m: Where on the rover the position was measured: ahead of its origin; an antenna without yaw.
        arm_y_m: To the left of its origin.
        alone_std_m: As `position_std_m` of this fix alone, where that is larger because the errors of
            successive fixes are alike; None where it is the same.
    """

    x_m: float
    y_m: float
    yaw_rad: float
    position_std_m: float
    yaw_std_rad: float
    t_capture_ns: int
    arm_x_m: float = 0.0
    arm_y_m: float = 0.0
    alone_std_m: float | None = None


@record(frozen=True, slots=True, kw_only=True)
class FaultSample(Sample):
    """An error that the device or its bus reports.

    Attributes:
        wheel: Index of the wheel it concerns, or None for the whole device.
        code: The device's error word; 0 means that an earlier fault has cleared.
        text: Meaning of the code.
    """

    wheel: int | None = None
    code: int
    text: str


@record(frozen=True, slots=True, kw_only=True)
class LinkSample(Sample):
    """The link to the device came up or went down."""

    up: bool
    reason: str


@record(frozen=True, slots=True, kw_only=True)
class WheelCommand:
    """Wheel speed setpoints in rad/s at the wheel, one per wheel, and until when they hold.

    Attributes:
        steering_rad: Steering setpoints, one per wheel; None where the drive keeps its last ones.
    """

    t_ns: int
    expires_ns: int
    speed_rad_s: tuple[float, ...]
    steering_rad: tuple[float, ...] | None = None


@record(frozen=True, slots=True, kw_only=True)
class SentCommand:
    """The setpoints that a drive really got.

    Attributes:
        t_ns: Host monotonic time of sending.
        speed_rad_s: Setpoints after the device's own rounding and clipping.
        delivered: False when the link was down or full and nothing went out.
        steering_rad: Steering setpoints of all wheels; None for a drive that does not steer.
    """

    t_ns: int
    speed_rad_s: tuple[float, ...]
    delivered: bool
    steering_rad: tuple[float, ...] | None = None
