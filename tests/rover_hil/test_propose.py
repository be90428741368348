"""`import table --propose`, names removed: columns are recognised, no wrong guess is without its mark."""

import gzip
import json
import re
from pathlib import Path

import numpy as np
import pytest

from rover_hil.drives.formats.table.columns import read_columns
from rover_hil.drives.formats.table.propose import proposal_text, propose
from tests.rover_hil.command import Command, assert_one_sentence
from tests.rover_hil.test_import_table import write

RIGHT = {
    "optiodom/diff": "time truth.x truth.y truth.yaw wheel.0.step wheel.1.step",
    "optiodom/omni3": "time truth.x truth.y truth.yaw wheel.0.step wheel.1.step wheel.2.step",
    "mower/increments": "time increments.distance increments.turn",
    "mower/truth": "time truth.x truth.y truth.yaw",
}


def without_names(source: Path, target: Path) -> Path:
    lines = gzip.decompress(source.read_bytes()).decode().splitlines()
    target.write_text("\n".join(line for line in lines if not re.search("[A-Za-z]{2}", line)) + "\n", "utf-8")
    return target


@pytest.mark.parametrize("name", RIGHT)
def test_columns_of_measured_drives_without_names_are_recognised(
    shared_data: Path, tmp_path: Path, name: str
) -> None:
    folder = shared_data / "vehicles"
    files = sorted((folder / name).glob("circular/*/*_run-*.csv.gz")) or [folder / f"{name}.csv.gz"]
    expected = dict(enumerate(RIGHT[name].split(), start=1))
    for file in [file for file in files if "_odo" not in file.name][::5]:
        guesses = propose(without_names(file, tmp_path / "drive.csv"))
        right = [guess for guess in guesses if expected.get(guess.column) == guess.key]
        assert len(right) >= 0.8 * len(expected)
        assert all(guess.is_doubtful for guess in guesses if guess not in right)


def test_the_proposal_of_a_measured_drive_is_imported_after_one_edit(
    command: Command, shared_data: Path
) -> None:
    folder = shared_data / "vehicles" / "optiodom" / "diff" / "circular"
    drive_csv = str(min(folder.glob("*/*_run-01.csv.gz")))
    assert command("import", "table", drive_csv, "--propose", "columns.toml") == 0, command.error
    assert "? column 5: wheel.0.step" in command.out
    assert "as a right wheel" in command.out
    text = Path("columns.toml").read_text("utf-8")
    assert "# ? whole numbers" in text
    text = text.replace("ticks_per_turn = 1000", "ticks_per_turn = 64, gear_ratio = 43.7")
    assert "y_m = -0.2, radius_m = 0.1 },  # column 5: right" in text
    text = re.sub(r"y_m = (-?)0.2, radius_m = 0.1", r"y_m = \g<1>0.1, radius_m = 0.042", text)
    Path("columns.toml").write_text(text, "utf-8")
    arguments = (drive_csv, "--columns", "columns.toml", "--out", "drive.mcap", "--json")
    assert command("import", "table", *arguments) == 0, command.error
    assert json.loads(command.out)[0]["findings"] == []


def guesses_of(path: Path) -> dict[str, tuple[int, dict[str, str], bool]]:
    return {guess.key: (guess.column, dict(guess.settings), guess.is_doubtful) for guess in propose(path)}


def test_units_wraps_and_a_gyro_are_seen_in_the_numbers(tmp_path: Path) -> None:
    t_s = 0.0125 * np.arange(400)
    rate = 0.5 + 0.4 * np.sin(t_s)
    yaw = np.cumsum(rate) * 0.0125
    x, y = np.cumsum(0.4 * 0.0125 * np.cos(yaw)), np.cumsum(0.4 * 0.0125 * np.sin(yaw))
    ticks = np.floor(np.cumsum(0.4 * 0.0125 / 0.05 * np.ones(len(t_s))) * 400) % 4096
    table = {
        "a": np.degrees(rate),
        "b": np.round(1000 * t_s, 1),
        "c": y,
        "d": np.degrees(yaw),
        "e": x,
        "f": ticks,
    }
    found = guesses_of(write(tmp_path / "made.csv", table))
    assert found["time"] == (2, {"unit": '"ms"'}, False)
    assert (found["truth.x"][0], found["truth.y"][0]) == (5, 3)
    assert found["truth.yaw"] == (4, {"unit": '"deg"'}, False)
    assert found["imu.yaw_rate"] == (1, {"unit": '"deg/s"'}, False)
    assert found["wheel.0.position"][1]["wrap"] == "4096"


