"""`rover-hil import table` on tables of every format, on wrong ones, and on measured drives of others."""

import gzip
import math
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from rover_hil.drives.drive import read_drive
from rover_hil.drives.files.csv_table import read_csv
from rover_hil.drives.formats.table.columns import read_columns
from tests.rover_hil.command import Command, assert_one_sentence

PERIOD_S, ROWS = 0.05, 101
SPEED_M_S, TURN_RAD_S = 0.4, 0.5
RADIUS_M, TRACK_M, TICKS = 0.05, 0.3, 4096
LEFT_RAD_S = (SPEED_M_S - 0.5 * TRACK_M * TURN_RAD_S) / RADIUS_M
RIGHT_RAD_S = (SPEED_M_S + 0.5 * TRACK_M * TURN_RAD_S) / RADIUS_M
T_S = PERIOD_S * np.arange(ROWS)
YAW_RAD = TURN_RAD_S * T_S
X_M, Y_M = (
    SPEED_M_S / TURN_RAD_S * np.sin(YAW_RAD),
    SPEED_M_S / TURN_RAD_S * (1.0 - np.cos(YAW_RAD)),
)
ROVER = f"""[rover]
kinematics = "wheels"
wheels = [
  {{ x_m = 0.0, y_m = {TRACK_M / 2}, radius_m = {RADIUS_M} }},
  {{ x_m = 0.0, y_m = {-TRACK_M / 2}, radius_m = {RADIUS_M} }},
]
[limits]
wheel_speed_rad_s = 30
wheel_acceleration_rad_s2 = 100
"""
TIME = '[time]\ncolumn = "t"\n'
TRUTH = '[truth]\nx = { column = "x" }\ny = { column = "y" }\nyaw = { column = "yaw" }\n'
RADIANS = "".join(f'[[wheel]]\nposition = {{ column = "{name}", unit = "rad" }}\n' for name in ("l", "r"))
NAMES = ("t", "l", "r", "x", "y", "yaw")


def drive() -> dict[str, np.ndarray]:
    columns = (T_S, LEFT_RAD_S * T_S, RIGHT_RAD_S * T_S, X_M, Y_M, YAW_RAD)
    return dict(zip(NAMES, columns, strict=True))


def write(path: Path, columns: dict[str, np.ndarray], *, header: bool = True, delimiter: str = ",") -> Path:
    lines = [delimiter.join(columns)] if header else []
    rows = zip(*(column.tolist() for column in columns.values()), strict=True)
    lines += [delimiter.join(repr(number) for number in row) for row in rows]
    raw = ("\n".join(lines) + "\n").encode()
    path.write_bytes(gzip.compress(raw) if path.suffix == ".gz" else raw)
    return path


def import_it(command: Command, columns: str, *files: str, out: str = "drive.mcap") -> int:
    Path("columns.toml").write_text(columns, "utf-8")
    return command("import", "table", *files, "--columns", "columns.toml", "--out", out)


def assert_circle(command: Command, tolerance_rad: float = 1e-9) -> None:
    rows = read_drive(Path("drive.mcap")).channels
    turned = [rows[f"position{wheel}_rad"].value for wheel in (1, 2)]
    for values, speed_rad_s in zip(turned, (LEFT_RAD_S, RIGHT_RAD_S), strict=True):
        assert values[-1] - values[0] == pytest.approx(speed_rad_s * T_S[-1], abs=tolerance_rad)
    assert command("replay", "drive.mcap") == 0
    assert "every output identical" in command.out


def write_parquet(path: Path, columns: dict[str, np.ndarray]) -> None:
    arrow, parquet = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    parquet.write_table(arrow.table(columns), path)


def write_npz(path: Path, columns: dict[str, np.ndarray]) -> None:
    np.savez(path, **columns)  # type: ignore[arg-type]


def write_structured(path: Path, columns: dict[str, np.ndarray]) -> None:
    rows = np.zeros(ROWS, [(name, float) for name in columns])
    for name, column in columns.items():
        rows[name] = column
    np.save(path, rows)


WRITERS: dict[str, Callable[[Path, dict[str, np.ndarray]], object]] = {
    "drive.csv": write,
    "drive.csv.gz": write,
    "semicolons.csv": lambda path, columns: write(path, columns, delimiter=";"),
    "drive.npy": write_structured,
    "drive.npz": write_npz,
    "drive.mat": savemat,
    "drive.parquet": write_parquet,
}


