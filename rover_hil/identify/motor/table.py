"""Read the motor columns of the measured Robotino runs (`;`-separated, three header lines).

Source: BrOleg5/research-wheel-slippage, `datasets/motor_identification` and the runs on one and two
surfaces. An optional column `m1volt` in V for each motor is the terminal voltage.
"""

import gzip
import math
import zlib
from pathlib import Path

import numpy as np

from drivers.errors import LogError
from drivers.robotino_board.codec import MAX_RAW, STEP_TICKS_PER_S
from rover_hil.identify.motor.record import Array, MotorRecord, Scale, Series, check_times

HEADER_LINES = 3
MOTORS = (1, 2, 3)
TICK_RAD = math.tau / 2000
SPEED_STEP_RAD_S = STEP_TICKS_PER_S * TICK_RAD
CURRENT_STEP_A = 4.0 / 156.0
"""The EA05 board sends the upper 8 of 10 bits."""
UNITS = {"setvel": "rad/s", "pos": "ticks", "vel": "rad/s", "cur": "A", "volt": "V"}
SCALE = Scale(
    position_rad=TICK_RAD,
    speed_rad_s=SPEED_STEP_RAD_S,
    current_a=CURRENT_STEP_A,
    current_is_cut=True,
    current_limit_a=(MAX_RAW & ~3) / 156.0,
)


def read_table(path: Path) -> list[MotorRecord]:
    """Return what a file tells about its three motors.

    Raises:
        LogError: The file cannot be read or holds something wrong.
    """
    lines = _read_lines(path)
    if len(lines) < HEADER_LINES + 3:
        msg = f"{path} has {len(lines)} lines, no three header lines and data below: give a Robotino run"
        raise LogError(msg)
    units, names = (lines[index].rstrip(";").split(";") for index in (1, 2))
    table = _numbers(path, lines, len(names))
    columns = dict(zip(names, table.T, strict=True))
    _check_columns(path, names, units)
    t_s = columns["t"] / 1000.0
    check_times(t_s, str(path))
    return [_record(path, motor, t_s, columns) for motor in MOTORS]


def cut_set_point(speed_rad_s: Array, step_rad_s: float) -> Array:
    """Return set-points as the board obeys them: whole steps, towards zero."""
    return np.asarray(np.trunc(speed_rad_s / step_rad_s + np.sign(speed_rad_s) * 1e-6) * step_rad_s)


def _record(path: Path, motor: int, t_s: Array, columns: dict[str, Array]) -> MotorRecord:
    volt = columns.get(f"m{motor}volt")
    return MotorRecord(
        log=path.name,
        motor=motor,
        is_robotino=True,
        set_point=Series(t_s, cut_set_point(columns[f"m{motor}setvel"], SPEED_STEP_RAD_S)),
        position=Series(t_s, columns[f"m{motor}pos"] * TICK_RAD),
        speed=Series(t_s, columns[f"m{motor}vel"]),
        current=Series(t_s, columns[f"m{motor}cur"]),
        current_is_signed=False,
        voltage=None if volt is None else Series(t_s, volt),
        scale=SCALE,
    )


def _check_columns(path: Path, names: list[str], units: list[str]) -> None:
    wanted = {"t": "ms"}
    for motor in MOTORS:
        wanted |= {f"m{motor}{name}": unit for name, unit in UNITS.items() if name != "volt"}
    wanted |= {f"m{motor}volt": "V" for motor in MOTORS if f"m{motor}volt" in names}
    for name, unit in wanted.items():
        if name not in names:
            msg = f"{path} line 3 names no column '{name}': give a run with all three motors and currents"
            raise LogError(msg)
        if units[names.index(name) : names.index(name) + 1] != [unit]:
            msg = f"{path} line 2, column '{name}': the unit is not {unit}: convert the column"
            raise LogError(msg)


def _numbers(path: Path, lines: list[str], width: int) -> Array:
    rows = []
    for number, line in enumerate(lines[HEADER_LINES:], start=HEADER_LINES + 1):
        cells = line.rstrip(";").split(";")
        try:
            row = [float(cell) for cell in cells]
        except ValueError:
            row = [math.nan]
        if len(row) != width or not all(map(math.isfinite, row)):
            msg = f"{path} line {number} does not hold {width} numbers: take it out or fetch the file again"
            raise LogError(msg)
        rows.append(row)
    return np.array(rows)


def _read_lines(path: Path) -> list[str]:
    try:
        raw = path.read_bytes()
        return (gzip.decompress(raw) if path.suffix == ".gz" else raw).decode().splitlines()
    except (OSError, EOFError, zlib.error, UnicodeDecodeError) as error:
        msg = f"cannot read {path}: {error}: give a .csv or .csv.gz file"
        raise LogError(msg) from error