def test_names_and_units_of_a_header_are_used(command: Command) -> None:
    rng = np.random.default_rng(35)
    rows = 50
    table = {
        "stamp [ms]": 20.0 * np.arange(rows),
        "left_rpm [rpm]": rng.normal(30.0, 1.0, rows),
        "right_rpm [rpm]": rng.normal(30.0, 1.0, rows),
        "gyro_z [deg/s]": rng.normal(0.0, 1.0, rows),
        "x [mm]": rng.normal(0.0, 1.0, rows),
        "y [mm]": rng.normal(0.0, 1.0, rows),
        "yaw [deg]": rng.normal(0.0, 1.0, rows),
    }
    write(Path("drive.csv"), table)
    assert command("import", "table", "drive.csv", "--propose", "columns.toml", "--json") == 0, command.error
    found = {guess["key"]: guess for guess in json.loads(command.out)}
    assert found["time"]["settings"] == {"unit": '"ms"'}
    assert found["wheel.0.speed"]["settings"] == {"unit": '"rpm"'}
    assert found["wheel.1.speed"]["column"] == 3
    assert found["imu.yaw_rate"]["settings"] == {"unit": '"deg/s"'}
    assert found["truth.x"]["settings"] == {"unit": '"mm"'}
    read_columns(Path("columns.toml"))
    assert command("import", "table", "drive.csv", "--propose", "columns.toml") == 2
    assert_one_sentence(command.error, "columns.toml exists", "--force")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a,b\n1,2\n", "fewer than three rows"),
        ("a,b\n3,2\n2,1\n1,0\n0,0\n", "no column grows from row to row"),
        ("a,b\nx,y\nz,w\nu,v\n", "fewer than three rows"),
    ],
)
def test_a_table_without_a_time_is_refused(command: Command, text: str, words: str) -> None:
    Path("drive.csv").write_text(text, "utf-8")
    assert command("import", "table", "drive.csv", "--propose", "columns.toml") == 2
    assert_one_sentence(command.error, words)
    assert not Path("columns.toml").exists()
    assert command("import", "table", "drive.csv") == 2
    assert_one_sentence(command.error, "--columns and --out are needed", "--propose")


T_S = 0.02 * np.arange(1000)
SPEED_M_S = np.where(T_S < 1.0, 0.0, 0.4)
RATE_RAD_S = np.where((T_S > 2.0) & (T_S < 8.0), 0.5, 0.0) - np.where((T_S > 10.0) & (T_S < 14.0), 0.4, 0.0)
YAW_RAD = np.cumsum(RATE_RAD_S) * 0.02
X_M, Y_M = (np.cumsum(SPEED_M_S * part(YAW_RAD)) * 0.02 for part in (np.cos, np.sin))
RIMS_M_S = SPEED_M_S - 0.15 * RATE_RAD_S, SPEED_M_S + 0.15 * RATE_RAD_S
LEFT_RAD, RIGHT_RAD = (np.cumsum(speed) * 0.02 / 0.05 for speed in RIMS_M_S)
POSE = {"x": X_M, "y": Y_M, "theta": YAW_RAD}


def sides_of(path: Path) -> list[tuple[str, str]]:
    """Return side and sign of each proposed wheel."""
    guesses = [guess for guess in propose(path) if guess.key.startswith("wheel.")]
    assert all(guess.is_doubtful for guess in guesses)
    return [(guess.side, guess.settings.get("sign", "1")) for guess in guesses]


