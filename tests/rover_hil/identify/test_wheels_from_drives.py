"""`rover-hil calibrate wheels LOGS`: what drives with ground truth show of the wheels."""

import json
import math
import tomllib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from controllers.motion.rover_geometry import OmniRoverSettings, RoverSettings, WheelsRoverSettings
from controllers.motion.wheel_settings import SteeringSettings, WheelSettings
from drivers.errors import LogError
from rover_hil.drives.quality.drive_paths import GROUND_TRUTH, DrivePath
from rover_hil.ready.wheels.from_drives import GeometryResult, geometry_from_drives
from rover_hil.ready.wheels.geometry import (
    BASE,
    DELAY,
    MARKER_X,
    MARKER_Y,
    MARKER_YAW,
    RADIUS,
    RADIUS_OF,
    STEERING_DELAY,
    STEERING_ZERO,
    TRACK,
    WHEELBASE,
)
from rover_hil.ready.wheels.motion_kinds import BY_HAND, CIRCLE, ON_THE_SPOT, SQUARE, STRAIGHT
from rover_hil.ready.wheels.trajectory import STEP_S, RecordedDrive
from rover_hil.ready.wheels.trajectory_fit import TrajectoryProblem
from tests.nature import calibration_drives as nature
from tests.nature.calibration_drives import DIFF, OMNI, TRICYCLE, Sensors, Wheel
from tests.rover_hil.command import Command, assert_one_sentence
from tests.rover_hil.test_import_table import write

DIFF_ROVER = WheelsRoverSettings(
    kinematics="wheels",
    wheels=tuple(WheelSettings(x_m=0.0, y_m=side * 0.1, radius_m=0.042) for side in (1.0, -1.0)),
)
OMNI_ROVER = OmniRoverSettings(
    kinematics="omni3", wheel_radius_m=0.051, base_radius_m=0.195, wheel_angles_deg=(300.0, 60.0, 180.0)
)
FREE = WheelSettings(x_m=0.0, y_m=0.08, radius_m=0.0325, driven=False, measured=False)
TRICYCLE_ROVER = WheelsRoverSettings(
    kinematics="wheels",
    wheels=(
        WheelSettings(
            x_m=0.15, y_m=0.0, radius_m=0.0325, steering=SteeringSettings(low_deg=-90.0, high_deg=90.0)
        ),
        FREE,
        FREE.model_copy(update={"y_m": -0.08}),
    ),
)
ROVERS: dict[str, tuple[Sequence[Wheel], RoverSettings]] = {
    "differential": (DIFF, DIFF_ROVER),
    "omni": (OMNI, OMNI_ROVER),
    "tricycle": (TRICYCLE, TRICYCLE_ROVER),
}
WRONG_RADIUS, WRONG_BASE, WRONG_SIDE, WRONG_ZERO = 0.03, -0.04, 0.01, 0.02
SENSORS = Sensors(marker=(0.03, -0.02, 0.1), delay_s=0.06, gyro=(1.015, 0.004))
POSES = slice(None, None, 10)


def planted(rover: str) -> tuple[Sequence[Wheel], RoverSettings, dict[str, float]]:
    """Return the true wheels, the description, and the numbers by which they differ."""
    wheels, described = ROVERS[rover]
    numbers = {RADIUS: WRONG_RADIUS, MARKER_X: 0.03, MARKER_Y: -0.02, MARKER_YAW: 0.1, DELAY: 0.06}
    if rover == "differential":
        numbers |= {TRACK: WRONG_BASE, f"{RADIUS_OF}left/right": WRONG_SIDE}
    elif rover == "omni":
        numbers |= {BASE: WRONG_BASE}
    else:
        numbers |= {WHEELBASE: WRONG_BASE, STEERING_ZERO: WRONG_ZERO}
    side = numbers.get(f"{RADIUS_OF}left/right", 0.0)
    true = [
        replace(
            wheel,
            x_m=(1.0 + WRONG_BASE) * wheel.x_m,
            y_m=(1.0 + WRONG_BASE) * wheel.y_m,
            radius_m=(1.0 + WRONG_RADIUS) * (1.0 + math.copysign(side, wheel.y_m)) * wheel.radius_m,
            direction_rad=wheel.direction_rad + numbers.get(STEERING_ZERO, 0.0),
        )
        for wheel in wheels
    ]
    return true, described, numbers


