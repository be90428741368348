"""The names of columns in tables with fixed names: quantities of the file of columns of `import table`.

A name is quantity, number of the wheel from 1, and unit: `position1_rad`, `yaw_rate_deg_s`, `heading_deg`,
`yaw_rad`. Names of the version before are accepted once more.
"""

import re
import sys
from dataclasses import replace
from functools import cache
from pathlib import Path

from drivers.errors import LogError, RoverHilError
from rover_hil.drives.files.csv_table import CsvTable, read_csv

FORMER = {
    r"enc(\d+)_rad": r"position\1_rad",
    "psi_rad": "yaw_rad",
    "compass_deg": "heading_deg",
    "gyro_z_deg_s": "yaw_rate_deg_s",
}
"""Patterns of the names of the version before, and the names of today."""


def read_named_table(path: Path, error: type[RoverHilError] = LogError) -> CsvTable:
    """Return a table with such names.

    The delimiter is a comma, a semicolon or a tab. One header line with names, or three of which the last
    has the short names, as in the Robotino data sets. Text behind a name in brackets is its unit and left
    out.

    Raises:
        RoverHilError: The file cannot be read, has no data, or rows of different lengths.
    """
    table = read_csv(path, error, delimiter=None, header_lines=None)
    if not table.names or not table.rows:
        raise error(
            f"{path} is not a table of measurements, it has no data: give a header line and rows below"
        )
    table.check_shape("correct the row")
    return _with_present_names(table)


def _with_present_names(table: CsvTable) -> CsvTable:
    """Return a table with the column names of today; names of the version before give a warning.

    Raises:
        RoverHilError: It has a column under both names.
    """
    renamed = {name: present for name in table.names if (present := _present_name(name)) != name}
    if not renamed:
        return table
    both = sorted(set(renamed.values()) & set(table.names))
    if both:
        former = next(name for name, present in renamed.items() if present == both[0])
        raise table.error(
            f"{table.path} line {table.header_line} has the column '{both[0]}' and '{former}', its name in "
            "the version before: remove one of them"
        )
    _warn(tuple(renamed.items()))
    return replace(
        table,
        names=[renamed.get(name, name) for name in table.names],
        units={renamed.get(name, name): unit for name, unit in table.units.items()},
    )


def _present_name(name: str) -> str:
    for pattern, present in FORMER.items():
        if re.fullmatch(pattern, name):
            return re.sub(pattern, present, name)
    return name


@cache
def _warn(renamed: tuple[tuple[str, str], ...]) -> None:
    """Warn once of names of the version before, however many tables have them."""
    words = ", ".join(f"{former} is now {present}" for former, present in renamed)
    text = f"Warning: columns have other names: {words}; the next version knows the new names only"
    print(text, file=sys.stderr)  # noqa: T201 - for the user
