"""`rover-hil import table` on the forms in which people have their tables, and on what is no table."""

import math
from collections.abc import Callable
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat
from scipy.io.matlab._mio5_params import OPAQUE_DTYPE, MatlabOpaque

from rover_hil.drives.drive import read_drive
from rover_hil.drives.files.csv_table import read_csv
from tests.rover_hil.command import Command, assert_one_sentence
from tests.rover_hil.test_field_bags import end_of
from tests.rover_hil.test_import_table import (
    LEFT_RAD_S,
    RADIANS,
    RIGHT_RAD_S,
    ROVER,
    ROWS,
    SPEED_M_S,
    T_S,
    TIME,
    TURN_RAD_S,
    X_M,
    Y_M,
    YAW_RAD,
    assert_circle,
    import_it,
    write,
)

BEGIN = datetime(2024, 5, 1, 23, 59, 58)  # noqa: DTZ001 - a clock without a zone


def comma(number: float) -> str:
    return f"{number:.9f}".replace(".", ",")


def rows(
    delimiter: str, time: Callable[[float], str] = "{:.9f}".format, number: Callable[[float], str] = repr
) -> str:
    cells = zip(T_S.tolist(), (LEFT_RAD_S * T_S).tolist(), (RIGHT_RAD_S * T_S).tolist(), strict=True)
    return "".join(
        delimiter.join((time(t_s), number(left), number(right))) + "\n" for t_s, left, right in cells
    )


def date(text: str) -> Callable[[float], str]:
    return lambda t_s: (BEGIN + timedelta(seconds=t_s)).strftime(text)


def quoted(text: str) -> str:
    """Return the rows with decimal commas in quotes."""
    lines = [line.replace(",", '";"').replace(".", ",").replace(";", ",") for line in text.splitlines()]
    return "".join(f'"{line}"\n' for line in lines)


TABLES = {
    "quoted decimal commas": "t,l,r\n" + quoted(rows(",")),
    "a row of units": "t;l;r\ns;rad;rad\n" + rows(";"),
    "units in brackets": "t\tl\tr\n[s]\t[rad]\t[rad]\n" + rows("\t"),
    "units above the names": "time;left;right\ns;rad;rad\nt;l;r\n" + rows(";"),
    "lines above the names": "Logger, 2.1\nRate;50\n\nWeather: rain, wind\nt;l;r\n" + rows(";"),
    "comments above the names": "# a\n# 50 Hz, 3 wheels\n# b\n# c\n# d\nt,l,r\n" + rows(","),
    "columns of spaces": "t  l  r\n" + rows("   ", number="{:.6e} ".format),
    "ISO dates": "t,l,r\n" + rows(",", date("%Y-%m-%dT%H:%M:%S.%f+02:00")),
    "ISO dates with spaces": "t,l,r\n" + rows(",", date("%Y-%m-%d %H:%M:%S.%f")),
    "dates with points": "t;l;r\n" + rows(";", date("%d.%m.%Y %H:%M:%S,%f"), comma),
    "times of day over midnight": "t,l,r\n" + rows(",", date("%H:%M:%S.%f")),
    "times of day in halves": "t,l,r\n" + rows(",", date("%I:%M:%S.%f %p")),
}


@pytest.mark.parametrize("name", TABLES)
def test_a_table_is_read_as_it_is(command: Command, name: str) -> None:
    Path("drive.csv").write_text(TABLES[name], "utf-8")
    assert import_it(command, TIME + RADIANS + ROVER, "drive.csv") == 0, command.error
    assert f"wheels: {ROWS} rows" in command.out
    assert f"{T_S[-1]:.1f} s: drive.mcap" in command.out
    assert_circle(command, 1e-5)


def test_the_letters_of_a_table_may_be_those_of_windows(command: Command) -> None:
    text = "t;l [°];r [°]\n" + rows(";", number=lambda each: repr(math.degrees(each)))
    for encoding in ("cp1252", "utf-16"):
        Path("drive.csv").write_bytes(text.encode(encoding))
        columns = TIME + RADIANS.replace('"rad"', '"deg"') + ROVER
        assert import_it(command, columns, "drive.csv") == 0, command.error
        assert_circle(command)
        Path("drive.mcap").unlink()


