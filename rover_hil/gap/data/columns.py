"""Measured series as named columns of tables and logs, and who reads them."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, TypeAlias, runtime_checkable

import numpy as np

from drivers.errors import ConfigError
from rover_hil.drives.column_names import read_named_table
from rover_hil.drives.drive import Drive
from rover_hil.drives.files.csv_table import CsvTable
from sim_backends.models.interface import Array, Run

Columns: TypeAlias = Mapping[str, Array]

RUN_COLUMN = "run"


@runtime_checkable
class LogModel(Protocol):
    """A model that can be compared with recorded drives."""

    def runs_of_log(self, drive: Drive) -> list[Run]:
        """Return the runs in the log of a drive; `logs.log_columns` gives its columns.

        Raises:
            ConfigError: It lacks columns of the model.
        """
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class Reader:
    """How measured runs of a model are read.

    Attributes:
        read: Returns the runs in a file or folder.
        runs_of_log: Returns the runs in a log; None where the model cannot be compared with logs.
        cut: Cuts a long run into several; None where a run cannot begin in the middle of a drive.
    """

    read: Callable[[Path], list[Run]]
    runs_of_log: Callable[[Drive], list[Run]] | None = None
    cut: Callable[[Run], list[Run]] | None = None


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
    """Return the columns of a table by their names, see `read_named_table`; empty cells are NaN.

    Raises:
        ConfigError: The file cannot be read, has rows of different lengths, or a cell holds no number.
    """
    return _columns(read_named_table(path, ConfigError))


def read_runs_by_name(path: Path) -> dict[str, dict[str, Array]]:
    """Return the columns of each run in a table: by its column `run`, else all rows under the file's name.

    Raises:
        ConfigError: See `read_columns`.
    """
    table = read_named_table(path, ConfigError)
    columns = _columns(table)
    if RUN_COLUMN not in table.names:
        return {path.name.split(".csv")[0]: columns}
    names = np.array(table.text(RUN_COLUMN))
    return {
        str(name): {key: values[names == name] for key, values in columns.items()}
        for name in dict.fromkeys(names)
    }


def _columns(table: CsvTable) -> dict[str, Array]:
    return {name: table.numbers(name) for name in table.names if name and name != RUN_COLUMN}


def need(columns: Columns, names: Sequence[str], where: str, why: str) -> None:
    """Check that columns exist.

    Raises:
        ConfigError: A column is missing.
    """
    missing = [name for name in names if name not in columns]
    if missing:
        raise ConfigError(f"{where} has no column '{missing[0]}': {why}")


def missing_values(columns: Columns, names: Sequence[str], where: str) -> dict[str, tuple[int, int]]:
    """Return the number of missing values and of all values of each column that has gaps.

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
    """Return the rows from the first to the last with a value in all of these columns.

    Raises:
        ConfigError: There are none.
    """
    valid = np.flatnonzero(np.all([np.isfinite(columns[name]) for name in names], axis=0))
    if valid.size == 0:
        raise ConfigError(f"{', '.join(names)} never have values at the same time: repair the record")
    return slice(int(valid[0]), int(valid[-1]) + 1)


def check_times(t_s: Array, where: str) -> None:
    """Check that times rise.

    Raises:
        ConfigError: They do not, or there are too few.
    """
    if t_s.size < 2:
        raise ConfigError(f"{where} has {t_s.size} rows: a series needs two or more")
    wrong = np.flatnonzero(~(np.diff(t_s) > 0.0))
    if wrong.size:
        raise ConfigError(f"{where}: the time does not increase or is missing after {t_s[wrong[0]]:g} s")