@pytest.mark.parametrize("name", WRITERS)
def test_a_table_of_any_format_becomes_a_log_that_replays(
    command: Command, tmp_path: Path, name: str
) -> None:
    WRITERS[name](tmp_path / name, drive())
    assert import_it(command, TIME + TRUTH + RADIANS + ROVER, str(tmp_path / name)) == 0, command.error
    assert f"wheels: {ROWS} rows" in command.out
    assert f"truth: {ROWS} rows" in command.out
    true = read_drive(Path("drive.mcap")).true_poses()
    assert true.x_m[-1] == X_M[-1]
    assert_circle(command)


def test_without_a_header_columns_are_numbered(command: Command, tmp_path: Path) -> None:
    write(tmp_path / "drive.txt", drive(), header=False, delimiter=" ")
    columns = 'delimiter = " "\n[time]\ncolumn = 1\n' + "".join(
        f'[[wheel]]\nposition = {{ column = {number}, unit = "rad" }}\n' for number in (2, 3)
    )
    assert import_it(command, columns + ROVER, str(tmp_path / "drive.txt")) == 0, command.error
    assert_circle(command)


def wheels_of(kind: str, text: str) -> str:
    return "".join(f'[[wheel]]\n{kind} = {{ column = "{name}", {text} }}\n' for name in ("l", "r"))


@pytest.mark.parametrize(
    ("kind", "text", "per_rad", "tolerance_rad"),
    [
        ("position", 'unit = "deg"', 180.0 / math.pi, 1e-9),
        ("position", 'unit = "rev", gear_ratio = 12', 12.0 / math.tau, 1e-9),
        ("position", 'unit = "mm"', 1000.0 * RADIUS_M, 1e-9),
        ("position", 'unit = "rad", sign = -1', -1.0, 1e-9),
        ("position", f'unit = "ticks", ticks_per_turn = {TICKS}', TICKS / math.tau, 1e-2),
        ("position", f'unit = "ticks", ticks_per_turn = {TICKS}, wrap = 8192', TICKS / math.tau, 1e-2),
        ("step", f'unit = "ticks", ticks_per_turn = {TICKS}', TICKS / math.tau, 1e-2),
    ],
)
def test_every_unit_of_an_angle(
    command: Command, tmp_path: Path, kind: str, text: str, per_rad: float, tolerance_rad: float
) -> None:
    columns = drive()
    for name in ("l", "r"):
        values = columns[name] * per_rad
        if "ticks" in text:
            values = np.round(values)
        if "wrap" in text:
            values = values % 8192
        columns[name] = np.diff(values, prepend=values[0]) if kind == "step" else values
    write(tmp_path / "drive.csv", columns)
    assert import_it(command, TIME + wheels_of(kind, text) + ROVER, str(tmp_path / "drive.csv")) == 0
    assert_circle(command, tolerance_rad)


@pytest.mark.parametrize(
    ("unit", "per_rad_s"), [("rpm", 30.0 / math.pi), ("km/h", 3.6 * RADIUS_M), ("m/s", RADIUS_M)]
)
def test_wheels_with_speeds_only(command: Command, tmp_path: Path, unit: str, per_rad_s: float) -> None:
    columns = drive() | {
        "l": np.full(ROWS, LEFT_RAD_S * per_rad_s),
        "r": np.full(ROWS, RIGHT_RAD_S * per_rad_s),
    }
    write(tmp_path / "drive.csv", columns)
    text = TIME + wheels_of("speed", f'unit = "{unit}"') + ROVER
    assert import_it(command, text, str(tmp_path / "drive.csv")) == 0, command.error
    assert "no angles, its speeds are integrated" in command.out
    speeds = read_drive(Path("drive.mcap")).channels["speed1_rad_s"].value
    assert speeds == pytest.approx(LEFT_RAD_S)


def last_pose(command: Command) -> tuple[float, float]:
    assert command("export", "drive.mcap", "--csv") == 0
    table = read_csv(Path("drive_csv/estimate.csv"))
    x_m, y_m = (table.numbers(f"estimate_{axis}_m")[-1] for axis in ("x", "y"))
    return float(x_m), float(y_m)


def test_increments_with_the_truth_in_another_table(command: Command, tmp_path: Path) -> None:
    columns = {
        "t": 1000.0 + T_S,
        "d": np.full(ROWS, SPEED_M_S * PERIOD_S),
        "a": np.full(ROWS, TURN_RAD_S * PERIOD_S),
    }
    write(tmp_path / "drive.csv", columns)
    write(tmp_path / "truth.csv", drive() | {"t": 999.9 + T_S})
    text = (
        TIME
        + '[increments]\ndistance = { column = "d" }\nturn = { column = "a" }\n'
        + TRUTH.replace("[truth]", '[truth]\nfile = "truth.csv"')
        + ROVER
    )
    assert import_it(command, text, str(tmp_path / "drive.csv")) == 0, command.error
    assert "true poses before the first or behind the last row" in command.out
    assert last_pose(command) == pytest.approx((X_M[-1], Y_M[-1]), abs=0.02)