def test_all_columns_have_decimal_commas_where_one_has_and_no_number_a_point(tmp_path: Path) -> None:
    table = tmp_path / "drive.csv"
    table.write_text("a;b\n0,100;1,234\n0,200;2,345\n", "utf-8")
    assert read_csv(table, delimiter=None).numbers("b").tolist() == [1.234, 2.345]
    table.write_text("a;b;c\n0,100;1,234;0.5\n0,200;2,345;0.6\n", "utf-8")
    with pytest.raises(Exception, match="write decimals with a point"):
        read_csv(table, delimiter=None).numbers("b")


def test_a_given_number_of_lines_is_the_header(command: Command) -> None:
    head = "".join(f"{number};{number};{number}\n" for number in range(7))
    Path("drive.csv").write_text(head + "t;l;r\n" + rows(";"), "utf-8")
    assert import_it(command, "header_lines = 8\n" + TIME + RADIANS + ROVER, "drive.csv") == 0, command.error
    assert_circle(command)


@pytest.mark.parametrize("unit", ["min", "days"])
def test_minutes_and_days_are_units_of_the_time(command: Command, unit: str) -> None:
    size = {"min": 60.0, "days": 86400.0}[unit]
    Path("drive.csv").write_text("t,l,r\n" + rows(",", lambda t_s: f"{45000.0 + t_s / size:.12f}"), "utf-8")
    columns = f'[time]\ncolumn = "t"\nunit = "{unit}"\n' + RADIANS + ROVER
    assert import_it(command, columns, "drive.csv") == 0, command.error
    assert f"{T_S[-1]:.1f} s: drive.mcap" in command.out


CAR = """[[wheel]]
steering = { column = "s", unit = "deg", %s }
[[wheel]]
position = { column = "l", unit = "rad" }
[rover]
kinematics = "wheels"
wheels = [
  { x_m = 1.0, y_m = 0.0, radius_m = 0.05, measured = false, steering = { low_deg = -60, high_deg = 60 } },
  { x_m = 0.0, y_m = 0.0, radius_m = 0.05 },
]
[limits]
wheel_speed_rad_s = 30
wheel_acceleration_rad_s2 = 100
"""


@pytest.mark.parametrize(
    ("keys", "ratio", "zero", "wrap"),
    [
        ("ratio = 16, zero = 2", 16.0, 2.0, math.inf),
        ("wrap = 360, zero = 350", 1.0, 350.0, 360.0),
        ("sign = -1, ratio = 15, zero = 100, wrap = 360", -15.0, 100.0, 360.0),
    ],
)
def test_steering_has_ratio_zero_and_wrap(
    command: Command, keys: str, ratio: float, zero: float, wrap: float
) -> None:
    true_deg = np.degrees(0.5 * np.sin(T_S))
    column = zero + ratio * true_deg
    if math.isfinite(wrap):
        column %= wrap
    write(Path("drive.csv"), {"t": T_S, "l": 8.0 * T_S, "s": column})
    assert import_it(command, TIME + CAR % keys, "drive.csv") == 0, command.error
    steering = read_drive(Path("drive.mcap")).channels["steer1_rad"]
    assert np.degrees(steering.value) == pytest.approx(true_deg, abs=1e-6)


def test_speed_and_yaw_rate_of_the_body_are_the_motion(command: Command) -> None:
    speed = np.full(ROWS, 3.6 * SPEED_M_S)
    rate = np.full(ROWS, math.degrees(TURN_RAD_S))
    speed[1::2] = np.nan  # the radar is slower than the rows
    write(Path("drive.csv"), {"t": T_S, "v": speed, "w": rate})
    columns = '[body]\nspeed = { column = "v", unit = "km/h" }\nyaw_rate = { column = "w", unit = "deg/s" }\n'
    assert import_it(command, TIME + columns + ROVER, "drive.csv") == 0, command.error
    assert "identify neither slip nor motors" in command.out
    end = end_of(Path("drive.mcap"))
    assert (end.x_m, end.y_m, end.yaw_rad) == pytest.approx((X_M[-1], Y_M[-1], YAW_RAD[-1]), abs=2e-3)


