"""Bags of one drive with exact kinematics, with what users' robots do to their messages.

Two driven wheels as in `docs/examples/differential.toml`. It shares no code with the program.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

RADIUS_M, TRACK_M = 0.06, 0.30
START_NS = 1_700_000_000_000_000_000
JOINTS = ("left_wheel", "right_wheel")
STEP_S = 0.001

Segment = tuple[float, float, float]
"""Speed in m/s, turn rate in rad/s, duration in s."""
CORNER: tuple[Segment, ...] = (
    (0.0, 0.0, 1.0),
    (0.25, 0.0, 4.0),
    (0.0, 0.5, math.pi),
    (0.25, 0.0, 4.0),
    (0.0, 0.0, 1.0),
)
ARC: tuple[Segment, ...] = ((0.0, 0.0, 1.5), (0.3, 0.3, 6.0), (0.3, 0.0, 2.0), (0.0, 0.0, 1.5))


@dataclass(frozen=True)
class Track:
    """The drive: time, pose, angles and speeds of the wheels, speed and turn rate, a row each millisecond."""

    t_s: np.ndarray
    pose: np.ndarray
    angle_rad: np.ndarray
    speed_rad_s: np.ndarray
    body: np.ndarray

    def row(self, t_s: float) -> int:
        return min(round(t_s / STEP_S), len(self.t_s) - 1)

    @property
    def end(self) -> tuple[float, float, float]:
        x, y, yaw = self.pose[-1].tolist()
        return x, y, yaw


def make_track(segments: Sequence[Segment], acceleration_m_s2: float | None = None) -> Track:
    """Return the drive of some segments; speeds change at once, or by an acceleration at the rims."""
    count = [round(duration / STEP_S) for _, _, duration in segments]
    wanted = np.repeat([(v, w) for v, w, _ in segments], count, axis=0)
    rims = np.stack((wanted[:, 0] - wanted[:, 1] * TRACK_M / 2, wanted[:, 0] + wanted[:, 1] * TRACK_M / 2), 1)
    if acceleration_m_s2 is not None:
        most = acceleration_m_s2 * STEP_S
        now = np.zeros(2)
        for row in rims:
            now = now + np.clip(row - now, -most, most)
            row[:] = now
    body = np.stack((rims.mean(axis=1), (rims[:, 1] - rims[:, 0]) / TRACK_M), 1)
    yaw = np.concatenate(([0.0], np.cumsum(body[:, 1]) * STEP_S))
    middle = yaw[:-1] + 0.5 * body[:, 1] * STEP_S
    x = np.concatenate(([0.0], np.cumsum(body[:, 0] * np.cos(middle)) * STEP_S))
    y = np.concatenate(([0.0], np.cumsum(body[:, 0] * np.sin(middle)) * STEP_S))
    angle = np.concatenate((np.zeros((1, 2)), np.cumsum(rims, axis=0) * STEP_S / RADIUS_M))
    hold = np.concatenate((body[:1], body))
    speed = np.concatenate((rims[:1], rims)) / RADIUS_M
    return Track(np.arange(len(x)) * STEP_S, np.stack((x, y, yaw), 1), angle, speed, hold)


@dataclass
class States:
    """One message of joint states."""

    names: list[str]
    position: list[float] = field(default_factory=list)
    velocity: list[float] = field(default_factory=list)
    effort: list[float] = field(default_factory=list)
    node: int = 0


Change = Callable[[float, list[float], list[float]], list[States]]
"""From time, angles and speeds to the messages of that moment."""


def plain(_: float, angles: list[float], speeds: list[float]) -> list[States]:
    return [States(list(JOINTS), angles, speeds)]


@dataclass(frozen=True)
class Bag:
    """What a bag holds.

    Attributes:
        change: Makes the messages of the wheels.
        wheel_hz: Their rate.
        imu: "none", "gyro" (acceleration unknown), "constant" (0, 0, 9.81) or "shaking".
        shake_m_s2: Acceleration of the shaking rover on each axis while it moves; at rest 1 %.
        offset_rad_s: Of the gyro.
        gyro_noise_rad_s: Of each reading.
        gyro: From number and rate of a reading to what the sensor sends.
        time_ns: From the time of a message in ns to that of its recording.
        gap_s: From when to when the wheels send nothing.
    """

    segments: tuple[Segment, ...] = CORNER
    change: Change = plain
    wheel_hz: float = 10.0
    imu: str = "gyro"
    imu_hz: float = 20.0
    shake_m_s2: float = 1.7
    offset_rad_s: float = 0.0
    gyro_noise_rad_s: float = 0.002
    acceleration_m_s2: float | None = None
    gyro: Callable[[int, float], float] = lambda _, rate: rate
    time_ns: Callable[[int], int] = lambda t_ns: START_NS + t_ns
    gap_s: tuple[float, float] = (0.0, 0.0)

    @property
    def track(self) -> Track:
        return make_track(self.segments, self.acceleration_m_s2)


class _Messages:
    def __init__(self) -> None:
        self.store = get_typestore(Stores.ROS2_HUMBLE)
        self.types: Any = self.store.types

    def header(self, t_ns: int) -> Any:
        stamp = self.types["builtin_interfaces/msg/Time"](sec=t_ns // 10**9, nanosec=t_ns % 10**9)
        return self.types["std_msgs/msg/Header"](stamp=stamp, frame_id="base_link")

    def vector(self, x: float, y: float, z: float) -> Any:
        return self.types["geometry_msgs/msg/Vector3"](x=x, y=y, z=z)

    def quaternion(self, yaw: float) -> Any:
        return self.types["geometry_msgs/msg/Quaternion"](
            x=0.0, y=0.0, z=math.sin(yaw / 2), w=math.cos(yaw / 2)
        )

    def states(self, t_ns: int, states: States) -> Any:
        return self.types["sensor_msgs/msg/JointState"](
            header=self.header(t_ns),
            name=states.names,
            position=np.array(states.position),
            velocity=np.array(states.velocity),
            effort=np.array(states.effort),
        )

    def imu(self, t_ns: int, rate: float, acceleration: Sequence[float] | None) -> Any:
        unknown = np.zeros(9)
        if acceleration is None:
            unknown[0] = -1.0
        return self.types["sensor_msgs/msg/Imu"](
            header=self.header(t_ns),
            orientation=self.quaternion(0.0),
            orientation_covariance=np.zeros(9),
            angular_velocity=self.vector(0.0, 0.0, rate),
            angular_velocity_covariance=np.zeros(9),
            linear_acceleration=self.vector(*(acceleration or (0.0, 0.0, 0.0))),
            linear_acceleration_covariance=unknown,
        )

    def pose(self, t_ns: int, pose: Sequence[float]) -> Any:
        return self.types["geometry_msgs/msg/PoseStamped"](
            header=self.header(t_ns),
            pose=self.types["geometry_msgs/msg/Pose"](
                position=self.types["geometry_msgs/msg/Point"](x=pose[0], y=pose[1], z=0.0),
                orientation=self.quaternion(pose[2]),
            ),
        )


def _quality(node: int) -> Qos:
    """Return the quality that a node offers; two nodes on a topic are distinguished by it."""
    never = QosTime(sec=0, nsec=0)
    return Qos(
        history=QosHistory.KEEP_LAST,
        depth=node + 1,
        reliability=QosReliability.RELIABLE,
        durability=QosDurability.VOLATILE,
        deadline=never,
        lifespan=never,
        liveliness=QosLiveliness.AUTOMATIC,
        liveliness_lease_duration=never,
        avoid_ros_namespace_conventions=False,
    )


def write_bag(path: Path, bag: Bag) -> Track:
    """Write the bag; return the drive."""
    track, messages = bag.track, _Messages()
    rng = np.random.default_rng(5)
    rows: list[tuple[int, str, int, Any]] = []
    end_s = float(track.t_s[-1])
    for i in range(int(end_s * bag.wheel_hz) + 1):
        t_s = i / bag.wheel_hz
        row, t_ns = track.row(t_s), round(t_s * 1e9)
        if bag.gap_s[0] <= t_s < bag.gap_s[1]:
            continue
        parts = bag.change(t_s, track.angle_rad[row].tolist(), track.speed_rad_s[row].tolist())
        for k, states in enumerate(parts):
            rows.append((t_ns + k * 1_000_000, "/joint_states", states.node, messages.states(t_ns, states)))
    for i in range(int(end_s * 10) + 1):
        t_ns = round(i * 1e8)
        rows.append((t_ns, "/pose", 0, messages.pose(t_ns, track.pose[track.row(i / 10)].tolist())))
    for i in range(int(end_s * bag.imu_hz) + 1 if bag.imu != "none" else 0):
        t_s = i / bag.imu_hz
        speed, turn = track.body[track.row(t_s)].tolist()
        rate = turn + bag.offset_rad_s + bag.gyro_noise_rad_s * rng.standard_normal()
        rate = bag.gyro(i, rate)
        shake = bag.shake_m_s2 * (1.0 if speed or turn else 0.01)
        acceleration = {
            "gyro": None,
            "constant": (0.0, 0.0, 9.81),
            "shaking": tuple((np.array((0.0, 0.0, 9.81)) + shake * rng.standard_normal(3)).tolist()),
        }[bag.imu]
        rows.append((round(t_s * 1e9), "/imu", 0, messages.imu(round(t_s * 1e9), rate, acceleration)))
    rows.sort(key=lambda item: item[0])
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connections: dict[tuple[str, int], Any] = {}
        for t_ns, topic, node, message in rows:
            key = (topic, node)
            if key not in connections:
                connections[key] = writer.add_connection(
                    topic,
                    message.__msgtype__,
                    typestore=messages.store,
                    offered_qos_profiles=[_quality(node)],
                )
            data = messages.store.serialize_cdr(message, message.__msgtype__)
            writer.write(connections[key], bag.time_ns(t_ns), data)
    return track
