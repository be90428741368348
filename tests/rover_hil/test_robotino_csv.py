import gzip
import math
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from drivers.driver import Rejection
from drivers.errors import ConfigError, LogError
from drivers.link import Received
from drivers.robotino_board.codec import RobotinoBoardCodec, parse_reply
from drivers.robotino_board.scales import scales
from drivers.robotino_board.settings import RobotinoBoardSettings
from drivers.samples import BumperSample, WheelSample
from rover_hil.drives.formats.robotino_csv import START_NS, BoardRow, read_run

BOARD = RobotinoBoardSettings(type="robotino_board", port="p")
SCALES = scales(BOARD)
SURFACES = ("table_surface", "brown_surface", "gray_surface", "green_surface")

NAMES = (
    "t;xsetspeed;m1setvel;m2setvel;m3setvel;m1pos;m2pos;m3pos;"
    "m1vel;m2vel;m3vel;m1cur;m2cur;m3cur;xpos;ypos;ang;"
)
UNITS = "ms;m/s;rad/s;rad/s;rad/s;ticks;ticks;ticks;rad/s;rad/s;rad/s;A;A;A;pix;pix;deg;"
ROWS = (
    "0.0098;0.1;-34.641;0;34.641;0;0;0;0;0;0;0;0;0;500.5;800.25;359;",
    "31.5;0.1;-34.641;0;34.641;-131;1;125;-16.9646;0;25.4469;1.12821;0.025641;0.230769;500.5;800.25;359;",
    "62.7;0.1;-34.641;0;34.641;-397;1;465;-28.2743;0;33.9292;0.282051;0;0.564103;501;798;2;",
)


def write_run(path: Path, *, names: str = NAMES, units: str = UNITS, rows: tuple[str, ...] = ROWS) -> Path:
    path.write_text("\n".join(("long names;", units, names, *rows, "")), encoding="utf-8")
    return path


def with_cell(row: int, column: str, cell: str) -> tuple[str, ...]:
    cells = ROWS[row].split(";")
    cells[NAMES.split(";").index(column)] = cell
    return (*ROWS[:row], ";".join(cells), *ROWS[row + 1 :])


def decoded_wheels(run: list[BoardRow]) -> list[WheelSample]:
    codec = RobotinoBoardCodec("board", BOARD)
    samples = [sample for row in run for sample in codec.decode(Received(row.t_ns, row.reply_frame))]
    assert not [sample for sample in samples if isinstance(sample, Rejection)]
    assert {type(sample) for sample in samples} == {WheelSample, BumperSample}
    return [sample for sample in samples if isinstance(sample, WheelSample)]


def read_columns(path: Path) -> dict[str, np.ndarray]:
    """Read a run in the shortest way, to compare with."""
    lines = gzip.decompress(path.read_bytes()).decode().splitlines()
    table = np.array([line.rstrip(";").split(";") for line in lines[3:]], dtype=float)
    return dict(zip(lines[2].rstrip(";").split(";"), table.T, strict=True))


def test_rows_carry_what_the_file_says(tmp_path: Path) -> None:
    run = read_run(write_run(tmp_path / "run.csv"), 2.0)
    first, second, third = run
    assert [row.t_ns for row in run] == [START_NS + 9_800, START_NS + 31_500_000, START_NS + 62_700_000]
    assert second.set_speed_rad_s == pytest.approx((-34.641 / 16, 0.0, 34.641 / 16))
    reply = parse_reply(second.reply_frame)
    assert reply.ticks == (-131, 1, 125)
    assert reply.speed_steps == (-6, 0, 9)
    assert reply.current_raw == (176, 4, 36)
    assert reply.time_ms == 32
    assert [row.truth["is_new"] for row in run] == [True, False, True]
    assert (first.truth["x_m"], first.truth["y_m"]) == pytest.approx((1.001, -1.6005))
    assert (third.truth["x_m"], third.truth["y_m"]) == pytest.approx((1.002, -1.596))
    assert first.truth["yaw_rad"] == pytest.approx(math.radians(359 + 90))
    assert third.truth["yaw_rad"] == pytest.approx(math.radians(362 + 90))


def test_packed_file_gives_the_same_rows(tmp_path: Path) -> None:
    plain = write_run(tmp_path / "run.csv")
    packed = tmp_path / "run.csv.gz"
    packed.write_bytes(gzip.compress(plain.read_bytes()))
    assert read_run(packed, 2.0) == read_run(plain, 2.0)


@pytest.mark.parametrize(
    ("row", "column", "cell", "complaint"),
    [
        (1, "m2cur", "-0.0256", "line 5, column 'm2cur': -0.0256 A is not within 0 to 6.5"),
        (1, "m2cur", "7", "line 5, column 'm2cur': 7 A is not within"),
        (2, "m3cur", "nan", "line 6, column 'm3cur': 'nan' is not a number"),
        (0, "xpos", "", "line 4, column 'xpos': '' is not a number"),
        (0, "m1setvel", "1,5", "line 4, column 'm1setvel': '1,5' is not a number"),
        (2, "ang", "inf", "line 6, column 'ang': 'inf' is not a number"),
        (2, "t", "31.5", "line 6, column 't': 31.5 ms is negative or not after the line before"),
        (0, "t", "-1", "line 4, column 't': -1 ms is negative"),
        (1, "m1pos", "3.5", "line 5, column 'm1pos': 3.5 ticks is not a whole number"),
        (1, "m1pos", "3000000000", "line 5, column 'm1pos': 3e[+]09 ticks is not within"),
        (1, "m1vel", "-730", "line 5, column 'm1vel': -730 rad/s is not within -720.9"),
    ],
)
def test_wrong_cell_is_named(tmp_path: Path, row: int, column: str, cell: str, complaint: str) -> None:
    path = write_run(tmp_path / "run.csv", rows=with_cell(row, column, cell))
    with pytest.raises(LogError, match=f"run.csv {complaint}.*fetch the file again"):
        read_run(path, 2.0)