def test_one_axis_of_acceleration_is_enough(command: Command) -> None:
    shaking = 0.05 * np.random.default_rng(3).standard_normal(ROWS)
    write(Path("drive.csv"), {"t": T_S, "l": LEFT_RAD_S * T_S, "r": RIGHT_RAD_S * T_S, "a": shaking})
    imu = '[imu]\nacceleration_x = { column = "a", unit = "g" }\n'
    assert import_it(command, TIME + RADIANS + imu + ROVER, "drive.csv") == 0, command.error
    assert f"imu: {ROWS} rows" in command.out
    assert_circle(command)


def test_rows_of_acceleration_alone_are_used(command: Command) -> None:
    columns = {"t": T_S, "l": LEFT_RAD_S * T_S, "r": RIGHT_RAD_S * T_S}
    noise = 0.01 * np.random.default_rng(3).standard_normal((2, ROWS))
    rate, acceleration = TURN_RAD_S + noise[0], noise[1]
    rate[::2], acceleration[1::2] = np.nan, np.nan
    write(Path("drive.csv"), columns | {"w": rate, "a": acceleration})
    imu = '[imu]\nyaw_rate = { column = "w" }\nacceleration_y = { column = "a" }\n'
    assert import_it(command, TIME + RADIANS + imu + ROVER, "drive.csv") == 0, command.error
    assert f"imu: {ROWS} rows" in command.out
    assert "no usable numbers" not in command.out


MATRICES = {
    "enc": np.column_stack((T_S, LEFT_RAD_S * T_S, RIGHT_RAD_S * T_S)),
    "gt": np.vstack((T_S[::5], X_M[::5], Y_M[::5], YAW_RAD[::5])),
    "gyro": np.column_stack((T_S[::2], TURN_RAD_S + 0.01 * np.sin(np.arange(0, ROWS, 2) ** 2))),
    "parameters": np.array([0.05, 0.3, 4096.0]),
}
OF_MATRICES = """[time]
column = "enc.1"
[[wheel]]
position = { column = "enc.2", unit = "rad" }
[[wheel]]
position = { column = "enc.3", unit = "rad" }
[imu]
file = "%s"
time = { column = "gyro.1" }
yaw_rate = { column = "gyro.2" }
[truth]
file = "%s"
time = { column = "gt.1" }
x = { column = "gt.2" }
y = { column = "gt.3" }
yaw = { column = "gt.4" }
"""


@pytest.mark.parametrize("suffix", ["mat", "npz"])
def test_matrices_of_different_lengths_are_in_one_file(command: Command, suffix: str) -> None:
    if suffix == "mat":
        savemat("drive.mat", MATRICES | {"note": "third run"})
    else:
        np.savez("drive.npz", **MATRICES)  # type: ignore[arg-type]
    name = f"drive.{suffix}"
    assert import_it(command, OF_MATRICES % (name, name) + ROVER, name) == 0, command.error
    assert f"wheels: {ROWS} rows" in command.out
    assert f"truth: {len(T_S[::5])} rows" in command.out
    assert f"imu: {len(T_S[::2])} rows" in command.out
    assert_circle(command)


def test_rows_of_a_sensor_outside_of_the_drive_are_counted_or_refused(command: Command) -> None:
    text = OF_MATRICES.split("[truth]")[0] % "drive.npz"
    for shift_s, code, words in (
        (-1.0, 0, "rows of [imu] before the first or behind the last row"),
        (99.0, 2, "no row of [imu] lies between the first and the last row"),
    ):
        gyro = MATRICES["gyro"] + (shift_s, 0.0)
        np.savez("drive.npz", **MATRICES | {"gyro": gyro})  # type: ignore[arg-type]
        log = f"{code}.mcap"
        assert import_it(command, text + ROVER, "drive.npz", out=log) == code, command.error
        assert words in command.out + command.error


def test_structures_of_matlab_have_columns(command: Command) -> None:
    log = {"t": T_S, "wheels": {"l": LEFT_RAD_S * T_S, "r": RIGHT_RAD_S * T_S}, "note": "x"}
    savemat("drive.mat", {"log": log, "other": {"t": T_S[::2]}})
    columns = TIME.replace('"t"', '"log.t"')
    columns += RADIANS.replace('"l"', '"log.wheels.l"').replace('"r"', '"log.wheels.r"')
    assert import_it(command, columns + ROVER, "drive.mat") == 0, command.error
    assert_circle(command)


