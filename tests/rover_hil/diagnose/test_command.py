"""`rover-hil diagnose`: drives of an independent simulator, sound and with planted errors."""

import json
import re
import tomllib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.nature import calibration_drives as nature
from tests.nature.calibration_drives import DIFF, Sensors, Wheel
from tests.rover_hil.command import Command, assert_one_sentence
from tests.rover_hil.test_import_table import write

pytestmark = pytest.mark.timeout(400)

COLUMNS = """[time]
column = "t"

[[wheel]]
position = { column = "l", unit = "rad" }

[[wheel]]
position = { column = "r", unit = "rad" }

[rover]   # by the drawing
kinematics = "wheels"
wheels = [
  { x_m = 0.0, y_m = 0.1, radius_m = 0.042 },   # left
  { x_m = 0.0, y_m = -0.1, radius_m = 0.042 },
]

[limits]
wheel_speed_rad_s = 30
wheel_acceleration_rad_s2 = 100

"""
TRUTH = """[truth]
x = { column = "x" }
y = { column = "y" }
yaw = { column = "yaw" }
"""
POSITIONS = """[fixes]
x = { column = "x" }
y = { column = "y" }
sigma_m = 0.02
"""
NAMES = ("t", "l", "r", "x", "y", "yaw")
ALL_KINDS = ("circle", "circle", "straight", "straight", "on the spot", "on the spot")
WHOLE = ("--columns", "columns.toml", "--out", "found")
OPTIONS = (*WHOLE, "--quick")


def tables(
    kinds: Sequence[str],
    seed: int = 2,
    wheels: Sequence[Wheel] = DIFF,
    *,
    columns: str = COLUMNS + TRUTH,
    along_slip: float = 0.004,
    rotation_slip: float = 0.0,
) -> list[str]:
    """Write tables of drives, and the file of their columns."""
    rng = np.random.default_rng(seed)
    Path("columns.toml").write_text(columns, "utf-8")
    paths = []
    for place, kind in enumerate(kinds):
        drive = nature.drive(
            wheels,
            kind,
            rng,
            seconds=40.0,
            along_slip=along_slip,
            rotation_slip=rotation_slip,
            sensors=Sensors(),
        )
        values = (drive.t_s, *drive.turned_rad.T, *drive.pose.T)
        paths.append(str(write(Path(f"drive{place}.csv"), dict(zip(NAMES, values, strict=True)))))
    return paths


def found() -> Any:
    return json.loads(Path("found/diagnosis.json").read_text("utf-8"))


def cause(command: Command) -> str:
    return command.out.splitlines()[1]


def test_wheels_that_are_three_percent_smaller_are_named(command: Command) -> None:
    small = [replace(wheel, radius_m=0.97 * wheel.radius_m) for wheel in DIFF]
    paths = tables(ALL_KINDS, wheels=small)
    assert command("diagnose", *paths, *OPTIONS, "--config", "columns.toml", "--enter") == 0, command.error
    assert re.search(r"Most harmful: the radius is (2\.9|3|3\.1) % smaller than described", cause(command))
    record = found()
    assert record["geometry"]["is_accepted"]
    radius = record["geometry"]["numbers"]["radius"]
    assert radius["value"] == pytest.approx(-0.03, abs=radius["half_width"])
    odometry = record["errors"]["per_100_m"]["odometry"]
    assert odometry["low"] <= 3.1
    assert odometry["value"] == pytest.approx(3.1, rel=0.3)
    text = Path("columns.toml").read_text("utf-8")
    assert "# by the drawing" in text
    wheels = tomllib.loads(text)["rover"]["wheels"]
    assert wheels[0]["radius_m"] == pytest.approx(0.97 * 0.042, rel=0.003)
    page = Path("found/diagnosis.html").read_text("utf-8")
    assert page.count('<img class="drawn"') == 2
    assert page.count("<h2>") == 10


@pytest.mark.parametrize("seed", [1, 5])
def test_sound_drives_have_no_finding(command: Command, seed: int) -> None:
    paths = tables(("circle", "straight", "by hand", "on the spot"), seed)
    assert command("diagnose", *paths, *OPTIONS) == 0, command.error
    record = found()
    assert not any(each["findings"] for each in record["drives"])
    assert not record["geometry"]["is_accepted"]
    assert "Most harmful" not in cause(command)
    assert record["covariance"]["growth"] < 1.0  # nothing is stated of the ground


def test_settings_of_a_firm_floor_are_validated(command: Command) -> None:
    paths = tables(("circle", "by hand", "circle", "by hand", "circle", "by hand"), 3)
    assert command("diagnose", *paths, *OPTIONS) == 0, command.error
    settings = found()["settings"]
    assert settings["is_accepted"]
    assert settings["after"]["growth"] > 2.0 * settings["before"]["growth"]
    assert settings["after"]["inside"] >= 0.8
    assert 'slip = "learned"' in command.out


def test_slip_in_rotations_is_no_geometry(command: Command) -> None:
    paths = tables(ALL_KINDS, rotation_slip=0.08)
    assert command("diagnose", *paths, *OPTIONS) in (0, 1), command.error
    assert "no single track fits all kinds of motion" in cause(command)
    assert not found()["geometry"]["is_accepted"]


