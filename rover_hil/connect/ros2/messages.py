"""The ROS 2 messages of the program, field by field: for topics while driving and for bags.

Field names, order and types are those of ROS 2. `field_types` is what the DDS types and the messages of
rosbags are made from, so that no message is declared twice. All defaults are the zeros of ROS.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from functools import cache
from typing import Annotated, Any, ClassVar, NamedTuple, Protocol, get_args, get_origin, get_type_hints

UInt8 = Annotated[int, "uint8"]
Byte = Annotated[int, "byte"]
Int32 = Annotated[int, "int32"]
UInt32 = Annotated[int, "uint32"]
Float32 = Annotated[float, "float32"]
Float64 = Annotated[float, "float64"]
Text = Annotated[str, "string"]
Truth = Annotated[bool, "bool"]
Float64s = Annotated[Sequence[float], "float64[]"]
Float32s = Annotated[Sequence[float], "float32[]"]
Texts = Annotated[Sequence[str], "string[]"]
Bytes = Annotated[bytes, "uint8[]"]
Matrix3 = Annotated[Sequence[float], "float64[9]"]
Matrix6 = Annotated[Sequence[float], "float64[36]"]

NANOSECONDS = 1_000_000_000


class Message(Protocol):
    """A message or a part of one.

    Attributes:
        ros_type: Name of its type, as `nav_msgs/msg/Odometry`.
    """

    __dataclass_fields__: ClassVar[dict[str, Any]]
    ros_type: ClassVar[str]


class FieldType(NamedTuple):
    """Type of a field.

    Attributes:
        base: Name of a primitive type of ROS, or the class of a part.
        is_list: Whether it holds several.
        size: Their number; None where it is not fixed.
    """

    base: str | type[Message]
    is_list: bool = False
    size: int | None = None


@cache
def field_types(message: type[Message]) -> Mapping[str, FieldType]:
    """Return the types of the fields of a message in their order."""
    hints = get_type_hints(message, include_extras=True)
    return {each.name: _field_type(hints[each.name]) for each in fields(message)}


def _field_type(hint: object) -> FieldType:
    if get_origin(hint) is not Annotated:
        return FieldType(hint)  # type: ignore[arg-type]
    kind, words = get_args(hint)
    base, bracket, size = str(words).partition("[")
    if not bracket:
        return FieldType(base)
    (item,) = get_args(kind) or (int,)
    return FieldType(base or item, is_list=True, size=int(size[:-1]) if size != "]" else None)


def dds_name(ros_type: str) -> str:
    """Return the name that ROS 2 gives a type in DDS, as `nav_msgs::msg::dds_::Odometry_`."""
    package, kind, name = ros_type.split("/")
    return f"{package}::{kind}::dds_::{name}_"


def zeros(size: int) -> list[float]:
    """Return a list of zeros."""
    return [0.0] * size


@dataclass(slots=True)
class Time:
    """A moment since 1970."""

    ros_type: ClassVar[str] = "builtin_interfaces/msg/Time"
    sec: Int32 = 0
    nanosec: UInt32 = 0

    @classmethod
    def of(cls, time_ns: int) -> "Time":
        """Return the moment of a time in ns since 1970."""
        return cls(*divmod(time_ns, NANOSECONDS))

    @property
    def time_ns(self) -> int:
        """Time in ns since 1970."""
        return self.sec * NANOSECONDS + self.nanosec


@dataclass(slots=True)
class Header:
    """Time and coordinate frame."""

    ros_type: ClassVar[str] = "std_msgs/msg/Header"
    stamp: Time = field(default_factory=Time)
    frame_id: Text = ""


@dataclass(slots=True)
class Vector3:
    """A vector."""

    ros_type: ClassVar[str] = "geometry_msgs/msg/Vector3"
    x: Float64 = 0.0
    y: Float64 = 0.0
    z: Float64 = 0.0


@dataclass(slots=True)
class Point:
    """A point in m."""

    ros_type: ClassVar[str] = "geometry_msgs/msg/Point"
    x: Float64 = 0.0
    y: Float64 = 0.0
    z: Float64 = 0.0


@dataclass(slots=True)
class Quaternion:
    """An orientation."""

    ros_type: ClassVar[str] = "geometry_msgs/msg/Quaternion"
    x: Float64 = 0.0
    y: Float64 = 0.0
    z: Float64 = 0.0
    w: Float64 = 1.0


@dataclass(slots=True)
class Pose:
    """Position and orientation."""

    ros_type: ClassVar[str] = "geometry_msgs/msg/Pose"
    position: Point = field(default_factory=Point)
    orientation: Quaternion = field(default_factory=Quaternion)


@dataclass(slots=True)
class PoseWithCovariance:
    """A pose and its covariance over x, y, z, roll, pitch, yaw by rows."""

    ros_type: ClassVar[str] = "geometry_msgs/msg/PoseWithCovariance"
    pose: Pose = field(default_factory=Pose)
    covariance: Matrix6 = field(default_factory=lambda: zeros(36))


@dataclass(slots=True)
class PoseWithCovarianceStamped:
    """A pose in a frame at a time."""

    ros_type: ClassVar[str] = "geometry_msgs/msg/PoseWithCovarianceStamped"
    header: Header = field(default_factory=Header)
    pose: PoseWithCovariance = field(default_factory=PoseWithCovariance)


@dataclass(slots=True)
class Twist:
    """Velocity in m/s and rad/s."""

    ros_type: ClassVar[str] = "geometry_msgs/msg/Twist"
    linear: Vector3 = field(default_factory=Vector3)
    angular: Vector3 = field(default_factory=Vector3)


@dataclass(slots=True)
class TwistStamped:
    """A velocity at a time."""

    ros_type: ClassVar[str] = "geometry_msgs/msg/TwistStamped"
    header: Header = field(default_factory=Header)
    twist: Twist = field(default_factory=Twist)


@dataclass(slots=True)
class TwistWithCovariance:
    """A velocity and its covariance."""

    ros_type: ClassVar[str] = "geometry_msgs/msg/TwistWithCovariance"
    twist: Twist = field(default_factory=Twist)
    covariance: Matrix6 = field(default_factory=lambda: zeros(36))


@dataclass(slots=True)
class Odometry:
    """Pose in `header.frame_id`, velocity in `child_frame_id`."""

    ros_type: ClassVar[str] = "nav_msgs/msg/Odometry"
    header: Header = field(default_factory=Header)
    child_frame_id: Text = ""
    pose: PoseWithCovariance = field(default_factory=PoseWithCovariance)
    twist: TwistWithCovariance = field(default_factory=TwistWithCovariance)


@dataclass(slots=True)
class Transform:
    """Where one frame is in another."""

    ros_type: ClassVar[str] = "geometry_msgs/msg/Transform"
    translation: Vector3 = field(default_factory=Vector3)
    rotation: Quaternion = field(default_factory=Quaternion)


@dataclass(slots=True)
class TransformStamped:
    """Where `child_frame_id` is in `header.frame_id` at a time."""

    ros_type: ClassVar[str] = "geometry_msgs/msg/TransformStamped"
    header: Header = field(default_factory=Header)
    child_frame_id: Text = ""
    transform: Transform = field(default_factory=Transform)


@dataclass(slots=True)
class TFMessage:
    """Transforms."""

    ros_type: ClassVar[str] = "tf2_msgs/msg/TFMessage"
    transforms: Annotated[Sequence[TransformStamped], "[]"] = ()


@dataclass(slots=True)
class JointState:
    """Angle, speed and torque of joints; a list may be empty."""

    ros_type: ClassVar[str] = "sensor_msgs/msg/JointState"
    header: Header = field(default_factory=Header)
    name: Texts = ()
    position: Float64s = ()
    velocity: Float64s = ()
    effort: Float64s = ()


@dataclass(slots=True)
class Imu:
    """Readings of an IMU; -1 as the first variance says that a quantity is not measured."""

    ros_type: ClassVar[str] = "sensor_msgs/msg/Imu"
    header: Header = field(default_factory=Header)
    orientation: Quaternion = field(default_factory=Quaternion)
    orientation_covariance: Matrix3 = field(default_factory=lambda: zeros(9))
    angular_velocity: Vector3 = field(default_factory=Vector3)
    angular_velocity_covariance: Matrix3 = field(default_factory=lambda: zeros(9))
    linear_acceleration: Vector3 = field(default_factory=Vector3)
    linear_acceleration_covariance: Matrix3 = field(default_factory=lambda: zeros(9))


@dataclass(slots=True)
class KeyValue:
    """A value by its name."""

    ros_type: ClassVar[str] = "diagnostic_msgs/msg/KeyValue"
    key: Text = ""
    value: Text = ""


@dataclass(slots=True)
class DiagnosticStatus:
    """State of a part of the robot: 0 for good, 1 for a warning, 2 for an error, 3 for no data."""

    ros_type: ClassVar[str] = "diagnostic_msgs/msg/DiagnosticStatus"
    level: Byte = 0
    name: Text = ""
    message: Text = ""
    hardware_id: Text = ""
    values: Annotated[Sequence[KeyValue], "[]"] = ()


@dataclass(slots=True)
class DiagnosticArray:
    """States of parts of the robot."""

    ros_type: ClassVar[str] = "diagnostic_msgs/msg/DiagnosticArray"
    header: Header = field(default_factory=Header)
    status: Annotated[Sequence[DiagnosticStatus], "[]"] = ()


@dataclass(slots=True)
class BatteryState:
    """State of a battery; NaN for what is not measured."""

    ros_type: ClassVar[str] = "sensor_msgs/msg/BatteryState"
    header: Header = field(default_factory=Header)
    voltage: Float32 = 0.0
    temperature: Float32 = 0.0
    current: Float32 = 0.0
    charge: Float32 = 0.0
    capacity: Float32 = 0.0
    design_capacity: Float32 = 0.0
    percentage: Float32 = 0.0
    power_supply_status: UInt8 = 0
    power_supply_health: UInt8 = 0
    power_supply_technology: UInt8 = 0
    present: Truth = False
    cell_voltage: Float32s = ()
    cell_temperature: Float32s = ()
    location: Text = ""
    serial_number: Text = ""


@dataclass(slots=True)
class Bool:
    """A truth value."""

    ros_type: ClassVar[str] = "std_msgs/msg/Bool"
    data: Truth = False


@dataclass(slots=True)
class CompressedImage:
    """A picture file."""

    ros_type: ClassVar[str] = "sensor_msgs/msg/CompressedImage"
    header: Header = field(default_factory=Header)
    format: Text = ""
    data: Bytes = b""


TYPE_HASHES: Mapping[type[Message], str] = {
    Odometry: "RIHS01_3cc97dc7fb7502f8714462c526d369e35b603cfc34d946e3f2eda2766dfec6e0",
    TFMessage: "RIHS01_e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087",
    JointState: "RIHS01_a13ee3a330e346c9d87b5aa18d24e11690752bd33a0350f11c5882bc9179260e",
    Imu: "RIHS01_7d9a00ff131080897a5ec7e26e315954b8eae3353c3f995c55faf71574000b5b",
    DiagnosticArray: "RIHS01_5a8a36efb05fb25070fa0fb3810290c0e6cd4862b54a8fb975a1ee8dc55a333e",
    BatteryState: "RIHS01_4bee5dfce981c98faa6828b868307a0a73f992ed0789f374ee96c8f840e69741",
    Twist: "RIHS01_9c45bf16fe0983d80e3cfe750d6835843d265a9a6c46bd2e609fcddde6fb8d2a",
    TwistStamped: "RIHS01_5f0fcd4f81d5d06ad9b4c4c63e3ea51b82d6ae4d0558f1d475229b1121db6f64",
    Bool: "RIHS01_feb91e995ff9ebd09c0cb3d2aed18b11077585839fb5db80193b62d74528f6c9",
    PoseWithCovarianceStamped: "RIHS01_26432f9803e43727d3c8f668d1fdb3c630f548af631e2f4e31382371bfea3b6e",
}
"""Hash after REP-2011 of each type that goes over the network."""
