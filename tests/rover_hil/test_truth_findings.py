"""What the truth of a drive says against its wheels: planted faults in measured drives, and sound drives."""

import cmath
import json
from pathlib import Path

import numpy as np
import pytest

from controllers.motion.kinematics import make_kinematics
from controllers.motion.rover_geometry import WheelsRoverSettings
from rover_hil.drives.quality.drive_paths import effects_of, moves_of
from tests.rover_hil.command import Command

DIFFERENTIAL = """[rover]
kinematics = "wheels"
wheels = [{ x_m = 0.0, y_m = -0.1, radius_m = 0.042 }, { x_m = 0.0, y_m = 0.1, radius_m = 0.042 }]
"""
OMNI = """[rover]
kinematics = "omni3"
wheel_radius_m = 0.051
base_radius_m = 0.195
wheel_angles_deg = [-60.0, 60.0, 180.0]
"""
REST = """[limits]
wheel_speed_rad_s = 200
wheel_acceleration_rad_s2 = 500
[truth]
x = { column = 2 }
y = { column = 3 }
yaw = { column = 4 }
"""
UNSURE = "this drive does not show which"


def columns(kind: str, order: tuple[int, ...], signs: tuple[int, ...], factor: float = 1.0) -> str:
    """Return a file of columns for the motion capture sets, with faults planted."""
    ticks, gear = (64 / factor, 43.7) if kind == "diff" else (1024 / factor, 12.0)
    usual = 1 if kind == "diff" else -1  # the ticks of the omnidirectional robot count the other way round
    text = "rate_hz = 10\nheader_lines = 0\ntime = { column = 1 }\n"
    for place, sign in zip(order, signs, strict=True):
        text += (
            f"[[wheel]]\nstep = {{ column = {5 + place}, unit = 'ticks', ticks_per_turn = {ticks!r}, "
            f"gear_ratio = {gear}, sign = {sign * usual} }}\n"
        )
    return text + (DIFFERENTIAL if kind == "diff" else OMNI) + REST


def findings_of(command: Command, shared_data: Path, kind: str, run: int, text: str) -> list[str]:
    folder = shared_data / "vehicles" / "optiodom" / kind / "circular"
    log = sorted(path for path in folder.glob("*/*_run-*.csv.gz") if not path.name.endswith("_odo.csv.gz"))[
        run
    ]
    Path("columns.toml").write_text(text, "utf-8")
    arguments = (str(log), "--columns", "columns.toml", "--out", "drive.mcap", "--json", "--force")
    assert command("import", "table", *arguments) == 0, command.error
    (drive,) = json.loads(command.out)
    return [finding["text"] for finding in drive["findings"]]


@pytest.mark.parametrize(
    ("kind", "run"),
    [
        ("diff", 0),
        ("omni3", 1),
        pytest.param("diff", 3, marks=pytest.mark.nightly),
        pytest.param("omni3", 20, marks=pytest.mark.nightly),
    ],
)
def test_a_measured_drive_as_it_is_has_no_finding(
    command: Command, shared_data: Path, kind: str, run: int
) -> None:
    count = 2 if kind == "diff" else 3
    assert (
        findings_of(command, shared_data, kind, run, columns(kind, tuple(range(count)), (1,) * count)) == []
    )


