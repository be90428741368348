"""Bags of ROS 2 in SQLite with the odometry of another program and an inertial sensor.

The rover is that of `docs/examples/differential.toml`: radius 0.06 m, track 0.30 m.
"""

import json
import math
import sqlite3
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tests.nature.odd_drives.motion import Array, Drive

EPOCH_NS = 1_700_000_000_000_000_000
TOPICS_FILE = """rover = "docs/examples/differential.toml"

[odometry]
topic = "/odom"

[imu]
topic = "/imu"
"""
IDENTITY = (0.0, 0.0, 0.0, 1.0)


class Cdr:
    """Little-endian CDR with the alignment of ROS 2."""

    def __init__(self) -> None:
        self._bytes = bytearray()

    def numbers(self, layout: str, *values: float) -> None:
        """Append numbers of one type, aligned to its size."""
        size = struct.calcsize(layout)
        self._bytes += b"\0" * (-len(self._bytes) % size)
        self._bytes += struct.pack(f"<{len(values)}{layout}", *values)

    def text(self, text: str) -> None:
        """Append a string."""
        data = text.encode() + b"\0"
        self.numbers("I", len(data))
        self._bytes += data

    def header(self, stamp_ns: int, frame: str) -> None:
        """Append a std_msgs/Header."""
        self.numbers("i", stamp_ns // 10**9)
        self.numbers("I", stamp_ns % 10**9)
        self.text(frame)

    def doubles(self, *values: float) -> None:
        """Append numbers of 64 bits."""
        self.numbers("d", *values)

    def message(self) -> bytes:
        """Return the message with its encapsulation header."""
        return b"\0\1\0\0" + bytes(self._bytes)


def odometry(stamp_ns: int, pose: Array, twist: Array) -> bytes:
    """Return a nav_msgs/Odometry of x, y, yaw and of forward, left, counter-clockwise speed."""
    cdr = Cdr()
    cdr.header(stamp_ns, "odom")
    cdr.text("base_link")
    half = float(pose[2]) / 2
    cdr.doubles(float(pose[0]), float(pose[1]), 0.0, 0.0, 0.0, math.sin(half), math.cos(half), *[0.0] * 36)
    cdr.doubles(float(twist[0]), float(twist[1]), 0.0, 0.0, 0.0, float(twist[2]), *[0.0] * 36)
    return cdr.message()


def inertial(stamp_ns: int, rate: float) -> bytes:
    """Return a sensor_msgs/Imu with a yaw rate only."""
    cdr = Cdr()
    cdr.header(stamp_ns, "imu")
    cdr.doubles(*IDENTITY, -1.0, *[0.0] * 8)
    cdr.doubles(0.0, 0.0, rate, *[0.0] * 9)
    cdr.doubles(0.0, 0.0, 0.0, -1.0, *[0.0] * 8)
    return cdr.message()


@dataclass(kw_only=True)
class Bag:
    """Odometry and yaw rate with their times."""

    times: Array
    poses: Array
    twists: Array
    imu_times: Array
    rates: Array
    recorder_jump_s: float = 0.0
    """The recorder's clock jumps by this much in the middle."""

    def _recorded_ns(self, time: float) -> int:
        jump = self.recorder_jump_s if time > float(self.times[-1]) / 2 else 0.0
        return EPOCH_NS + round((time + 0.002 + jump) * 1e9)

    def write(self, folder: Path) -> list[str]:
        """Write bag and file of topics. Return the arguments of the import."""
        messages: list[tuple[float, int, int, bytes]] = []
        for time, pose, twist in zip(self.times, self.poses, self.twists, strict=True):
            stamp = EPOCH_NS + round(float(time) * 1e9)
            messages.append((float(time), 1, self._recorded_ns(float(time)), odometry(stamp, pose, twist)))
        for time, rate in zip(self.imu_times, self.rates, strict=True):
            stamp = EPOCH_NS + round(float(time) * 1e9)
            messages.append((float(time), 2, self._recorded_ns(float(time)), inertial(stamp, float(rate))))
        messages.sort(key=lambda message: message[0])
        bag = folder / "bag"
        bag.mkdir()
        _write_database(bag / "bag_0.db3", messages)
        recorded = [message[2] for message in messages]
        counts = (len(self.times), len(self.imu_times))
        (bag / "metadata.yaml").write_text(json.dumps(_metadata(recorded, counts)), encoding="utf-8")
        (folder / "topics.toml").write_text(TOPICS_FILE, encoding="utf-8")
        return ["rosbag", "bag", "--topics", "topics.toml"]


TOPICS = (("/odom", "nav_msgs/msg/Odometry"), ("/imu", "sensor_msgs/msg/Imu"))


def _write_database(path: Path, messages: list[tuple[float, int, int, bytes]]) -> None:
    """Write the data file of a bag."""
    database = sqlite3.connect(path)
    database.execute(
        "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL,"
        " serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL)"
    )
    database.execute(
        "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL,"
        " timestamp INTEGER NOT NULL, data BLOB NOT NULL)"
    )
    database.execute("CREATE INDEX timestamp_idx ON messages (timestamp ASC)")
    for index, (name, kind) in enumerate(TOPICS, 1):
        database.execute("INSERT INTO topics VALUES (?, ?, ?, 'cdr', '')", (index, name, kind))
    rows = [(topic, stamp, data) for _, topic, stamp, data in messages]
    database.executemany("INSERT INTO messages(topic_id, timestamp, data) VALUES (?, ?, ?)", rows)
    database.commit()
    database.close()


def _metadata(recorded: list[int], counts: tuple[int, int]) -> dict[str, Any]:
    """Return the content of metadata.yaml."""
    start, length = min(recorded), max(recorded) - min(recorded)
    topics = [
        {
            "topic_metadata": {
                "name": name,
                "type": kind,
                "serialization_format": "cdr",
                "offered_qos_profiles": "",
            },
            "message_count": count,
        }
        for (name, kind), count in zip(TOPICS, counts, strict=True)
    ]
    return {
        "rosbag2_bagfile_information": {
            "version": 5,
            "storage_identifier": "sqlite3",
            "duration": {"nanoseconds": length},
            "starting_time": {"nanoseconds_since_epoch": start},
            "message_count": sum(counts),
            "topics_with_message_count": topics,
            "compression_format": "",
            "compression_mode": "",
            "relative_file_paths": ["bag_0.db3"],
            "files": [
                {
                    "path": "bag_0.db3",
                    "starting_time": {"nanoseconds_since_epoch": start},
                    "duration": {"nanoseconds": length},
                    "message_count": sum(counts),
                }
            ],
        }
    }


def record_bag(drive: Drive, rng: np.random.Generator) -> Bag:
    """Return the bag of a drive of two wheels: the odometry is integrated from them, as ROS does."""
    radius = drive.rover.radius_m
    track = 2.0 * next(iter(drive.rover.wheels.values()))[1]
    left, right = drive.speeds[:, 0] * radius, drive.speeds[:, 1] * radius
    forward, turn = (left + right) / 2, (right - left) / track
    step = float(drive.t[1] - drive.t[0])
    yaw = np.concatenate(([0.0], np.cumsum(turn[:-1]) * step))
    middle = yaw + turn * step / 2
    x = np.concatenate(([0.0], np.cumsum((forward * np.cos(middle))[:-1]) * step))
    y = np.concatenate(([0.0], np.cumsum((forward * np.sin(middle))[:-1]) * step))
    times = np.arange(0.0, drive.t[-1], 0.05) + 0.001
    imu_times = np.arange(0.0, drive.t[-1], 0.02) + 0.003
    twist = np.stack((forward, np.zeros_like(forward), turn), axis=1)
    return Bag(
        times=times,
        poses=drive.at(np.stack((x, y, yaw), axis=1), times),
        twists=drive.at(twist, times),
        imu_times=imu_times,
        rates=drive.at(drive.yaw_rate, imu_times) + 0.001 + rng.normal(0.0, 0.003, len(imu_times)),
    )
