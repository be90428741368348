"""Slip of logs whose true positions were measured by tape while the rover stood."""

import math
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from drivers.errors import LogError
from rover_hil.app.app import app
from rover_hil.drives.marks import Marks
from rover_hil.identify.slip.hand_positions import poses_between
from rover_hil.identify.slip.runs import find_runs
from tests.rover_hil.identify.test_slip_fixes import SPEED_M_S, read, slips, write_drive

BEGINS_S, ENDS_S = 1.0, 11.0


def drive_by_tape(folder: Path, name: str = "run", *, slip: float = 0.3, direction_rad: float = 0.5) -> Path:
    """Write a drive without a camera, and beside it where it began and ended."""
    log = write_drive(
        folder / f"{name}.mcap",
        slip=slip,
        begins_s=BEGINS_S,
        ends_s=ENDS_S,
        direction_rad=direction_rad,
        is_seen=lambda _: False,
    )
    way_m = (1.0 - slip) * SPEED_M_S * (ENDS_S - BEGINS_S)
    x_m, y_m = way_m * math.cos(direction_rad), way_m * math.sin(direction_rad)
    write_positions(folder, (0.5, 1.0, 2.0, 0.0), (11.5, 1.0 + x_m, 2.0 + y_m, 0.0), name=name)
    return log


def write_positions(folder: Path, *rows: tuple[float, ...], name: str = "run") -> None:
    lines = ["t_s,x_m,y_m,yaw_deg", *(",".join(map(str, row)) for row in rows)]
    (folder / f"{name}.positions.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")


@pytest.mark.parametrize("slip", [0.0, 0.3])
def test_every_half_second_of_a_leg_has_its_mean_slip(tmp_path: Path, slip: float) -> None:
    run = read(drive_by_tape(tmp_path, slip=slip))
    assert run.truth == "positions in run.positions.csv"
    driving = run.encoder_distance_m() > 0.05
    assert driving.sum() >= 18
    with np.errstate(invalid="ignore"):
        assert slips(run)[driving] == pytest.approx(slip, abs=0.01)
    directions = np.arctan2(run.camera_velocity[driving, 1], run.camera_velocity[driving, 0])
    assert directions == pytest.approx(0.5, abs=0.01)


def test_the_file_of_positions_is_no_run_of_its_own(tmp_path: Path) -> None:
    log = drive_by_tape(tmp_path)
    write_positions(tmp_path, (0.5, 1.0, 2.0, 0.0), name="lost")
    found = find_runs([tmp_path])
    assert found.files == (log,)
    assert found.other_files == (tmp_path / "lost.positions.csv",)  # that of the log is used


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ([(0.5, 0, 0, 0)], "at least two places"),
        ([(0.5, 0, 0, 0), (0.4, 1, 0, 0)], "do not rise"),
        ([(0.5, 0, 0, 0), (5.0, 1, 0, 0)], "the wheels turn at t_s = 5"),
        ([(0.5, 0, 0, 0), (99.0, 1, 0, 0)], "must be within the log"),
        ([(0.2, 0, 0, 0), (0.6, 1, 0, 0)], "too little for the error of a tape"),
        ([(0.5, 0, 0, 0), (11.5, 30, 0, 0)], "further than the wheels can have moved"),
        ([("x", 0, 0, 0), (11.5, 1, 0, 0)], "'x' is not a number"),
    ],
)
def test_positions_that_cannot_be_used_are_refused_in_words(
    tmp_path: Path, rows: list[tuple[float, ...]], message: str
) -> None:
    log = drive_by_tape(tmp_path)
    write_positions(tmp_path, *rows)
    with pytest.raises(LogError, match=message):
        read(log)


def test_a_file_without_its_columns_says_which(tmp_path: Path) -> None:
    log = drive_by_tape(tmp_path)
    (tmp_path / "run.positions.csv").write_text("t_s,x_m,y_m\n0,0,0\n")
    with pytest.raises(LogError, match="names no column 'yaw_deg'"):
        read(log)


def test_a_file_of_a_former_version_is_refused_with_its_new_name(tmp_path: Path) -> None:
    log = drive_by_tape(tmp_path)
    (tmp_path / "run.positions.csv").rename(tmp_path / "run.marks.csv")
    assert find_runs([tmp_path]).files == (log,)
    with pytest.raises(LogError, match=r"now called run\.positions\.csv: rename it"):
        read(log)


def test_the_stated_accuracy_decides_how_short_a_leg_may_be(tmp_path: Path) -> None:
    log = drive_by_tape(tmp_path)
    path = tmp_path / "run.positions.csv"
    rows = path.read_text("utf-8").split()
    path.write_text("\n".join([f"{rows[0]},sigma_m", *(f"{row},0.1" for row in rows[1:])]), "utf-8")
    with pytest.raises(LogError, match=r"a tape \(100 mm\): drive at least 2\.83 m"):
        read(log)


def test_a_leg_on_which_the_rover_turns_shows_no_slip(tmp_path: Path) -> None:
    log = drive_by_tape(tmp_path)
    rows = [row.split(",") for row in (tmp_path / "run.positions.csv").read_text("utf-8").split()[1:]]
    places = [tuple(float(cell) for cell in row) for row in rows]
    write_positions(tmp_path, places[0], (11.2, *places[1][1:3], math.nan), places[1])
    assert read(log).truth == "positions in run.positions.csv"  # a place without a yaw is left out
    write_positions(tmp_path, places[0], (*places[1][:3], 90.0))
    with pytest.raises(LogError, match="the rover turns or bends on every leg"):
        read(log)


SIDE_M = np.linspace(0.0, 1.0, 21)


@pytest.mark.parametrize(
    ("second_m", "yaw_deg"),
    [
        pytest.param(np.concatenate((SIDE_M, 1.0 + 1j * SIDE_M)), 0.0, id="corner without a turn"),
        pytest.param(0.3 * (np.exp(1j * np.linspace(0.0, math.tau, 41)) - 1.0), 360.0, id="whole turn"),
    ],
)
def test_a_leg_that_is_not_straight_shows_no_slip(
    tmp_path: Path, second_m: np.ndarray, yaw_deg: float
) -> None:
    """The rover drives ahead with a slip of 20 %, and then with the same yaw at both ends otherwise."""
    first = np.concatenate((np.zeros(5), SIDE_M, np.ones(5)))
    path_m = np.concatenate((first, 1.0 + second_m, np.full(5, 1.0 + second_m[-1])))
    t_s = np.linspace(0.0, 0.1 * (len(path_m) - 1), len(path_m))
    ends = [2, len(first) - 2, len(path_m) - 3]
    true_m = 0.8 * path_m[ends]
    marks = Marks(t_s[ends], true_m.real, true_m.imag, np.array([0.0, 0.0, yaw_deg]), np.full(3, 0.005))
    poses = poses_between(marks, tmp_path, t_s, path_m)
    assert poses[: len(first), 0] == pytest.approx(0.8 * first)
    assert np.isnan(poses[len(first) + 1 : -6]).all()


def test_maps_are_fitted_to_drives_by_tape(tmp_path: Path) -> None:
    for number in range(8):
        drive_by_tape(tmp_path / "sand", str(number), slip=0.25, direction_rad=-math.pi + 0.8 * number)
    out = tmp_path / "sand.toml"
    found = CliRunner().invoke(app, ["identify", "slip", str(tmp_path / "sand"), "--out", str(out), "--json"])
    assert found.exit_code == 0, found.output
    assert out.exists()
