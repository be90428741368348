"""Drive -> log -> drive: what a recording of any format holds comes out of its log unchanged."""

import math
import struct
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import can
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rosbags.rosbag2 import StoragePlugin, Writer
from scipy.io import savemat

from rover_hil.config import load_config
from rover_hil.drives.drive import Drive, read_drive
from rover_hil.drives.files.can_frames import read_can_log
from rover_hil.drives.formats.can.rover import rover_of_log
from rover_hil.drives.formats.can.to_log import write_can_as_log
from rover_hil.drives.formats.drive import START_NS
from rover_hil.drives.formats.rosbag.to_log import write_bag_as_log
from rover_hil.drives.formats.rosbag.topics import Topics
from rover_hil.drives.formats.table.columns import Columns, rover_of
from rover_hil.drives.formats.table.to_log import write_table_as_log
from tests.rover_hil.field_bags import States, _Messages
from tests.rover_hil.flight_logs import Kind, dataflash, ulog
from tests.rover_hil.test_field_bags import ROOT
from tests.rover_hil.test_import_can_forms import ROVER

EXAMPLES = settings(max_examples=12)
LINK = 1e-6
"""Samples are recorded in whole nanoradians, and so on."""
BEGIN_S = 1_700_000_000
WHEELS = [{"x_m": 0.0, "y_m": y_m, "radius_m": 0.06} for y_m in (0.15, -0.15)]
LIMITS = {"wheel_speed_rad_s": 30, "wheel_acceleration_rad_s2": 500}


@dataclass(frozen=True)
class Recording:
    """What was measured: n rows; of two wheels (n, 2)."""

    t_us: np.ndarray
    position_rad: np.ndarray
    speed_rad_s: np.ndarray
    current_a: np.ndarray
    yaw_rate_rad_s: np.ndarray
    pose: np.ndarray

    def columns(self) -> dict[str, np.ndarray]:
        names = ("p0", "p1", "v0", "v1", "c0", "c1", "w", "x", "y", "yaw")
        values = (
            *self.position_rad.T,
            *self.speed_rad_s.T,
            *self.current_a.T,
            self.yaw_rate_rad_s,
            *self.pose.T,
        )
        return dict(zip(names, values, strict=True))


def numbers(low: float, high: float) -> st.SearchStrategy[float]:
    return st.floats(low, high, allow_subnormal=False)


ROW = st.tuples(
    st.integers(10_000, 60_000),
    *[numbers(-0.2, 0.2)] * 2,
    *[numbers(-20.0, 20.0)] * 2,
    *[numbers(-9.0, 9.0)] * 2,
    numbers(-3.0, 3.0),
    numbers(0.001, 0.05),
    numbers(-0.05, 0.05),
    numbers(-0.1, 0.1),
)


@st.composite
def recordings(draw: st.DrawFn) -> Recording:
    table = np.array(draw(st.lists(ROW, min_size=15, max_size=40)))
    return Recording(
        t_us=np.cumsum(table[:, 0]),
        position_rad=np.cumsum(table[:, 1:3], axis=0),
        speed_rad_s=table[:, 3:5],
        current_a=table[:, 5:7],
        yaw_rate_rad_s=table[:, 7],
        pose=np.cumsum(table[:, 8:11], axis=0),
    )


@contextmanager
def folder() -> Iterator[Path]:
    with TemporaryDirectory() as name:
        yield Path(name)


def assert_equal(
    drive: Drive,
    recording: Recording,
    quantities: Mapping[str, np.ndarray],
    tolerance: float = LINK,
    tolerance_s: float = 1e-9,
) -> None:
    """Assert that quantities, the ground truth among them, are those of the log, with their times."""
    t_s = (recording.t_us - recording.t_us[0]) * 1e-6
    for name, values in quantities.items():
        found = drive.channels[name]
        assert (found.t_ns - START_NS) * 1e-9 == pytest.approx(t_s, abs=tolerance_s), name
        assert found.value == pytest.approx(values, abs=tolerance), name


def all_of(recording: Recording) -> dict[str, np.ndarray]:
    columns = recording.columns()
    channels = {
        "position1_rad": "p0", "position2_rad": "p1", "speed1_rad_s": "v0", "speed2_rad_s": "v1",
        "current1_a": "c0", "current2_a": "c1", "gyro_z_rad_s": "w", "x_m": "x", "y_m": "y",
        "yaw_rad": "yaw",
    }  # fmt: skip
    return {channel: columns[name] for channel, name in channels.items()}


