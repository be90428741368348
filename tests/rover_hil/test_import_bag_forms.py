"""`rover-hil import rosbag`: speeds of the body, and what is left out under which name."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer

from tests.rover_hil.command import Command
from tests.rover_hil.field_bags import JOINTS, START_NS, States, _Messages
from tests.rover_hil.test_field_bags import ROOT, end_of

RATE_RAD_S, SPEED_M_S = 0.5, 0.25
ROVER = f'rover = "{ROOT}/docs/examples/differential.toml"\n'
WHEELS = ROVER + '[wheels]\ntopic = "/wheels"\njoints = ["left_wheel", "right_wheel"]\n'
MESSAGES = _Messages()
Make = Callable[[int, int], Any]
"""From number and time of a message to it."""


def write_bag(topics: dict[str, Make]) -> Path:
    """Write 4 s of messages at 20 Hz on each topic."""
    path = Path("bag")
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        own: dict[str, Any] = {}
        for number in range(81):
            t_ns = START_NS + number * 50_000_000
            for topic, make in topics.items():
                message = make(number, t_ns)
                kind = message.__msgtype__
                if topic not in own:
                    own[topic] = writer.add_connection(topic, kind, typestore=MESSAGES.store)
                writer.write(own[topic], t_ns, MESSAGES.store.serialize_cdr(message, kind))
    return path


def import_it(command: Command, topics: dict[str, Make], text: str) -> int:
    bag = write_bag(topics)
    Path("topics.toml").write_text(text, "utf-8")
    return command("import", "rosbag", str(bag), "--topics", "topics.toml", "--out", "drive.mcap")


def wheels(number: int, t_ns: int) -> Any:
    return MESSAGES.states(t_ns, States(list(JOINTS), [0.2 * number] * 2, [4.0] * 2))


def twist(number: int, t_ns: int) -> Any:
    return MESSAGES.types["geometry_msgs/msg/TwistStamped"](
        header=MESSAGES.header(t_ns),
        twist=MESSAGES.types["geometry_msgs/msg/Twist"](
            linear=MESSAGES.vector(math.nan if number % 4 == 3 else SPEED_M_S, 0.0, 0.0),
            angular=MESSAGES.vector(0.0, 0.0, RATE_RAD_S),
        ),
    )


def imu_without_rates(number: int, t_ns: int) -> Any:
    message = MESSAGES.imu(t_ns, 0.0, (0.1 * (number % 3), 0.0, 9.8))
    message.angular_velocity_covariance[0] = -1.0
    return message


def lost_receiver(number: int, t_ns: int) -> Any:
    return MESSAGES.types["sensor_msgs/msg/NavSatFix"](
        header=MESSAGES.header(t_ns),
        status=MESSAGES.types["sensor_msgs/msg/NavSatStatus"](status=-1 if number < 30 else 0, service=1),
        latitude=48.1 + 1e-7 * number,
        longitude=11.6,
        altitude=0.0,
        position_covariance=np.diag((1.0, 1.0, 1.0)).ravel(),
        position_covariance_type=2,
    )


def test_speed_and_yaw_rate_of_the_body_are_the_motion(command: Command) -> None:
    text = ROVER + '[odometry]\ntopic = "/twist"\n'
    assert import_it(command, {"/twist": twist}, text) == 0, command.error
    assert "odometry: 61 messages" in command.out
    end = end_of(Path("drive.mcap"))
    yaw_rad = RATE_RAD_S * 4.0
    radius_m = SPEED_M_S / RATE_RAD_S
    true = (radius_m * math.sin(yaw_rad), radius_m * (1.0 - math.cos(yaw_rad)), yaw_rad)
    # One message in four holds no speed; the next one closes the gap.
    assert (end.x_m, end.y_m, end.yaw_rad) == pytest.approx(true, abs=2e-3)


def test_accelerations_without_rates_are_used(command: Command) -> None:
    text = WHEELS + '[imu]\ntopic = "/imu"\n'
    assert import_it(command, {"/wheels": wheels, "/imu": imu_without_rates}, text) == 0, command.error
    assert "imu: 81 messages" in command.out
    assert "no usable numbers" not in command.out


def test_positions_that_the_receiver_did_not_have_are_left_out_by_that_name(command: Command) -> None:
    text = WHEELS + '[fixes]\ntopic = "/gnss"\n'
    assert import_it(command, {"/wheels": wheels, "/gnss": lost_receiver}, text) == 0, command.error
    assert "fixes: 51 messages" in command.out
    assert "the receiver had no position" in command.out
    assert "no usable numbers" not in command.out
