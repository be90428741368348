"""What other programs get of a cycle: over ROS 2, and as a line of JSON. All times are in ns since 1970."""

from collections.abc import Mapping

from typing_extensions import TypedDict

Triple = tuple[float, float, float]


class OdometryRecord(TypedDict):
    """Pose, velocity and slip of a cycle.

    `time_ns` is since 1970. The covariance is that of x, y, yaw: xx, xy, x yaw, yy, y yaw, yaw yaw. The
    velocity is in the body frame, its variance in m2/s2, m2/s2, rad2/s2. `slip` is a ratio of the travel of
    the wheels, None where it is not valid: `slip_reason` says why.
    """

    time_ns: int
    mode: str
    reason: str
    x_m: float
    y_m: float
    yaw_rad: float
    covariance: tuple[float, ...]
    velocity_x_m_s: float
    velocity_y_m_s: float
    yaw_rate_rad_s: float
    velocity_variance: tuple[float, float, float]
    slip: float | None
    slip_sd: float | None
    slip_reason: str


class WheelsRecord(TypedDict):
    """Wheels, and angles of those that steer; None for what is not known."""

    time_ns: int
    position_rad: list[float | None]
    speed_rad_s: list[float | None]
    steering_rad: list[float]


class ImuRecord(TypedDict):
    """A reading of an IMU in body axes; None for what is not measured."""

    time_ns: int
    rate_rad_s: tuple[float | None, float | None, float]
    force_m_s2: Triple | None


class PowerRecord(TypedDict):
    """Supply of the rover."""

    time_ns: int
    voltage_v: float
    current_a: float | None


class StatusRecord(TypedDict):
    """State of a part of the rover: 0 for good, 1 for a warning, 2 for an error, 3 for no data."""

    level: int
    name: str
    message: str
    values: Mapping[str, object]


class CycleRecord(TypedDict):
    """A cycle.

    `odometry` is None where the estimate is not newer than in the record before. `map_to_odom` is where the
    frame of the pose is in that of pose fixes: x and y in m, yaw in rad; None without fixes. `imu` has the
    readings of the gyro's device. `status` is there once per second and at each change, else None.
    """

    time_ns: int
    odometry: OdometryRecord | None
    map_to_odom: Triple | None
    wheels: WheelsRecord | None
    imu: list[ImuRecord]
    power: list[PowerRecord]
    status: list[StatusRecord] | None
