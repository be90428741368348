"""`rover-hil calibrate compass` on turns of a magnetised rover of which the truth is known."""

import datetime as dt
import json
import math
from pathlib import Path

import pytest

from drivers.errors import LogError
from drivers.heading_calibration import DeviationTable, MagnetometerCalibration
from rover_hil.config import load_config, read_config_text
from rover_hil.config.entry import with_entry
from rover_hil.ready.compass.coverage import Coverage
from rover_hil.ready.compass.fit import _headings, fit_compass
from rover_hil.ready.compass.record import read_record
from rover_hil.ready.turns import turning_config
from tests.cases import first_often
from tests.nature.magnetised_rover import Rover
from tests.rover_hil.command import Command, assert_one_sentence
from tests.rover_hil.identify.compass_logs import truth_rms_deg, write_turns

DAY = dt.date(2026, 5, 4)
BAR_DEG = 1.5
THREE_FIELDS = (40.0, -40.0, 20.0)
"""Hard iron of three times the horizontal field of 20 uT."""
LAG_S = 0.45


@pytest.mark.parametrize("seed", first_often([20, 21]))
def test_hard_iron_of_three_times_the_field_leaves_a_small_error(tmp_path: Path, seed: int) -> None:
    path = tmp_path / "turns.mcap"
    truth = write_turns(path, Rover(magnets=THREE_FIELDS), seed)
    record = read_record(path, "imu")
    fit = fit_compass(record, DAY)
    assert fit.problem == ""
    assert isinstance(fit.calibration, MagnetometerCalibration)
    assert fit.before_rms_deg > 60.0
    assert fit.rms_deg < BAR_DEG
    headings = _headings(record, fit.calibration)
    true_deg = truth_rms_deg(truth, headings.t_s, headings.yaw_rad)
    assert true_deg < BAR_DEG
    assert fit.rms_deg == pytest.approx(true_deg, rel=0.1)
    assert fit.scale == pytest.approx(-0.012, abs=0.003)


def test_the_deviation_of_a_compass_is_found(tmp_path: Path) -> None:
    path = tmp_path / "turns.mcap"
    truth = write_turns(path, Rover(magnets=(6.0, 2.4, 5.0), rate=0.4), 22)
    record = read_record(path, "compass")
    fit = fit_compass(record, DAY)
    assert fit.problem == ""
    assert isinstance(fit.calibration, DeviationTable)
    assert fit.before_rms_deg > 10.0
    assert fit.rms_deg < BAR_DEG
    assert fit.lag_s == pytest.approx(LAG_S, abs=0.1)
    headings = _headings(record, fit.calibration)
    assert truth_rms_deg(truth, headings.t_s - LAG_S, headings.yaw_rad) < BAR_DEG


def test_the_error_without_calibration_is_that_of_the_compass_and_not_of_the_gyro(tmp_path: Path) -> None:
    """The gyro reads 1.2 % too little, which adds up to 13 deg over three turns."""
    path = tmp_path / "turns.mcap"
    truth = write_turns(path, Rover(magnets=(1.2, 0.5, 1.0), rate=0.4), 22)
    record = read_record(path, "compass")
    fit = fit_compass(record, DAY)
    raw = _headings(record, None)
    true_deg = truth_rms_deg(truth, raw.t_s - LAG_S, raw.yaw_rad)
    assert 1.0 < true_deg < 5.0
    assert fit.before_rms_deg == pytest.approx(true_deg, rel=0.15)


def test_vertical_iron_is_taken_out_where_the_rover_tilts(tmp_path: Path) -> None:
    path = tmp_path / "turns.mcap"
    write_turns(path, Rover(magnets=(40.0, -40.0, 80.0), wobble=1.5), 23)
    assert fit_compass(read_record(path, "imu"), DAY).rms_deg < BAR_DEG


@pytest.mark.parametrize(
    ("rover", "device", "flip", "words"),
    [
        (Rover(turns=1), "imu", False, "times: at least 3 turns are needed"),
        (Rover(), "imu", True, "mounted the wrong way up"),
        (Rover(magnets=(60.0, 10.0, 0.0)), "compass", False, "iron is stronger than the earth's field"),
        (Rover(noise=3.0), "imu", False, "the error on held-out turns is"),
    ],
    ids=["too few turns", "gyro upside down", "compass beside a magnet", "noise"],
)
def test_a_doubtful_calibration_is_not_written(
    command: Command, tmp_path: Path, rover: Rover, device: str, flip: bool, words: str
) -> None:
    write_turns(tmp_path / "turns.mcap", rover, 24, flip_gyro=flip)
    assert command("calibrate", "compass", "turns.mcap", "--device", device, "--out", "c.toml") == 1
    assert words in command.out
    assert "not written" in command.out
    assert not (tmp_path / "c.toml").exists()
    assert words.split("'")[0] in (tmp_path / "c.html").read_text("utf-8")


