"""`rover-hil import table` on logs of autopilots: ULog of PX4 and DataFlash of ArduPilot."""

import math
import re
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from pymap3d import enu2geodetic

from rover_hil.drives.drive import read_drive
from rover_hil.drives.files.array_table import read_table
from rover_hil.drives.files.csv_table import read_csv
from tests.rover_hil.command import Command, assert_one_sentence
from tests.rover_hil.flight_logs import Kind, Message, dataflash, ulog

RADIUS_M, TRACK_M = 0.1, 0.4
SPEED_M_S, TURN_RAD_S = 0.5, 0.2
END_S = 12.0
RIMS_M_S = (SPEED_M_S - 0.5 * TRACK_M * TURN_RAD_S, SPEED_M_S + 0.5 * TRACK_M * TURN_RAD_S)
ORIGIN_DEG = (48.1, 11.6)
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
PX4 = """[time]
column = "timestamp"
unit = "us"
[[wheel]]
position = { column = "wheel_encoders.wheel_angle[0]", unit = "rad" }
[[wheel]]
position = { column = "wheel_encoders.wheel_angle[1]", unit = "rad" }
[imu]
yaw_rate = { column = "sensor_gyro_1.z", sign = -1 }
heading = { column = "vehicle_local_position.heading", unit = "rad", sign = -1, zero = 1.5707963267948966 }
heading_reference = "true"
[fixes]
latitude = { column = "vehicle_gps_position.latitude_deg" }
longitude = { column = "vehicle_gps_position.longitude_deg" }
sigma = { column = "vehicle_gps_position.eph" }
"""
ARDUPILOT = """[time]
column = "TimeUS"
unit = "us"
[[wheel]]
position = { column = "WENC.Dist0", unit = "m" }
[[wheel]]
position = { column = "WENC.Dist1", unit = "m" }
[imu]
yaw_rate = { column = "IMU_1.GyrZ", sign = -1 }
heading = { column = "ATT.Yaw", unit = "deg", sign = -1, zero = 90 }
[fixes]
latitude = { column = "GPS.Lat" }
longitude = { column = "GPS.Lng" }
sigma_m = 0.05
"""
PX4_KINDS = (
    Kind(
        "wheel_encoders",
        (("uint64_t", "timestamp"), ("float[2]", "wheel_speed"), ("float[2]", "wheel_angle")),
    ),
    Kind("sensor_gyro", (("uint64_t", "timestamp"), ("float", "x"), ("float", "z"))),
    Kind("sensor_gyro", (("uint64_t", "timestamp"), ("float", "x"), ("float", "z")), instance=1),
    Kind("vehicle_local_position", (("uint64_t", "timestamp"), ("float", "heading"))),
    Kind(
        "vehicle_gps_position",
        (
            ("uint64_t", "timestamp"),
            ("double", "latitude_deg"),
            ("double", "longitude_deg"),
            ("float", "eph"),
        ),
    ),
)
ARDUPILOT_KINDS = (
    Kind("WENC", (("Q", "TimeUS"), ("f", "Dist0"), ("B", "Qual0"), ("f", "Dist1"), ("B", "Qual1"))),
    Kind("IMU", (("Q", "TimeUS"), ("B", "I"), ("f", "GyrX"), ("f", "GyrZ"))),
    Kind("ATT", (("Q", "TimeUS"), ("C", "Yaw"))),
    Kind("GPS", (("Q", "TimeUS"), ("B", "I"), ("L", "Lat"), ("L", "Lng"))),
)


def pose(t_s: float) -> tuple[float, float, float]:
    """Return the place, and the direction of the nose clockwise from north; it starts to the north."""
    turned, radius_m = TURN_RAD_S * t_s, SPEED_M_S / TURN_RAD_S
    north_m, west_m = radius_m * math.sin(turned), radius_m * (1.0 - math.cos(turned))
    latitude, longitude, _ = enu2geodetic(-west_m, north_m, 0.0, *ORIGIN_DEG, 0.0)
    return float(latitude), float(longitude), -turned % math.tau


