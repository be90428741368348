"""What the quantities of the rover are as ROS messages: the same while driving and in bags.

Frames after REP-103 and REP-105. Variances of what a rover on a plane does not measure are `NOT_MEASURED`.
"""

import math
from collections.abc import Iterable, Mapping, Sequence

from controllers.estimation.settings import FilterSettings
from rover_hil.connect.records import ImuRecord, OdometryRecord, PowerRecord, StatusRecord
from rover_hil.connect.ros2.messages import (
    BatteryState,
    DiagnosticStatus,
    Header,
    Imu,
    JointState,
    KeyValue,
    Odometry,
    Point,
    Pose,
    PoseWithCovariance,
    Quaternion,
    Time,
    Transform,
    TransformStamped,
    Twist,
    TwistWithCovariance,
    Vector3,
    zeros,
)

NOT_MEASURED = 1e6
"""Variance of z, roll and pitch, and of velocities that are not measured."""
UNKNOWN = -1.0
"""First element of a covariance whose quantity is not measured, by the convention of sensor_msgs/Imu."""
_TRIANGLE = {(0, 0): 0, (0, 1): 1, (0, 5): 2, (1, 1): 3, (1, 5): 4, (5, 5): 5}
"""Place of (x, y, yaw) covariances of the estimate in those of a pose: x, y, z, roll, pitch, yaw."""


def header(time_ns: int, frame: str) -> Header:
    """Return the header of a time in ns since 1970."""
    return Header(Time.of(time_ns), frame)


def turned(yaw_rad: float) -> Quaternion:
    """Return the orientation of a yaw."""
    return Quaternion(z=math.sin(yaw_rad / 2), w=math.cos(yaw_rad / 2))


def yaw_of(orientation: Quaternion) -> float:
    """Return the yaw of an orientation; NaN where it is none."""
    x, y, z, w = orientation.x, orientation.y, orientation.z, orientation.w
    if not 0.98 <= x * x + y * y + z * z + w * w <= 1.02:
        return math.nan
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def pose_covariance(triangle: Sequence[float]) -> list[float]:
    """Return the covariance of a pose, of that of x, y and yaw: its upper triangle by rows."""
    covariance = zeros(36)
    for (row, column), place in _TRIANGLE.items():
        covariance[6 * row + column] = covariance[6 * column + row] = triangle[place]
    for unmeasured in (2, 3, 4):
        covariance[7 * unmeasured] = NOT_MEASURED
    return covariance


def twist_covariance(variance: Sequence[float]) -> list[float]:
    """Return the covariance of a velocity, of the variances of x, y and yaw rate."""
    covariance = zeros(36)
    for place, value in zip((0, 1, 5), variance, strict=True):
        covariance[7 * place] = value
    for unmeasured in (2, 3, 4):
        covariance[7 * unmeasured] = NOT_MEASURED
    return covariance


def odometry(record: OdometryRecord, frame: str, child: str) -> Odometry:
    """Return the pose in `frame` and the velocity in `child`."""
    return Odometry(
        header=header(record["time_ns"], frame),
        child_frame_id=child,
        pose=PoseWithCovariance(
            Pose(Point(record["x_m"], record["y_m"]), turned(record["yaw_rad"])),
            pose_covariance(record["covariance"]),
        ),
        twist=TwistWithCovariance(
            Twist(
                Vector3(record["velocity_x_m_s"], record["velocity_y_m_s"]),
                Vector3(z=record["yaw_rate_rad_s"]),
            ),
            twist_covariance(record["velocity_variance"]),
        ),
    )


def transform(time_ns: int, pose: tuple[float, float, float], frame: str, child: str) -> TransformStamped:
    """Return where `child` is in `frame`: x and y in m, yaw in rad."""
    x_m, y_m, yaw_rad = pose
    return TransformStamped(header(time_ns, frame), child, Transform(Vector3(x_m, y_m), turned(yaw_rad)))


def joint_state(time_ns: int, frame: str, joints: Mapping[str, tuple[float, float | None]]) -> JointState:
    """Return positions and speeds of joints by their names.

    No number is NaN: where one speed is not known, all are left out, as the message allows.
    """
    speeds = [speed for _, speed in joints.values() if speed is not None]
    return JointState(
        header=header(time_ns, frame),
        name=list(joints),
        position=[position for position, _ in joints.values()],
        velocity=speeds if len(speeds) == len(joints) else [],
    )


def imu(record: ImuRecord, frame: str, noise: FilterSettings) -> Imu:
    """Return rates and specific force; the orientation is not measured as a whole.

    Args:
        record: The reading.
        frame: Body frame: the reading is in its axes.
        noise: Standard deviations of one reading.
    """
    not_known = [UNKNOWN, *zeros(8)]
    rates, force = record["rate_rad_s"], record["force_m_s2"]
    return Imu(
        header=header(record["time_ns"], frame),
        orientation_covariance=not_known,
        angular_velocity=Vector3(*(each or 0.0 for each in rates)),
        angular_velocity_covariance=_diagonal(
            NOT_MEASURED if each is None else noise.gyro_rate_noise_rad_s**2 for each in rates
        ),
        linear_acceleration=Vector3(*(force or ())),
        linear_acceleration_covariance=(
            not_known if force is None else _diagonal([noise.acceleration_noise_m_s2**2] * 3)
        ),
    )


def battery_state(record: PowerRecord, frame: str) -> BatteryState:
    """Return the supply of the rover; a current that is drawn is negative, what is not known NaN."""
    not_known, current_a = math.nan, record["current_a"]
    return BatteryState(
        header=header(record["time_ns"], frame),
        voltage=record["voltage_v"],
        temperature=not_known,
        current=not_known if current_a is None else -current_a,
        charge=not_known,
        capacity=not_known,
        design_capacity=not_known,
        percentage=not_known,
        present=True,
    )


def status(record: StatusRecord) -> DiagnosticStatus:
    """Return the state of a part; its name also is its hardware id."""
    pairs = [KeyValue(key, "" if value is None else str(value)) for key, value in record["values"].items()]
    name = record["name"]
    return DiagnosticStatus(record["level"], f"rover_hil: {name}", record["message"], name, pairs)


def _diagonal(variances: Iterable[float]) -> list[float]:
    matrix = zeros(9)
    for place, value in enumerate(variances):
        matrix[4 * place] = value
    return matrix
