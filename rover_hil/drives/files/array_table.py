"""Read a table of numbers that is no text: NumPy, MATLAB and Parquet files, logs of autopilots."""

import io
import zipfile
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from drivers.errors import ConfigError, LogError, RoverHilError
from drivers.files import TABLE_BYTES, TABLE_CELLS, TABLE_COLUMNS, TABLE_LINES, read_bytes
from rover_hil.drives.arrays import Array
from rover_hil.drives.files.csv_table import CsvTable, read_csv
from rover_hil.drives.files.flight_table import FlightTable, read_flight_log
from rover_hil.drives.files.unreadable import UnreadableError

FLIGHT_LOGS = frozenset({".ulg", ".bin"})
PICKLE = "pickle"
"""In what NumPy reports of arrays of objects; it advises to load them."""
MATLAB_7_3 = b"MATLAB 7.3"
MISSING_PARQUET = "reading Parquet needs pyarrow: pip install rover-hil[export]"
AGAIN = {
    ".npy": "write it again with numpy.save",
    ".npz": "write it again with numpy.savez",
    ".mat": "save it again in MATLAB with save(..., '-v7')",
    ".parquet": "write it again",
    ".ulg": "download it again from the autopilot; `ulog_info` shows what is in it",
    ".bin": "download it again from the autopilot; `mavlogdump.py` shows what is in it",
}
"""What helps where a file is damaged."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ArrayTable:
    """A table of numbers, n rows; the same questions as to `CsvTable`.

    Attributes:
        columns: By name, in order; those of other matrices in the file may be of other length.
        rows: Their number: that of the column that was asked for, else of the most numbers in the file.
        note: What of the file cannot be read, for messages.
        error: Raised when something is wrong with the table.
    """

    path: Path
    columns: Mapping[str, Array]
    rows: int
    note: str = ""
    error: type[RoverHilError]

    @property
    def names(self) -> Sequence[str]:
        """Names of the columns, in order."""
        return list(self.columns)

    def where(self, row: int) -> str:
        """Return the place of a row, for messages."""
        return f"{self.path} row {row + 1}"

    def require(self, names: Iterable[str], why: str) -> None:
        """Check that there are columns of these names, and rows.

        Raises:
            RoverHilError: A column is missing or not of this table, or there are no rows.
        """
        for name in names:
            if name not in self.columns:
                raise self.error(f"{self.path} names no column '{name}': {why}{self.note}")
            if not len(self.columns[name]):
                raise self.error(f"{self.path} holds no rows: {why}")
            if len(self.columns[name]) != self.rows:
                raise self.error(
                    f"{self.path}: column '{name}' has {len(self.columns[name])} rows, the time {self.rows}: "
                    "name columns of one matrix; [imu], [fixes] and [truth] may have a time of their own "
                    "and this file as `file`"
                )

    def numbers(self, name: str, *, fix: str = "", is_needed: bool = False) -> Array:
        """Return a column; NaN where a number is not finite.

        Raises:
            RoverHilError: It is not of this table, or `is_needed`, and a number is not finite.
        """
        self.require((name,), fix)
        column = np.where(np.isfinite(self.columns[name]), self.columns[name], np.nan)
        missing = np.flatnonzero(np.isnan(column))
        if is_needed and missing.size:
            advice = f": {fix}" if fix else ""
            raise self.error(f"{self.where(int(missing[0]))}, column '{name}': it is not a number{advice}")
        return column


Table = CsvTable | ArrayTable | FlightTable


def read_table(
    path: Path,
    error: type[RoverHilError] = LogError,
    *,
    delimiter: str | None,
    header_lines: int | None,
    wanted: Collection[str] | None = None,
    time: str | int | None = None,
) -> Table:
    """Return the table in a file; the ending of its name says what it is, any other one is text.

    `.npy`, `.npz`, `.mat` up to version 7, `.parquet`; columns of arrays without names are called by their
    number from 1, those of an array `name` with several columns `name.1`, `name.2` and so on, those of a
    structure `name.field`. The rows of an array are along its longer side. `.ulg` and `.bin` are logs of
    autopilots, see `FlightTable`.

    Args:
        path: The file.
        error: What to raise, here and from the table.
        delimiter: As for `read_csv`.
        header_lines: As for `read_csv`.
        wanted: Columns to read of the log of an autopilot; None for all.
        time: Name or number of the column of times, where arrays of the file have different lengths.

    Raises:
        RoverHilError: The file cannot be read, or is larger than the limits in `drivers.files`.
        ConfigError: A library is missing.
    """
    suffix = path.suffix.lower()
    read = _READERS.get(suffix)
    if read is None and suffix not in FLIGHT_LOGS:
        return read_csv(path, error, delimiter=delimiter, header_lines=header_lines)
    try:
        raw = b"" if read is None else read_bytes(path, TABLE_BYTES)
    except OSError as problem:
        raise error(f"cannot read {path}: {problem.strerror}: give another file") from problem
    try:
        if read is None:
            return read_flight_log(path, wanted, error)
        columns = read(raw)
    except FileNotFoundError as problem:
        raise error(f"cannot read {path}: {problem.strerror}: give another file") from problem
    except (RoverHilError, MemoryError):
        raise
    except UnreadableError as problem:
        raise error(f"cannot read {path}: {problem}") from problem
    # The readers of these formats raise whatever a damaged file makes them stumble over.
    except Exception as problem:
        if PICKLE in str(problem):
            raise error(
                f"cannot read {path}: it holds Python objects, which are never loaded, as that may run code: "
                "save arrays of numbers"
            ) from problem
        raise error(f"{path} is cut, damaged or no {suffix} file: {AGAIN[suffix]}") from problem
    objects = [name for name, column in columns.items() if column is None]
    known = {name: column for name, column in columns.items() if column is not None}
    note = (
        ""
        if not objects
        else (
            f"; {', '.join(objects)} is a table or an object of MATLAB, which only MATLAB reads: save its "
            "columns with S = table2struct(T, 'ToScalar', true)"
        )
    )
    if not known:
        raise error(f"{path} holds no arrays of numbers{note or ': give another file'}")
    return ArrayTable(path=path, columns=known, rows=_rows_of(known, time), note=note, error=error)


def _rows_of(columns: Mapping[str, Array], time: str | int | None) -> int:
    """Return the number of rows of the column of times, else of the most numbers."""
    name = list(columns)[time - 1] if isinstance(time, int) and time <= len(columns) else time
    if name in columns:
        return len(columns[str(name)])
    lengths = Counter(map(len, columns.values()))
    return max(lengths, key=lambda rows: rows * lengths[rows])


_Columns = dict[str, Array | None]
"""By name; None for what only another program can read."""


def _columns_of(name: str, values: Any) -> _Columns:
    """Return the columns of one array; none where it holds no table of numbers."""
    if type(values).__name__ == "MatlabOpaque":
        return {name: None}
    array = np.asarray(values)
    if array.dtype.names:
        columns: _Columns = {}
        for field in array.dtype.names:
            columns |= _columns_of(f"{name}.{field}" if name else field, _of_cells(array[field]))
        return columns
    if array.dtype.kind not in "biuf" or array.ndim not in {1, 2} or array.size > TABLE_CELLS:
        return {}
    if array.ndim == 1 or 1 in array.shape:
        return {name or "1": _numbers(array.ravel())}
    if array.shape[1] > array.shape[0]:
        array = array.T
    _check_columns(array.shape[1])
    stem = f"{name}." if name else ""
    return {f"{stem}{number}": _numbers(column) for number, column in enumerate(array.T, start=1)}


def _of_cells(values: Any) -> Any:
    """Return what the cells of a field hold: of one cell its array, of many the number in each."""
    if values.dtype.kind != "O":
        return values.ravel()
    if values.size == 1:
        return values.ravel()[0]
    cells = [np.asarray(cell) for cell in values.ravel()]
    is_numeric = all(cell.size == 1 and cell.dtype.kind in "biuf" for cell in cells)
    return np.array([cell.ravel()[0] for cell in cells] if is_numeric else [])


def _numbers(values: Any) -> Array:
    if len(values) > TABLE_LINES:
        raise UnreadableError(f"it has more than {TABLE_LINES:,} rows, the limit: divide it")
    return np.asarray(values, np.float64)


def _check_columns(count: int) -> None:
    if count > TABLE_COLUMNS:
        raise UnreadableError(
            f"it has {count:,} columns, more than {TABLE_COLUMNS:,}, the limit: leave columns out"
        )


def _read_npy(raw: bytes) -> _Columns:
    return _columns_of("", np.load(io.BytesIO(raw), allow_pickle=False))


def _read_npz(raw: bytes) -> _Columns:
    with zipfile.ZipFile(io.BytesIO(raw)) as archive:
        _check_columns(len(archive.infolist()))
        if sum(member.file_size for member in archive.infolist()) > TABLE_BYTES:
            raise UnreadableError(f"it is larger than {TABLE_BYTES:,} bytes unpacked, the limit: divide it")
    columns: _Columns = {}
    with np.load(io.BytesIO(raw), allow_pickle=False) as arrays:
        for name in arrays.files:
            columns |= _columns_of(name, arrays[name])
    return columns


def _read_mat(raw: bytes) -> _Columns:
    from scipy.io import loadmat

    if raw.startswith(MATLAB_7_3):
        raise UnreadableError("it is of version 7.3: save it again in MATLAB with save(..., '-v7')")
    columns: _Columns = {}
    for name, values in loadmat(io.BytesIO(raw)).items():
        if not name.startswith("__"):
            columns |= _columns_of(name, values)
    return columns


def _is_number(kind: Any) -> bool:
    from pyarrow import types

    return any(
        is_kind(kind)
        for is_kind in (types.is_integer, types.is_floating, types.is_boolean, types.is_timestamp)
    )


def _read_parquet(raw: bytes) -> _Columns:
    try:
        from pyarrow import BufferReader
        from pyarrow.parquet import ParquetFile
    except ImportError as problem:
        raise ConfigError(MISSING_PARQUET) from problem
    file = ParquetFile(BufferReader(raw))
    if file.metadata.num_rows * file.metadata.num_columns > TABLE_CELLS:
        raise UnreadableError(f"it has more than {TABLE_CELLS:,} cells, the limit: divide it")
    _check_columns(file.metadata.num_columns)
    # Texts and lists are not read: one cell of them may be larger than any table.
    kept = [field.name for field in file.schema_arrow if _is_number(field.type)]
    table = file.read(columns=kept)
    columns: _Columns = {}
    for name in table.column_names:
        values = table[name].to_numpy()
        if values.dtype.kind == "M":
            values = values.astype("datetime64[ns]").astype(np.int64) / 1e9
        if values.dtype.kind in "biuf":
            columns[name] = _numbers(values)
    return columns


_READERS: Mapping[str, Callable[[bytes], _Columns]] = {
    ".npy": _read_npy,
    ".npz": _read_npz,
    ".mat": _read_mat,
    ".parquet": _read_parquet,
}
