"""The table of a drive: its columns in SI units, with their data-quality findings."""

from collections.abc import Iterator, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from controllers.estimation.settings import FilterSettings
from drivers.clock import NANOSECONDS_PER_SECOND
from drivers.errors import LogError
from drivers.settings import Settings
from rover_hil.config import Config
from rover_hil.drives.arrays import Array, Flags
from rover_hil.drives.clocks import (
    Clock,
    back_fault,
    counted_anew,
    set_ahead,
    spread,
    unit_fault,
    unset_rows,
    unwrapped,
)
from rover_hil.drives.files.array_table import Table, read_table
from rover_hil.drives.files.csv_table import CsvTable
from rover_hil.drives.files.flight_table import FlightTable
from rover_hil.drives.formats.rosbag.joints import REGULAR
from rover_hil.drives.formats.table.columns import (
    SI_PER_UNIT,
    AngleColumn,
    Column,
    Columns,
    ImuColumns,
    PlaceColumns,
    TimeColumn,
    angle_unit,
)
from rover_hil.drives.formats.table.unused import unused_parts
from rover_hil.drives.quality.oddities import NO_FAULT, REPAIRED, TOLD, Oddity

FIX = "correct the cell or the file of columns"
LONGEST_S = 1e6
"""A drive is not longer."""
LONGEST_GAP_S = 1.0
"""In a longer gap of the table the path of the rover is worth a word."""


class Row(NamedTuple):
    """What was measured at one time.

    Attributes:
        t_ns: Since the first row.
        section: `wheels`, `increments`, `imu`, `fixes` or `truth`.
        values: By quantity; one number for each wheel, else one for each axis.
    """

    t_ns: int
    section: str
    values: Mapping[str, Sequence[float]]


@dataclass
class ImportedRows:
    """What was read of a table.

    Attributes:
        rows: In the order of their times.
        quantities: Which the wheels have.
        filter: Noise of the sensors, where the drive itself shows it; else None.
        is_gyro_coarse: Whether its readings repeat although it is alive, see `COARSE_RAD_S`.
        notes: What a user must know of it, one sentence each.
        oddities: Data-quality findings, and what was done about each.
    """

    rows: list[Row] = field(default_factory=list)
    quantities: tuple[str, ...] = ("Position",)
    filter: FilterSettings | None = None
    is_gyro_coarse: bool = False
    notes: list[str] = field(default_factory=list)
    oddities: list[Oddity] = field(default_factory=list)