def recorded(drive: nature.Drive, rover: RoverSettings, name: str, *, has_yaw: bool = True) -> RecordedDrive:
    edges_s = np.arange(0.0, drive.t_s[-1], STEP_S)
    middles_s = 0.5 * (edges_s[1:] + edges_s[:-1])
    count = len(rover.wheels) if isinstance(rover, WheelsRoverSettings) else 3
    turned_rad, steering_rad = np.zeros((len(middles_s), count)), np.zeros((len(middles_s), count))
    for wheel in range(drive.turned_rad.shape[1]):
        turned_rad[:, wheel] = np.diff(np.interp(edges_s, drive.t_s, drive.turned_rad[:, wheel]))
        steering_rad[:, wheel] = np.interp(middles_s, drive.t_s, drive.steering_rad[:, wheel])
    gyro_rad = np.concatenate(([0.0], np.cumsum(drive.gyro_rad_s[:-1] * np.diff(drive.t_s))))
    x_m, y_m, yaw_rad = drive.pose[POSES].T
    inside = drive.t_s[POSES] <= edges_s[-1]
    return RecordedDrive(
        path=Path(f"{name}.mcap"),
        rover=rover,
        t_s=edges_s,
        turned_rad=turned_rad,
        steering_rad=steering_rad if rover is TRICYCLE_ROVER else None,
        gyro_rad=np.interp(edges_s, drive.t_s, gyro_rad),
        truth=DrivePath(
            drive.t_s[POSES][inside], x_m[inside], y_m[inside], yaw_rad[inside] if has_yaw else None
        ),
        source=GROUND_TRUTH,
    )


def drives_of(
    rover: str, kinds: Sequence[str], seed: int, *, slip: float = 0.0, has_yaw: bool = True, each: int = 2
) -> list[RecordedDrive]:
    wheels, described, _ = planted(rover)
    rng = np.random.default_rng(seed)
    return [
        recorded(
            nature.drive(wheels, kind, rng, rotation_slip=slip, along_slip=0.004, sensors=SENSORS),
            described,
            f"{kind}-{number}",
            has_yaw=has_yaw,
        )
        for kind in kinds
        for number in range(each)
    ]


def kinds_of(rover: str) -> list[str]:
    return [STRAIGHT, CIRCLE, *([] if rover == "tricycle" else [ON_THE_SPOT]), SQUARE, BY_HAND]


def misses(result: GeometryResult, numbers: dict[str, float]) -> list[str]:
    """Return the numbers that are outside of their intervals."""
    return [
        each.number.name
        for each in result.fit.estimates
        if each.is_shown and abs(each.value - numbers.get(each.number.name, 0.0)) > each.half_width
    ]


@pytest.mark.parametrize("has_yaw", [True, False])
@pytest.mark.parametrize("rover", ROVERS)
def test_planted_numbers_are_found_within_their_intervals(rover: str, has_yaw: bool) -> None:
    *_, numbers = planted(rover)
    result = geometry_from_drives(drives_of(rover, kinds_of(rover), 1, has_yaw=has_yaw))
    assert result.problem == ""
    assert list(result.kinds[::2]) == kinds_of(rover)
    shown = {each.number.name for each in result.fit.estimates if each.is_shown}
    assert {RADIUS, WHEELBASE if rover == "tricycle" else TRACK if rover == "differential" else BASE} <= shown
    assert len(misses(result, numbers)) <= 1, misses(result, numbers)
    for kind in result.by_kind:
        assert kind.end_m[1] < kind.end_m[0] or kind.kind == ON_THE_SPOT
    assert result.gyro is not None
    assert result.gyro.scale == pytest.approx(1.015, abs=result.gyro.half_width + 0.002)


def test_late_steering_is_found_beside_a_late_ground_truth() -> None:
    wheels, described, numbers = planted("tricycle")
    rng, sensors = np.random.default_rng(3), replace(SENSORS, steering_delay_s=0.15)
    drives = [
        recorded(nature.drive(wheels, kind, rng, sensors=sensors), described, f"{kind}{number}")
        for kind in (SQUARE, BY_HAND)
        for number in range(2)
    ]
    result = geometry_from_drives(drives)
    assert result.problem == ""
    assert result.fit.values[STEERING_DELAY] == pytest.approx(0.15, abs=0.01)
    assert result.fit.values[DELAY] == pytest.approx(0.06, abs=0.01)
    assert result.fit.values[STEERING_ZERO] == pytest.approx(numbers[STEERING_ZERO], abs=0.002)


@pytest.mark.parametrize("rover", ROVERS)
def test_slip_in_rotations_is_no_geometry(rover: str) -> None:
    """The wheels roll farther where the rover rotates more tightly: no single track or wheelbase fits."""
    result = geometry_from_drives(drives_of(rover, kinds_of(rover), 1, slip=0.08))
    base = {"differential": TRACK, "omni": BASE, "tricycle": WHEELBASE}[rover]
    assert result.differences[0].number.name == base
    assert f"no single {base} fits all kinds of motion" in result.problem
    values = result.differences[0].values
    if rover != "tricycle":
        assert "slip in rotations" in result.problem
        assert values[ON_THE_SPOT][0] - values[CIRCLE][0] > 0.05
    else:
        assert values[SQUARE][0] - values[CIRCLE][0] > 0.004