def test_a_tricycle_with_one_driven_and_steered_wheel(command: Command, tmp_path: Path) -> None:
    base_m, radius_m = 0.5, 0.1
    steering_rad = math.atan2(TURN_RAD_S * base_m, SPEED_M_S)
    rolled_m = math.hypot(TURN_RAD_S * base_m, SPEED_M_S) * PERIOD_S
    columns = {
        "t": T_S,
        "s": np.full(ROWS, rolled_m / radius_m),
        "a": np.full(ROWS, math.degrees(steering_rad) + 2.0),
    }
    write(tmp_path / "drive.csv", columns)
    text = (
        TIME
        + f"[tricycle]\nwheelbase_m = {base_m}\nradius_m = {radius_m}\n"
        + 'step = { column = "s", unit = "rad" }\nsteering = { column = "a", unit = "deg", zero = 2.0 }\n'
        + ROVER
    )
    assert import_it(command, text, str(tmp_path / "drive.csv")) == 0, command.error
    assert last_pose(command) == pytest.approx((X_M[-1], Y_M[-1]), abs=0.02)


def test_the_truth_of_a_marker_that_sits_anywhere_is_that_of_the_rover(
    command: Command, tmp_path: Path
) -> None:
    ahead_m, left_m, yaw_deg = 0.2, -0.1, 90.0
    columns = drive()
    marker_m = (X_M + 1j * Y_M) + np.exp(1j * YAW_RAD) * complex(ahead_m, left_m)
    columns |= {"x": marker_m.real, "y": marker_m.imag, "yaw": YAW_RAD + math.radians(yaw_deg)}
    write(tmp_path / "drive.csv", columns)
    truth = TRUTH + f"marker = {{ x_m = {ahead_m}, y_m = {left_m}, yaw_deg = {yaw_deg} }}\n"
    assert import_it(command, TIME + truth + RADIANS + ROVER, str(tmp_path / "drive.csv")) == 0
    true = read_drive(Path("drive.mcap")).true_poses()
    assert true.x_m == pytest.approx(X_M, abs=1e-12)
    assert true.y_m == pytest.approx(Y_M, abs=1e-12)
    assert true.yaw_rad == pytest.approx(YAW_RAD, abs=1e-12)