@pytest.mark.parametrize(
    ("names", "units", "rows", "complaint"),
    [
        (NAMES.replace("m2cur", "i2"), UNITS, ROWS, "line 3 names no column 'm2cur'"),
        (NAMES, UNITS.replace("pix", "mm"), ROWS, "line 2, column 'xpos': the unit is not pix"),
        (NAMES, UNITS, (ROWS[0], ROWS[1][:30]), "line 5 has 6 cells, its header 17"),
        (NAMES, UNITS, (), "holds no lines below its header"),
    ],
)
def test_wrong_table_is_named(
    tmp_path: Path, names: str, units: str, rows: tuple[str, ...], complaint: str
) -> None:
    path = write_run(tmp_path / "run.csv", names=names, units=units, rows=rows)
    with pytest.raises(LogError, match=complaint):
        read_run(path, 2.0)


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("run.csv.gz", b"not packed"),
        ("run.csv.gz", gzip.compress(b"t;" * 1000, mtime=0)[:-20]),
        ("run.csv", b"\xff\xfe\x00"),
        ("run.csv", b"one line"),
    ],
    ids=["not packed", "cut off", "no text", "one line"],
)
def test_unreadable_file_is_named(tmp_path: Path, name: str, content: bytes) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(LogError, match=name):
        read_run(path, 2.0)
    with pytest.raises(LogError, match=r"cannot read .*missing"):
        read_run(tmp_path / "missing.csv", 2.0)


@pytest.mark.parametrize("scale", [0.0, -1.8, math.nan, math.inf])
def test_scale_must_be_a_positive_number(tmp_path: Path, scale: float) -> None:
    with pytest.raises(ConfigError, match="millimetres per pixel"):
        read_run(write_run(tmp_path / "run.csv"), scale)


@pytest.mark.parametrize("surface", SURFACES)
def test_measured_runs_survive_the_wire(shared_data: Path, surface: str) -> None:
    folder = shared_data / "robotino_2023" / "one_surface_type" / surface
    for path in sorted(folder.glob("*.csv.gz"))[::12]:
        columns = read_columns(path)
        wheels = decoded_wheels(read_run(path, 1.84))
        assert len(wheels) == 3 * len(columns["t"])
        for motor in range(3):
            samples = wheels[motor::3]
            angles = np.array([sample.position_rad for sample in samples], dtype=float)
            speeds = np.array([sample.speed_rad_s for sample in samples], dtype=float)
            currents = np.array([sample.current_a for sample in samples], dtype=float)
            ticks = columns[f"m{motor + 1}pos"]
            assert np.array_equal(np.round(angles / SCALES.position_rad), ticks)
            assert speeds * BOARD.gear_ratio == pytest.approx(columns[f"m{motor + 1}vel"], abs=1e-3)
            assert currents == pytest.approx(columns[f"m{motor + 1}cur"], abs=1e-5)


def encoder_path(run: list[BoardRow]) -> complex:
    """Add up the encoders' steps in the camera's frame, x + iy in metres, on true headings."""
    angles = np.array([sample.position_rad for sample in decoded_wheels(run)], dtype=float).reshape(-1, 3)
    v1, v2, v3 = 0.040 * np.diff(angles, axis=0).T
    yaws = np.array([(old.truth["yaw_rad"] + new.truth["yaw_rad"]) / 2 for old, new in pairwise(run)])
    steps = (v3 - v1) / math.sqrt(3) + 1j * (v1 + v3 - 2 * v2) / 3
    return complex(np.sum(steps * np.exp(1j * yaws)))


@pytest.mark.parametrize(("surface", "tolerance_deg"), [("brown_surface", 4.0), ("table_surface", 9.0)])
def test_camera_frame_agrees_with_the_encoders(shared_data: Path, surface: str, tolerance_deg: float) -> None:
    folder = shared_data / "robotino_2023" / "one_surface_type" / surface
    for path in sorted(folder.glob("*.csv.gz"))[::4]:
        run = read_run(path, 1.84)
        start, end = run[0], run[-1]
        seen = complex(end.truth["x_m"] - start.truth["x_m"], end.truth["y_m"] - start.truth["y_m"])
        ratio = seen / encoder_path(run)
        assert 0.7 < abs(ratio) < 1.0
        assert abs(math.degrees(np.angle(ratio))) < tolerance_deg


def test_camera_yaw_turns_with_the_encoders(shared_data: Path) -> None:
    folder = shared_data / "robotino_2023" / "one_surface_type" / "brown_surface"
    by_encoders, by_camera = [], []
    for path in sorted(folder.glob("*.csv.gz")):
        run = read_run(path, 1.84)
        wheels = decoded_wheels(run)
        turned = [(last.position_rad or 0.0) for last in wheels[-3:]]
        by_encoders.append(0.040 * sum(turned) / 3 / 0.125)
        by_camera.append(run[-1].truth["yaw_rad"] - run[0].truth["yaw_rad"])
    slope, _ = np.polyfit(by_encoders, by_camera, 1)
    assert slope == pytest.approx(1.01, abs=0.03)