def test_single_radii_that_are_not_shown_are_no_slip() -> None:
    """One drive of each kind does not show single radii; they must not look like slip in rotations."""
    wheels = [
        replace(wheel, radius_m=factor * 0.051)
        for wheel, factor in zip(OMNI, (1.006, 1.014, 1.0), strict=True)
    ]
    rng = np.random.default_rng(1)
    drives = [
        recorded(nature.drive(wheels, kind, rng, along_slip=0.002, sensors=SENSORS), OMNI_ROVER, kind)
        for kind in (STRAIGHT, CIRCLE, ON_THE_SPOT, SQUARE)
    ]
    assert not geometry_from_drives(drives).differences


def test_slip_that_hides_the_track_is_found() -> None:
    """Kinds of motion contradict each other so much that no track is shown."""
    kinds = (STRAIGHT, CIRCLE, ON_THE_SPOT, SQUARE)
    result = geometry_from_drives(drives_of("differential", kinds, 2, slip=0.3))
    assert result.differences[0].number.name == TRACK
    assert "slip in rotations" in result.problem


def test_intervals_contain_the_numbers_of_whole_drives() -> None:
    """With slip that wanders, numbers depend on how the drives are cut."""
    wheels, described, _ = planted("differential")
    rng = np.random.default_rng(8)
    drives = [
        recorded(nature.drive(wheels, CIRCLE, rng, along_slip=0.05, sensors=SENSORS), described, str(number))
        for number in range(8)
    ]
    result = geometry_from_drives(drives)
    numbers = [each.number for each in result.fit.estimates]
    problem = TrajectoryProblem(drives, result.geometry, numbers).of_whole_drives()
    whole = problem.solve(list(result.fit.values), result.fit.values)
    apart = {name: abs(value - whole.values[name]) for name, value in result.fit.values.items()}
    assert max(apart.values()) > 0.0
    for each in result.fit.estimates:
        assert each.half_width >= apart.get(each.number.name, 0.0)


def test_circles_alone_do_not_show_what_they_cannot() -> None:
    """Without a yaw, circles to one side show neither the radius nor the place of the marker."""
    wheels, described, _ = planted("differential")
    rng = np.random.default_rng(0)
    drives: list[RecordedDrive] = []
    while len(drives) < 3:
        drive = recorded(
            nature.drive(wheels, CIRCLE, rng, sensors=SENSORS), described, f"{len(drives)}", has_yaw=False
        )
        if drive.turned_rad[:, 1].sum() > drive.turned_rad[:, 0].sum():  # to the left
            drives.append(drive)
    result = geometry_from_drives(drives)
    estimates = {each.number.name: each for each in result.fit.estimates}
    assert estimates[RADIUS].half_width > 0.05 or not estimates[RADIUS].is_shown
    for each in result.fit.estimates:
        if each.is_shown:
            true = planted("differential")[2].get(each.number.name, 0.0)
            assert abs(each.value - true) <= each.half_width, each.number.name


def test_a_right_description_is_confirmed_and_not_written() -> None:
    rng = np.random.default_rng(3)
    drives = [
        recorded(nature.drive(DIFF, kind, rng, along_slip=0.01), DIFF_ROVER, f"{kind}{number}")
        for kind in (STRAIGHT, CIRCLE, ON_THE_SPOT)
        for number in range(2)
    ]
    result = geometry_from_drives(drives)
    assert result.problem != ""
    assert not result.differences


def test_a_wrong_unit_is_no_calibration() -> None:
    drives = [
        replace(drive, turned_rad=2.0 * drive.turned_rad)
        for drive in drives_of("differential", [CIRCLE, BY_HAND], 1)
    ]
    result = geometry_from_drives(drives)
    assert "the radius differs by -48 %: correct ticks" in result.problem


def test_one_drive_alone_validates_nothing() -> None:
    (drive,) = drives_of("differential", [BY_HAND], 5, each=1)
    result = geometry_from_drives([drive])
    assert "no drive to validate them on" in result.problem
    assert geometry_from_drives([drive], drives_of("differential", [BY_HAND], 6, each=1)).problem == ""


@pytest.mark.parametrize("kind", [STRAIGHT, CIRCLE, ON_THE_SPOT, SQUARE, BY_HAND])
def test_kinds_of_motion_are_recognised(kind: str) -> None:
    for rover in ("differential", "omni", "tricycle"):
        if kind not in kinds_of(rover):
            continue
        wheels, described = ROVERS[rover]
        rng = np.random.default_rng(7)
        drives = [recorded(nature.drive(wheels, kind, rng), described, str(place)) for place in range(3)]
        assert geometry_from_drives(drives).kinds == [kind] * 3


