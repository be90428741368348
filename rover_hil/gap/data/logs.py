"""Logs of this software as columns."""

import math
from collections.abc import Callable, Mapping
from pathlib import Path

from controllers.motion.rover_geometry import OmniRoverSettings, SkidSteerRoverSettings
from drivers.errors import LogError
from drivers.robotino_board.scales import scales
from drivers.robotino_board.settings import RobotinoBoardSettings
from rover_hil.config import Config
from rover_hil.drives.channels import POSE
from rover_hil.drives.drive import read_drive
from rover_hil.gap.data.columns import DriveLog
from rover_hil.gap.data.parameters import DATA
from sim_backends.models.interface import Run

WHEELS = ("position_rad", "speed_rad_s", "current_a", "voltage_v", "set_rad_s")
BODY = ("heading_rad", "gyro_z_rad_s", "pitch_rad", "roll_rad", *POSE)


def find_logs(path: Path) -> list[Path]:
    """Return a log, or all logs in a folder and the folders below it."""
    return [path] if path.suffix == ".mcap" else sorted(path.rglob("*.mcap"))


def read_logs(runs_of_log: Callable[[DriveLog], list[Run]], path: Path) -> list[Run]:
    """Return the runs in the logs of a file or folder.

    Raises:
        ConfigError: A log lacks what the model needs.
        LogError: A log cannot be read.
    """
    files = find_logs(path)
    runs = []
    for file in files:
        name = file.stem if len(files) == 1 else file.relative_to(path).with_suffix("").as_posix()
        runs += runs_of_log(read_log(file, name))
    return runs


def read_log(path: Path, name: str) -> DriveLog:
    """Return a log as columns, a row for each reading of the first wheel.

    Raises:
        LogError: It cannot be read, or contains no drive.
    """
    drive = read_drive(path)
    columns = drive.table((*WHEELS, *BODY), outside=math.nan)
    count = len(drive.channels[drive.clock])
    if count < DATA.runs.least_rows:
        raise LogError(f"log {path} holds {count} readings of the first wheel: give the log of a drive")
    return DriveLog(
        name=name, columns=columns, facts=_facts(drive.config), kind=drive.config.rover.kinematics
    )


def _facts(config: Config) -> Mapping[str, float]:
    rover, device = config.rover, config.devices[config.roles.wheels]
    facts: dict[str, float] = {}
    if isinstance(rover, SkidSteerRoverSettings):
        facts |= {"wheel_radius_m": rover.wheel_radius_m, "track_m": rover.track_m}
    if isinstance(rover, OmniRoverSettings):
        facts |= {"wheel_radius_m": rover.wheel_radius_m, "base_radius_m": rover.base_radius_m}
    if isinstance(device, RobotinoBoardSettings):
        counts = scales(device)
        facts |= {
            "gear_ratio": device.gear_ratio,
            "speed_step_rad_s": counts.speed_rad_s,
            "current_step_a": counts.current_step_a,
        }
    return facts
