"""The records of a run as messages on the topics of ROS 2."""

import math
from collections.abc import Sequence

from controllers.estimation.settings import FilterSettings
from rover_hil.config.ros2_settings import Ros2Settings
from rover_hil.connect.records import CycleRecord, OdometryRecord, WheelsRecord
from rover_hil.connect.ros2 import mapping
from rover_hil.connect.ros2.messages import (
    BatteryState,
    DiagnosticArray,
    Imu,
    JointState,
    Odometry,
    TFMessage,
    TransformStamped,
)
from rover_hil.connect.ros2.node import Node

POWER_PERIOD_NS = 1_000_000_000


class Publisher:
    """Sends the records of a run; makes all its writers at once, so that readers find them early.

    Args:
        node: The participant.
        settings: The section [ros2].
        noise: Of the readings of the IMU.
        joint_names: Of the wheels, then of the steering of those that steer.
        static: Where devices are on the rover.
    """

    def __init__(
        self,
        node: Node,
        settings: Ros2Settings,
        noise: FilterSettings,
        joint_names: Sequence[str],
        static: Sequence[TransformStamped] = (),
    ) -> None:
        self._settings = settings
        self._noise = noise
        self._joint_names = joint_names
        self._odometry = node.writer("odom", Odometry)
        self._joints = node.writer("joint_states", JointState)
        self._imu = node.writer("imu/data", Imu)
        self._diagnostics = node.writer("diagnostics", DiagnosticArray)
        self._battery = node.writer("battery_state", BatteryState)
        self._tf = self._tf_static = None
        if settings.publish_tf:
            self._tf = node.writer("tf", TFMessage)
            self._tf_static = node.writer("tf_static", TFMessage, latched=True)
            self._tf_static(TFMessage(list(static)))
        self._power_due_ns = 0

    def send(self, record: CycleRecord) -> None:
        """Send what is new in a record."""
        base = self._settings.base_frame
        if record["odometry"] is not None:
            self._send_odometry(record["odometry"], record["map_to_odom"])
        if record["wheels"] is not None:
            self._send_joints(record["wheels"])
        for reading in record["imu"]:
            self._imu(mapping.imu(reading, base, self._noise))
        for power in record["power"]:
            if abs(power["time_ns"] - self._power_due_ns) >= POWER_PERIOD_NS:
                self._power_due_ns = power["time_ns"]
                self._battery(mapping.battery_state(power, base))
        if record["status"] is not None:
            states = [mapping.status(each) for each in record["status"]]
            self._diagnostics(DiagnosticArray(mapping.header(record["time_ns"], ""), states))

    def _send_odometry(self, record: OdometryRecord, map_to_odom: tuple[float, float, float] | None) -> None:
        settings, time_ns = self._settings, record["time_ns"]
        self._odometry(mapping.odometry(record, settings.odom_frame, settings.base_frame))
        if self._tf is None:
            return
        pose = record["x_m"], record["y_m"], record["yaw_rad"]
        transforms = [mapping.transform(time_ns, pose, settings.odom_frame, settings.base_frame)]
        if map_to_odom is not None:
            transforms.append(
                mapping.transform(time_ns, map_to_odom, settings.map_frame, settings.odom_frame)
            )
        self._tf(TFMessage(transforms))

    def _send_joints(self, record: WheelsRecord) -> None:
        joints: list[tuple[float, float | None]] = [
            (math.nan if position is None else position, speed)
            for position, speed in zip(record["position_rad"], record["speed_rad_s"], strict=True)
        ]
        # A wheel turns at a speed, its steering has an angle only.
        joints += [(angle_rad, 0.0) for angle_rad in record["steering_rad"]]
        named = zip(self._joint_names, joints, strict=False)
        known = {name: joint for name, joint in named if math.isfinite(joint[0])}
        self._joints(mapping.joint_state(record["time_ns"], self._settings.base_frame, known))
