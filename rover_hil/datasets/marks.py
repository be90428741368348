"""Positions measured by hand at marks: a CSV file beside a log, which counts as its pose fixes."""

import csv
import io
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from drivers.errors import LogError
from rover_hil.datasets.arrays import Array
from rover_hil.datasets.csv_table import read_csv

COLUMNS = ("t_s", "x_m", "y_m", "yaw_deg", "sigma_m")
ENDING = ".marks.csv"
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


def marks_beside(log: Path) -> Path:
    """Return the path of the marks of a log."""
    return log.with_name(f"{log.stem}{ENDING}")


def read_marks(path: Path) -> Marks:
    """Return the marks in a file with the columns `COLUMNS`; cells of `yaw_deg` may be empty.

    Raises:
        LogError: The file cannot be read, a number is missing or out of range, or times do not rise.
    """
    table = read_csv(path)
    fix = "write one row per mark under t_s,x_m,y_m,yaw_deg,sigma_m"
    table.require(COLUMNS, fix)
    columns = [table.numbers(name, fix=fix, is_needed=name != "yaw_deg") for name in COLUMNS]
    marks = Marks(*columns)
    wrong = ~((marks.sigma_m > 0.0) & (np.abs(marks.x_m) < LARGEST_M) & (np.abs(marks.y_m) < LARGEST_M))
    if wrong.any():
        where = table.where(int(np.argmax(wrong)))
        raise LogError(f"{where}: sigma_m must be above 0 and positions below {LARGEST_M:g} m: correct it")
    if (np.diff(marks.t_s) <= 0.0).any():
        raise LogError(f"{path}: the times do not rise: sort the rows")
    return marks


def marks_text(marks: Marks) -> str:
    """Return the text of a file of marks."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    for row in zip(marks.t_s, marks.x_m, marks.y_m, marks.yaw_deg, marks.sigma_m, strict=True):
        writer.writerow("" if np.isnan(value) else f"{value:.4f}" for value in row)
    return text.getvalue()
