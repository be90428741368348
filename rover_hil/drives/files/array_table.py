"""Read a table of numbers that is no text: NumPy, MATLAB and Parquet files, logs of autopilots."""

import io
import zipfile
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

FLIGHT_LOGS = frozenset({".ulg", ".bin"})
PICKLE = "pickle"
"""In what NumPy reports of arrays of objects; it advises to load them."""
MISSING_PARQUET = "reading Parquet needs pyarrow: pip install rover-hil[export]"


@dataclass(frozen=True, slots=True, kw_only=True)
class ArrayTable:
    """A table of numbers, n rows; the same questions as to `CsvTable`.

    Attributes:
        columns: By name, in order.
        error: Raised when something is wrong with the table.
    """

    path: Path
    columns: Mapping[str, Array]
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
            RoverHilError: A column is missing, or there are no rows.
        """
        for name in names:
            if name not in self.columns:
                raise self.error(f"{self.path} names no column '{name}': {why}")
            if not len(self.columns[name]):
                raise self.error(f"{self.path} holds no rows: {why}")

    def numbers(self, name: str, *, fix: str = "", is_needed: bool = False) -> Array:
        """Return a column; NaN where a number is not finite.

        Raises:
            RoverHilError: `is_needed`, and a number is not finite.
        """
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
) -> Table:
    """Return the table in a file; the ending of its name says what it is, any other one is text.

    `.npy`, `.npz`, `.mat` up to version 7, `.parquet`; columns of arrays without names are called by their
    number from 1, those of an array `name` with several columns `name.1`, `name.2` and so on. `.ulg` and
    `.bin` are logs of autopilots, see `FlightTable`.

    Args:
        path: The file.
        error: What to raise, here and from the table.
        delimiter: As for `read_csv`.
        header_lines: As for `read_csv`.
        wanted: Columns to read of the log of an autopilot; None for all.

    Raises:
        RoverHilError: The file cannot be read, or is larger than the limits in `drivers.files`.
        ConfigError: A library is missing.
    """
    suffix = path.suffix.lower()
    read = _READERS.get(suffix)
    if read is None and suffix not in FLIGHT_LOGS:
        return read_csv(path, error, delimiter=delimiter, header_lines=header_lines)
    try:
        if read is None:
            return read_flight_log(path, wanted, error)
        columns = read(read_bytes(path, TABLE_BYTES))
    except OSError as problem:
        raise error(f"cannot read {path}: {problem.strerror or problem}: give another file") from problem
    except RoverHilError:
        raise
    # The readers of these formats raise whatever a damaged file makes them stumble over.
    except Exception as problem:
        line = " ".join(str(problem).split())[:200]
        if PICKLE in line:
            line = "it holds Python objects, which are never loaded, as that may run code"
        raise error(f"{path} is not a table in the format of its name: {line}: write it again") from problem
    if len({len(column) for column in columns.values()}) > 1:
        sizes = ", ".join(f"{name} {len(column)}" for name, column in list(columns.items())[:10])
        raise error(f"{path}: its columns are not equally long ({sizes}): keep one table in a file")
    return ArrayTable(path=path, columns=columns, error=error)


def _columns_of(name: str, values: Any) -> dict[str, Array]:
    """Return the columns of one array; none where it holds no table of numbers."""
    array = np.asarray(values)
    if array.dtype.names:
        return {field: _numbers(array[field].ravel()) for field in array.dtype.names}
    if array.dtype.kind not in "biuf" or array.ndim not in {1, 2} or array.size > TABLE_CELLS:
        return {}
    if array.ndim == 1 or 1 in array.shape:
        return {name or "1": _numbers(array.ravel())}
    _check_columns(array.shape[1])
    stem = f"{name}." if name else ""
    return {f"{stem}{number}": _numbers(column) for number, column in enumerate(array.T, start=1)}


def _numbers(values: Any) -> Array:
    if len(values) > TABLE_LINES:
        raise ValueError(f"it has more than {TABLE_LINES:,} rows, the limit: divide it")
    return np.asarray(values, np.float64)


def _check_columns(count: int) -> None:
    if count > TABLE_COLUMNS:
        raise ValueError(f"it has {count:,} columns, more than {TABLE_COLUMNS:,}, the limit")


def _read_npy(raw: bytes) -> dict[str, Array]:
    return _columns_of("", np.load(io.BytesIO(raw), allow_pickle=False))


def _read_npz(raw: bytes) -> dict[str, Array]:
    with zipfile.ZipFile(io.BytesIO(raw)) as archive:
        _check_columns(len(archive.infolist()))
        if sum(member.file_size for member in archive.infolist()) > TABLE_BYTES:
            raise ValueError(f"it is larger than {TABLE_BYTES:,} bytes unpacked, the limit: divide it")
    columns: dict[str, Array] = {}
    with np.load(io.BytesIO(raw), allow_pickle=False) as arrays:
        for name in arrays.files:
            columns |= _columns_of(name, arrays[name])
    return columns


def _read_mat(raw: bytes) -> dict[str, Array]:
    from scipy.io import loadmat

    columns: dict[str, Array] = {}
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


def _read_parquet(raw: bytes) -> dict[str, Array]:
    try:
        from pyarrow import BufferReader
        from pyarrow.parquet import ParquetFile
    except ImportError as problem:
        raise ConfigError(MISSING_PARQUET) from problem
    file = ParquetFile(BufferReader(raw))
    if file.metadata.num_rows * file.metadata.num_columns > TABLE_CELLS:
        raise ValueError(f"it has more than {TABLE_CELLS:,} cells, the limit: divide it")
    _check_columns(file.metadata.num_columns)
    # Texts and lists are not read: one cell of them may be larger than any table.
    kept = [field.name for field in file.schema_arrow if _is_number(field.type)]
    table = file.read(columns=kept)
    columns: dict[str, Array] = {}
    for name in table.column_names:
        values = table[name].to_numpy()
        if values.dtype.kind == "M":
            values = values.astype("datetime64[ns]").astype(np.int64) / 1e9
        if values.dtype.kind in "biuf":
            columns[name] = _numbers(values)
    return columns


_READERS: Mapping[str, Callable[[bytes], dict[str, Array]]] = {
    ".npy": _read_npy,
    ".npz": _read_npz,
    ".mat": _read_mat,
    ".parquet": _read_parquet,
}
