"""Positions measured by hand at marks, as with a tape: the file `run.positions.csv` beside `run.mcap`."""

import csv
import io
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from drivers.errors import LogError
from rover_hil.drives.arrays import Array
from rover_hil.drives.files.csv_table import read_csv

COLUMNS = ("t_s", "x_m", "y_m", "yaw_deg", "sigma_m")
ENDING = ".positions.csv"
FORMER_ENDING = ".marks.csv"
TAPE_SD_M = 0.005
"""Accuracy of a position in a file without `sigma_m`."""
YAW_BASE_M = 0.3
"""The yaw is measured between two points of the rover this far apart, each with `sigma_m`."""
LARGEST_M = 1000.0


@dataclass(frozen=True, slots=True)
class Marks:
    """Measured poses, n of them, in the frame of the pose at start.

    Attributes:
        t_s: Time since the start of the log, (n,) as everything else.
        x_m, y_m: Position.
        yaw_deg: Yaw, counter-clockwise; NaN where it was not measured.
        sigma_m: Standard deviation of x and of y.
    """

    t_s: Array
    x_m: Array
    y_m: Array
    yaw_deg: Array
    sigma_m: Array

    @property
    def yaw_sd_rad(self) -> Array:
        """Standard deviation of the yaw."""
        sd: Array = np.sqrt(2.0) * self.sigma_m / YAW_BASE_M
        return sd

    @property
    def start_sd_m(self) -> float:
        """Standard deviation of the start: the rover is put on its mark as exactly as marks are measured."""
        return float(self.sigma_m.min())

    @property
    def start_yaw_sd_rad(self) -> float:
        """Standard deviation of the yaw at start."""
        return float(self.yaw_sd_rad.min())


def marks_file(log: Path) -> Path:
    """Return where the marks of a log would be: `run.positions.csv` beside `run.mcap`."""
    return log.with_name(log.name.removesuffix(".mcap") + ENDING)


def mark_files(log: Path) -> tuple[Path, Path]:
    """Return where the marks of a log would be, in this version and in former ones."""
    path = marks_file(log)
    return path, path.with_name(path.name.removesuffix(ENDING) + FORMER_ENDING)


def marks_beside(log: Path) -> Path | None:
    """Return the file of the marks of a log; None without one.

    Raises:
        LogError: There is one with the ending of former versions.
    """
    path, former = mark_files(log)
    if path.is_file():
        return path
    if former.is_file():
        raise LogError(
            f"{former}: such files are now called {path.name}: rename it, the columns are the same"
        )
    return None


def read_marks(path: Path) -> Marks:
    """Return the marks in a file with the columns `COLUMNS`.

    Cells of `yaw_deg` may be empty. Without the column `sigma_m` it is `TAPE_SD_M`.

    Raises:
        LogError: The file cannot be read, a number is missing or out of range, or times do not rise.
    """
    table = read_csv(path)
    fix = f"write one row per place where the rover stood under {','.join(COLUMNS)}"
    table.require(COLUMNS[:-1], fix)
    t_s, x_m, y_m, yaw_deg = (
        table.numbers(name, fix=fix, is_needed=name != "yaw_deg") for name in COLUMNS[:-1]
    )
    sigma_m = np.full(len(t_s), TAPE_SD_M)
    if COLUMNS[-1] in table.names:
        sigma_m = table.numbers(COLUMNS[-1], fix=fix, is_needed=True)
    wrong = ~((sigma_m > 0.0) & (np.abs(x_m) < LARGEST_M) & (np.abs(y_m) < LARGEST_M))
    if wrong.any():
        where = table.where(int(np.argmax(wrong)))
        raise LogError(f"{where}: sigma_m must be above 0 and positions below {LARGEST_M:g} m: correct it")
    if (np.diff(t_s) <= 0.0).any():
        raise LogError(f"{path}: the times t_s do not rise: sort the rows")
    return Marks(t_s, x_m, y_m, yaw_deg, sigma_m)


def marks_text(marks: Marks) -> str:
    """Return the text of a file of marks."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    for row in zip(marks.t_s, marks.x_m, marks.y_m, marks.yaw_deg, marks.sigma_m, strict=True):
        writer.writerow("" if np.isnan(value) else f"{value:.4f}" for value in row)
    return text.getvalue()
