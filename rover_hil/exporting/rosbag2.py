"""Write a log as a ROS 2 bag, with the messages that ROS programs expect, through the library rosbags."""

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np

from drivers.errors import ConfigError
from drivers.samples import RateSample, WheelSample
from rover_hil.recording.images import decode_image
from rover_hil.recording.reader import LogReader
from rover_hil.recording.schema import (
    ESTIMATE,
    ESTIMATE_SHAPE,
    RAW,
    SAMPLES,
    SAMPLES_SHAPE,
    TRUTH,
    TRUTH_SHAPE,
)

BAG_VERSION: Literal[9] = 9
"""Of the metadata; ROS 2 Iron and later write it, and older ones read it."""
NANOSECONDS = 1_000_000_000
UNKNOWN = -1.0
"""First element of a covariance whose quantity is not measured, by the convention of sensor_msgs/Imu."""
_FROM_TRIANGLE = {(0, 0): 0, (0, 1): 1, (0, 5): 2, (1, 1): 3, (1, 5): 4, (5, 5): 5}
"""Place of (x, y, yaw) covariances of the estimate in those of a pose: x, y, z, roll, pitch, yaw."""


def write_rosbag2(log: LogReader, folder: Path, on_message: Callable[[], None]) -> Mapping[str, int]:
    """Write a bag into a folder that does not exist yet; return the number of messages by topic.

    Topics: `/odom` (estimate) and `/ground_truth` as nav_msgs/Odometry, `/joint_states` as
    sensor_msgs/JointState, `/imu/DEVICE` as sensor_msgs/Imu with rates only, and `/camera/DEVICE/compressed`
    as sensor_msgs/CompressedImage. Stamps are wall-clock time.

    Args:
        log: The log.
        folder: The bag.
        on_message: Called after each message of the log, to show progress.

    Raises:
        ConfigError: rosbags is missing.
        LogError: The log is damaged.
    """
    try:
        from rosbags.rosbag2 import Writer
    except ImportError as error:
        raise ConfigError("--rosbag2 needs rosbags: `pip install rover-hil[rosbag]`") from error
    with Writer(folder, version=BAG_VERSION) as writer:
        bag = _Bag(writer, log.wall_offset_ns)
        for message in log.messages():
            if message.topic == ESTIMATE:
                record = log.parse(message, ESTIMATE_SHAPE)
                pose = record["estimate"]
                bag.odometry(
                    "/odom",
                    message.t_ns,
                    (pose["x_m"], pose["y_m"], pose["yaw_rad"]),
                    (pose["velocity_x_m_s"], pose["velocity_y_m_s"], pose["yaw_rate_rad_s"]),
                    pose["covariance"],
                )
            elif message.topic == TRUTH:
                truth = log.parse(message, TRUTH_SHAPE)
                speeds = [truth.get(name) for name in ("velocity_x_m_s", "velocity_y_m_s", "yaw_rate_rad_s")]
                bag.odometry(
                    "/ground_truth",
                    message.t_ns,
                    (truth["x_m"], truth["y_m"], truth["yaw_rad"]),
                    [speed if isinstance(speed, float) else math.nan for speed in speeds],
                    (0.0,) * 6,
                )
            elif message.topic == SAMPLES:
                samples = log.parse(message, SAMPLES_SHAPE)
                if samples.wheels:
                    bag.wheels(samples.wheels)
                for rate in samples.rates:
                    bag.rate(rate)
            elif message.topic.startswith(RAW) and _is_picture(message.data):
                bag.picture(message.topic.removeprefix(RAW), message.t_ns, message.data)
            on_message()
    return bag.counts


def _is_picture(data: bytes) -> bool:
    return data[8:].startswith((b"\xff\xd8", b"\x89PNG", b"BM"))


