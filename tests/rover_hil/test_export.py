"""Logs as tables and as ROS 2 bags: the same numbers under names with units."""

import csv
import errno
import json
import shutil
import sqlite3
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pyarrow.parquet
import pytest
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore

from drivers.link import CameraImage, Received
from rover_hil.exporting.tables import read_tables
from rover_hil.recording.reader import LogReader
from rover_hil.recording.writer import LogWriter
from tests.rover_hil.command import Command, assert_one_sentence
from tests.rover_hil.conftest import ROBOTINO_S

CYCLES = round(50 * ROBOTINO_S)


@pytest.fixture(scope="module")
def log(robotino_log: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return Path(shutil.copy(robotino_log, tmp_path_factory.mktemp("export") / "run.mcap"))


def rows_of(path: Path) -> list[Mapping[str, str]]:
    with path.open(newline="") as stream:
        return list(csv.DictReader(stream))


def test_csv_holds_every_record_with_units_and_the_truth(command: Command, log: Path, tmp_path: Path) -> None:
    assert command("export", str(log), "--csv", "--out", str(tmp_path / "tables"), "--json") == 0
    rows = json.loads(command.out)["rows"]
    assert rows["estimate"] == rows["truth"] == rows["cycle"] == CYCLES
    truth = rows_of(tmp_path / "tables" / "truth.csv")
    estimate = rows_of(tmp_path / "tables" / "estimate.csv")
    wheels = rows_of(tmp_path / "tables" / "wheels.csv")
    messages = [message.json() for message in LogReader(log).messages() if message.topic == "/truth"]
    last = messages[-1]
    assert isinstance(last, dict)
    assert float(truth[-1]["x_m"]) == last["x_m"]
    assert float(truth[-1]["wheel_speed3_rad_s"]) == last["wheel_speed_rad_s"][2]
    assert float(truth[-1]["t_s"]) == pytest.approx(ROBOTINO_S)
    assert {"estimate_x_m", "estimate_covariance_yaw_yaw", "command_speed1_rad_s"} <= set(estimate[0])
    assert {row["wheel"] for row in wheels} == {"0", "1", "2"}
    assert "voltage_v" not in wheels[0]


def test_the_folder_of_a_run_stands_for_its_log(command: Command, log: Path, tmp_path: Path) -> None:
    assert command("export", str(log.parent), "--csv", "--out", str(tmp_path / "tables")) == 0
    assert command("replay", str(log.parent)) == 0
    assert f"{CYCLES} cycles replayed, every output identical" in command.out
    assert command("replay", str(tmp_path / "tables")) == 2
    assert_one_sentence(command.error, "run.mcap")


def test_parquet_has_the_rows_of_csv(command: Command, log: Path, tmp_path: Path) -> None:
    assert command("export", str(log), "--parquet", "--out", str(tmp_path / "tables")) == 0
    table = pyarrow.parquet.read_table(tmp_path / "tables" / "estimate.parquet").to_pydict()
    expected = read_tables(LogReader(log))["estimate"]
    assert table["estimate_x_m"] == expected.column("estimate_x_m")
    assert table["mode"] == expected.column("mode")


def test_a_bag_holds_poses_wheels_rates_and_pictures(log: Path, tmp_path: Path, command: Command) -> None:
    path = tmp_path / "run.mcap"
    source = LogReader(log)
    jpeg = cv2.imencode(".jpg", np.full((20, 30, 3), 90, np.uint8))[1].tobytes()
    with LogWriter(path, source.start_ns, source.config_json, source.attachments, "virtual") as writer:
        for message in source.messages():
            if message.topic in ("/estimate", "/samples", "/truth"):
                writer.write_json(message.topic, message.t_ns, message.json())
        pixels = np.full((20, 30, 3), 90, np.uint8)
        writer.received("camera", Received(source.start_ns, CameraImage(pixels, None, jpeg)))
    assert command("export", str(path), "--rosbag2", "--out", str(tmp_path / "bag")) == 0
    store = get_typestore(Stores.ROS2_HUMBLE)
    last: dict[str, Any] = {}
    with Reader(tmp_path / "bag") as bag:
        for connection, _, data in bag.messages():
            last[connection.topic] = store.deserialize_cdr(data, connection.msgtype)
    estimate = read_tables(LogReader(path))["estimate"].rows[-1]
    assert set(last) == {"/odom", "/ground_truth", "/joint_states", "/imu/imu", "/camera/camera/compressed"}
    odometry = last["/odom"]
    assert odometry.pose.pose.position.x == estimate["estimate_x_m"]
    assert odometry.pose.covariance[35] == estimate["estimate_covariance_yaw_yaw"]
    # z, roll and pitch are not measured, and no velocity is certain.
    assert list(odometry.pose.covariance[[14, 21, 28]]) == [1e6] * 3
    assert min(odometry.twist.covariance[[0, 7, 35]]) > 0.0
    assert list(odometry.twist.covariance[[14, 21, 28]]) == [1e6] * 3
    assert last["/imu/imu"].orientation_covariance[0] == -1.0
    assert last["/joint_states"].name == ["wheel1", "wheel2", "wheel3"]
    assert last["/camera/camera/compressed"].data.tobytes() == jpeg


@pytest.mark.parametrize(
    ("options", "words"), [((), "choose one format"), (("--csv", "--parquet"), "choose one format")]
)
def test_one_format_is_wanted(command: Command, log: Path, options: tuple[str, ...], words: str) -> None:
    assert command("export", str(log), *options) == 2
    assert_one_sentence(command.error, words)


@pytest.mark.parametrize(
    "failure", [sqlite3.OperationalError("database or disk is full"), OSError(errno.ENOSPC, "No space left")]
)
def test_a_full_disk_leaves_no_bag(
    command: Command, log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, failure: Exception
) -> None:
    def fail(*_: object) -> None:
        raise failure

    monkeypatch.setattr("rosbags.rosbag2.storage_sqlite3.Sqlite3Writer.close", fail)
    assert command("export", str(log), "--rosbag2", "--out", str(tmp_path / "bag")) == 2
    assert_one_sentence(command.error, f"cannot write {tmp_path / 'bag'}", str(failure.args[-1]))
    assert list(tmp_path.iterdir()) == []


def test_a_full_disk_leaves_no_tables(
    command: Command, log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    written = []

    def write(path: Path, data: bytes) -> int:
        written.append(path)
        if len(written) == 3:
            raise OSError(errno.ENOSPC, "No space left on device")
        with path.open("wb") as stream:
            return stream.write(data)

    monkeypatch.setattr(Path, "write_bytes", write)
    assert command("export", str(log), "--csv", "--out", str(tmp_path / "tables")) == 2
    assert_one_sentence(command.error.lstrip("\n"), "No space left on device", "--out")
    assert not (tmp_path / "tables").exists()


def test_an_export_is_never_overwritten_unless_forced(command: Command, log: Path, tmp_path: Path) -> None:
    for name in ("csv", "rosbag2"):
        folder = str(tmp_path / name)
        assert command("export", str(log), f"--{name}", "--out", folder) == 0
        assert command("export", str(log), f"--{name}", "--out", folder) == 2
        assert_one_sentence(command.error, "--force")
        assert command("export", str(log), f"--{name}", "--out", folder, "--force") == 0


def test_a_folder_that_is_no_bag_is_never_replaced(command: Command, log: Path, tmp_path: Path) -> None:
    (tmp_path / "mine.txt").write_text("kept")
    assert command("export", str(log), "--rosbag2", "--out", str(tmp_path), "--force") == 2
    assert_one_sentence(command.error, "not a bag")
    assert (tmp_path / "mine.txt").read_text() == "kept"


def test_what_is_no_log_is_said_so(command: Command, tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    path.write_bytes(b"no log")
    assert command("export", str(path), "--csv") == 2
    assert_one_sentence(command.error, "not an MCAP file")
