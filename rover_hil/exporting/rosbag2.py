"""Write a log as a ROS 2 bag, with the messages that ROS programs expect, through the library rosbags."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

from controllers.estimation.settings import FilterSettings
from drivers.errors import ConfigError
from drivers.samples import AccelerationSample, RateSample, WheelSample
from rover_hil.connect.odometry_record import OdometryRecorder
from rover_hil.connect.records import ImuRecord, OdometryRecord
from rover_hil.connect.ros2 import mapping
from rover_hil.connect.ros2.messages import CompressedImage, Message
from rover_hil.exporting.rosbag_types import to_rosbags
from rover_hil.recording.data_files import restore_config
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
    TruthRecord,
)

BAG_VERSION: Literal[9] = 9
"""Of the metadata; ROS 2 Iron and later write it, and older ones read it."""
BASE = "base_link"


def write_rosbag2(log: LogReader, folder: Path, on_message: Callable[[], None]) -> Mapping[str, int]:
    """Write a bag into a folder that does not exist yet; return the number of messages by topic.

    Topics: `/odom` (estimate) and `/ground_truth` as nav_msgs/Odometry, `/joint_states` as
    sensor_msgs/JointState, `/imu/DEVICE` as sensor_msgs/Imu with rates and specific force, and
    `/camera/DEVICE/compressed` as sensor_msgs/CompressedImage. Stamps are wall-clock time, of `/odom` that of
    the wheel positions behind the estimate.

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
    with restore_config(log) as config, Writer(folder, version=BAG_VERSION) as writer:
        bag = _Bag(writer, log.wall_offset_ns, config.filter)
        recorder = OdometryRecorder(config.filter, config.ground)
        accelerations: dict[str, AccelerationSample] = {}
        for message in log.messages():
            if message.topic == ESTIMATE:
                record = log.parse(message, ESTIMATE_SHAPE)
                odometry = recorder.record(log.wall_offset_ns, record)
                if odometry is not None:
                    bag.odometry("/odom", "odom", odometry)
            elif message.topic == TRUTH:
                truth = log.parse(message, TRUTH_SHAPE)
                bag.odometry("/ground_truth", "world", _exact(log.wall_offset_ns + message.t_ns, truth))
            elif message.topic == SAMPLES:
                samples = log.parse(message, SAMPLES_SHAPE)
                if samples.wheels:
                    bag.wheels(samples.wheels)
                accelerations.update({each.device: each for each in samples.accelerations})
                for rate in samples.rates:
                    bag.rate(rate, accelerations.get(rate.device))
            elif message.topic.startswith(RAW) and _is_picture(message.data):
                bag.picture(message.topic.removeprefix(RAW), message.t_ns, message.data)
            on_message()
    return bag.counts


def _exact(time_ns: int, truth: TruthRecord) -> OdometryRecord:
    """Return the record of a true pose: without variances but those of velocities that are not known."""
    speeds = [truth.get(name) for name in ("velocity_x_m_s", "velocity_y_m_s", "yaw_rate_rad_s")]
    known = [speed if isinstance(speed, float) else None for speed in speeds]
    forward, left, turn = (speed or 0.0 for speed in known)
    variances = [mapping.NOT_MEASURED if speed is None else 0.0 for speed in known]
    return {
        "time_ns": time_ns,
        "mode": "",
        "reason": "",
        "x_m": truth["x_m"],
        "y_m": truth["y_m"],
        "yaw_rad": truth.get("yaw_rad", 0.0),
        "covariance": (0.0,) * 5 + (0.0 if "yaw_rad" in truth else mapping.NOT_MEASURED,),
        "velocity_x_m_s": forward,
        "velocity_y_m_s": left,
        "yaw_rate_rad_s": turn,
        "velocity_variance": (variances[0], variances[1], variances[2]),
        "slip": None,
        "slip_sd": None,
        "slip_reason": "",
    }


def _is_picture(data: bytes) -> bool:
    return data[8:].startswith((b"\xff\xd8", b"\x89PNG", b"BM"))


class _Bag:
    """A bag being written."""

    def __init__(self, writer: Any, wall_offset_ns: int, noise: FilterSettings) -> None:
        from rosbags.typesys import Stores, get_typestore

        self.counts: dict[str, int] = {}
        self._writer = writer
        self._offset_ns = wall_offset_ns
        self._noise = noise
        self._store = get_typestore(Stores.ROS2_HUMBLE)
        self._connections: dict[str, Any] = {}

    def odometry(self, topic: str, frame: str, record: OdometryRecord) -> None:
        """Write a nav_msgs/Odometry."""
        self._write(topic, record["time_ns"], mapping.odometry(record, frame, BASE))

    def wheels(self, samples: Sequence[WheelSample]) -> None:
        """Write a sensor_msgs/JointState of the wheels of a cycle; wheels without a position are left out."""
        joints = {
            f"wheel{sample.wheel + 1}": (sample.position_rad, sample.speed_rad_s)
            for sample in samples
            if sample.position_rad is not None
        }
        time_ns = self._offset_ns + samples[-1].t_ns
        self._write("/joint_states", time_ns, mapping.joint_state(time_ns, BASE, joints))

    def rate(self, sample: RateSample, force: AccelerationSample | None) -> None:
        """Write a sensor_msgs/Imu."""
        time_ns = self._offset_ns + sample.t_ns
        record: ImuRecord = {
            "time_ns": time_ns,
            "rate_rad_s": (sample.rate_x_rad_s, sample.rate_y_rad_s, sample.rate_z_rad_s),
            "force_m_s2": None if force is None else (force.x_m_s2, force.y_m_s2, force.z_m_s2),
        }
        message = mapping.imu(record, BASE, self._noise)
        self._write(f"/imu/{sample.device}", time_ns, message)

    def picture(self, device: str, t_ns: int, data: bytes) -> None:
        """Write a sensor_msgs/CompressedImage; a frame without pixels is left out."""
        image = decode_image(data)
        if image.image.size == 0:
            return
        time_ns = self._offset_ns + t_ns
        message = CompressedImage(
            header=mapping.header(self._offset_ns + (image.t_capture_ns or t_ns), device),
            format="png" if image.jpeg is None else "jpeg",
            data=data[8:],
        )
        self._write(f"/camera/{device}/compressed", time_ns, message)

    def _write(self, topic: str, time_ns: int, message: Message) -> None:
        kind = message.ros_type
        if topic not in self._connections:
            self._connections[topic] = self._writer.add_connection(topic, kind, typestore=self._store)
        data = self._store.serialize_cdr(to_rosbags(message, self._store.types), kind)
        self._writer.write(self._connections[topic], time_ns, data)
        self.counts[topic] = self.counts.get(topic, 0) + 1