class _Bag:
    """A bag being written."""

    def __init__(self, writer: Any, wall_offset_ns: int) -> None:
        from rosbags.typesys import Stores, get_typestore

        self.counts: dict[str, int] = {}
        self._writer = writer
        self._offset_ns = wall_offset_ns
        self._store = get_typestore(Stores.ROS2_HUMBLE)
        self._types: Any = self._store.types
        self._connections: dict[str, Any] = {}

    def odometry(
        self,
        topic: str,
        t_ns: int,
        pose: Sequence[float],
        velocity: Sequence[float],
        triangle: Sequence[float],
    ) -> None:
        """Write a nav_msgs/Odometry; `triangle` is the covariance of x, y and yaw."""
        covariance = np.zeros((6, 6))
        for (row, column), place in _FROM_TRIANGLE.items():
            covariance[row, column] = covariance[column, row] = triangle[place]
        position = self._make("geometry_msgs/msg/Point", x=pose[0], y=pose[1], z=0.0)
        turned = self._make(
            "geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=math.sin(pose[2] / 2), w=math.cos(pose[2] / 2)
        )
        twist = self._make(
            "geometry_msgs/msg/Twist",
            linear=self._vector(velocity[0], velocity[1], 0.0),
            angular=self._vector(0.0, 0.0, velocity[2]),
        )
        message = self._make(
            "nav_msgs/msg/Odometry",
            header=self._header(t_ns, "odom" if topic == "/odom" else "world"),
            child_frame_id="base_link",
            pose=self._make(
                "geometry_msgs/msg/PoseWithCovariance",
                pose=self._make("geometry_msgs/msg/Pose", position=position, orientation=turned),
                covariance=covariance.ravel(),
            ),
            twist=self._make("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=np.zeros(36)),
        )
        self._write(topic, t_ns, message)

    def wheels(self, samples: Sequence[WheelSample]) -> None:
        """Write a sensor_msgs/JointState of the wheels of a cycle."""
        numbers = [
            [math.nan if value is None else value for value in (sample.position_rad, sample.speed_rad_s)]
            for sample in samples
        ]
        t_ns = samples[-1].t_ns
        message = self._make(
            "sensor_msgs/msg/JointState",
            header=self._header(t_ns, "base_link"),
            name=[f"wheel{sample.wheel + 1}" for sample in samples],
            position=np.array([pair[0] for pair in numbers]),
            velocity=np.array([pair[1] for pair in numbers]),
            effort=np.array([]),
        )
        self._write("/joint_states", t_ns, message)

    def rate(self, sample: RateSample) -> None:
        """Write a sensor_msgs/Imu with angular rates only."""
        unknown = np.zeros(9)
        unknown[0] = UNKNOWN
        message = self._make(
            "sensor_msgs/msg/Imu",
            header=self._header(sample.t_ns, sample.device),
            orientation=self._make("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=0.0, w=1.0),
            orientation_covariance=unknown,
            angular_velocity=self._vector(
                sample.rate_x_rad_s or 0.0, sample.rate_y_rad_s or 0.0, sample.rate_z_rad_s
            ),
            angular_velocity_covariance=np.zeros(9),
            linear_acceleration=self._vector(0.0, 0.0, 0.0),
            linear_acceleration_covariance=unknown,
        )
        self._write(f"/imu/{sample.device}", sample.t_ns, message)

    def picture(self, device: str, t_ns: int, data: bytes) -> None:
        """Write a sensor_msgs/CompressedImage; a frame without pixels is left out."""
        image = decode_image(data)
        if image.image.size == 0:
            return
        message = self._make(
            "sensor_msgs/msg/CompressedImage",
            header=self._header(image.t_capture_ns or t_ns, device),
            format="png" if image.jpeg is None else "jpeg",
            data=np.frombuffer(data, np.uint8, offset=8),
        )
        self._write(f"/camera/{device}/compressed", t_ns, message)

    def _write(self, topic: str, t_ns: int, message: Any) -> None:
        kind = message.__msgtype__
        if topic not in self._connections:
            self._connections[topic] = self._writer.add_connection(topic, kind, typestore=self._store)
        data = self._store.serialize_cdr(message, kind)
        self._writer.write(self._connections[topic], self._offset_ns + t_ns, data)
        self.counts[topic] = self.counts.get(topic, 0) + 1

    def _make(self, kind: str, **values: object) -> Any:
        return self._types[kind](**values)

    def _vector(self, x: float, y: float, z: float) -> Any:
        return self._make("geometry_msgs/msg/Vector3", x=x, y=y, z=z)

    def _header(self, t_ns: int, frame: str) -> Any:
        seconds, nanoseconds = divmod(self._offset_ns + t_ns, NANOSECONDS)
        stamp = self._make("builtin_interfaces/msg/Time", sec=seconds, nanosec=nanoseconds)
        return self._make("std_msgs/msg/Header", stamp=stamp, frame_id=frame)
