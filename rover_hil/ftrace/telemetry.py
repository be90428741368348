"""Telemetry beside the frames: a CSV file with one row per frame."""

import csv
import math
from dataclasses import dataclass
from pathlib import Path

from drivers.errors import ConfigError

NEEDED = ("frame", "t")
RATES = ("gyro_roll_dps", "gyro_pitch_dps", "gyro_yaw_dps")
SPEED = "wheel_speed_mps"


@dataclass(frozen=True, slots=True)
class TelemetryRow:
    """What was measured at a frame: time, wheel speed and turn rates in SI units; None if not told."""

    t_s: float
    wheel_speed_m_s: float | None
    rates_rad_s: tuple[float, float, float] | None


def read_telemetry(path: Path) -> dict[int, TelemetryRow]:
    """Return the rows by frame number.

    Columns: frame, t; optional wheel_speed_mps, gyro_roll_dps, gyro_pitch_dps, gyro_yaw_dps, which may also
    have empty cells. Others, like compass_deg, are not used.

    Raises:
        ConfigError: The file cannot be read, a column is missing, a cell is no number, time goes backwards.
    """
    try:
        with path.open(encoding="utf-8", newline="") as stream:
            reader = csv.DictReader(stream)
            names = [name.strip() for name in reader.fieldnames or []]
            for name in NEEDED:
                if name not in names:
                    msg = f"{path} line 1 names no column '{name}': its columns must be frame,t,{SPEED},..."
                    raise ConfigError(msg)
            reader.fieldnames = names
            return _rows(path, reader)
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        msg = f"cannot read telemetry {path}: {error}"
        raise ConfigError(msg) from error


def _rows(path: Path, reader: "csv.DictReader[str]") -> dict[int, TelemetryRow]:
    rows: dict[int, TelemetryRow] = {}
    before = -math.inf
    for cells in reader:
        place = f"{path} line {reader.line_num}"
        frame, t_s = _number(cells, "frame", place), _number(cells, "t", place)
        if frame is None or t_s is None or frame != int(frame):
            msg = f"{place}: frame must be a whole number and t a time in s"
            raise ConfigError(msg)
        if t_s <= before:
            msg = f"{place}: time {t_s:g} s is not after {before:g} s: rows must be in order of time"
            raise ConfigError(msg)
        before = t_s
        rates = [_number(cells, name, place) for name in RATES]
        x, y, z = (None if rate is None else math.radians(rate) for rate in rates)
        told = None if x is None or y is None or z is None else (x, y, z)
        rows[int(frame)] = TelemetryRow(t_s, _number(cells, SPEED, place), told)
    return rows


def _number(cells: dict[str, str], name: str, place: str) -> float | None:
    text = (cells.get(name) or "").strip()
    if not text:
        return None
    try:
        value = float(text)
    except ValueError as error:
        msg = f"{place}: {name} is '{text}', not a number"
        raise ConfigError(msg) from error
    return value if math.isfinite(value) else None