def test_a_column_of_another_matrix_is_refused_with_what_helps(command: Command) -> None:
    savemat("drive.mat", MATRICES)
    columns = TIME.replace('"t"', '"enc.1"')
    columns += RADIANS.replace('"l"', '"enc.2"').replace('"r"', '"gyro.2"')
    assert import_it(command, columns + ROVER, "drive.mat") == 2
    assert_one_sentence(
        command.error, "column 'gyro.2' has 51 rows, the time 101", "name columns of one matrix"
    )


def test_a_wrong_cell_in_the_first_row_is_named(command: Command) -> None:
    Path("drive.csv").write_text("t,l,r\n0.0,bad,worse\n" + rows(","), "utf-8")
    assert import_it(command, TIME + RADIANS + ROVER, "drive.csv") == 2
    assert "names no column 't'" in command.error
    Path("drive.csv").write_text("t,l,r\n0.0,bad,0.0\n" + rows(","), "utf-8")
    assert import_it(command, TIME + RADIANS + ROVER, "drive.csv") == 2
    assert_one_sentence(command.error, "line 2, column 'l': 'bad' is not a number")
    Path("pair.csv").write_text("rate,50\nt,l\n0.0,bad\n0.1,1.0\n0.2,2.0\n0.3,3.0\n", "utf-8")
    table = read_csv(Path("pair.csv"), delimiter=None, header_lines=None)
    assert (list(table.names), table.lines[0]) == (["t", "l"], 3)


def test_tables_of_matlab_are_named(command: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    opaque = MatlabOpaque(np.zeros((1,), OPAQUE_DTYPE))
    monkeypatch.setattr("scipy.io.loadmat", lambda _: {"T": opaque, "t": T_S})
    Path("drive.mat").write_bytes(bytes(200))
    assert import_it(command, TIME + RADIANS + ROVER, "drive.mat") == 2
    assert_one_sentence(
        command.error, "names no column 'l'", "T is a table or an object of MATLAB", "table2struct"
    )


def save_mat(path: Path) -> None:
    savemat(path, {"t": T_S})


def cut(write: Callable[[Path], object]) -> Callable[[Path], None]:
    def write_cut(path: Path) -> None:
        write(path)
        path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])

    return write_cut


NO_TABLES: dict[str, tuple[Callable[[Path], object], str]] = {
    "cut.mat": (cut(save_mat), "save it again in MATLAB with save(..., '-v7')"),
    "new.mat": (lambda path: path.write_bytes(b"MATLAB 7.3 MAT-file".ljust(1000)), "it is of version 7.3"),
    "cut.npy": (cut(lambda path: np.save(path, T_S)), "write it again with numpy.save"),
    "text.npz": (lambda path: path.write_text("none", "utf-8"), "write it again with numpy.savez"),
    "text.parquet": (lambda path: path.write_text("none" * 9, "utf-8"), "write it again"),
    "cut.ulg": (
        lambda path: path.write_bytes(b"ULog\x01\x12\x35" + bytes(20)),
        "holds no message with a time: is it such a log?",
    ),
    "book.xlsx": (lambda path: path.write_bytes(b"PK\x03\x04" + bytes(99)), "save the sheet as CSV"),
    "binary.csv": (lambda path: path.write_bytes(bytes(range(256))), "export it as CSV"),
    "dates.csv": (
        lambda path: path.write_text("t,l,r\n5/1/2024 12:00:00,0,0\n5/1/2024 12:00:01,0,0\n", "utf-8"),
        "write dates as 2024-05-31T12:34:56.789",
    ),
}
OF_LIBRARIES = (
    "codec",
    "expected",
    "magic",
    "HDF",
    "h5py",
    "unpack",
    "EOF",
    "zip",
    "buffer",
    "Parquet magic",
)


@pytest.mark.parametrize("name", NO_TABLES)
def test_what_is_no_table_is_refused_with_what_helps(command: Command, name: str) -> None:
    make, words = NO_TABLES[name]
    make(Path(name))
    assert import_it(command, TIME + RADIANS + ROVER, name) == 2
    assert_one_sentence(command.error, name, words)
    assert not any(word in command.error for word in OF_LIBRARIES)
    assert not Path("drive.mcap").exists()
