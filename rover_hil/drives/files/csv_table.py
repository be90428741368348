"""Read a CSV table, plain or packed: names and perhaps units in its header, numbers below."""

import csv
import io
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

WORDS = {"": math.nan, "true": 1.0, "false": 0.0}
DELIMITERS = "\t;,"
MOST_HEADER_LINES = 3
CELL_SHOWN = 40
"""Characters of a wrong cell in a message."""
DECIMAL_COMMA = re.compile(r"^([+-]?\d*),(\d+(?:[eE][+-]?\d+)?)$")
DECIMAL_POINT = re.compile(r"^[+-]?\d*\.\d+(?:[eE][+-]?\d+)?$")
THOUSANDS = re.compile(r"^[+-]?[1-9]\d{0,2},\d{3}$")
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

        Args:
            name: Of the column.
            fix: What to do about a wrong cell, for the message.
            is_needed: Every cell must hold a finite number.

        Raises:
            RoverHilError: A cell holds no number.
        """
        cells = self.text(name)
        numbers = [_number(cell) for cell in cells]
        for row, number in enumerate(numbers):
            if number is None or (is_needed and not math.isfinite(number)):
                advice = f": {fix}" if fix else ""
                if "," in cells[row]:
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
        delimiter: Between cells, None for the first of tab, semicolon and comma in the file's first line; one
            at the end of every line is left out.
        header_lines: 1, with units in brackets behind the names; 3: long names, units, names; None: all above
            the first number, the last holds the names; without any the columns are called 1, 2 and so on.

    Raises:
        RoverHilError: The file cannot be read, is shorter than its header, has a name twice, or is larger
            than the limits in `drivers.files`.
    """
    text = _open_text(path, error)
    try:
        first = text.readline()
        text.seek(0)
        if delimiter is None:
            delimiter = next((each for each in DELIMITERS if each in first), ",")
        lines, rows = _read_rows(text, delimiter)
    except (csv.Error, UnicodeDecodeError, _TooLargeError) as problem:
        raise error(f"cannot read {path} as a table: {problem}") from problem
    if delimiter != ",":
        rows = _with_decimal_points(rows)
    if first.rstrip().endswith(delimiter):
        rows = [cells[:-1] if cells[-1:] == ("",) else cells for cells in rows]
    count = _header_lines(rows) if header_lines is None else header_lines
    if len(rows) < count > 1:
        raise error(f"{path} has {len(rows)} lines, no header of {count}: is it such a file?")
    width = len(rows[0]) if rows else 0
    header = rows[:count] or [tuple(map(str, range(1, width + 1))) if count == 0 else ()]
    named = [_name_and_unit(cell) for cell in header[-1]]
    for name, times in Counter(name for name, _ in named).items():
        if name and times > 1:
            raise error(f"{path} has the column '{name}' twice: leave one out")
    units = {name: unit for name, unit in named if unit is not None}
    if count > 1:
        units |= dict(zip((name for name, _ in named), header[-2], strict=False))
    return CsvTable(
        path=path,
        names=[name for name, _ in named],
        units=units,
        header_line=lines[count - 1] if count and rows else 1,
        lines=lines[count:],
        rows=rows[count:],
        error=error,
    )


def _with_decimal_points(rows: Sequence[tuple[str, ...]]) -> list[tuple[str, ...]]:
    """Return the rows, with a point in the numbers of columns that have decimal commas.

    1,234 alone may be a thousand: a column has decimal commas where another of its numbers cannot be one, and
    none has a decimal point.
    """
    commas: dict[int, bool] = {}
    for cells in rows:
        for place, cell in enumerate(cells):
            if "," in cell and DECIMAL_COMMA.match(cell):
                commas[place] = commas.get(place, False) or not THOUSANDS.match(cell)
    decimal = {place for place, is_sure in commas.items() if is_sure}
    for cells in rows if decimal else ():
        decimal -= {place for place in decimal if place < len(cells) and DECIMAL_POINT.match(cells[place])}
    if not decimal:
        return list(rows)
    return [
        tuple(
            [
                DECIMAL_COMMA.sub(r"\1.\2", cell) if place in decimal else cell
                for place, cell in enumerate(cells)
            ]
        )
        for cells in rows
    ]


def _header_lines(rows: Sequence[Sequence[str]]) -> int:
    """Return the number of rows above the first number."""
    for count, cells in enumerate(rows[: MOST_HEADER_LINES + 1]):
        if any(cell.lower() not in WORDS and _number(cell) is not None for cell in cells):
            return count
    return len(rows)


def _number(cell: str) -> float | None:
    try:
        return float(cell)
    except ValueError:
        return WORDS.get(cell.lower())


def header_lines(path: Path, count: int, error: type[RoverHilError] = LogError) -> list[str]:
    """Return the first lines of a `.csv` or `.csv.gz` file; fewer where it has fewer or is no text.

    Raises:
        RoverHilError: The file cannot be read.
    """
    text = _open_text(path, error)
    try:
        return [line for _, line in zip(range(count), text, strict=False)]
    except UnicodeDecodeError:
        return []


def _name_and_unit(cell: str) -> tuple[str, str | None]:
    match = NAME_AND_UNIT.match(cell)
    return (cell, None) if match is None else (match["name"], match["unit"])


class _TooLargeError(ValueError):
    """A table has more lines or cells than the limits allow."""


def _read_rows(text: io.TextIOWrapper, delimiter: str) -> tuple[list[int], list[tuple[str, ...]]]:
    """Return line number and cells of each row that is not blank.

    Raises:
        _TooLargeError: There are too many.
        csv.Error, UnicodeDecodeError: The text is not a table.
    """
    reader = csv.reader(text, delimiter=delimiter, skipinitialspace=True)
    lines: list[int] = []
    # Tuples of text, because lists of them keep the garbage collector busy.
    rows: list[tuple[str, ...]] = []
    cells = 0
    for row in reader:
        cells += len(row)
        if cells > TABLE_CELLS or len(rows) >= TABLE_LINES:
            raise _TooLargeError(
                f"it has more than {TABLE_LINES:,} lines or {TABLE_CELLS:,} cells, the limits: divide it"
            )
        if len(row) > TABLE_COLUMNS:
            raise _TooLargeError(
                f"line {reader.line_num} has {len(row):,} cells, more than {TABLE_COLUMNS:,}, the limit: "
                "leave columns out"
            )
        if row:
            lines.append(reader.line_num)
            rows.append(tuple([cell.strip() for cell in row]))
    return lines, rows


def _open_text(path: Path, error: type[RoverHilError]) -> io.TextIOWrapper:
    try:
        raw = read_packed_bytes(path, TABLE_BYTES)
    except OSError as problem:
        reason = problem.strerror or str(problem)
        raise error(f"cannot read {path}: {reason}: give a .csv or .csv.gz file") from problem
    return io.TextIOWrapper(io.BytesIO(raw), "utf-8-sig")
