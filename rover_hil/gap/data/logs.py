"""Logs of this software as columns."""

import math
from collections.abc import Callable
from pathlib import Path

from drivers.errors import LogError
from rover_hil.drives.channels import POSE
from rover_hil.drives.drive import Drive, read_drive
from rover_hil.gap.data.columns import Columns
from rover_hil.gap.data.parameters import DATA
from sim_backends.models.interface import Run

WHEELS = ("position_rad", "speed_rad_s", "current_a", "voltage_v", "set_rad_s")
BODY = ("heading_rad", "gyro_z_rad_s", "pitch_rad", "roll_rad", *POSE)


def find_logs(path: Path) -> list[Path]:
    """Return a log, or all logs in a folder and the folders below it."""
    return [path] if path.suffix == ".mcap" else sorted(path.rglob("*.mcap"))


def read_logs(runs_of_log: Callable[[Drive], list[Run]], path: Path) -> list[Run]:
    """Return the runs in the logs of a file or folder.

    Raises:
        ConfigError: A log lacks what the model needs.
        LogError: A log cannot be read.
    """
    files = find_logs(path)
    runs = []
    for file in files:
        drive = read_drive(file)
        drive.name = file.stem if len(files) == 1 else file.relative_to(path).with_suffix("").as_posix()
        runs += runs_of_log(drive)
    return runs


def log_columns(drive: Drive) -> Columns:
    """Return the columns of a log, a row for each reading of the first wheel; NaN where there is no value.

    `t_s`; by wheel from 1 `position1_rad`, `speed1_rad_s`, `set1_rad_s`, `current1_a`, `voltage1_v` (all at
    the wheel, current a magnitude where its sign is unknown); `heading_deg`, `yaw_rate_deg_s`, `pitch_deg`
    (nose up), `roll_deg` (left side up); the true pose `x_m`, `y_m`, `yaw_rad`.

    Raises:
        LogError: It contains no drive.
    """
    count = len(drive.channels[drive.clock])
    if count < DATA.runs.least_rows:
        raise LogError(
            f"log {drive.log.path} holds {count} readings of the first wheel: give the log of a drive"
        )
    return drive.table((*WHEELS, *BODY), outside=math.nan)