class DriveTable:
    """The table of a drive: its columns in SI units, and the rows that were made of them.

    Args:
        path: The table.
        columns: What its columns hold.
        rover: Its wheels and their limits.

    Attributes:
        columns: As given.
        rover: As given.
        table: The table without a last row that is cut.
        used: Which of its rows are not repeated.
        t_ns: Time of each used row, since the first.
        drive: What was read so far.

    Raises:
        LogError: The table cannot be read; names file, row, column and fix.
    """

    def __init__(self, path: Path, columns: Columns, rover: Config) -> None:
        self.columns = columns
        self.rover = rover
        self.table = self.open_table(path, columns.time)
        self.drive = ImportedRows()
        self._others: dict[tuple[str, TimeColumn | None], Table] = {}
        if isinstance(self.table, CsvTable):
            self.table = self._with_set_clock(self._without_cut_row(self.table))
        if isinstance(self.table, FlightTable):
            oddities = self.table.oddities.items()
            self.drive.oddities += [Oddity(what=what, count=count, done=TOLD) for what, count in oddities]
        times = self.times_s(self.table, columns.time)
        self._start_s = float(times[0])
        values = self._values()
        self.used = self._not_repeated(times, values)
        times = times[self.used]
        for judge in (spread, set_ahead):
            clock = judge(times, values[self.used])
            self._note_clock(clock)
            times = clock.times_s
        self._elapsed_s = np.diff(times)
        self.t_ns = self.nanoseconds(times)

    def open_table(self, path: Path, time: TimeColumn) -> Table:
        """Return a table with the columns that are named, of the length of its times."""
        columns = self.columns
        named = {column.column for column in _named_columns(columns)}
        wanted = (
            {name for name in named if isinstance(name, str)}
            if not any(isinstance(name, int) for name in named)
            else None
        )
        return read_table(
            path,
            delimiter=columns.delimiter,
            header_lines=columns.header_lines,
            wanted=wanted,
            time=time.column,
        )

    def _without_cut_row(self, table: CsvTable) -> CsvTable:
        """Return a table without a last row that has fewer cells than all others: the file was cut in it.

        Raises:
            LogError: A row has more cells than there are names.
        """
        for row, cells in enumerate(table.rows):
            if len(cells) > len(table.names):
                raise LogError(
                    f"{table.where(row)} has {len(cells)} cells, more than the {len(table.names)} names: "
                    "correct the row, or give the delimiter in the file of columns"
                )
        widths = set(map(len, table.rows[:-1]))
        if len(widths) != 1 or len(table.rows[-1]) >= min(widths):
            return table
        self.drive.oddities.append(Oddity(what="a last row that is cut", where=table.where(-1), count=1))
        return replace(table, rows=table.rows[:-1], lines=table.lines[:-1])

    def _with_set_clock(self, table: CsvTable) -> CsvTable:
        """Return a table without rows of time 0 among others."""
        name = self.name_of(table, self.columns.time)
        is_unset = unset_rows(table.numbers(name, fix=FIX, is_needed=True))
        if not is_unset.any():
            return table
        what = "rows of time 0 among others: their clock was not set"
        self.drive.oddities.append(Oddity(what=what, where=name, count=int(is_unset.sum())))
        kept = np.flatnonzero(~is_unset).tolist()
        return replace(
            table, rows=[table.rows[row] for row in kept], lines=[table.lines[row] for row in kept]
        )

    def note_rows(self) -> None:
        """Note where rows or cells are missing."""
        drive, elapsed_s = self.drive, self._elapsed_s
        if len(elapsed_s) and elapsed_s.max() > LONGEST_GAP_S:
            drive.notes.append(
                f"no row for up to {elapsed_s.max():.1f} s: the path meanwhile is not measured"
            )
        if isinstance(self.table, FlightTable):
            return
        positive_s = elapsed_s[elapsed_s > 0.0]
        usual_s = float(np.median(positive_s)) if len(positive_s) else 0.0
        # Where the rows come regularly, a gap of nearly whole periods is rows that are missing.
        if len(positive_s) and np.quantile(positive_s, 0.9) < REGULAR * usual_s:
            missing = int(np.round(positive_s[positive_s > REGULAR * usual_s] / usual_s - 1.0).sum())
            if missing:
                drive.oddities.append(
                    Oddity(what="rows missing between others", count=missing, done=NO_FAULT)
                )
        if isinstance(self.table, CsvTable):
            drive.oddities += self._unused(self.table)
        for column in _all_columns(self.columns):
            name = self.name_of(self.table, column)
            empty = int(np.isnan(self.table.numbers(name, fix=FIX)).sum())
            if empty:
                drive.oddities.append(Oddity(what="empty cells", where=name, count=empty, done=NO_FAULT))

    def _unused(self, table: CsvTable) -> Iterator[Oddity]:
        parts = [
            part for part in (self.columns.imu, self.columns.fixes, self.columns.truth) if part is not None
        ]
        used = list(_all_columns(self.columns))
        for part in parts:
            if part.file == table.path.name:  # the same table once more, with times of its own
                used += [value for _, value in part if isinstance(value, Column)]
        files = [part.file for part in parts if part.file is not None]
        return unused_parts(table, {self.name_of(table, column) for column in used}, files)

    def name_of(self, table: Table, column: Column) -> str:
        """Return the name of a column given by name or number.

        Raises:
            LogError: The table has no such column.
        """
        name = column.column
        if isinstance(name, int):
            if name > len(table.names):
                raise LogError(
                    f"{table.path} has {len(table.names)} columns, no column {name}: correct the file of "
                    "columns, or give the delimiter there"
                )
            name = table.names[name - 1]
        known = ", ".join(list(table.names)[:20])
        table.require((name,), f"it has {known}; correct the file of columns, or give the delimiter there")
        return name

    def numbers(self, column: Column, *, is_needed: bool = False) -> Array:
        """Return the numbers of a column in the used rows, with its sign, in its unit."""
        name = self.name_of(self.table, column)
        numbers: Array = column.sign * self.table.numbers(name, fix=FIX, is_needed=is_needed)[self.used]
        return numbers

    def times_s(self, table: Table, time: TimeColumn) -> Array:
        """Return the times of all rows, which never run back.

        Raises:
            LogError: They do, or are not the times of a drive.
        """
        name = self.name_of(table, time)
        times_s = time.sign * SI_PER_UNIT[time.unit] * table.numbers(name, fix=FIX, is_needed=True)
        for judge in (unwrapped, counted_anew):
            clock = judge(times_s)
            self._note_clock(clock)
            times_s = clock.times_s
        back = np.flatnonzero(np.diff(times_s) < 0.0)
        if back.size:
            row = int(back[0]) + 1
            if fault := back_fault(times_s):
                raise LogError(f"{table.path}, column '{name}': {fault}")
            raise LogError(
                f"{table.where(row)}, column '{name}': the time runs back by "
                f"{times_s[row - 1] - times_s[row]:.6g} s, {back.size} times in all: divide the file there, "
                "or name another column"
            )
        fault = unit_fault(times_s, time.unit) if table is self.table and isinstance(table, CsvTable) else ""
        if fault:
            raise LogError(f"{table.path}, column '{name}': {fault}: correct the unit of the time")
        if times_s[-1] - times_s[0] > LONGEST_S:
            raise LogError(
                f"{table.path}, column '{name}': {times_s[-1] - times_s[0]:.3g} s from the first row to the "
                "last, more than 11 days: correct its unit, which may be ms, us or ns"
            )
        return times_s

    def _note_clock(self, clock: Clock) -> None:
        self.drive.oddities += [
            Oddity(what=what, count=count, done=REPAIRED) for what, count in clock.findings
        ]

    def nanoseconds(self, times_s: Array) -> list[int]:
        """Return times since the first row of the drive."""
        numbers: list[int] = np.round((times_s - self._start_s) * NANOSECONDS_PER_SECOND).astype(int).tolist()
        return numbers

    def _values(self) -> Array:
        """Return the numbers of all rows but their time, one column for each that is used."""
        table, (_, *columns) = self.table, _all_columns(self.columns)
        names = [self.name_of(table, column) for column in columns]
        return np.column_stack([table.numbers(name, fix=FIX) for name in names])

    def _not_repeated(self, times_s: Array, values: Array) -> Flags:
        """Return which rows are not the row before once more, time included."""
        same = (np.diff(times_s) == 0.0) & np.all(np.diff(values, axis=0) == 0.0, axis=1)
        if same.any():
            self.drive.oddities.append(Oddity(what="rows that repeat the one before", count=int(same.sum())))
        return np.concatenate(([True], ~same))

    def increments(self, column: Column, unit: float) -> Array:
        """Return increments in SI units; each is needed, because what one held is in no other row."""
        return self.numbers(column, is_needed=True) * unit

    def angle_rad(self, column: AngleColumn) -> Array:
        """Return the angles of a column from its zero."""
        return (self.numbers(column) - column.sign * column.zero) * angle_unit(column)

    def table_of(self, part: PlaceColumns | ImuColumns) -> Table:
        """Return the table in which a sensor is: that of the drive, or one of its own."""
        if part.file is None:
            return self.table
        key = part.file, part.time
        if key not in self._others:
            path = self.table.path.parent / part.file
            self._others[key] = self.open_table(path, part.time or self.columns.time)
        return self._others[key]

    def of_sensor(self, part: ImuColumns) -> "DriveTable":
        """Return the rows of a sensor's own table that are within the drive; itself, where it has none.

        Raises:
            LogError: None is.
        """
        if part.file is None:
            return self
        other = copy(self)
        other.table = self.table_of(part)
        times_s = self.times_s(other.table, part.time or self.columns.time)
        t_ns = np.array(self.nanoseconds(times_s))
        within = (t_ns >= 0) & (t_ns <= self.t_ns[-1])
        if not within.any():
            raise LogError(
                f"{other.table.path}: no row of [imu] lies between the first and the last row of "
                f"{self.table.path}: correct the time columns or their units"
            )
        if not within.all():
            outside = "rows of [imu] before the first or behind the last row"
            self.drive.oddities.append(Oddity(what=outside, count=int((~within).sum())))
        other.used = within
        other.t_ns = t_ns[within].tolist()
        return other

    def add(
        self, section: str, tables: Mapping[str, Sequence[Sequence[float]]], held: Flags | None = None
    ) -> None:
        """Add a row for each row of the table that holds a number."""
        names = list(tables)
        rows = enumerate(zip(self.t_ns, *tables.values(), strict=True))
        self.drive.rows.extend(
            Row(t_ns, section, dict(zip(names, values, strict=True)))
            for place, (t_ns, *values) in rows
            if held is None or held[place]
        )


def _all_columns(columns: Columns) -> Iterator[Column]:
    """Yield all columns of the table of the drive."""
    yield from _named_columns(columns, is_drive=True)


def _named_columns(columns: Columns, *, is_drive: bool = False) -> Iterator[Column]:
    """Yield all columns, of other tables too unless `is_drive`."""
    yield columns.time
    groups: list[Settings | None] = [*columns.wheel, columns.increments, columns.body, columns.tricycle]
    groups += [
        part
        for part in (columns.imu, columns.fixes, columns.truth)
        if part is not None and not (is_drive and part.file is not None)
    ]
    for group in groups:
        for _, value in group or ():
            if isinstance(value, Column):
                yield value