@pytest.mark.parametrize(
    ("columns", "sides"),
    [
        ({"right": RIGHT_RAD, "left": LEFT_RAD}, [("right", "1"), ("left", "1")]),
        ({"l": LEFT_RAD, "r": RIGHT_RAD}, [("left", "1"), ("right", "1")]),
        ({"RearRight": RIGHT_RAD, "RearLeft": LEFT_RAD}, [("right", "1"), ("left", "1")]),
        (
            {"fl": LEFT_RAD, "rl": LEFT_RAD, "fr": RIGHT_RAD, "rr": RIGHT_RAD},
            [("left", "1")] * 2 + [("right", "1")] * 2,
        ),
        ({"wheel_1": LEFT_RAD, "wheel_2": RIGHT_RAD}, [("", "1"), ("", "1")]),
        ({"wheel_1": RIGHT_RAD, "wheel_2": LEFT_RAD} | POSE, [("right", "1"), ("left", "1")]),
        ({"wheel_1": -LEFT_RAD, "wheel_2": RIGHT_RAD} | POSE, [("left", "-1"), ("right", "1")]),
        (
            {"wheel_1": LEFT_RAD, "wheel_2": LEFT_RAD, "wheel_3": RIGHT_RAD} | POSE,
            [("left", "1")] * 2 + [("right", "1")],
        ),
    ],
)
def test_sides_are_those_of_names_and_of_the_path(
    tmp_path: Path, columns: dict[str, np.ndarray], sides: list[tuple[str, str]]
) -> None:
    path = write(tmp_path / "drive.csv", {"t": T_S} | columns)
    assert sides_of(path) == sides
    text = proposal_text(path, propose(path))
    for number, (side, _) in enumerate(sides):
        line = text.splitlines()[3 + number]
        assert side or "? left or right" in line
        assert ("y_m = -0.2" in line) == (side == "right" or (not side and number % 2 == 1))


def test_a_name_that_the_path_contradicts_is_questioned(tmp_path: Path) -> None:
    path = write(tmp_path / "drive.csv", {"t": T_S, "left": RIGHT_RAD, "right": LEFT_RAD} | POSE)
    assert sides_of(path) == [("right", "1"), ("left", "1")]
    assert "as a right wheel, but by its name a left one: exchanged?" in proposal_text(path, propose(path))


@pytest.mark.parametrize(
    ("columns", "column", "unit", "is_doubtful"),
    [
        ({"t": T_S}, "t", "s", False),
        ({"t": 1000.0 * T_S}, "t", "ms", False),
        ({"t": 50.0 * T_S + 0.0}, "t", "s", True),
        ({"t": T_S, **POSE}, "x", "m", False),
        ({"t": T_S, "x": 1000.0 * X_M, "y": 1000.0 * Y_M, "theta": YAW_RAD}, "x", "mm", True),
        ({"t": T_S, "x": 50.0 * X_M, "y": 50.0 * Y_M, "theta": np.degrees(YAW_RAD)}, "x", "m", True),
        ({"t": T_S, "x_mm": 50.0 * X_M, "y_mm": 50.0 * Y_M, "theta": YAW_RAD}, "x_mm", "mm", False),
        ({"t": T_S, "left_rpm": RIMS_M_S[0], "right_rpm": RIMS_M_S[1]}, "left_rpm", "rpm", True),
        ({"t": T_S, "v_left_m_s": RIMS_M_S[0], "v_right_m_s": RIMS_M_S[1]}, "v_left_m_s", "m/s", True),
        ({"t": T_S, "ds": 8.0 * SPEED_M_S, "dyaw": RATE_RAD_S}, "ds", "mm", True),
        ({"t": T_S, "ds_mm": 8.0 * SPEED_M_S, "dyaw": RATE_RAD_S}, "dyaw", "rad", True),
        ({"t": T_S, "v": SPEED_M_S, "omega_z": RATE_RAD_S}, "v", "m/s", True),
        ({"t": T_S, "v_km_h": SPEED_M_S, "omega_z": RATE_RAD_S}, "v_km_h", "km/h", False),
    ],
)
def test_a_unit_is_right_or_questioned(
    tmp_path: Path, columns: dict[str, np.ndarray], column: str, unit: str, is_doubtful: bool
) -> None:
    path = write(tmp_path / "drive.csv", columns)
    number = list(columns).index(column) + 1
    guess = next(guess for guess in propose(path) if guess.column == number)
    assert (guess.settings["unit"], guess.is_doubtful) == (f'"{unit}"', is_doubtful)


def test_speed_and_yaw_rate_of_a_body_are_proposed(command: Command) -> None:
    write(Path("drive.csv"), {"t": T_S, "v": SPEED_M_S, "omega_z": RATE_RAD_S})
    assert command("import", "table", "drive.csv", "--propose", "columns.toml") == 0, command.error
    body = read_columns(Path("columns.toml")).body
    assert body is not None
    assert (body.speed.column, body.yaw_rate.column) == (2, 3)


