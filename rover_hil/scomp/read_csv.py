"""Read drives and true paths from CSV files: one header line of names, numbers, empty cells for nothing."""

import csv
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from drivers.errors import LogError
from rover_hil.scomp.drive import TruePath

Array = NDArray[np.float64]

WORDS = {"": "nan", "true": "1", "false": "0"}
TRUTH = ("t_s", "x_m", "y_m", "psi_rad")


def read_columns(path: Path, wanted: Sequence[str]) -> tuple[dict[str, Array], list[str]]:
    """Return those of the wanted columns that a file has, and the names of its other columns.

    Raises:
        LogError: The file cannot be read, has no data, a name twice, or a cell that is no number.
    """
    try:
        with path.open(encoding="utf-8-sig", newline="") as stream:
            rows = [row for row in csv.reader(stream, skipinitialspace=True) if row]
    except OSError as error:
        msg = f"cannot read {path}: {error.strerror}; correct the path"
        raise LogError(msg) from error
    except (UnicodeDecodeError, csv.Error) as error:
        msg = f"cannot read {path}: {error}; give a CSV file with a header line"
        raise LogError(msg) from error
    if len(rows) < 2:
        msg = f"{path} has no data: give a CSV file with a header line and rows below"
        raise LogError(msg)
    names = [name.strip() for name in rows[0]]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        msg = f"{path} has the column '{twice[0]}' twice: leave one out"
        raise LogError(msg)
    for number, row in enumerate(rows[1:], start=2):
        if len(row) != len(names):
            msg = f"{path} row {number} has {len(row)} cells, the header has {len(names)}: mend the row"
            raise LogError(msg)
    columns = {
        name: _numbers([row[index] for row in rows[1:]], f"{path}, column '{name}'")
        for index, name in enumerate(names)
        if name in wanted
    }
    return columns, [name for name in names if name not in wanted]


def read_truth(path: Path) -> TruePath:
    """Return a true path; columns beyond t_s, x_m, y_m, psi_rad have no effect.

    Raises:
        LogError: The file cannot be read, lacks a column, has an empty cell, or its time does not rise.
    """
    columns, _ = read_columns(path, TRUTH)
    for name in TRUTH:
        if name not in columns:
            msg = f"{path} has no column '{name}': the true path needs {', '.join(TRUTH)}"
            raise LogError(msg)
        empty = np.flatnonzero(~np.isfinite(columns[name]))
        if empty.size:
            msg = f"{path}, column '{name}': row {empty[0] + 2} holds no finite number: leave the row out"
            raise LogError(msg)
    if not (np.diff(columns["t_s"]) > 0.0).all():
        msg = f"{path}: the time goes backwards or stands: sort the rows"
        raise LogError(msg)
    return TruePath(
        t_s=columns["t_s"], x_m=columns["x_m"], y_m=columns["y_m"], psi_rad=np.unwrap(columns["psi_rad"])
    )


def _numbers(cells: Sequence[str], where: str) -> Array:
    numbers = np.empty(len(cells))
    for index, cell in enumerate(cells):
        try:
            numbers[index] = float(WORDS.get(cell.strip().lower(), cell))
        except ValueError:
            msg = f"{where}, row {index + 2}: '{cell}' is no number; write a number or leave the cell empty"
            raise LogError(msg) from None
    return np.where(np.isfinite(numbers), numbers, np.nan)
