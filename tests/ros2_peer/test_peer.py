"""The program against Fast DDS 2.9.1, in both directions. Run by `make test-ros2`, skipped otherwise."""

import os
import struct
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drivers.clock import SystemClock, nanoseconds
from rover_hil.config.ros2_settings import Ros2Settings
from rover_hil.connect.ros2.connection import Ros2Connection
from rover_hil.connect.ros2.messages import (
    BatteryState,
    Bool,
    DiagnosticArray,
    FieldType,
    Imu,
    JointState,
    Message,
    Odometry,
    TFMessage,
    Twist,
    TwistStamped,
    field_types,
)
from tests.rover_hil.connect.by_hand import Scripted, Steps, drive, hand_config, own_domain, replays_exactly
from tests.rover_hil.connect.random_messages import random_message
from tests.rover_hil.connect.test_fixes import drive_with_a_jump, greatest_step_m

PEER = os.environ.get("ROS2_PEER", "")
SECONDS = float(os.environ.get("ROS2_PEER_SECONDS", "10"))
"""Of the exchange of all topics; 600 for the figures that are published."""
pytestmark = [
    pytest.mark.skipif(not PEER, reason="needs the peer with Fast DDS: `make test-ros2`"),
    pytest.mark.timeout(SECONDS + 300),
]

RATE_HZ = 50.0
SEED = 291
TOPICS: dict[str, type[Message]] = {
    "odom": Odometry,
    "tf": TFMessage,
    "joint_states": JointState,
    "imu/data": Imu,
    "diagnostics": DiagnosticArray,
    "battery_state": BatteryState,
}
FORMATS = {
    "bool": "<?",
    "byte": "<B",
    "uint8": "<B",
    "int32": "<i",
    "uint32": "<I",
    "float32": "<f",
    "float64": "<d",
}


def digest(message: Message) -> str:
    """Return the digest of all fields of a message, as the peer makes it."""
    value = 14695981039346656037
    for byte in b"".join(_bytes(message)):
        value = ((value ^ byte) * 1099511628211) % 2**64
    return f"{value:016x}"


def _bytes(message: Message) -> Iterator[bytes]:
    for name, kind in field_types(type(message)).items():
        value = getattr(message, name)
        if kind.is_list:
            if kind.size is None:
                yield struct.pack("<I", len(value))
            for item in value:
                yield from _item(item, kind)
        else:
            yield from _item(value, kind)


def _item(value: Any, kind: FieldType) -> Iterator[bytes]:
    if not isinstance(kind.base, str):
        yield from _bytes(value)
    elif kind.base == "string":
        yield struct.pack("<I", len(value.encode())) + value.encode()
    else:
        yield struct.pack(FORMATS[kind.base], value)


@pytest.fixture(scope="module")
def node() -> Any:
    from rover_hil.connect.ros2.node import Node

    return Node(Ros2Settings(domain=own_domain()))


class Reader:
    """A peer that reads until it is asked what it has read; a pipe would be full after a while.

    Args:
        folder: For its output.
        reliability: `reliable` or `best_effort`.
        durability: `volatile` or `transient_local`.
        topics: What it reads.
    """

    def __init__(
        self, folder: Path, reliability: str, durability: str, topics: dict[str, type[Message]]
    ) -> None:
        self._topics = topics
        self._path = folder / f"{reliability}.txt"
        pairs = [f"rt/{name}={kind.__name__}" for name, kind in topics.items()]
        line = [PEER, "read", str(own_domain()), reliability, durability, *pairs]
        with self._path.open("w") as output:
            self._process = subprocess.Popen(line, stdin=subprocess.PIPE, stdout=output)
        clock = SystemClock()
        while not self._path.read_text().startswith("ready\n"):
            assert self._process.poll() is None
            clock.sleep_until(clock.now_ns() + nanoseconds(0.01))

    def lines(self) -> list[list[str]]:
        """Return topic, digest, stamp and arrival of what was read; the peer then ends."""
        self._process.communicate()
        return [line.split() for line in self._path.read_text().splitlines()[1:]]

    def digests(self) -> dict[str, list[str]]:
        """Return the digests of what was read by topic; the peer then ends."""
        found: dict[str, list[str]] = {name: [] for name in self._topics}
        for topic, value, _, _ in self.lines():
            found[topic.removeprefix("rt/")].append(value)
        return found