def columns_of(
    time: Mapping[str, object], name_of: Mapping[str, str] | None = None, **more: object
) -> Columns:
    def column(name: str, **keys: object) -> dict[str, object]:
        return {"column": name if name_of is None else name_of[name], **keys}

    table = {
        "rover": {"kinematics": "wheels", "wheels": WHEELS},
        "limits": LIMITS,
        "time": time,
        "wheel": [
            {
                "position": column(f"p{wheel}", unit="rad"),
                "speed": column(f"v{wheel}", unit="rad/s"),
                "current": column(f"c{wheel}"),
            }
            for wheel in range(2)
        ],
        "imu": {"yaw_rate": column("w")},
        "truth": {name: column(name) for name in ("x", "y", "yaw")},
        **more,
    }
    return Columns.model_validate(table)


def drive_of_table(path: Path, columns: Columns) -> Drive:
    rover = rover_of(columns, path)
    for _ in write_table_as_log(path, columns, rover, path.with_suffix(".mcap"), with_estimate=False):
        pass
    return read_drive(path.with_suffix(".mcap"))


@given(recordings(), st.sampled_from([",", ";", "\t", " "]), st.booleans(), st.booleans())
@EXAMPLES
def test_text_tables(recording: Recording, delimiter: str, has_commas: bool, has_units: bool) -> None:
    table = {"t": recording.t_us * 1e-3, **recording.columns()}
    lines = [delimiter.join(table)]
    if has_units:
        units = ("ms", "rad", "rad", "rad/s", "rad/s", "A", "A", "rad/s", "m", "m", "rad")
        lines.append(delimiter.join(units))
    lines += [delimiter.join(f"{value:.9f}" for value in row) for row in zip(*table.values(), strict=True)]
    text = "\n".join(lines) + "\n"
    if has_commas and delimiter != ",":
        text = text.replace(".", ",")
    with folder() as place:
        (place / "drive.csv").write_text(text, "utf-8")
        drive = drive_of_table(place / "drive.csv", columns_of({"column": "t", "unit": "ms"}))
        assert_equal(drive, recording, all_of(recording), tolerance_s=2e-9)


@given(recordings(), st.sampled_from(["npz", "mat", "matrix.mat"]))
@EXAMPLES
def test_arrays(recording: Recording, kind: str) -> None:
    table = {"t": recording.t_us, **recording.columns()}
    name_of, time = None, "t"
    with folder() as place:
        path = place / f"drive.{kind}"
        if kind == "npz":
            np.savez(path, **table)  # type: ignore[arg-type]
        elif kind == "mat":
            savemat(path, {**table, "other": np.eye(3)})
        else:
            savemat(path, {"m": np.column_stack(list(table.values())), "other": np.eye(3)})
            name_of, time = {name: f"m.{number}" for number, name in enumerate(table, start=1)}, "m.1"
        drive = drive_of_table(path, columns_of({"column": time, "unit": "us"}, name_of))
        assert_equal(drive, recording, all_of(recording))


@given(recordings(), st.sampled_from(["ulg", "bin"]))
@EXAMPLES
def test_flight_logs(recording: Recording, kind: str) -> None:
    table = recording.columns()
    is_ulog = kind == "ulg"
    time, number, count = ("timestamp", "double", "uint64_t") if is_ulog else ("TimeUS", "d", "Q")
    kinds = [
        Kind("ENC", [(count, time), *((number, name) for name in ("p0", "p1", "v0", "v1", "c0", "c1"))]),
        Kind("POS", [(count, time), *((number, name) for name in ("w", "x", "y", "yaw"))]),
    ]
    messages = []
    for row, t_us in enumerate(recording.t_us.tolist()):
        for part, each in enumerate(kinds):
            messages.append((part, [int(t_us), *(float(table[name][row]) for _, name in each.fields[1:])]))
    name_of = {name: f"{each.name}.{name}" for each in kinds for _, name in each.fields[1:]}
    with folder() as place:
        path = place / f"drive.{kind}"
        path.write_bytes((ulog if is_ulog else dataflash)(kinds, messages))
        drive = drive_of_table(path, columns_of({"column": time, "unit": "us"}, name_of))
        assert_equal(drive, recording, all_of(recording))


