"""Reading of drives and parameters, writing of parameters and paths."""

from dataclasses import dataclass
from pathlib import Path

from controllers.slip.scomp.parameters import RoverGeometry, ScompParameters
from drivers.settings import read_toml
from rover_hil.config import validated
from rover_hil.drives.drive import Drive
from rover_hil.drives.drive import read_drive as read_log
from rover_hil.drives.toml_text import toml_text
from rover_hil.scomp.columns import KNOWN, drive_of
from rover_hil.scomp.drive import DriveRows, Track
from rover_hil.scomp.read_csv import read_columns
from rover_hil.scomp.read_log import log_columns

DIGITS = 6
COLUMNS = ("t_s", "x_m", "y_m", "heading_rad", "slip", "slip_angle_rad", "sigma_x_m", "sigma_y_m")


@dataclass(frozen=True, slots=True, kw_only=True)
class ReadDrive:
    """A drive and what was left out of it; rover and readings of the log are None for a CSV file."""

    drive: DriveRows
    notes: tuple[str, ...]
    rover: RoverGeometry | None
    recorded: Drive | None


def read_drive(path: Path) -> ReadDrive:
    """Read one of our logs (`.mcap`) or a CSV file.

    Raises:
        LogError: It cannot be read, has no wheels, or its time does not increase.
    """
    if path.suffix == ".mcap":
        recorded = read_log(path, with_traces=True)
        columns, rover = log_columns(recorded)
        drive, notes = drive_of(columns, str(path))
        return ReadDrive(drive=drive, notes=tuple(notes), rover=rover, recorded=recorded)
    columns, others = read_columns(path, KNOWN)
    drive, notes = drive_of(columns, str(path))
    if others:
        notes.append(f"columns that are not used: {', '.join(others)}")
    return ReadDrive(drive=drive, notes=tuple(notes), rover=None, recorded=None)


def read_parameters(path: Path) -> ScompParameters:
    """Return the parameters in a file.

    Raises:
        ConfigError: It cannot be read or has an invalid value; the message names the key.
    """
    table = read_toml(path, f"parameter file {path}", "correct the path or leave --params out")
    return validated(ScompParameters, table, str(path))


def parameters_text(parameters: ScompParameters) -> str:
    """Return parameters as the text of a file."""
    return toml_text(parameters.model_dump(by_alias=True, exclude_none=True), DIGITS)


def track_text(track: Track) -> str:
    """Return a path as the text of a CSV file."""
    columns = [getattr(track, name).tolist() for name in COLUMNS]
    lines = [
        f"{t_s!r}," + ",".join(f"{value:.6f}" for value in values)
        for t_s, *values in zip(*columns, strict=True)
    ]
    return "\n".join([",".join(COLUMNS), *lines]) + "\n"