def test_the_result_is_entered_where_the_configuration_finds_it(command: Command, tmp_path: Path) -> None:
    write_turns(tmp_path / "turns.mcap", Rover(magnets=(6.0, 2.4, 5.0)), 22)
    (tmp_path / "rover.toml").write_text(read_config_text("el-dorado"), "utf-8")
    assert command("calibrate", "compass", "rover.toml", "--log", "turns.mcap", "--enter", "--json") == 0
    assert json.loads(command.out)["file"] == "rover-compass.toml"
    assert "Calibration of 'compass'" in (tmp_path / "rover-compass.html").read_text("utf-8").replace(
        "&#39;", "'"
    )
    compass = load_config("rover.toml").devices["compass"]
    assert getattr(compass, "calibration", None) == "rover-compass.toml"
    assert "# On a real rover" in (tmp_path / "rover.toml").read_text("utf-8")
    assert command("check", "rover.toml") == 0
    assert "without a calibration" not in command.out
    # A second calibration goes to the same file, and only with --force.
    assert command("calibrate", "compass", "rover.toml", "--log", "turns.mcap") == 2
    assert_one_sentence(command.error, "rover-compass.toml exists", "--force")


def test_bad_input_is_one_sentence(command: Command, tmp_path: Path) -> None:
    write_turns(tmp_path / "turns.mcap", Rover(turns=1), 25)
    for arguments, words in (
        (("turns.mcap", "--out", "c.toml", "--virtual"), "is a log"),
        (("turns.mcap",), "--out is missing"),
        (("turns.mcap", "--out", "c.toml", "--device", "wheels"), "'wheels' is no compass"),
        (("el-dorado", "--enter"), "--enter: el-dorado cannot be edited"),
        (
            ("el-dorado", "--virtual", "--by-hand"),
            "--by-hand drives nothing: leave --virtual and --drive out",
        ),
        (("docs/examples/none.toml",), "no configuration"),
        (("turns.mcap", "--out", "c.html"), "name a file that ends with .toml"),
    ):
        assert command("calibrate", "compass", *arguments) == 2
        assert_one_sentence(command.error, words)


def test_a_sensor_that_sends_no_magnetic_frames_is_named(tmp_path: Path) -> None:
    path = tmp_path / "turns.mcap"
    truth = write_turns(path, Rover(turns=1), 26)
    record = read_record(path, "imu")
    record.payloads[:] = [type(each)(each.t_ns, each.payload[:22]) for each in record.payloads]
    assert len(truth.frames) == len(record.payloads)
    with pytest.raises(LogError, match="magnetic frames"):
        fit_compass(record, DAY)


def test_the_rover_turns_without_what_it_calibrates() -> None:
    config = turning_config(load_config("el-dorado"), "compass", 3)
    assert config.roles.headings == ()
    assert config.roles.camera is None
    assert config.scomp is None
    assert set(config.devices) == {"wheels", "compass", "imu"}
    assert config.mission is not None
    assert config.mission.type == "whole_turns"


def test_coverage_counts_turns_and_directions() -> None:
    coverage = Coverage()
    for step in range(51):
        coverage.add(math.remainder(0.1 * math.pi * step, math.tau))
    assert coverage.turns == pytest.approx(2.5)
    assert "turned 2.5 of 6 times" in coverage.text(6)
    assert coverage.covered == 20


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("[a.b]\nx = 1\n\n[c]\ny = 2\n", '[a.b]\nx = 1\nk = "new"\n\n[c]\ny = 2\n'),
        ('[a.b]   # why\nk = "old"  # kept\n', '[a.b]   # why\nk = "new"  # kept\n'),
        ("[c]\ny = 2\n", '[c]\ny = 2\n\n[a.b]\nk = "new"\n'),
        ("a = { b = { k = 1 } }\n", 'a = { b = { k = "new" } }\n'),
    ],
)
def test_a_value_is_entered_and_comments_stay(text: str, expected: str) -> None:
    assert with_entry(text, "a.b", "k", "new") == expected