def test_numbers_of_different_rovers_are_not_mixed() -> None:
    first, second = drives_of("differential", [CIRCLE], 1)
    other = replace(second, rover=OMNI_ROVER)
    with pytest.raises(LogError, match="have different"):
        geometry_from_drives([first, other])


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

[truth]
x = { column = "x" }
y = { column = "y" }
yaw = { column = "yaw" }
"""


def import_drives(command: Command, kinds: Sequence[str]) -> list[str]:
    wheels, _, _ = planted("differential")
    rng = np.random.default_rng(2)
    Path("columns.toml").write_text(COLUMNS, "utf-8")
    tables = []
    for place, kind in enumerate(kinds):
        drive = nature.drive(wheels, kind, rng, sensors=replace(SENSORS, delay_s=0.0))
        columns = dict(
            zip(
                ("t", "l", "r", "x", "y", "yaw"),
                (drive.t_s, *drive.turned_rad.T, *drive.pose.T),
                strict=True,
            )
        )
        tables.append(str(write(Path(f"drive{place}.csv"), columns)))
    arguments = ("--columns", "columns.toml", "--no-estimate", "--out", "logs")
    assert command("import", "table", *tables, *arguments) == 0, command.error
    return [f"logs/drive{place}.mcap" for place in range(len(kinds))]


def test_imported_logs_correct_their_file_of_columns(command: Command) -> None:
    logs = import_drives(command, [CIRCLE, CIRCLE, BY_HAND, BY_HAND])
    arguments = ("calibrate", "wheels", "columns.toml", *logs, "--out", "wheels.toml", "--enter")
    assert command(*arguments) == 0, command.error
    first = command.out.splitlines()[0]
    assert first.startswith("answer: the corrected wheels are better")
    assert "not driven: straight, on the spot, square" in command.out
    text = Path("columns.toml").read_text("utf-8")
    assert "# by the drawing" in text
    assert "# left" in text
    entered = tomllib.loads(text)["rover"]["wheels"]
    assert entered == tomllib.loads(Path("wheels.toml").read_text("utf-8"))["rover"]["wheels"]
    assert entered[0]["radius_m"] == pytest.approx(1.03 * 1.01 * 0.042, rel=0.002)
    assert entered[1]["y_m"] == pytest.approx(-0.96 * 0.1, rel=0.005)
    assert Path("wheels.html").read_text("utf-8").count('<img class="drawn"') == 2
    assert command("calibrate", "wheels", *logs, "--validation", logs[0], "--json") in (0, 1)
    found = json.loads(command.out)
    assert found["numbers"]["track"]["is_shown"]
    assert set(found["validation"]) == {CIRCLE}


@pytest.mark.parametrize("yaw", [True, False])
def test_ground_truth_with_and_without_yaw_has_an_offset(command: Command, yaw: bool) -> None:
    wheels, _, _ = planted("differential")
    drive = nature.drive(wheels, BY_HAND, np.random.default_rng(4), sensors=replace(SENSORS, delay_s=0.12))
    text = COLUMNS if yaw else COLUMNS.replace('yaw = { column = "yaw" }\n', "")
    Path("columns.toml").write_text(text, "utf-8")
    columns = (drive.t_s, *drive.turned_rad.T, *drive.pose.T)
    write(Path("drive.csv"), dict(zip(("t", "l", "r", "x", "y", "yaw"), columns, strict=True)))
    arguments = ("--columns", "columns.toml", "--no-estimate", "--out", "drive.mcap")
    assert command("import", "table", "drive.csv", *arguments) == 0, command.error
    assert command("calibrate", "time", "drive.mcap", "--json") == 0, command.error
    found = json.loads(command.out)["offsets"]["ground truth"]
    assert found["offset_s"] == pytest.approx(0.12, abs=0.005 + 3.0 * found["sd_s"])
    assert found["sd_s"] < 0.02


def test_wrong_calls_are_one_sentence(command: Command) -> None:
    logs = import_drives(command, [CIRCLE, STRAIGHT])
    for options, words in (
        ("columns.toml --validation a.mcap", "--validation: name logs of other drives"),
        (f"{logs[0]} none.mcap", "cannot read log none.mcap"),
        (f"robotino {logs[0]}", "is of a rover with other wheels"),
        (f"{logs[0]} --enter", "cannot be edited"),
        (f"columns.toml {logs[0]} --line {logs[0]}=2", "--line and --spin: leave them out"),
        (f"columns.toml {logs[0]} --virtual", "is a log: leave --virtual out"),
        ("columns.toml", "--out is needed"),
    ):
        assert command("calibrate", "wheels", *options.split()) == 2, options
        assert_one_sentence(command.error, words)
