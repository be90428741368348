"""Which topic of a bag holds what: the TOML file of `import rosbag`."""

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from drivers.settings import Settings, read_toml
from rover_hil.config import validated
from rover_hil.drives.formats.fixes import FixNoise, MarkerPlace

JOINT_STATE = "sensor_msgs/msg/JointState"
ODOMETRY = "nav_msgs/msg/Odometry"
IMU = "sensor_msgs/msg/Imu"
NAV_SAT_FIX = "sensor_msgs/msg/NavSatFix"
COMPRESSED_IMAGE = "sensor_msgs/msg/CompressedImage"
ARRAYS = ("std_msgs/msg/Float64MultiArray", "std_msgs/msg/Float32MultiArray")
POSES = (
    ODOMETRY,
    "geometry_msgs/msg/PoseStamped",
    "geometry_msgs/msg/PoseWithCovarianceStamped",
    "geometry_msgs/msg/TransformStamped",
)
POINT = "geometry_msgs/msg/PointStamped"
TWISTS = ("geometry_msgs/msg/TwistStamped", "geometry_msgs/msg/TwistWithCovarianceStamped")
MOST_WHEELS = 32
TopicName = Annotated[str, Field(min_length=1, max_length=255)]


class Topic(Settings):
    """A topic, by its name in the bag."""

    topic: TopicName


class WheelTopic(Topic):
    """Angles and speeds of the wheels, sensor_msgs/JointState.

    Attributes:
        joints: Names of the joints, in the order of the rover's wheels; "" for a wheel without an encoder.
        steering: Names of the joints whose angles are the steering of the wheels, in the same order; "" for a
            wheel that does not steer.
        signs: -1 for a joint that counts backwards when the rover drives forwards, else 1.
        effort_is_current: The effort is a motor current in A. ROS says N or N m, many drivers send A.
        wrap_rad: The angles wrap after this much. One to four turns are found without it.
    """

    joints: Annotated[tuple[str, ...], Field(min_length=1, max_length=MOST_WHEELS)]
    steering: Annotated[tuple[str, ...], Field(max_length=MOST_WHEELS)] = ()
    signs: tuple[Literal[1, -1], ...] = ()
    effort_is_current: bool = False
    wrap_rad: Annotated[float, Field(gt=0)] | None = None

    @model_validator(mode="after")
    def _check_signs(self) -> Self:
        if self.signs and len(self.signs) != len(self.joints):
            raise ValueError(f"{len(self.signs)} signs for {len(self.joints)} joints: give one for each")
        if self.steering and len(self.steering) != len(self.joints):
            raise ValueError(
                f"{len(self.steering)} names in steering for {len(self.joints)} joints: give one for each, "
                '"" for a wheel that does not steer'
            )
        return self


class ImuTopic(Topic):
    """Angular rates, and acceleration where there is one, sensor_msgs/Imu.

    Attributes:
        use_orientation: The orientation is one against the earth, x to the east: it becomes heading and tilt.
        heading_reference: What the yaw is measured against.
    """

    use_orientation: bool = False
    heading_reference: Literal["magnetic", "true"] = "magnetic"


class FixTopic(Topic, FixNoise):
    """Poses or positions that correct the estimate; their covariance is used where they have one.

    Attributes:
        marker: What is measured; default: the origin of the rover.
    """

    marker: MarkerPlace = MarkerPlace()


class Topics(Settings):
    """What of a bag becomes a log.

    Attributes:
        rover: Configuration whose wheels and limits are those of the rover: a TOML file, or a shipped one.
        wheels: Angles and speeds of the wheels.
        odometry: Instead of `wheels`: a path, nav_msgs/Odometry, or speed and yaw rate, geometry_msgs/
            TwistStamped or TwistWithCovarianceStamped; the wheels get the angles that give it.
        imu: Angular rates.
        currents: Motor currents in A, in the order of the rover's wheels, std_msgs/Float64MultiArray or
            Float32MultiArray.
        fixes: Poses or positions that correct the estimate: sensor_msgs/NavSatFix, or as for the truth.
        truth: Ground truth, nav_msgs/Odometry, geometry_msgs/PoseStamped, PoseWithCovarianceStamped,
            TransformStamped, or PointStamped without a yaw.
        camera: Pictures, sensor_msgs/CompressedImage, JPEG or PNG.
    """

    rover: str
    wheels: WheelTopic | None = None
    odometry: Topic | None = None
    imu: ImuTopic | None = None
    currents: Topic | None = None
    fixes: FixTopic | None = None
    truth: Topic | None = None
    camera: Topic | None = None

    @model_validator(mode="after")
    def _check_wheels(self) -> Self:
        if (self.wheels is None) == (self.odometry is None):
            raise ValueError("give the topic of the wheels: either [wheels] or [odometry]")
        if self.currents is not None and self.wheels is not None and self.wheels.effort_is_current:
            raise ValueError(
                "the currents come from [currents] or from the effort of [wheels], not from both"
            )
        named = [topic.topic for _, topic, _ in self.mapped()]
        repeated = next((name for name in named if named.count(name) > 1), None)
        if repeated is not None:
            raise ValueError(f"two sections name the topic {repeated}: correct one")
        return self

    def mapped(self) -> Iterator[tuple[str, Topic, tuple[str, ...]]]:
        """Yield section, topic and allowed message types of all that is mapped."""
        for section, topic, types in (
            ("wheels", self.wheels, (JOINT_STATE,)),
            ("odometry", self.odometry, (ODOMETRY, *TWISTS)),
            ("imu", self.imu, (IMU,)),
            ("currents", self.currents, ARRAYS),
            ("fixes", self.fixes, (NAV_SAT_FIX, POINT, *POSES)),
            ("truth", self.truth, (POINT, *POSES)),
            ("camera", self.camera, (COMPRESSED_IMAGE,)),
        ):
            if topic is not None:
                yield section, topic, types


def read_topics(path: Path) -> Topics:
    """Return the content of a file of topics.

    Raises:
        ConfigError: It cannot be read, or holds mistakes; one line per mistake.
    """
    return validated(Topics, read_toml(path, f"file of topics {path}", "correct the path"), str(path))