def times() -> Iterator[tuple[int, float, int]]:
    """Yield the time in us and in s, and the number of the cycle."""
    for cycle in range(int(END_S * 100) + 1):
        yield 5_000_000 + cycle * 10_000, cycle / 100, cycle


def gyro_rad_s(cycle: int) -> float:
    """Return a reading that scatters without a mean."""
    return TURN_RAD_S + (0.001, -0.002, 0.001)[cycle % 3]


def px4_messages() -> Iterator[Message]:
    for t_us, t_s, cycle in times():
        latitude, longitude, clockwise_rad = pose(t_s)
        yield 1, (t_us, 0.0, 9.0)
        yield 2, (t_us + 500, 0.0, -gyro_rad_s(cycle))
        if cycle % 5 == 0:
            angles = [rim / RADIUS_M * t_s for rim in RIMS_M_S]
            yield 0, (t_us + 1000, 0.0, 0.0, *angles)
            yield 3, (t_us + 1500, math.remainder(clockwise_rad, math.tau))
        if cycle % 20 == 0:
            yield 4, (t_us + 2000, latitude, longitude, 0.05)


def ardupilot_messages() -> Iterator[Message]:
    for t_us, t_s, cycle in times():
        latitude, longitude, clockwise_rad = pose(t_s)
        yield 1, (t_us, 0, 0.0, 9.0)
        yield 1, (t_us + 500, 1, 0.0, -gyro_rad_s(cycle))
        if cycle % 5 == 0:
            left_m, right_m = (rim * t_s for rim in RIMS_M_S)
            yield 0, (t_us + 1000, left_m, 90, right_m, 91)
            yield 2, (t_us + 1500, 100.0 * math.degrees(clockwise_rad))
        if cycle % 20 == 0:
            yield 3, (t_us + 2000, 0, 1e7 * latitude, 1e7 * longitude)
            yield 3, (t_us + 2100, 1, 1e7 * ORIGIN_DEG[0], 1e7 * ORIGIN_DEG[1])


LOGS = {
    "drive.ulg": ("pyulog", PX4),
    "drive.bin": ("pymavlink", ARDUPILOT),
}


