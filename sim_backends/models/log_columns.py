"""Measured series as named columns: tables in files, and what a model asks of the log of a drive."""

import csv
import gzip
import math
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol, TypeAlias, runtime_checkable

import numpy as np

from drivers.errors import ConfigError
from sim_backends.models.interface import Array, Run

Columns: TypeAlias = Mapping[str, Array]

DELIMITERS = "\t;,"
HEADER_LINES = 3
RUN_COLUMN = "run"


@dataclass(frozen=True, slots=True, kw_only=True)
class DriveLog:
    """A recorded drive.

    Attributes:
        name: Its own among all.
        columns: All of one length; NaN where nothing was said. `t_s`; by wheel from 1 `enc1_rad`,
            `speed1_rad_s`, `set1_rad_s`, `current1_a`, `voltage1_v` (all at the wheel, current a magnitude
            where its sign is not told); `compass_deg`, `gyro_z_deg_s`, `pitch_deg` (nose up), `roll_deg`
            (left side up); the true pose `x_m`, `y_m`, `psi_rad`.
        facts: What is known of the rover: `wheel_radius_m`, `track_m`, `base_radius_m`, `gear_ratio`,
            `speed_step_rad_s`, `current_step_a`, where it is known.
        kind: Kinematics: "omni3", "skid_steer_4", ...
    """

    name: str
    columns: Columns
    facts: Mapping[str, float] = field(default_factory=dict)
    kind: str = ""


@runtime_checkable
class LogModel(Protocol):
    """A model that can be compared with recorded drives."""

    def runs_of_log(self, log: DriveLog) -> list[Run]:
        """Return the runs in a log.

        Raises:
            ConfigError: It lacks what the model is compared with.
        """
        ...


def table_files(path: Path) -> list[Path]:
    """Return a file, or all tables in a folder and the folders below it.

    Raises:
        ConfigError: There are none.
    """
    if path.is_file():
        return [path]
    files = sorted(one for one in path.rglob("*.csv*") if one.suffixes[-2:] in ([".csv"], [".csv", ".gz"]))
    files = [one for one in files if one.is_file()] or sorted(path.rglob("*.csv.gz"))
    if not files:
        raise ConfigError(f"{path} holds no .csv and no .csv.gz file")
    return files


def read_columns(path: Path) -> dict[str, Array]:
    """Return the columns of a table by their names; empty cells are NaN, cells of words are left out.

    The delimiter is a comma, a semicolon or a tab. One header line with names, or three of which the last
    has the short names, as in the Robotino data sets. Text behind a name in brackets is its unit and left
    out.

    Raises:
        ConfigError: The file cannot be read, or has rows of different lengths.
    """
    rows = _rows(path)
    start = _first_numbers(rows)
    if start == 0 or start >= len(rows):
        raise ConfigError(f"{path} is no table of measurements: a header and rows of numbers are needed")
    names = [cell.split("[")[0].strip() for cell in rows[start - 1]]
    body = rows[start:]
    wrong = next((place for place, row in enumerate(body) if len(row) != len(names)), None)
    if wrong is not None:
        raise ConfigError(
            f"{path}, line {start + wrong + 1} has {len(body[wrong])} cells, its header {len(names)}"
        )
    columns = {}
    for place, name in enumerate(names):
        if name and name != RUN_COLUMN:
            where = f"{path}: a cell of column '{name}'"
            columns[name] = np.array([cell_number(row[place], where) for row in body])
    return columns


def read_runs_by_name(path: Path) -> dict[str, dict[str, Array]]:
    """Return the columns of each run in a table: by its column `run`, else all rows under the file's name.

    Raises:
        ConfigError: See `read_columns`.
    """
    columns = read_columns(path)
    rows = _rows(path)
    start = _first_numbers(rows)
    header = [cell.strip() for cell in rows[start - 1]]
    if RUN_COLUMN not in header:
        return {path.name.split(".csv")[0]: columns}
    names = np.array([row[header.index(RUN_COLUMN)].strip() for row in rows[start:]])
    return {
        str(name): {key: values[names == name] for key, values in columns.items()}
        for name in dict.fromkeys(names)
    }


def need(columns: Columns, names: Sequence[str], where: str, why: str) -> None:
    """Check that columns are there.

    Raises:
        ConfigError: One is not.
    """
    missing = [name for name in names if name not in columns]
    if missing:
        raise ConfigError(f"{where} has no column '{missing[0]}': {why}")


def missing_values(columns: Columns, names: Sequence[str], where: str) -> dict[str, tuple[int, int]]:
    """Return the number of missing values and of all values of each column that has gaps.

    Args:
        columns: Columns of a record.
        names: Columns that have a value in every row of a sound record; absent ones are skipped.
        where: Record and run, for the message.

    Raises:
        ConfigError: A column holds no value at all.
    """
    gaps = {}
    for name in names:
        values = columns.get(name)
        if values is None or np.isfinite(values).all():
            continue
        count = int(np.sum(~np.isfinite(values)))
        if count == values.size:
            raise ConfigError(
                f"{where}: column '{name}' holds no value: remove the column or repair the record"
            )
        gaps[name] = (count, int(values.size))
    return gaps


def whole_rows(columns: Columns, names: Sequence[str]) -> slice:
    """Return the rows from the first to the last in which all of these columns say something.

    Raises:
        ConfigError: There are none.
    """
    told = np.flatnonzero(np.all([np.isfinite(columns[name]) for name in names], axis=0))
    if told.size == 0:
        raise ConfigError(f"{', '.join(names)} never all have a value at one time: mend the record")
    return slice(int(told[0]), int(told[-1]) + 1)


def check_times(t_s: Array, where: str) -> None:
    """Check that times rise.

    Raises:
        ConfigError: They do not, or there are too few.
    """
    if t_s.size < 2:
        raise ConfigError(f"{where} has {t_s.size} rows: a series needs two or more")
    wrong = np.flatnonzero(~(np.diff(t_s) > 0.0))
    if wrong.size:
        raise ConfigError(f"{where}: the time stands, goes backwards or is missing after {t_s[wrong[0]]:g} s")


def _rows(path: Path) -> list[list[str]]:
    try:
        raw = path.read_bytes()
        text = (gzip.decompress(raw) if path.suffix == ".gz" else raw).decode("utf-8-sig")
    except (OSError, EOFError, zlib.error, UnicodeDecodeError) as error:
        raise ConfigError(f"cannot read {path} as a table: {error}") from error
    lines = text.splitlines()
    first = lines[0] if lines else ""
    delimiter = next((one for one in DELIMITERS if one in first), ",")
    rows = [[cell.strip() for cell in row] for row in csv.reader(lines, delimiter=delimiter) if row]
    # The Robotino files end each line with a delimiter.
    return [row[:-1] if len(row) > 1 and not row[-1] and first.endswith(delimiter) else row for row in rows]


def _first_numbers(rows: Sequence[Sequence[str]]) -> int:
    for index, row in enumerate(rows[: HEADER_LINES + 1]):
        if any(_is_number(cell) for cell in row):
            return index
    return len(rows)


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def cell_number(cell: str, where: str) -> float:
    """Return the number in a cell of a table; NaN where it is empty.

    Raises:
        ConfigError: It is no number.
    """
    text = cell.strip()
    try:
        return float(text) if text else math.nan
    except ValueError as error:
        raise ConfigError(f"{where} is '{text}', no number") from error