PLANTED = [
    ("diff", (1, 0), (1, 1), 1.0, ("left and right exchanged", "all wheels reversed", UNSURE)),
    ("diff", (0, 1), (-1, -1), 1.0, ("left and right exchanged", "all wheels reversed", UNSURE)),
    ("diff", (0, 1), (-1, 1), 1.0, ("wheel 0 reversed",)),
    pytest.param("diff", (0, 1), (1, -1), 1.0, ("wheel 1 reversed",), marks=pytest.mark.nightly),
    ("diff", (1, 0), (-1, 1), 1.0, ("wheels and ground truth contradict each other",)),
    ("diff", (0, 1), (1, 1), 1.0 / 57.29578, ("deg where rad is meant",)),
    ("diff", (0, 1), (1, 1), 1.0 / 9.5493, ("rpm where rad/s is meant",)),
    ("diff", (0, 1), (1, 1), 6.2832, ("revolutions where rad is meant",)),
    ("diff", (0, 1), (1, 1), 4.0, ("ticks_per_turn, gear_ratio, radius",)),
    ("omni3", (0, 1, 2), (-1, -1, -1), 1.0, ("all wheels reversed",)),
    ("omni3", (0, 1, 2), (1, -1, 1), 1.0, ("wheel 1 reversed",)),
    pytest.param(
        *("omni3", (0, 1, 2), (1, 1, 1), 1.0 / 57.29578, ("deg where rad is meant",)),
        marks=pytest.mark.nightly,
    ),
]


@pytest.mark.parametrize(("kind", "order", "signs", "factor", "words"), PLANTED)
def test_a_fault_planted_in_a_measured_drive_is_named(
    command: Command,
    shared_data: Path,
    kind: str,
    order: tuple[int, ...],
    signs: tuple[int, ...],
    factor: float,
    words: tuple[str, ...],
) -> None:
    found = findings_of(command, shared_data, kind, 1, columns(kind, order, signs, factor))
    assert len(found) == 1
    for word in words:
        assert word in found[0]


@pytest.mark.usefixtures("unrendered")
def test_replay_and_report_tell_what_the_truth_shows(command: Command, shared_data: Path) -> None:
    (found,) = findings_of(command, shared_data, "diff", 1, columns("diff", (0, 1), (-1, 1)))
    assert command("replay", "drive.mcap", "--out", "report") == 0
    assert f"finding in the whole drive: {found}" in command.out
    assert found in json.loads(Path("report/summary.json").read_text("utf-8"))["findings"][-1]["text"]


TRICYCLE = """rate_hz = 20
header_lines = 0
time = { column = 1 }
[[wheel]]
step = { column = 5, unit = "ticks", ticks_per_turn = 1600 }
steering = { column = 6, unit = "UNIT", sign = SIGN }
[[wheel]]
[[wheel]]
[rover]
kinematics = "wheels"
wheels = [
  { x_m = 0.15, y_m = 0.0, radius_m = 0.0325, steering = { low_deg = -90, high_deg = 90 } },
  { x_m = 0.0, y_m = 0.1, radius_m = 0.0325, driven = false, measured = false },
  { x_m = 0.0, y_m = -0.1, radius_m = 0.0325, driven = false, measured = false },
]
"""


@pytest.mark.parametrize(
    ("unit", "sign", "words"),
    [
        ("rad", "1", ""),
        ("rad", "-1", "the steering reversed"),
        ("deg", "1", "the steering in rad where deg is meant"),
    ],
)
def test_the_steering_of_a_measured_tricycle_is_compared_with_its_truth(
    command: Command, shared_data: Path, unit: str, sign: str, words: str
) -> None:
    text = TRICYCLE.replace("UNIT", unit).replace("SIGN", sign) + REST
    found = findings_of(command, shared_data, "tricyc", 0, text)
    assert len(found) == bool(words)
    assert words in "".join(found)