@pytest.fixture(params=LOGS)
def log(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    name: str = request.param
    pytest.importorskip(LOGS[name][0], reason=f"reading it needs {LOGS[name][0]}: rover-hil[flight]")
    raw = (
        ulog(PX4_KINDS, px4_messages(), dropout_after=400)
        if name == "drive.ulg"
        else dataflash(ARDUPILOT_KINDS, ardupilot_messages())
    )
    (tmp_path / name).write_bytes(raw)
    return tmp_path / name


def import_it(command: Command, log: Path, columns: str | None = None) -> int:
    Path("columns.toml").write_text((columns or LOGS[log.name][1]) + ROVER, "utf-8")
    return command("import", "table", str(log), "--columns", "columns.toml", "--out", "drive.mcap")


def test_a_drive_is_imported_and_replays(command: Command, log: Path) -> None:
    assert import_it(command, log) == 0, command.error
    assert "wheels: 241 rows" in command.out
    assert "fixes: 61 rows" in command.out
    assert not re.search(r"(?m)^(finding|doubt) ", command.out)
    assert ("dropouts of the logger" in command.out) == (log.suffix == ".ulg")
    rows = read_drive(Path("drive.mcap")).channels
    for wheel, rim_m_s in enumerate(RIMS_M_S, start=1):
        angles = rows[f"position{wheel}_rad"].value
        assert angles[-1] - angles[0] == pytest.approx(rim_m_s / RADIUS_M * END_S, rel=1e-6)
    assert rows["gyro_z_rad_s"].value.mean() == pytest.approx(TURN_RAD_S, rel=1e-5)
    assert len(rows["gyro_z_rad_s"]) == 1201
    headings = np.unwrap(rows["heading_rad"].value)
    assert headings[0] == pytest.approx(math.pi / 2, abs=1e-3)
    assert headings[-1] - headings[0] == pytest.approx(TURN_RAD_S * END_S, abs=2e-3)
    assert command("replay", "drive.mcap") == 0
    assert "every output identical" in command.out
    assert command("export", "drive.mcap", "--csv") == 0
    fixes = read_csv(Path("drive_csv/pose_fixes.csv"))
    x_m, y_m = (fixes.numbers(name) for name in ("x_m", "y_m"))
    radius_m, turned = SPEED_M_S / TURN_RAD_S, TURN_RAD_S * END_S
    assert (x_m[-1], y_m[-1]) == pytest.approx(
        (-radius_m * (1.0 - math.cos(turned)), radius_m * math.sin(turned)), abs=0.02
    )
    estimate = read_csv(Path("drive_csv/estimate.csv"))
    end_x_m, end_y_m = (estimate.numbers(f"estimate_{key}_m")[-1] for key in "xy")
    assert math.hypot(end_x_m, end_y_m) == pytest.approx(math.hypot(x_m[-1], y_m[-1]), abs=0.15)


def test_only_the_columns_asked_for_are_read(log: Path) -> None:
    table = read_table(log, delimiter=None, header_lines=None)
    time = "timestamp" if log.suffix == ".ulg" else "TimeUS"
    assert table.names[0] == time
    name = "sensor_gyro.z" if log.suffix == ".ulg" else "IMU.GyrZ"
    other = "sensor_gyro_1.z" if log.suffix == ".ulg" else "IMU_1.GyrZ"
    assert {name, other} <= set(table.names)
    assert (np.diff(table.numbers(time)) >= 0.0).all()
    values = table.numbers(name)
    assert np.isfinite(values).sum() == 1201
    assert np.nanmax(values) == 9.0
    few = read_table(log, delimiter=None, header_lines=None, wanted=(time, other))
    assert len(few.numbers(time)) == 1201
    assert {each.partition(".")[0] for each in few.names[1:]} == {other.partition(".")[0]}


def test_a_missing_column_is_one_sentence(command: Command, log: Path) -> None:
    columns = LOGS[log.name][1].replace("wheel_angle[1]", "wheel_angle[7]").replace("Dist1", "Dist7")
    assert import_it(command, log, columns) == 2
    assert_one_sentence(command.error, log.name, "7", "columns")
    assert not Path("drive.mcap").exists()


@pytest.mark.parametrize("seed", range(6))
def test_damaged_logs_end_with_a_sentence_or_are_told(command: Command, log: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    raw = bytearray(log.read_bytes())
    if seed < 2:
        raw = raw[: int((0.0, 0.5)[seed] * len(raw))]
    for place in rng.integers(0, len(raw), 20) if seed >= 2 else ():
        raw[place] = rng.integers(0, 256)
    log.write_bytes(bytes(raw))
    code = import_it(command, log)
    assert code in (0, 2)
    if code == 2:
        assert_one_sentence(command.error, log.name)
    assert Path("drive.mcap").exists() == (code == 0)


def test_without_the_library_the_extra_is_named(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, (library, columns) in LOGS.items():
        for module in (library, f"{library}.DFReader"):
            monkeypatch.setitem(sys.modules, module, None)
        (tmp_path / name).write_bytes(b"ULog\x01\x12\x35" if name == "drive.ulg" else b"\xa3\x95")
        assert import_it(command, tmp_path / name, columns) == 2
        assert_one_sentence(command.error, library, "rover-hil[flight]")


def test_nothing_is_guessed_of_a_flight_log(command: Command, log: Path) -> None:
    """Its columns have fixed names and units; a guess took its microseconds for milliseconds."""
    assert command("import", "table", str(log), "--propose", "proposed.toml") == 2
    assert_one_sentence(command.error, log.name, "fixed names", "import_a_table.md")
    assert not Path("proposed.toml").exists()