def latitude_longitude(columns: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return the columns with their places near 48 N, 11 E; radii of curvature of WGS 84, by hand."""
    latitude_rad, axis_m, eccentricity2 = math.radians(48.0), 6378137.0, 6.69437999014e-3
    root = math.sqrt(1.0 - eccentricity2 * math.sin(latitude_rad) ** 2)
    north_m, east_m = axis_m * (1.0 - eccentricity2) / root**3, axis_m * math.cos(latitude_rad) / root
    places = {"x": 11.0 + np.degrees(columns["x"] / east_m), "y": 48.0 + np.degrees(columns["y"] / north_m)}
    return columns | places


GEODETIC = TRUTH.replace("x =", "longitude =").replace("y =", "latitude =")


def test_a_truth_in_latitude_and_longitude_is_east_and_north(command: Command, tmp_path: Path) -> None:
    write(tmp_path / "drive.csv", latitude_longitude(drive()))
    assert import_it(command, TIME + GEODETIC + RADIANS + ROVER, str(tmp_path / "drive.csv")) == 0, (
        command.error
    )
    true = read_drive(Path("drive.mcap")).true_poses()
    assert true.x_m == pytest.approx(X_M, abs=1e-4)
    assert true.y_m == pytest.approx(Y_M, abs=1e-4)


@pytest.mark.parametrize(
    ("truth", "words"),
    [
        (GEODETIC, ("line 3", "are none in degrees")),
        (TRUTH + 'latitude = { column = "y" }\n', ("give x and y, or latitude and longitude",)),
    ],
)
def test_places_that_are_none_are_refused(
    command: Command, tmp_path: Path, truth: str, words: tuple[str, ...]
) -> None:
    columns = latitude_longitude(drive())
    columns["y"][1] = 4800.5
    write(tmp_path / "drive.csv", columns)
    assert import_it(command, TIME + truth + RADIANS + ROVER, str(tmp_path / "drive.csv")) == 2
    assert_one_sentence(command.error, *words)
    assert not Path("drive.mcap").exists()


TRICYCLE = """header_lines = 0
time = { column = 1 }
[tricycle]
wheelbase_m = 0.15
radius_m = 0.0325
step = { column = 5, unit = "ticks", ticks_per_turn = 1600 }
steering = { column = 6, unit = "rad" }
[truth]
x = { column = 2 }
y = { column = 3 }
yaw = { column = 4 }
[rover]
kinematics = "wheels"
wheels = [{ x_m = 0.0, y_m = -0.1, radius_m = 0.0325 }, { x_m = 0.0, y_m = 0.1, radius_m = 0.0325 }]
[limits]
wheel_speed_rad_s = 200
wheel_acceleration_rad_s2 = 500
"""


@pytest.mark.slow
def test_a_measured_tricycle_follows_its_truth(command: Command, shared_data: Path) -> None:
    """With nominal numbers: the steering has an offset that they do not hold, hence 8 % of the turn."""
    folder = shared_data / "vehicles" / "optiodom" / "tricyc" / "circular"
    for run in sorted(folder.glob("*/*_run-01.csv.gz"))[:3]:
        Path("columns.toml").write_text(TRICYCLE, "utf-8")
        arguments = (str(run), "--columns", "columns.toml", "--out", "drive.mcap", "--force")
        assert command("import", "table", *arguments) == 0, command.error
        true = np.unwrap(read_drive(Path("drive.mcap")).true_poses().yaw_rad)
        assert command("export", "drive.mcap", "--csv", "--force") == 0
        yaw = np.unwrap(read_csv(Path("drive_csv/estimate.csv")).numbers("estimate_yaw_rad"))
        assert yaw[-1] - yaw[0] == pytest.approx(true[-1] - true[0], rel=0.08)
        assert command("replay", "drive.mcap") == 0
        assert "every output identical" in command.out


def test_yaw_rate_and_currents(command: Command, tmp_path: Path) -> None:
    columns = drive() | {"w": np.full(ROWS, math.degrees(TURN_RAD_S)), "i": np.full(ROWS, 300.0)}
    write(tmp_path / "drive.csv", columns)
    text = TIME + RADIANS + 'current = { column = "i", unit = "mA" }\n'
    text += '[imu]\nyaw_rate = { column = "w", unit = "deg/s" }\n' + ROVER
    assert import_it(command, text, str(tmp_path / "drive.csv")) == 0, command.error
    rows = read_drive(Path("drive.mcap")).channels
    assert rows["gyro_z_rad_s"].value == pytest.approx(TURN_RAD_S)
    assert rows["current2_a"].value == pytest.approx(0.3)


def test_a_repeated_row_counts_once(command: Command, tmp_path: Path) -> None:
    columns = {name: np.insert(values, 50, values[50]) for name, values in drive().items()}
    columns["l"], columns["r"] = (
        np.full(ROWS + 1, LEFT_RAD_S * PERIOD_S),
        np.full(ROWS + 1, RIGHT_RAD_S * PERIOD_S),
    )
    write(tmp_path / "drive.csv", columns)
    assert (
        import_it(command, TIME + wheels_of("step", 'unit = "rad"') + ROVER, str(tmp_path / "drive.csv")) == 0
    )
    assert "rows that repeat the one before" in command.out
    assert_circle(command)


def test_several_tables_become_several_logs_or_none(command: Command, tmp_path: Path) -> None:
    one, two = write(tmp_path / "one.csv", drive()), write(tmp_path / "two.csv.gz", drive())
    Path("file").touch()
    assert import_it(command, TIME + RADIANS + ROVER, str(one), str(two), out="file") == 2
    assert_one_sentence(command.error, "file is a file", "name a folder")
    assert import_it(command, TIME + RADIANS + ROVER, str(one), str(two), out="logs") == 0
    assert sorted(path.name for path in Path("logs").iterdir()) == ["one.mcap", "two.mcap"]
    assert import_it(command, TIME + RADIANS + ROVER, str(one), out="logs/one.mcap") == 2
    assert_one_sentence(command.error, "--force")
    Path("new").mkdir()
    write(two, {"t": T_S[::-1], "l": T_S, "r": T_S})
    assert import_it(command, TIME + RADIANS + ROVER, str(one), str(two), out="new") == 2
    assert_one_sentence(command.error, "two.csv.gz line 3", "column 't'", "runs back")
    assert not list(Path("new").iterdir())


WRONG: dict[str, tuple[str, str, tuple[str, ...]]] = {
    "word": (
        "t,l,r\n0,0,0\n1,abc,0\n",
        RADIANS,
        ("line 3", "column 'l'", "'abc' is not a number"),
    ),
    "no column": ("t,left,r\n0,0,0\n", RADIANS, ("no column 'l'", "it has t, left, r")),
    "no rows": ("t,l,r\n", RADIANS, ("no lines below its header",)),
    "empty": ("", RADIANS, ("no column 't'",)),
    "wrong delimiter": ("t|l|r\n0|0|0\n", RADIANS, ("no column 't'", "delimiter")),
    "unit of the time": ("t,l,r\n0,0,0\n2000000,0,0\n", RADIANS, ("11 days", "unit")),
    "an empty step": (
        "t,l,r\n0,0,0\n0.1,,0\n",
        wheels_of("step", 'unit = "rad"'),
        ("line 3", "column 'l'", "not a number"),
    ),
    "degrees for radians": (
        "t,l,r\n" + "".join(f"{0.1 * n:g},{90 * n},0\n" for n in range(20)),
        RADIANS,
        ("line 3", "column 'l'", "turns faster than limits.wheel_speed_rad_s", "correct the unit"),
    ),
    "turns between cannot be counted": (
        "t,l,r\n" + "".join(f"{n},{n % 4},0\n" for n in range(20)),
        wheels_of("position", 'unit = "rad", wrap = 4'),
        ("wraps after 4", "record faster"),
    ),
    "too few wheels": ("t,l,r\n0,0,0\n", RADIANS[: len(RADIANS) // 2], ("1 [[wheel]]", "2 wheels")),
    "no number": ("t,l,r\n0,,\n1,,\n", RADIANS, ("no row holds a number",)),
}


@pytest.mark.parametrize("case", WRONG)
def test_a_wrong_table_ends_with_one_sentence(command: Command, case: str) -> None:
    text, wheels, words = WRONG[case]
    Path("drive.csv").write_text(text, "utf-8")
    assert import_it(command, TIME + wheels + ROVER, "drive.csv") == 2
    assert_one_sentence(command.error, *words)
    assert not Path("drive.mcap").exists()


@pytest.mark.parametrize("name", ["drive.npy", "drive.npz", "drive.mat", "drive.parquet", "drive.csv.gz"])
@pytest.mark.parametrize("raw", [b"", b"no such file", bytes(4096)])
def test_a_damaged_file_ends_with_one_sentence(command: Command, name: str, raw: bytes) -> None:
    Path(name).write_bytes(raw)
    assert import_it(command, TIME + RADIANS + ROVER, name) == 2
    assert_one_sentence(command.error, name)
    assert not Path("drive.mcap").exists()


def test_a_pickle_is_not_loaded(command: Command) -> None:
    np.save("drive.npy", np.array([{"t": 1}], object), allow_pickle=True)
    assert import_it(command, TIME + RADIANS + ROVER, "drive.npy") == 2
    assert_one_sentence(command.error, "drive.npy", "never loaded")


@pytest.mark.parametrize(
    ("columns", "words"),
    [
        (TIME + ROVER, ("give the motion once",)),
        (TIME + RADIANS, ("rover",)),
        (TIME + RADIANS + ROVER.replace("[limits]", "[limit]"), ("limit",)),
        (TIME + wheels_of("position", 'unit = "ticks"') + ROVER, ("ticks_per_turn",)),
    ],
)
def test_a_wrong_file_of_columns_names_the_key(
    command: Command, columns: str, words: tuple[str, ...]
) -> None:
    write(Path("drive.csv"), drive())
    assert import_it(command, columns, "drive.csv") == 2
    for word in words:
        assert word in command.error
    assert "Traceback" not in command.error


def test_the_files_of_columns_in_the_how_to_are_valid(tmp_path: Path) -> None:
    page = (Path(__file__).parents[2] / "docs" / "how-to" / "import_a_table.md").read_text("utf-8")
    blocks = re.findall(r"^```toml\n(.*?)^```", page, re.MULTILINE | re.DOTALL)
    assert len(blocks) == 3
    for block in blocks:
        (tmp_path / "columns.toml").write_text(block, "utf-8")
        read_columns(tmp_path / "columns.toml")


def test_the_sample_becomes_a_log_that_follows_its_truth(command: Command) -> None:
    assert command("sample", "table") == 0
    arguments = ("table.csv", "--columns", "columns.toml", "--out", "drive.mcap")
    assert command("import", "table", *arguments) == 0, command.error
    assert command("replay", "drive.mcap") == 0
    assert "every output identical" in command.out
