"""The process of ROS 2: C code that parses untrusted datagrams must not crash the loop.

It sends the records that it gets from the loop, and hands over what arrives. It decides nothing.
"""

import json
import math
import os
import signal
from collections.abc import Iterator, Sequence
from multiprocessing.connection import Connection
from typing import Any

from drivers.clock import Clock, SystemClock, wall_time_ns
from drivers.errors import ConfigError
from rover_hil.config import Config
from rover_hil.config.ros2_joints import MISSING_LIBRARY, joint_names
from rover_hil.connect.cycle_bytes import CycleUnpacker
from rover_hil.connect.cycle_record import CycleRecorder
from rover_hil.connect.ros2.device_frames import static_transforms
from rover_hil.connect.ros2.fixes import read_fix
from rover_hil.connect.ros2.messages import (
    Bool,
    PoseWithCovarianceStamped,
    Twist,
    TwistStamped,
)
from rover_hil.connect.shared_ring import RingReader, RingWriter, SharedRing
from rover_hil.connect.wall_clock import WallOffset

POLL_S = 0.001
MOST_RECORDS = 16
"""Sent between two looks at what arrives."""
DEPTH = 64
"""Messages that are kept between two looks. No stop must be overwritten, nor a command of one sender by that
of another: who sends right after it would take the rover over."""
MOST_WAITING = 256
MOST_CHARACTERS = 500
"""Of an error that is reported."""


def serve(config: Config, cycles: SharedRing, arrivals: SharedRing, lifeline: Connection) -> None:
    """Serve until the loop closes its end of the lifeline, or is no more.

    Args:
        config: A rover with the section [ros2].
        cycles: What the loop hands over.
        arrivals: What is handed over to the loop, with a heartbeat in each round.
        lifeline: Held open by the loop.
    """
    # Ctrl-C goes to all processes of a terminal: the loop decides when this one ends.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    outgoing = RingWriter(arrivals)
    _silence_errors()
    try:
        server = _Server(config, RingReader(cycles), outgoing)
        # The lifeline carries nothing: it can be read when it has been closed.
        while not lifeline.poll(POLL_S):
            server.turn()
    except ConfigError as error:
        _report_failure(outgoing, str(error))
    except Exception as error:  # noqa: BLE001 - the cause is reported to the loop, whatever it is
        _report_failure(outgoing, f"{type(error).__name__}: {error}")


def _report_failure(outgoing: RingWriter, words: str) -> None:
    outgoing.put(json.dumps({"failed": words[:MOST_CHARACTERS]}).encode())


class _Server:
    def __init__(self, config: Config, cycles: RingReader, outgoing: RingWriter) -> None:
        try:
            from rover_hil.connect.ros2.node import Node
            from rover_hil.connect.ros2.publishing import Publisher
        except ImportError as error:
            raise ConfigError(f"{MISSING_LIBRARY} ({error})") from error
        settings = config.ros2
        if settings is None:
            raise ConfigError("ros2: this section is missing")
        self._cycles, self._outgoing = cycles, outgoing
        self._clock: Clock = SystemClock()
        self._looked_ns = self._clock.now_ns()
        self._unpacker = CycleUnpacker()
        self._recorder = CycleRecorder(config, WallOffset())
        node = Node(settings)
        names = joint_names(config.rover, settings)
        self._publisher = Publisher(node, settings, config.filter, names, static_transforms(config))
        self._velocities = (
            [node.reader("cmd_vel", kind, depth=DEPTH) for kind in (Twist, TwistStamped)]
            if settings.commands
            else []
        )
        self._stops = [
            node.reader("emergency_stop", Bool, depth=DEPTH),
            node.reader("emergency_stop", Bool, latched=True, depth=DEPTH),
        ]
        self._fixes = node.reader("pose_fix", PoseWithCovarianceStamped) if settings.pose_fixes else None
        self._map_frame = settings.map_frame
        self._waiting: list[dict[str, Any]] = [{"ready": True}]

    def turn(self) -> None:
        """Hand over what has arrived, and send what the loop has."""
        self._outgoing.give_sign()
        self._waiting += self._arrived()
        self._hand_over()
        for _ in range(MOST_RECORDS):
            data = self._cycles.take()
            if data is None:
                return
            # On a loaded machine several of them can take longer than a silence may last.
            self._outgoing.give_sign()
            self._publisher.send(self._recorder.record(self._unpacker.unpack(data), self._clock.now_ns()))

    def _arrived(self) -> Iterator[dict[str, Any]]:
        before_ns, now_ns = self._looked_ns, self._clock.now_ns()
        self._looked_ns = now_ns
        for take in self._velocities:
            for message, writer, _ in take():
                twist = message.twist if isinstance(message, TwistStamped) else message
                stamp_ns = message.header.stamp.time_ns if isinstance(message, TwistStamped) else 0
                yield {
                    "writer": writer,
                    "arrival_ns": now_ns,
                    "earliest_ns": before_ns,
                    "motion": _motion(twist),
                    "stamp_ns": stamp_ns or None,
                }
        for take in self._stops:
            for message, writer, sent_ns in take():
                yield {"writer": writer, "stamp_ns": sent_ns, "is_pressed": message.data}
        for message, _, _ in () if self._fixes is None else self._fixes():
            fix = read_fix(message, self._map_frame, now_ns, wall_time_ns())
            yield {"wrong": fix} if isinstance(fix, str) else {"fix": fix}

    def _hand_over(self) -> None:
        """Send what waits; of too much only emergency stops that are pressed and the newest are kept."""
        while self._waiting and self._outgoing.put(json.dumps(self._waiting[0]).encode()):
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
