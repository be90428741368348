"""Logs of autopilots as tables: ULog of PX4, and DataFlash of ArduPilot.

Each message is a row, in the order of the times; the cells of other messages are empty. Columns are called
as message and field, such as `wheel_encoders.wheel_angle[0]` or `WENC.Dist0`; those of a second sensor of
the same kind `sensor_gyro_1.z`. The time of all of them is one column, in microseconds.
"""

import io
import os
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from drivers.errors import ConfigError, LogError, RoverHilError
from drivers.files import FLIGHT_LOG_BYTES, MEGABYTE, TABLE_LINES
from rover_hil.drives.arrays import Array
from rover_hil.drives.files.ulog_formats import check_formats
from rover_hil.drives.files.unreadable import UnreadableError

ULOG_TIME, DATAFLASH_TIME = "timestamp", "TimeUS"
FAST_INDEX = "PYMAVLINK_FAST_INDEX"
MOST_COMPLAINTS = 10_000
BEGINS = {".ulg": b"ULog\x01\x12\x35", ".bin": b"\xa3\x95"}
MISSING = "reading {} needs {}: pip install rover-hil[flight]"


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightTable:
    """The messages of a log; the same questions as to `CsvTable`.

    Attributes:
        time: Name of the column of times.
        t_us: Time of each row, n.
        rows: Rows of the messages of each kind.
        fields: Numbers of the messages, by kind and field.
        oddities: Data-quality findings in the file: what each is, and how often.
        error: Raised when something is wrong with the table.
    """

    path: Path
    time: str
    t_us: Array
    rows: Mapping[str, NDArray[np.intp]]
    fields: Mapping[str, Mapping[str, Array]]
    oddities: Mapping[str, int] = field(default_factory=dict)
    error: type[RoverHilError] = LogError

    @property
    def names(self) -> Sequence[str]:
        """Names of the columns, in order."""
        return [
            self.time,
            *(f"{kind}.{name}" for kind, names in self.fields.items() for name in names if name != self.time),
        ]

    def where(self, row: int) -> str:
        """Return the place of a row, for messages."""
        return f"{self.path} at {self.time} = {self.t_us[row]:.0f}"

    def require(self, names: Iterable[str], why: str) -> None:
        """Check that there are columns of these names.

        Raises:
            RoverHilError: A column is missing.
        """
        for name in names:
            if name not in self.names:
                raise self.error(f"{self.path} names no column '{name}': {why}")

    def numbers(self, name: str, *, fix: str = "", is_needed: bool = False) -> Array:
        """Return a column; NaN in the rows of other messages, and where a number is not finite.

        Raises:
            RoverHilError: `is_needed`, and a number is not finite.
        """
        if name == self.time:
            return self.t_us.copy()
        kind, _, key = name.partition(".")
        column = np.full(len(self.t_us), np.nan)
        values = self.fields[kind][key]
        column[self.rows[kind]] = np.where(np.isfinite(values), values, np.nan)
        missing = np.flatnonzero(np.isnan(column))
        if is_needed and missing.size:
            advice = f": {fix}" if fix else ""
            raise self.error(f"{self.where(int(missing[0]))}, column '{name}': it is not a number{advice}")
        return column


def read_flight_log(path: Path, wanted: Collection[str] | None, error: type[RoverHilError]) -> FlightTable:
    """Return the messages in a log: `.ulg` is ULog, `.bin` DataFlash.

    Args:
        path: The file.
        wanted: Columns to read; None for all.
        error: What to raise, here and from the table.

    Raises:
        RoverHilError: The file cannot be read, or is larger than the limits in `drivers.files`.
        ConfigError: A library is missing.
    """
    if path.stat().st_size > FLIGHT_LOG_BYTES:
        raise error(f"{path} is larger than {FLIGHT_LOG_BYTES // MEGABYTE} MB, the limit: divide it")
    suffix = path.suffix.lower()
    with path.open("rb") as file:
        if not file.read(len(BEGINS[suffix])) == BEGINS[suffix]:
            raise error(f"{path} does not begin like a {suffix} log: give another file")
    kinds = None if wanted is None else {name.partition(".")[0] for name in wanted if "." in name}
    is_ulog = suffix == ".ulg"
    fields, oddities = (_read_ulog if is_ulog else _read_dataflash)(path, kinds)
    time = ULOG_TIME if is_ulog else DATAFLASH_TIME
    times = [columns[time] for columns in fields.values()]
    if not times:
        raise error(f"{path} holds no message with a time{_known(kinds)}: is it such a log?")
    t_us = np.concatenate(times)
    if len(t_us) > TABLE_LINES:
        raise error(f"{path} holds more than {TABLE_LINES:,} messages, the limit: divide it")
    order = np.argsort(t_us, kind="stable")
    place = np.empty(len(order), np.intp)
    place[order] = np.arange(len(order))
    ends = np.cumsum([len(each) for each in times])[:-1]
    return FlightTable(
        path=path,
        time=time,
        t_us=t_us[order],
        rows=dict(zip(fields, np.split(place, ends), strict=True)),
        fields=fields,
        oddities={what: count for what, count in oddities.items() if count},
        error=error,
    )


