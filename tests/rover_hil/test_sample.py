"""`rover-hil sample` writes data of known content, and nothing over earlier files."""

import csv
from pathlib import Path

import numpy as np
import pytest

from rover_hil.drives.drive import read_drive
from rover_hil.drives.formats.robotino_csv import read_run
from rover_hil.sample import catalogue
from rover_hil.sample.catalogue import SAMPLES, Sample
from tests.rover_hil.command import Command, assert_one_sentence

MM_PER_PX = 1.84


def test_the_list_names_every_sample_with_its_files(command: Command) -> None:
    assert command("sample") == 0
    lines = command.out.splitlines()
    assert [line.split()[0] for line in lines] == list(SAMPLES)
    for line, sample in zip(lines, SAMPLES.values(), strict=True):
        assert line.endswith(": " + ", ".join(sample.paths))


def test_an_unknown_sample_is_one_sentence_with_the_names(command: Command) -> None:
    assert command("sample", "nothing") == 2
    assert_one_sentence(command.error, "'nothing'", "rover", "slope")


def test_nothing_is_overwritten_and_force_does_it(command: Command, tmp_path: Path) -> None:
    path = tmp_path / "my_rover.toml"
    path.write_text("mine", "utf-8")
    assert command("sample", "rover") == 2
    assert_one_sentence(command.error, "my_rover.toml", "--force")
    assert path.read_text("utf-8") == "mine"
    assert command("sample", "rover", "--force") == 0
    assert command("check", "my_rover.toml") == 0
    assert sorted(item.name for item in tmp_path.iterdir()) == ["my_rover.toml"]


def test_a_sample_joins_a_folder_that_exists(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def make(folder: Path) -> None:
        (folder / "runs" / "first").mkdir(parents=True)

    one = Sample("a folder", ("runs/first",), make)
    monkeypatch.setattr("rover_hil.sample.command.SAMPLES", {"runs": one})
    (tmp_path / "runs" / "mine").mkdir(parents=True)
    assert command("sample", "runs") == 0
    assert sorted(item.name for item in (tmp_path / "runs").iterdir()) == ["first", "mine"]
    assert [item.name for item in tmp_path.iterdir()] == ["runs"]


def test_a_sample_that_fails_leaves_nothing(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(folder: Path) -> None:
        (folder / "half").mkdir()
        raise OSError("disk full")

    samples = {**SAMPLES, "rover": Sample("a failure", ("half",), fail)}
    monkeypatch.setattr("rover_hil.sample.command.SAMPLES", samples)
    assert catalogue.SAMPLES is SAMPLES
    with pytest.raises(OSError, match="disk full"):
        command("sample", "rover")
    assert list(tmp_path.iterdir()) == []


def test_the_slope_differs_from_the_model_as_it_says(command: Command, tmp_path: Path) -> None:
    assert command("sample", "slope") == 0
    with (tmp_path / "measured" / "summary.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 36
    level = [float(row["slip_angle_deg"]) for row in rows if row["slope_deg"] == row["roll_deg"] == "10.0"]
    steep = [float(row["slip_angle_deg"]) for row in rows if row["slope_deg"] == row["roll_deg"] == "20.0"]
    # Roll equal to slope: the model has no slip angle there, soil that flows downhill has.
    assert abs(np.mean(level)) < 0.5
    assert abs(np.mean(steep)) > 2.0
    assert np.std(level) > 0.0


def test_the_robotino_file_is_the_drive_it_was_made_from(command: Command, tmp_path: Path) -> None:
    assert command("sample", "robotino") == 0
    run = read_run(tmp_path / "exp00.csv", MM_PER_PX)
    first, last = run[0], run[-1]
    # It drives to (1.5, 0.6) m with its nose ahead.
    x_m, y_m = last.truth["x_m"] - first.truth["x_m"], last.truth["y_m"] - first.truth["y_m"]
    assert np.degrees(np.arctan2(y_m, x_m)) == pytest.approx(21.8, abs=3.0)
    assert 0.5 < np.hypot(x_m, y_m) < 1.7
    assert first.truth["yaw_rad"] == pytest.approx(0.0, abs=0.02)
    assert command("import", "robotino", "exp00.csv", "-o", "exp00.mcap") == 0
    drive = read_drive(tmp_path / "exp00.mcap")
    turned = [drive.channels[f"position{wheel}_rad"].value for wheel in (1, 2, 3)]
    assert max(np.ptp(angles) for angles in turned) > 5.0