@pytest.mark.parametrize(
    ("turns", "distances", "words"),
    [
        (1.0, 1.0, ""),
        (57.29578, 1.0, "all rotations 0.01745 times as large: deg where rad is meant"),
        (1.0, 10.0, "mm where cm is meant"),
        (1.5, 1.0, "turns 0.667 times as much as by the wheels: track or wheelbase 1.49 times as wide"),
        (1.05, 1.0, ""),
    ],
)
def test_turns_or_distances_in_a_wrong_unit_are_named(
    command: Command, turns: float, distances: float, words: str
) -> None:
    """It drives 0.5 m/s, half of the time straight, half of the time turning at 0.4 rad/s to either side."""
    lines, pose = ["t,d,a,x,y,yaw"], 0j
    yaw = 0.0
    for number in range(800):
        turn = 0.02 * (0.0, 1.0, 0.0, -1.0, -1.0, 1.0, 1.0, 1.0)[number // 100]
        yaw += turn
        pose += 0.025 * cmath.rect(1.0, yaw - 0.5 * turn)
        numbers = (0.05 * number, 0.025 * distances, turn * turns, pose.real, pose.imag, yaw)
        lines.append(",".join(map(repr, numbers)))
    Path("drive.csv").write_text("\n".join(lines) + "\n", "utf-8")
    text = 'rate_hz = 20\ntime = { column = "t" }\n[increments]\ndistance = { column = "d" }\n'
    text += 'turn = { column = "a" }\n[truth]\nx = { column = "x" }\ny = { column = "y" }\n'
    text += 'yaw = { column = "yaw" }\n'
    limits = "[limits]\nwheel_speed_rad_s = 200\nwheel_acceleration_rad_s2 = 500\n"
    Path("columns.toml").write_text(text + DIFFERENTIAL + limits, "utf-8")
    arguments = ("drive.csv", "--columns", "columns.toml", "--out", "drive.mcap", "--json")
    assert command("import", "table", *arguments) == 0, command.error
    (drive,) = json.loads(command.out)
    texts = [finding["text"] for finding in drive["findings"] if finding["name"] == "truth"]
    assert len(texts) == bool(words)
    assert words in "".join(texts)


def test_a_speed_that_is_not_the_change_of_the_angle_is_told(command: Command) -> None:
    """The angle turns at 3 rad/s and swings; the column of the speed holds rpm, called rad/s."""
    lines = ["t,l,r,sl,sr"]
    angle = 0.0
    for number in range(400):
        speed = 3.0 + 2.0 * (number // 40 % 2)
        lines.append(f"{0.05 * number},{angle},{angle},{speed * 9.5493},{-speed}")
        angle += 0.05 * speed
    Path("drive.csv").write_text("\n".join(lines) + "\n", "utf-8")
    text = 'time = { column = "t" }\n' + "".join(
        f'[[wheel]]\nposition = {{ column = "{side}", unit = "rad" }}\n'
        f'speed = {{ column = "s{side}", unit = "rad/s" }}\n'
        for side in "lr"
    )
    Path("columns.toml").write_text(text + DIFFERENTIAL + REST.split("[truth]")[0], "utf-8")
    assert command("import", "table", "drive.csv", "--columns", "columns.toml", "--out", "d.mcap") == 0
    assert "finding in the whole drive: wheel 0: its speed is 9.5" in command.out
    assert "rpm where rad/s is meant" in command.out
    assert "wheel 1: its speed is -0.99" in command.out or "wheel 1: its speed is -1" in command.out
    assert command("replay", "d.mcap") == 0
    assert "rpm where rad/s is meant" in command.out


def test_the_moves_of_many_rows_are_those_of_each() -> None:
    wheels = [{"x_m": 0.0, "y_m": y_m, "radius_m": 0.1} for y_m in (0.3, -0.3)]
    steering = {"low_deg": -40.0, "high_deg": 40.0}
    front = {"x_m": 0.8, "y_m": 0.0, "radius_m": 0.1, "steering": steering}
    kinematics = make_kinematics(
        WheelsRoverSettings.model_validate({"kinematics": "wheels", "wheels": [*wheels, front]})
    )
    random = np.random.default_rng(3)
    turned_rad = random.normal(size=(20, 3))
    steering_rad = random.uniform(-0.6, 0.6, (20, 3)) * np.array([0.0, 0.0, 1.0])
    rows = list(zip(turned_rad.tolist(), steering_rad.tolist(), strict=True))
    steered = np.array([kinematics.body_motion(*row) for row in rows])
    assert moves_of(turned_rad, effects_of(kinematics, steering_rad)) == pytest.approx(steered, abs=1e-12)
    straight = np.array([kinematics.body_motion(row) for row, _ in rows])
    assert moves_of(turned_rad, effects_of(kinematics, None)) == pytest.approx(straight, abs=1e-12)