DBC = """VERSION ""
BU_: Rover Host
BO_ 256 Angles: 8 Rover
 SG_ P0 : 0|32@1- (0.0001,0) [0|0] "rad" Host
 SG_ P1 : 32|32@1- (0.0001,0) [0|0] "rad" Host
BO_ 257 Speeds: 8 Rover
 SG_ V0 : 0|32@1- (0.0001,0) [0|0] "rad/s" Host
 SG_ V1 : 32|32@1- (0.0001,0) [0|0] "rad/s" Host
BO_ 258 Gyro: 4 Rover
 SG_ W : 0|32@1- (0.0001,0) [0|0] "rad/s" Host
"""
MAPPING = 'dbc = "own.dbc"\n' + "".join(
    f"[[wheel]]\nnode = {wheel}\n"
    f'position = {{ message = "Angles", signal = "P{wheel}", unit = "rad" }}\n'
    f'speed = {{ message = "Speeds", signal = "V{wheel}", unit = "rad/s" }}\n'
    for wheel in range(2)
)
MAPPING += '[yaw_rate]\nmessage = "Gyro"\nsignal = "W"\nunit = "rad/s"\n'
CAN_LOGS = ["log", "asc", "blf", "csv", "mf4"]


@given(recordings(), st.sampled_from(CAN_LOGS), st.booleans())
@settings(EXAMPLES, max_examples=20)
def test_can_logs(recording: Recording, suffix: str, is_fd: bool) -> None:
    sent = (recording.position_rad, recording.speed_rad_s, recording.yaw_rate_rad_s[:, np.newaxis])
    with folder() as place:
        for name, text in (("own.dbc", DBC), ("own.toml", MAPPING), ("rover.toml", ROVER)):
            (place / name).write_text(text, "utf-8")
        with can.Logger(place / f"drive.{suffix}") as logger:
            for row, t_us in enumerate(recording.t_us.tolist()):
                for number, table in enumerate(sent):
                    raw = [round(1e4 * value) for value in table[row].tolist()]
                    logger.on_message_received(
                        can.Message(
                            BEGIN_S + t_us * 1e-6,
                            256 + number,
                            is_extended_id=False,
                            is_fd=is_fd,
                            data=struct.pack(f"<{len(raw)}i", *raw),
                            channel=1,
                        )
                    )
        config = rover_of_log(str(place / "rover.toml"), place / "own.toml")
        frames = read_can_log(place / f"drive.{suffix}")
        for _ in write_can_as_log(frames, config, place / "drive.mcap", with_estimate=False):
            pass
        names = [name for name in all_of(recording) if name.startswith(("position", "speed", "gyro"))]
        quantities = {name: all_of(recording)[name] for name in names}
        drive = read_drive(place / "drive.mcap")
        assert_equal(drive, recording, quantities, tolerance=0.5001e-4, tolerance_s=2e-6)


TOPICS = {
    "rover": f"{ROOT}/docs/examples/differential.toml",
    "wheels": {"topic": "/joints", "joints": ["left", "right"], "effort_is_current": True},
    "imu": {"topic": "/imu"},
    "truth": {"topic": "/pose"},
}


@given(recordings(), st.sampled_from(StoragePlugin), st.booleans())
@EXAMPLES
def test_bags(recording: Recording, plugin: StoragePlugin, is_cut: bool) -> None:
    messages = _Messages()
    with folder() as place:
        with Writer(place / "bag", version=9, storage_plugin=plugin) as writer:
            own: dict[str, Any] = {}
            for t_ns, topic, message in bag_messages(messages, recording):
                kind = message.__msgtype__
                if topic not in own:
                    own[topic] = writer.add_connection(topic, kind, typestore=messages.store)
                writer.write(own[topic], t_ns, messages.store.serialize_cdr(message, kind))
        bag = place / "bag"
        if is_cut and plugin is StoragePlugin.MCAP:
            bag = next(bag.glob("*.mcap"))
            bag.write_bytes(bag.read_bytes()[:-30])
        topics = Topics.model_validate(TOPICS)
        rover = load_config(topics.rover)
        for _ in write_bag_as_log(bag, topics, rover, place / "drive.mcap", with_estimate=False):
            pass
        quantities = all_of(recording)
        quantities["yaw_rad"] = np.array([wrapped_rad(yaw) for yaw in quantities["yaw_rad"].tolist()])
        assert_equal(read_drive(place / "drive.mcap"), recording, quantities)


def bag_messages(messages: _Messages, recording: Recording) -> Iterator[tuple[int, str, Any]]:
    for row, t_us in enumerate(recording.t_us.tolist()):
        t_ns = BEGIN_S * 10**9 + int(t_us) * 1000
        states = States(
            ["left", "right"],
            recording.position_rad[row].tolist(),
            recording.speed_rad_s[row].tolist(),
            recording.current_a[row].tolist(),
        )
        yield t_ns, "/joints", messages.states(t_ns, states)
        yield t_ns, "/imu", messages.imu(t_ns, float(recording.yaw_rate_rad_s[row]), None)
        yield t_ns, "/pose", messages.pose(t_ns, recording.pose[row].tolist())


def wrapped_rad(yaw_rad: float) -> float:
    return math.remainder(yaw_rad, math.tau)