def turns_of(rate: np.ndarray, speed: np.ndarray) -> dict[str, np.ndarray]:
    """Return a drive whose wheels are named only by their number."""
    yaw = np.cumsum(rate) * 0.02
    x, y = (np.cumsum(speed * part(yaw)) * 0.02 for part in (np.cos, np.sin))
    wheels = [np.cumsum(speed + side * rate) * 0.02 / 0.05 for side in (0.15, -0.15)]
    return {
        "t": T_S,
        "wheel_1": wheels[0],
        "wheel_2": wheels[1],
        "x": x,
        "y": y,
        "theta": yaw,
        "note": 0.0 * T_S,
    }


def test_sides_are_decided_by_all_drives_and_unused_columns_are_listed(command: Command) -> None:
    """In an even circle distance and rotation are one: it shows no side."""
    rng = np.random.default_rng(3)
    even = np.full(len(T_S), 0.5)
    write(Path("circle.csv"), turns_of(even, np.full(len(T_S), 0.3) + rng.normal(0.0, 0.01, len(T_S))))
    write(Path("weave.csv"), turns_of(0.5 * np.sin(0.7 * T_S), np.full(len(T_S), 0.3)))
    alone = [guess for guess in propose(Path("circle.csv")) if guess.key.startswith("wheel.")]
    assert [guess.side for guess in alone] == ["", ""]
    assert all("an even bend does not show its side" in guess.reason for guess in alone)
    together = [
        guess for guess in propose(Path("circle.csv"), [Path("weave.csv")]) if guess.key.startswith("wheel.")
    ]
    assert [guess.side for guess in together] == ["right", "left"]
    assert command("import", "table", "circle.csv", "weave.csv", "--propose", "columns.toml") == 0
    assert "? column 7: 'note' is not used" in command.out
    assert "# ? column 7: 'note' is not used" in Path("columns.toml").read_text("utf-8")
    write(Path("other.csv"), {"t": T_S, "a": T_S})
    assert command("import", "table", "circle.csv", "other.csv", "--propose", "more.toml") == 2
    assert_one_sentence(command.error, "other.csv has other columns than circle.csv")


def test_increments_need_no_rover(command: Command) -> None:
    write(Path("drive.csv"), {"t": T_S, "dist": 0.02 * SPEED_M_S, "turn": 0.02 * RATE_RAD_S})
    assert command("import", "table", "drive.csv", "--propose", "columns.toml") == 0, command.error
    assert "# rover = { kinematics" in Path("columns.toml").read_text("utf-8")
    arguments = ("drive.csv", "--columns", "columns.toml", "--out", "drive.mcap")
    assert command("import", "table", *arguments) == 0, command.error
    assert "no [rover] is described: two wheels" in command.out
    text = 'time = { column = "t" }\n[[wheel]]\nposition = { column = "dist", unit = "m" }\n'
    Path("columns.toml").write_text(text, "utf-8")
    assert command("import", "table", *arguments, "--force") == 2
    assert_one_sentence(command.error, "[[wheel]] needs the rover", "rover = { kinematics = 'wheels'")


def test_columns_of_a_sensor_of_its_own_are_not_missed_in_the_drive(command: Command) -> None:
    """The drive is named as its own table of ground truth, and the gyro is in another one."""
    wheels = {"l": LEFT_RAD, "r": RIGHT_RAD}
    write(Path("drive.csv"), {"t": T_S, **wheels, "x": X_M, "y": Y_M, "spare": 0.0 * T_S})
    write(Path("gyro.csv"), {"t": T_S, "w": RATE_RAD_S})
    Path("columns.toml").write_text(
        """time = { column = "t" }
wheel = [
  { position = { column = "l", unit = "rad" } },
  { position = { column = "r", unit = "rad" } },
]
limits = { wheel_speed_rad_s = 100, wheel_acceleration_rad_s2 = 500 }
rover = { kinematics = "wheels", wheels = [
  { x_m = 0.0, y_m = 0.15, radius_m = 0.05 },
  { x_m = 0.0, y_m = -0.15, radius_m = 0.05 },
] }
truth = { file = "drive.csv", x = { column = "x" }, y = { column = "y" } }
imu = { file = "gyro.csv", yaw_rate = { column = "w" } }
""",
        "utf-8",
    )
    arguments = ("drive.csv", "--columns", "columns.toml", "--out", "drive.mcap")
    assert command("import", "table", *arguments) == 0, command.error
    (line,) = [line for line in command.out.splitlines() if "columns that are not used" in line]
    assert "spare" in line
    assert re.search(r"spare +1 ", line)