def test_every_value_of_every_topic_arrives_in_order(node: Any, tmp_path: Path) -> None:
    rng = np.random.default_rng(SEED)
    stock = {name: [random_message(kind, rng) for _ in range(100)] for name, kind in TOPICS.items()}
    digests = {name: [digest(each) for each in messages] for name, messages in stock.items()}
    writers = {name: node.writer(name, kind) for name, kind in TOPICS.items()}
    peers = {each: Reader(tmp_path, each, "volatile", TOPICS) for each in ("reliable", "best_effort")}
    clock = SystemClock()
    clock.sleep_until(clock.now_ns() + nanoseconds(3.0))  # until all have found each other
    count = round(SECONDS * RATE_HZ)
    due_ns = clock.now_ns()
    for number in range(count):
        for name, send in writers.items():
            send(stock[name][number * 7 % 100])
        due_ns += nanoseconds(1.0 / RATE_HZ)
        clock.sleep_until(due_ns)
    clock.sleep_until(clock.now_ns() + nanoseconds(1.0))
    expected = {name: [digests[name][number * 7 % 100] for number in range(count)] for name in TOPICS}
    for reliability, started in peers.items():
        found = started.digests()
        wrong = {name: len(set(values) - set(digests[name])) for name, values in found.items()}
        lost = {name: count - len(values) for name, values in found.items()}
        print(f"{reliability}: {count} messages on each topic, wrong {wrong}, lost {lost}")  # noqa: T201
        assert not any(wrong.values())
        if reliability == "reliable":
            assert found == expected


def test_a_late_reader_gets_the_static_transforms(node: Any, tmp_path: Path) -> None:
    message = random_message(TFMessage, np.random.default_rng(SEED))
    send = node.writer("tf_static", TFMessage, latched=True)
    send(message)
    late = Reader(tmp_path, "reliable", "transient_local", {"tf_static": TFMessage})
    clock = SystemClock()
    clock.sleep_until(clock.now_ns() + nanoseconds(5.0))
    assert late.digests() == {"tf_static": [digest(message)]}


@pytest.mark.parametrize("kind", [Twist, TwistStamped])
def test_commands_arrive_in_order_with_their_values(node: Any, kind: type[Message]) -> None:
    take = node.reader("cmd_vel", kind, depth=10_000)
    count = round(0.5 * SECONDS * RATE_HZ)
    line = [PEER, "send", str(own_domain()), kind.__name__, "rt/cmd_vel", str(count), "20", "1"]
    subprocess.run(line, check=True)
    twists = [getattr(message, "twist", message) for message, _, _ in take()]
    expected = [(0.05 + 1e-6 * number, 1e-3 * number, -1e-6 * number) for number in range(1, count + 1)]
    assert [(each.linear.x, each.linear.y, each.angular.z) for each in twists] == expected


def test_both_readers_of_stops_get_every_message(node: Any) -> None:
    ordinary = node.reader("emergency_stop", Bool, depth=1000)
    subprocess.run(
        [PEER, "send", str(own_domain()), "Bool", "rt/emergency_stop", "100", "20", "1"], check=True
    )
    assert [message.data for message, _, _ in ordinary()] == [number % 2 == 1 for number in range(1, 101)]


def test_a_peer_drives_the_rover_gets_its_odometry_and_stops_it(tmp_path: Path) -> None:
    driven, stopped = [], []
    reading = Reader(tmp_path, "reliable", "volatile", {"odom": Odometry})

    def script(run: Scripted, connection: Ros2Connection) -> Steps:
        yield from run.wait(lambda: run.mode == "running")
        domain = str(own_domain())
        line = [PEER, "send", domain, "TwistStamped", "rt/cmd_vel", "150", "20", "0"]
        with subprocess.Popen(line):
            yield from run.wait(lambda: run.is_driven)
            driven.append(run.now_ns)
            yield from run.wait(lambda: not run.is_driven)
        press = [PEER, "send", domain, "Bool", "rt/emergency_stop", "1", "20", "1"]
        with subprocess.Popen(press):
            yield from run.wait(lambda: "emergency_stop" in run.reason)
            stopped.append(run.now_ns)
        yield from run.stay(50)
        assert "emergency_stop" in run.reason

    run, _ = drive(hand_config(), tmp_path / "run.mcap", script)
    assert run.is_over, (driven, stopped, run.mode, run.reason)
    assert replays_exactly(tmp_path / "run.mcap")
    stamps = [int(stamp) for _, _, stamp, _ in reading.lines()]
    assert len(stamps) > 150
    assert stamps == sorted(set(stamps))


def test_a_peer_gets_a_jump_of_the_position_in_the_transform_from_map_to_odom_only(
    node: Any, tmp_path: Path
) -> None:
    reading = Reader(tmp_path, "reliable", "volatile", {"tf": TFMessage})
    sent = drive_with_a_jump(node, tmp_path / "run.mcap", 0.5)
    digests = [digest(message) for message in sent]
    found = reading.digests()["tf"]
    assert found[: len(digests)] == digests[: len(found)]
    assert len(found) > 200
    assert greatest_step_m(sent, "odom") < 0.02
    assert greatest_step_m(sent, "map") > 0.3
