"""The process of ROS 2: C code that parses strangers' datagrams must not crash the loop.

It sends the records that it gets from the loop, and hands over what arrives. It decides nothing.
"""

import json
import math
import os
import select
import signal
import socket
from collections.abc import Iterator, Sequence
from contextlib import suppress
from typing import Any, NamedTuple

from controllers.estimation.settings import FilterSettings
from drivers.clock import Clock, SystemClock, wall_time_ns
from drivers.errors import ConfigError
from rover_hil.config.ros2_joints import MISSING_LIBRARY
from rover_hil.config.ros2_settings import Ros2Settings
from rover_hil.connect.ros2.fixes import read_fix
from rover_hil.connect.ros2.messages import (
    Bool,
    PoseWithCovarianceStamped,
    TransformStamped,
    Twist,
    TwistStamped,
)
from rover_hil.run.sign_of_life import SignOfLife

POLL_S = 0.001
MOST_BYTES = 1 << 18
"""Of a record of the loop."""
MOST_RECORDS = 16
"""Sent between two looks at what arrives."""
STOP_DEPTH = 64
"""Messages on the topic of emergency stops that are kept between two looks: none must be overwritten."""
MOST_WAITING = 256


class Face(NamedTuple):
    """What the process needs to know of the rover.

    Attributes:
        settings: The section [ros2].
        noise: Of the readings of the IMU.
        joint_names: Of wheels and steering.
        static: Where devices are on the rover.
    """

    settings: Ros2Settings
    noise: FilterSettings
    joint_names: tuple[str, ...]
    static: tuple[TransformStamped, ...]


def serve(face: Face, line: socket.socket, life: SignOfLife) -> None:
    """Serve until the loop closes the line.

    Args:
        face: The rover.
        line: To the loop.
        life: Given each time round.
    """
    # Ctrl-C goes to all processes of a terminal: the loop decides when this one ends.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    line.setblocking(False)
    try:
        server = _Server(face, line)
    except ConfigError as error:
        with suppress(OSError):
            line.send(json.dumps({"failed": str(error)}).encode())
        return
    _silence_errors()
    try:
        while server.is_connected:
            life.give()
            server.turn()
    except Exception as error:  # noqa: BLE001 - the loop is told the cause, whatever it is
        with suppress(OSError):
            line.send(json.dumps({"failed": f"{type(error).__name__}: {error}"}).encode())


class _Server:
    def __init__(self, face: Face, line: socket.socket) -> None:
        try:
            from rover_hil.connect.ros2.node import Node
            from rover_hil.connect.ros2.publishing import Publisher
        except ImportError as error:
            raise ConfigError(f"{MISSING_LIBRARY} ({error})") from error
        self._line = line
        self._clock: Clock = SystemClock()
        self.is_connected = True
        node = Node(face.settings)
        self._publisher = Publisher(node, face.settings, face.noise, face.joint_names, face.static)
        self._velocities = (
            [node.reader("cmd_vel", Twist), node.reader("cmd_vel", TwistStamped)]
            if face.settings.commands
            else []
        )
        self._stops = [
            node.reader("emergency_stop", Bool, depth=STOP_DEPTH),
            node.reader("emergency_stop", Bool, latched=True, depth=STOP_DEPTH),
        ]
        self._fixes = node.reader("pose_fix", PoseWithCovarianceStamped) if face.settings.pose_fixes else None
        self._map_frame = face.settings.map_frame
        self._waiting: list[dict[str, Any]] = [{"ready": True}]

    def turn(self) -> None:
        """Hand over what has arrived, send what the loop has, wait for more for a moment."""
        self._waiting += self._arrived()
        self._hand_over()
        select.select([self._line], [], [], POLL_S)
        for _ in range(MOST_RECORDS):
            try:
                data = self._line.recv(MOST_BYTES)
            except BlockingIOError:
                return
            except OSError:
                data = b""
            if not data:
                self.is_connected = False
                return
            self._publisher.send(json.loads(data))

    def _arrived(self) -> Iterator[dict[str, Any]]:
        now_ns = self._clock.now_ns()
        for take in self._velocities:
            for message, writer, _ in take():
                twist = message.twist if isinstance(message, TwistStamped) else message
                stamp_ns = message.header.stamp.time_ns if isinstance(message, TwistStamped) else 0
                yield {
                    "writer": writer,
                    "arrival_ns": now_ns,
                    "motion": _motion(twist),
                    "stamp_ns": stamp_ns or None,
                }
        for take in self._stops:
            for message, writer, sent_ns in take():
                yield {"writer": writer, "stamp_ns": sent_ns, "is_pressed": message.data}
        for message, _, _ in () if self._fixes is None else self._fixes():
            found = read_fix(message, self._map_frame, now_ns, wall_time_ns())
            yield {"wrong": found} if isinstance(found, str) else {"fix": found}

    def _hand_over(self) -> None:
        """Send what waits; of too much only emergency stops that are pressed and the newest are kept."""
        while self._waiting:
            try:
                self._line.send(json.dumps(self._waiting[0]).encode())
            except BlockingIOError:
                break
            except OSError:
                self.is_connected = False
                return
            del self._waiting[0]
        if len(self._waiting) > MOST_WAITING:
            pressed = [each for each in self._waiting[:-1] if each.get("is_pressed")]
            self._waiting = [*pressed[:MOST_WAITING], self._waiting[-1]]


def _motion(twist: Twist) -> Sequence[float]:
    """Return what a rover on a plane can do of a velocity; NaN where any number is not finite."""
    linear, angular = twist.linear, twist.angular
    numbers = (linear.x, linear.y, linear.z, angular.x, angular.y, angular.z)
    if not all(map(math.isfinite, numbers)):
        return (math.nan,) * 3
    return linear.x, linear.y, angular.z


def _silence_errors() -> None:
    """Lose the standard error: Cyclone writes a line there for each damaged datagram of a stranger."""
    nothing = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nothing, 2)
    os.close(nothing)
