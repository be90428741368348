"""Reader of drives and true paths in CSV files: a header line, numbers, empty cells for missing ones."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from drivers.errors import LogError
from rover_hil.drives.arrays import Array
from rover_hil.drives.column_names import with_present_names
from rover_hil.drives.files.csv_table import CsvTable, read_csv
from rover_hil.scomp.drive import TruePath

TRUTH = ("t_s", "x_m", "y_m", "yaw_rad")


def read_columns(path: Path, wanted: Sequence[str]) -> tuple[dict[str, Array], list[str]]:
    """Return those of the wanted columns that a file has, and the names of its other columns.

    Raises:
        LogError: The file cannot be read, has no data, a name twice, or a cell that holds no number.
    """
    table = _read(path)
    columns = {name: _numbers(table, name) for name in table.names if name in wanted}
    return columns, [name for name in table.names if name not in wanted]


def read_truth(path: Path) -> TruePath:
    """Return a true path; columns beyond t_s, x_m, y_m, yaw_rad have no effect.

    Raises:
        LogError: The file cannot be read, a column or a cell is missing, or its time does not increase.
    """
    table = _read(path)
    table.require(TRUTH, f"the true path needs {', '.join(TRUTH)}")
    columns = [_numbers(table, name) for name in TRUTH]
    for name, values in zip(TRUTH, columns, strict=True):
        empty = np.flatnonzero(np.isnan(values))
        if empty.size:
            raise LogError(
                f"{table.where(int(empty[0]))}, column '{name}' holds no finite number: leave the row out"
            )
    t_s, x_m, y_m, yaw_rad = columns
    if not (np.diff(t_s) > 0.0).all():
        raise LogError(f"{path}: the time does not increase: sort the rows")
    return TruePath(t_s=t_s, x_m=x_m, y_m=y_m, yaw_rad=np.unwrap(yaw_rad))


def _read(path: Path) -> CsvTable:
    table = read_csv(path)
    if not table.rows:
        raise LogError(f"{path} has no data: give a CSV file with a header line and rows below")
    table.check_shape("mend the row")
    return with_present_names(table)


def _numbers(table: CsvTable, name: str) -> Array:
    return table.numbers(name, fix="write a number or leave the cell empty")
