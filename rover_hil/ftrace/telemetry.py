"""Telemetry of the frames: a CSV file with one row per frame."""

import math
from dataclasses import dataclass
from pathlib import Path

from drivers.errors import ConfigError
from rover_hil.drives.files.csv_table import read_csv

NEEDED = ("frame", "t")
RATES = ("gyro_roll_dps", "gyro_pitch_dps", "gyro_yaw_dps")
SPEED = "wheel_speed_mps"


@dataclass(frozen=True, slots=True)
class TelemetryRow:
    """What was measured at a frame: time, wheel speed and turn rates in SI units; None where not measured."""

    t_s: float
    wheel_speed_m_s: float | None
    rates_rad_s: tuple[float, float, float] | None


def read_telemetry(path: Path) -> dict[int, TelemetryRow]:
    """Return the rows by frame number.

    Columns: frame, t; optional wheel_speed_mps, gyro_roll_dps, gyro_pitch_dps, gyro_yaw_dps, which may also
    have empty cells. Others, like compass_deg, are not used.

    Raises:
        ConfigError: The file cannot be read, a column is missing or comes twice, a cell holds no number,
            a frame comes twice, or time goes backwards.
    """
    table = read_csv(path, ConfigError)
    table.require(NEEDED, f"its columns must be frame,t,{SPEED},...")
    columns = [
        table.numbers(name).tolist() if name in table.names else [math.nan] * len(table.rows)
        for name in (*NEEDED, SPEED, *RATES)
    ]
    rows: dict[int, TelemetryRow] = {}
    before = -math.inf
    for row, (frame, t_s, speed, *rates) in enumerate(zip(*columns, strict=True)):
        if not frame.is_integer() or math.isnan(t_s):
            raise ConfigError(f"{table.where(row)}: frame must be a whole number and t a time in s")
        if t_s <= before:
            raise ConfigError(f"{table.where(row)}: time {t_s:g} s is not after {before:g} s: sort the rows")
        if int(frame) in rows:
            raise ConfigError(f"{table.where(row)}: frame {frame:g} comes twice: leave one row out")
        before = t_s
        x, y, z = map(math.radians, rates)
        known_rates = None if math.isnan(x + y + z) else (x, y, z)
        rows[int(frame)] = TelemetryRow(t_s, None if math.isnan(speed) else speed, known_rates)
    return rows