def _known(kinds: Collection[str] | None) -> str:
    return "" if not kinds else f" of {', '.join(sorted(kinds))}"


class _Complaints(io.TextIOBase):
    """Counts the lines that a library prints of a damaged file."""

    def __init__(self) -> None:
        self.count = 0

    def write(self, text: str, /) -> int:
        self.count += text.count("\n")
        if self.count > MOST_COMPLAINTS:
            raise UnreadableError(f"it is damaged in more than {MOST_COMPLAINTS:,} places")
        return len(text)


@contextmanager
def _complaints() -> Iterator[_Complaints]:
    """Catch what the libraries print, which is not for the user."""
    complaints = _Complaints()
    with redirect_stdout(complaints), redirect_stderr(complaints):
        yield complaints


@contextmanager
def _indexed_in_python() -> Iterator[None]:
    """Keep pymavlink from its index in C, which writes what is damaged past `sys.stderr`."""
    before = os.environ.get(FAST_INDEX)
    os.environ[FAST_INDEX] = "0"
    try:
        yield
    finally:
        os.environ.pop(FAST_INDEX)
        if before is not None:
            os.environ[FAST_INDEX] = before


_Found = tuple[dict[str, dict[str, Array]], dict[str, int]]


def _read_ulog(path: Path, kinds: Collection[str] | None) -> _Found:
    try:
        from pyulog import ULog
    except ImportError as problem:
        raise ConfigError(MISSING.format("ULog", "pyulog")) from problem
    # A second sensor of a kind is called kind_1 here, and kind with a number there.
    topics = None if kinds is None else sorted({*kinds, *(kind.rpartition("_")[0] for kind in kinds)} - {""})
    check_formats(path)
    with _complaints() as said:
        log = ULog(str(path), topics)
    fields = {}
    for data in log.data_list:
        kind = f"{data.name}_{data.multi_id}" if data.multi_id else data.name
        if kinds is None or kind in kinds:
            fields[kind] = {name: np.asarray(values, np.float64) for name, values in data.data.items()}
    return fields, {
        "dropouts of the logger": len(log.dropouts),
        "places of damage": max(said.count, int(log.file_corruption)),
    }


def _read_dataflash(path: Path, kinds: Collection[str] | None) -> _Found:
    try:
        from pymavlink.DFReader import DFReader_binary
    except ImportError as problem:
        raise ConfigError(MISSING.format("DataFlash", "pymavlink")) from problem
    types = None if kinds is None else sorted({*kinds, *(kind.rpartition("_")[0] for kind in kinds)} - {""})
    lists: dict[str, dict[str, list[float]]] = {}
    with _complaints() as said, _indexed_in_python():
        log = DFReader_binary(str(path))
        try:
            while (message := log.recv_match(type=types)) is not None:
                _note(message, kinds, lists)
        finally:
            log.filehandle.close()
    fields = {
        kind: {name: np.array(values, np.float64) for name, values in columns.items()}
        for kind, columns in lists.items()
    }
    return fields, {"places of damage": said.count}


def _note(message: object, kinds: Collection[str] | None, lists: dict[str, dict[str, list[float]]]) -> None:
    """Append the numbers of a message of DataFlash to those of its kind."""
    values = message.to_dict()  # type: ignore[attr-defined]
    kind = values.pop("mavpackettype")
    instance = message.fmt.instance_field  # type: ignore[attr-defined]
    if instance is not None and values.get(instance):
        kind = f"{kind}_{values[instance]}"
    if DATAFLASH_TIME not in values or (kinds is not None and kind not in kinds):
        return
    numbers = {name: float(value) for name, value in values.items() if isinstance(value, int | float)}
    columns = lists.setdefault(kind, {name: [] for name in numbers})
    for name, column in columns.items():
        column.append(numbers.get(name, np.nan))
