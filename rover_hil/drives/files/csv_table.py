"""Read a CSV table, plain or packed: names and perhaps units in its header, numbers below."""

import csv
import math
import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from drivers.errors import LogError, RoverHilError
from drivers.files import TABLE_BYTES, TABLE_CELLS, TABLE_COLUMNS, TABLE_LINES, read_packed_bytes
from rover_hil.drives.arrays import Array
from rover_hil.drives.files.cell_numbers import clock_seconds, number_of, with_decimal_points
from rover_hil.drives.files.csv_layout import (
    SAMPLE_BYTES,
    Header,
    as_text,
    header_of,
    likely_delimiter,
)
from rover_hil.drives.files.unreadable import UnreadableError

CELL_SHOWN = 40
"""Characters of a wrong cell in a message."""
NAME_AND_UNIT = re.compile(r"^(?P<name>[^\[\(]+?)\s*(?:[\[\(](?P<unit>[^\]\)]*)[\]\)])?$")
"""`current [A]` or `current (A)`."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CsvTable:
    """The cells of a table; columns are parsed on demand.

    Attributes:
        names: Of the columns, in order.
        units: By name, where the header states one.
        header_line: Line of the names, from 1.
        lines: The line of each row in the file, n of them.
        rows: Cells of each row, without the spaces around them, n of them.
        error: Raised when something is wrong with the table.
    """

    path: Path
    names: Sequence[str]
    units: Mapping[str, str]
    header_line: int
    lines: Sequence[int]
    rows: Sequence[Sequence[str]]
    error: type[RoverHilError]

    def where(self, row: int) -> str:
        """Return the place of a row, for messages."""
        return f"{self.path} line {self.lines[row]}"

    def require(self, names: Iterable[str], why: str) -> None:
        """Check that there are columns of these names, and rows.

        Raises:
            RoverHilError: A column is missing, or there are no rows.
        """
        for name in names:
            if name not in self.names:
                raise self.error(f"{self.path} line {self.header_line} names no column '{name}': {why}")
        if not self.rows:
            raise self.error(f"{self.path} holds no lines below its header: {why}")

    def check_shape(self, fix: str) -> None:
        """Check that all rows are as long as the header.

        Raises:
            RoverHilError: They are not.
        """
        width = len(self.names)
        for row, cells in enumerate(self.rows):
            if len(cells) != width:
                raise self.error(f"{self.where(row)} has {len(cells)} cells, its header {width}: {fix}")

    def text(self, name: str) -> list[str]:
        """Return the cells of a column; empty where a row is too short."""
        place = list(self.names).index(name)
        return [cells[place] if place < len(cells) else "" for cells in self.rows]

    def numbers(self, name: str, *, fix: str = "", is_needed: bool = False) -> Array:
        """Return a column as numbers; NaN where a cell is empty or not finite, 1 and 0 for true and false.

        Dates and times of day become seconds.

        Args:
            name: Of the column.
            fix: What to do about a wrong cell, for the message.
            is_needed: Every cell must hold a finite number.

        Raises:
            RoverHilError: A cell holds no number.
        """
        cells = self.text(name)
        numbers = [number_of(cell) for cell in cells]
        if None in numbers and (times_s := clock_seconds(cells)) is not None:
            numbers = list(times_s)
        for row, number in enumerate(numbers):
            if number is None or (is_needed and not math.isfinite(number)):
                advice = f": {fix}" if fix else ""
                if ":" in cells[row] or "/" in cells[row]:
                    advice += "; write dates as 2024-05-31T12:34:56.789, times of day as 12:34:56.789"
                elif "," in cells[row]:
                    advice += "; a comma may divide thousands or decimals: write decimals with a point"
                shown = cells[row][:CELL_SHOWN]
                raise self.error(f"{self.where(row)}, column '{name}': '{shown}' is not a number{advice}")
        column = np.array(numbers, np.float64)
        column[~np.isfinite(column)] = np.nan
        return column


def read_csv(
    path: Path,
    error: type[RoverHilError] = LogError,
    *,
    delimiter: str | None = ",",
    header_lines: int | None = 1,
) -> CsvTable:
    """Return the table in a `.csv` or `.csv.gz` file; blank lines are left out.

    Args:
        path: The file.
        error: What to raise, here and from the table.
        delimiter: Between cells, None for the one of tab, semicolon, comma and spaces that makes the most
            cells numbers; one at the end of every line is left out.
        header_lines: Lines above the numbers, None for all above the first row of numbers. The last holds the
            names, or the last but one, where the last holds units; units may stand in brackets behind the
            names, too. Without any the columns are called 1, 2 and so on.

    Raises:
        RoverHilError: The file cannot be read, is shorter than its header, has a name twice, or is larger
            than the limits in `drivers.files`.
    """
    raw = _read_raw(path, error)
    try:
        if delimiter is None:
            delimiter = likely_delimiter(as_text(raw).read(SAMPLE_BYTES))
        lines, rows = _read_rows(as_text(raw), delimiter)
    except UnreadableError as problem:
        raise error(f"cannot read {path} as a table: {problem}") from problem
    except csv.Error as problem:
        raise error(
            f"cannot read {path} as a table: its quotes or line ends are damaged: save it again"
        ) from problem
    header = header_of(rows, header_lines)
    if len(rows) < header.lines > 1:
        raise error(f"{path} has {len(rows)} lines, no header of {header.lines}: is it such a file?")
    names, units = _names_of(rows, header)
    if names[-1:] == [""] or delimiter == " ":
        rows = [cells[:-1] if cells[-1:] == ("",) else cells for cells in rows]
        names = names[:-1] if names[-1:] == [""] else names
    for name, times in Counter(names).items():
        if name and times > 1:
            raise error(f"{path} has the column '{name}' twice: leave one out")
    data = rows[header.lines :]
    return CsvTable(
        path=path,
        names=names,
        units=units,
        header_line=1 if header.names is None or not rows else lines[header.names],
        lines=lines[header.lines :],
        rows=with_decimal_points(data) if delimiter != "," or b'"' in raw else data,
        error=error,
    )


def _names_of(rows: Sequence[Sequence[str]], header: Header) -> tuple[list[str], dict[str, str]]:
    """Return the names of the columns, and the units by name."""
    if header.names is None:
        return [str(number) for number in range(1, len(rows[0]) + 1)] if rows else [], {}
    named = [_name_and_unit(cell) for cell in rows[header.names]]
    names = [name for name, _ in named]
    units = {name: unit for name, unit in named if unit is not None}
    if header.units is not None:
        units |= {
            name: unit.strip("[]()") for name, unit in zip(names, rows[header.units], strict=False) if unit
        }
    return names, units


def header_lines(path: Path, count: int, error: type[RoverHilError] = LogError) -> list[str]:
    """Return the first lines of a `.csv` or `.csv.gz` file; fewer where it has fewer or is no text.

    Raises:
        RoverHilError: The file cannot be read.
    """
    try:
        return [line for _, line in zip(range(count), as_text(_read_raw(path, error)), strict=False)]
    except UnreadableError:
        return []


def _name_and_unit(cell: str) -> tuple[str, str | None]:
    match = NAME_AND_UNIT.match(cell)
    return (cell, None) if match is None else (match["name"], match["unit"])


def _read_rows(text: Iterable[str], delimiter: str) -> tuple[list[int], list[tuple[str, ...]]]:
    """Return line number and cells of each row that is not blank.

    Raises:
        UnreadableError: There are too many.
        csv.Error: The text is not a table.
    """
    source = (line.strip() for line in text) if delimiter == " " else text
    reader = csv.reader(source, delimiter=delimiter, skipinitialspace=True)
    lines: list[int] = []
    # Tuples of text, because lists of them keep the garbage collector busy.
    rows: list[tuple[str, ...]] = []
    cells = 0
    for row in reader:
        cells += len(row)
        if cells > TABLE_CELLS or len(rows) >= TABLE_LINES:
            raise UnreadableError(
                f"it has more than {TABLE_LINES:,} lines or {TABLE_CELLS:,} cells, the limits: divide it"
            )
        if len(row) > TABLE_COLUMNS:
            raise UnreadableError(
                f"line {reader.line_num} has {len(row):,} cells, more than {TABLE_COLUMNS:,}, the limit: "
                "leave columns out"
            )
        if row:
            lines.append(reader.line_num)
            rows.append(tuple([cell.strip() for cell in row]))
    return lines, rows


def _read_raw(path: Path, error: type[RoverHilError]) -> bytes:
    try:
        return read_packed_bytes(path, TABLE_BYTES)
    except OSError as problem:
        reason = problem.strerror or str(problem)
        raise error(f"cannot read {path}: {reason}: give a .csv or .csv.gz file") from problem