def test_exchanged_wheels_are_the_cause(command: Command) -> None:
    exchanged = COLUMNS.replace('"l"', '"q"').replace('"r"', '"l"').replace('"q"', '"r"')
    paths = tables(("circle", "by hand"), columns=exchanged + TRUTH)
    assert command("diagnose", *paths, *OPTIONS) == 1, command.error
    assert "left and right exchanged" in cause(command)
    assert command.out.splitlines()[2].startswith("Correct this first")


def test_what_cannot_be_known_is_stated(command: Command) -> None:
    paths = tables(("by hand",), columns=COLUMNS)
    assert command("diagnose", *paths, *OPTIONS) == 0, command.error
    assert "what the odometry is worth cannot be known" in command.out.splitlines()[0]
    assert found()["errors"] is None
    assert command.out.count("cannot be known") >= 6


def test_positions_alone_compare_lengths(command: Command) -> None:
    paths = tables(("by hand", "circle"), columns=COLUMNS + POSITIONS)
    assert command("diagnose", *paths, *WHOLE) == 0, command.error
    assert "no known place has a yaw" in command.out.splitlines()[0]
    assert "the estimate has used the positions" in command.out
    assert "without /pose_fix, in the longest drives: ATE" in command.out
    record = found()
    assert record["covariance"] is None
    (use,) = record["measurements"]
    assert use["counts"]["accepted"] > 100
    without = record["ate_without_m"]["/pose_fix"]
    assert without["without"] > without["with"]


def test_a_log_gives_the_same_as_its_table(command: Command) -> None:
    (path,) = tables(("circle",))
    assert command("diagnose", path, *OPTIONS) == 0, command.error
    first = found()
    assert command("diagnose", "found/drive0.mcap", "--out", "found", "--force", "--json") == 0
    assert json.loads(command.out)["errors"] == first["errors"]


def test_wrong_calls_are_one_sentence_and_write_nothing(command: Command) -> None:
    first, second = tables(("circle", "straight"))
    lines = Path(second).read_text("utf-8").splitlines()
    lines[7] = lines[7].replace(lines[7].split(",")[1], "fast")
    Path("broken.csv").write_text("\n".join(lines), "utf-8")
    Path("cut.mcap").write_bytes(b"\x89MCAP0\r\n123")
    Path("other").mkdir()
    write(Path("other/drive0.csv"), {"t": np.arange(5.0)})
    for arguments, words in (
        ("none.csv", "no file or folder none.csv"),
        (first, "name with --columns"),
        (f"{first} none.csv --columns columns.toml", "no file or folder none.csv"),
        (f"{first} {first} --columns columns.toml", "give each drive once"),
        (f"{first} other/drive0.csv --columns columns.toml", "give each drive once"),
        (f"{first} --columns none.toml", "none.toml"),
        (f"{first} broken.csv --columns columns.toml", "broken.csv"),
        ("cut.mcap", "cut.mcap"),
        (f"{first} --columns columns.toml --enter", "name with --config"),
        (f"{first} --columns columns.toml --enter --config robotino", "cannot be edited"),
    ):
        assert command("diagnose", *arguments.split(), "--out", "found") == 2, arguments
        assert_one_sentence(command.error, words)
        assert not Path("found").exists(), arguments


def test_a_yaw_that_the_wheels_gave_shows_no_error_of_rotations(command: Command) -> None:
    paths = tables(("circle",), rotation_slip=0.05)
    for path in paths:
        t, left, right, x, y, _ = np.loadtxt(path, delimiter=",", skiprows=1).T
        yaw = 0.042 * (right - left) / 0.2
        write(Path(path), dict(zip(NAMES, (t, left, right, x, y, yaw), strict=True)))
    assert command("diagnose", *paths, *OPTIONS) in (0, 1), command.error
    assert "the error per rotation is not known" in command.out
    record = found()
    assert record["errors"]["per_rotation_rad"]["odometry"]["count"] == 0
    assert "the yaw of the ground truth is that by which the wheels turn" in command.out


def test_the_answer_of_gap_is_in_the_diagnosis(command: Command) -> None:
    paths = tables(("circle", "straight", "circle", "straight"))
    assert command("diagnose", *paths, *WHOLE) == 0, command.error
    assert found()["gap"].startswith("NO_GAP: "), found()["gap"]
    assert "missing effect, by `rover-hil gap rover`: " in command.out


def test_two_straight_drives_are_diagnosed(command: Command) -> None:
    small = [replace(wheel, radius_m=0.97 * wheel.radius_m) for wheel in DIFF]
    paths = tables(("straight", "straight"), wheels=small)
    assert command("diagnose", *paths, *OPTIONS) == 0, command.error
    assert "the drives rotate too little" in command.out
    assert re.search(r"the radius is (2\.9|3|3\.1) % smaller", cause(command))


def test_distances_that_the_ground_truth_gave_are_no_odometry(command: Command) -> None:
    paths = tables(("circle",))
    for path in paths:
        t, _, _, x, y, yaw = np.loadtxt(path, delimiter=",", skiprows=1).T
        way = np.concatenate(([0.0], np.cumsum(np.hypot(np.diff(x), np.diff(y)))))
        apart = 0.1 * (yaw - yaw[0])
        columns = (t, (way - apart) / 0.042, (way + apart) / 0.042, x, y, yaw)
        write(Path(path), dict(zip(NAMES, columns, strict=True)))
    assert command("diagnose", *paths, *OPTIONS) in (0, 1), command.error
    assert "the distances of the wheels are those of the ground truth" in command.out.splitlines()[0]
    assert found()["errors"] is None
