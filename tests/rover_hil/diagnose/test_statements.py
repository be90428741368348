"""What the page of `diagnose` states: what is entered, what waits, what is small, and what is explained."""

import json
import math
import re
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rover_hil.diagnose.answer import rotation_words
from rover_hil.diagnose.drive_errors import ESTIMATE, LEFT, ODOMETRY, RIGHT, Compared, errors_of
from rover_hil.diagnose.trajectory_errors import Trajectory
from tests.nature.calibration_drives import DIFF
from tests.rover_hil.command import Command
from tests.rover_hil.diagnose.test_command import ALL_KINDS, COLUMNS, OPTIONS, TRUTH, cause, found, tables
from tests.rover_hil.test_import_table import write

pytestmark = pytest.mark.timeout(400)

TRICYCLE = """time = { column = 1 }
[truth]
x = { column = 2 }
y = { column = 3 }
yaw = { column = 4 }
[[wheel]]
step = { column = 5, unit = "ticks", ticks_per_turn = 1600 }
steering = { column = 6, unit = "rad" }
[rover]
kinematics = "wheels"
wheels = [
  { x_m = 0.15, y_m = 0.0, radius_m = 0.0325, steering = { low_deg = -100, high_deg = 100 } },
  { x_m = 0.0, y_m = 0.1, radius_m = 0.0325, measured = false },
  { x_m = 0.0, y_m = -0.1, radius_m = 0.0325, measured = false },
]
[limits]
wheel_speed_rad_s = 60
wheel_acceleration_rad_s2 = 500
"""


def test_only_numbers_that_differ_are_entered(command: Command) -> None:
    small = [replace(wheel, radius_m=0.97 * wheel.radius_m) for wheel in DIFF]
    paths = tables(ALL_KINDS, wheels=small)
    assert command("diagnose", *paths, *OPTIONS, "--config", "columns.toml", "--enter") == 0, command.error
    wheels = tomllib.loads(Path("columns.toml").read_text("utf-8"))["rover"]["wheels"]
    assert [wheel["y_m"] for wheel in wheels] == [0.1, -0.1]
    assert wheels[0]["radius_m"] == wheels[1]["radius_m"] == pytest.approx(0.97 * 0.042, rel=0.003)
    assert re.search(r"to enter: radius_m 0\.042 -> 0\.0407\d* of wheels 0, 1\n", command.out)
    assert re.search(r"track: .* \(95 %\); not shown to differ, stays as described", command.out)
    numbers = found()["geometry"]["numbers"]
    assert numbers["radius"]["is_entered"]
    assert not numbers["track"]["is_entered"]


def test_a_number_that_validation_drives_need_is_entered_and_marked(
    command: Command, shared_data: Path
) -> None:
    """In bends of one radius three numbers have their errors in common; none may be held alone."""
    folder = shared_data / "vehicles" / "optiodom" / "tricyc" / "circular"
    paths = [
        str(folder / name / f"{name}_run-0{number}.csv.gz")
        for name in ("140120211415", "140120211454")
        for number in (1, 2)
    ]
    Path("columns.toml").write_text(TRICYCLE, "utf-8")
    assert command("diagnose", *paths, *OPTIONS) == 1, command.error
    assert "wheelbase: +3.94 +- 11 % (95 %); not shown to differ by itself, entered because" in command.out
    # The clock of the ground truth shows with the corrected wheels alone: one run states both.
    worth, first = command.out.splitlines()[:2]
    assert re.search(r"deg \(.*\) too far per rotation to the left, and .* too little to the right", worth)
    assert first.startswith("Most harmful: the steering zero is off by -1.1 deg")
    assert "; in 2 of 4 drives: with the corrected wheels, the clock of the ground truth runs 1.022" in first
    assert command.out.splitlines()[2].startswith("Enter the corrected numbers")
    assert "the common clock of all sensors that is wrong by a factor" in command.out
    # Bends to the left alone: slip is what a geometry does not explain.
    paths = [path for path in paths if "run-02" in path]
    assert command("diagnose", *paths, *OPTIONS, "--force") == 0, command.error
    assert "the described numbers of the wheels are wrong together (radius" in cause(command)
    assert "none of them to the right" in command.out.splitlines()[0]
    slip = found()["slip"]["circle"]
    assert slip["low"] < 0.0 < slip["high"]
    assert not any(each["is_entered"] for each in found()["geometry"]["numbers"].values())


def circles(bias_rad_s: float, scale: float) -> Compared:
    """Return five circles to the left and then five to the right, with a wrong zero and a wrong scale."""
    t_s = np.arange(0.0, 200.0, 0.1)
    rate = np.where(t_s < 100.0, 1.0, -1.0) * math.tau / 20.0
    yaw, own = (np.cumsum(each) * 0.1 for each in (rate, scale * rate + bias_rad_s))
    true, track = (Trajectory(np.cumsum(0.02 * np.exp(1j * each)), each) for each in (yaw, own))
    return Compared(t_s=t_s, true=true, tracks={ODOMETRY: track, ESTIMATE: track})


