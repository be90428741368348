"""Ground truth and positions of a drive on a CAN bus: its signals, or tables with the same clock."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Self

import numpy as np
from cantools.database.can import Database, Message
from pydantic import model_validator

from drivers.can_wheels.mapping_file import read_dbc
from drivers.can_wheels.messages import bus_id
from drivers.errors import LogError
from drivers.settings import Settings, read_toml
from rover_hil.config import validated
from rover_hil.drives.arrays import Array
from rover_hil.drives.files.can_frames import LARGEST_PAYLOAD, CanFrames
from rover_hil.drives.files.can_signals import MessageFrames
from rover_hil.drives.files.flight_table import FlightTable
from rover_hil.drives.formats.table.columns import Column, Columns, FixColumns, TimeColumn, TruthColumns
from rover_hil.drives.formats.table.drive_table import DriveTable, ImportedRows
from rover_hil.drives.formats.table.places import take_fixes, take_truth

TIME = "time"


class CanPlaces(Settings):
    """What is known of the places of a drive.

    Attributes:
        fixes: Poses or places that correct the estimate; a column is `Message.Signal`, or one of a table in
            `file`, beside the log.
        truth: True pose, likewise.
    """

    fixes: FixColumns | None = None
    truth: TruthColumns | None = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.fixes is None and self.truth is None:
            raise ValueError("give [truth] or [fixes]")
        for name, place in (("fixes", self.fixes), ("truth", self.truth)):
            if place is not None and place.file is not None and place.time is None:
                raise ValueError(f"{name}: give the time of the table {place.file}")
        return self


def read_places(path: Path) -> CanPlaces:
    """Return the content of a file of places.

    Raises:
        ConfigError: It cannot be read, or holds mistakes; one line per mistake.
    """
    return validated(CanPlaces, read_toml(path, f"file of places {path}", "correct the path"), str(path))


def drive_of_places(
    frames: CanFrames, places: CanPlaces, dbc_files: Sequence[Path], span_s: tuple[float, float]
) -> ImportedRows:
    """Return the rows with places of a drive, in the order of their times.

    Args:
        frames: The log; tables are beside it.
        places: What is known.
        dbc_files: With the signals.
        span_s: Times of the first and the last frame of the rover.

    Raises:
        LogError: A signal or a column is missing, or holds something wrong.
        ConfigError: A DBC file cannot be read.
    """
    source = _Signals(frames, places, [read_dbc(path) for path in dict.fromkeys(dbc_files)], span_s)
    if places.fixes is not None:
        take_fixes(source, places.fixes)
    if places.truth is not None:
        take_truth(source, places.truth)
    source.drive.rows.sort(key=lambda row: row.t_ns)
    return source.drive


class _Signals(DriveTable):
    """The named signals of a log, as a table with a row for each of their frames, and one at the end."""

    def __init__(
        self,
        frames: CanFrames,
        places: CanPlaces,
        databases: Sequence[Database],
        span_s: tuple[float, float],
    ) -> None:
        time = TimeColumn(column=TIME)
        self.columns = Columns.model_construct(time=time, fixes=places.fixes, truth=places.truth)
        self.drive = ImportedRows()
        self._others = {}
        self._start_s, end_s = span_s
        messages = {
            message.name: message
            for database in reversed(databases)
            for message in database.messages
            if message.name in _messages_of(places)
        }
        table = _table_of(frames, list(messages.values()), end_s)
        self.table = table
        self.used = np.ones(len(table.t_us), np.bool_)
        self.t_ns = self.nanoseconds(table.t_us * 1e-6)


def _messages_of(places: CanPlaces) -> set[str]:
    """Return the names of the messages whose signals are columns."""
    own = [place for place in (places.fixes, places.truth) if place is not None and place.file is None]
    columns = [value for place in own for _, value in place if isinstance(value, Column)]
    return {str(column.column).partition(".")[0] for column in columns}


def _table_of(frames: CanFrames, messages: Sequence[Message], end_s: float) -> FlightTable:
    by_identifier = frames.by_identifier()
    places, fields = [], {}
    for message in messages:
        if message.length > LARGEST_PAYLOAD:
            raise LogError(
                f"{frames.path}: message '{message.name}' is longer than 8 bytes: name another one"
            )
        own = by_identifier.get(bus_id(message))
        if own is None:
            raise LogError(f"{frames.path}: no frame of message '{message.name}' is in it: name another one")
        decoded = MessageFrames(message, frames.lengths[own], frames.data[own])
        fields[message.name] = dict(_values_of(message, decoded))
        places.append(own)
    times = [*(frames.t_s[own] * 1e6 for own in places), np.array([end_s * 1e6])]
    t_us = np.concatenate(times)
    order = np.argsort(t_us, kind="stable")
    row_of = np.empty(len(order), np.intp)
    row_of[order] = np.arange(len(order))
    parts = np.split(row_of, np.cumsum([len(each) for each in times])[:-1])
    rows = dict(zip(fields, parts, strict=False))
    return FlightTable(path=frames.path, time=TIME, t_us=t_us[order], rows=rows, fields=fields)


def _values_of(message: Message, decoded: MessageFrames) -> Iterator[tuple[str, Array]]:
    for signal in message.signals:
        try:
            yield signal.name, decoded.values(signal.name)
        except KeyError:  # the DBC file does not say where or when it is
            continue