def back_and_forth(scale: float) -> Compared:
    """Return rotations that change their side every third of one: their errors cancel over whole ones."""
    t_s = np.arange(0.0, 400.0, 0.1)
    yaw = 2.1 * np.abs((t_s / 10.0) % 2.0 - 1.0)
    true, track = (Trajectory(np.asarray(0.002 * t_s, np.complex128), each) for each in (yaw, scale * yaw))
    return Compared(t_s=t_s, true=true, tracks={ODOMETRY: track, ESTIMATE: track})


def test_errors_to_the_left_and_to_the_right_are_not_averaged() -> None:
    errors = errors_of({"bias": circles(0.01, 1.0)})
    assert errors is not None
    left, right = (errors.per_rotation_to_rad[ODOMETRY][side] for side in (LEFT, RIGHT))
    assert (left.value, right.value) == pytest.approx((0.2, -0.2), rel=0.15)
    words = rotation_words(errors, ODOMETRY)
    assert re.search(
        r"1\d deg .* too far per rotation to the left, and 1\d deg .* too little to the right", words
    )
    errors = errors_of({"scale": circles(0.0, 1.05), "back and forth": back_and_forth(1.05)})
    assert errors is not None
    assert re.fullmatch(r"1\d deg \(.*\) too far per rotation", rotation_words(errors, ODOMETRY))
    assert math.degrees(errors.per_rotation_rad[ODOMETRY].value) == pytest.approx(17.1, rel=0.05)


def test_geometry_waits_for_exchanged_wheels(command: Command) -> None:
    exchanged = COLUMNS.replace('"l"', '"q"').replace('"r"', '"l"').replace('"q"', '"r"')
    paths = tables(("circle", "by hand"), columns=exchanged + TRUTH)
    assert command("diagnose", *paths, *OPTIONS) == 1, command.error
    assert "4. Geometry and sensors\n   cannot be known: it waits until the finding of drive0" in command.out
    assert "radius" not in command.out.split("4. Geometry")[1].split("5. Odometry")[0]


def test_a_finding_in_a_small_part_states_its_share(command: Command) -> None:
    """The speeds have lost their sign: the rover backs up for 3 s of some minutes."""
    t_s = np.arange(0.0, 200.0, 0.02)
    speed = np.where((t_s > 90.0) & (t_s < 93.0), -0.3, 0.3 + 0.1 * np.sin(0.2 * t_s))
    rate = 0.3 * np.sin(0.1 * t_s)
    yaw = np.cumsum(rate) * 0.02
    place = np.cumsum(speed * np.exp(1j * yaw)) * 0.02
    left, right = (np.abs(speed) + side * 0.1 * rate for side in (-1.0, 1.0))
    angles = [np.cumsum(each) * 0.02 / 0.042 for each in (left, right)]
    rng = np.random.default_rng(5)
    places = [part + rng.normal(0.0, 0.001, len(t_s)) for part in (place.real, place.imag)]
    Path("columns.toml").write_text(COLUMNS + TRUTH, "utf-8")
    columns = dict(zip(("t", "l", "r", "x", "y", "yaw"), (t_s, *angles, *places, yaw), strict=True))
    path = write(Path("drive.csv"), columns)
    assert command("diagnose", str(path), *OPTIONS) == 1, command.error
    first, next_step = command.out.splitlines()[1:3]
    assert re.match(r"Most harmful in 1 of 1 drives, 1\.\d % of the motion: ", first)
    assert next_step.startswith("Correct this, as the finding states: it concerns 1.")
    assert "first" not in next_step


def test_words_are_explained_and_nothing_is_unreadable(command: Command) -> None:
    paths = tables(("circle", "by hand", "circle", "by hand", "circle", "by hand"), 3)
    write(Path("ranges.csv"), {"t": np.arange(5.0), "beacon": np.ones(5), "range": np.ones(5)})
    assert command("diagnose", *paths, *OPTIONS) == 0, command.error
    assert re.search(
        r"\ntogether .*\nATE \(absolute trajectory error\): .* RPE \(relative pose error\): ", command.out
    )
    assert re.search(r"the standard deviation .* without these settings, and holds \(\d", command.out)
    assert "holds: " not in command.out
    assert "legs" not in command.out
    assert "# slip: share of the travel of the wheels that is lost; cross_slip: " in command.out
    assert (
        "data: a table of ranges to beacons, or of their places, which nothing uses, ranges.csv: "
        in command.out
    )
    assert "cross_slip: " in Path("found/diagnosis.html").read_text("utf-8")
    assert json.loads(Path("found/diagnosis.json").read_text("utf-8"))["settings"]["is_accepted"]
