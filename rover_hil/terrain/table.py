"""A table of results: printed, as CSV, and as JSON records, from one definition."""

import csv
import io
import math
from collections.abc import Sequence
from typing import NamedTuple

from rich import box
from rich.table import Table as RichTable

Cell = float | str | bool | None


class Table(NamedTuple):
    """Rows of numbers and words.

    Attributes:
        name: Of the CSV file, without ending.
        title: Above the table.
        columns: Names with units, also the keys of records.
        rows: One cell per column; None where there is no value.
    """

    name: str
    title: str
    columns: tuple[str, ...]
    rows: Sequence[tuple[Cell, ...]]

    def records(self) -> list[dict[str, Cell]]:
        """Return one dictionary per row."""
        return [dict(zip(self.columns, row, strict=True)) for row in self.rows]

    def csv_text(self) -> str:
        """Return the table as CSV, numbers in full precision."""
        stream = io.StringIO()
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(self.columns)
        writer.writerows([_exact(cell) for cell in row] for row in self.rows)
        return stream.getvalue()

    def rich(self) -> RichTable:
        """Return the table for the terminal."""
        table = RichTable(title=self.title, title_justify="left", box=box.SIMPLE, padding=0)
        for column in self.columns:
            table.add_column(column.replace("_", " "), justify="right")
        for row in self.rows:
            table.add_row(*(shown(cell) for cell in row))
        return table


def number(value: float) -> float | None:
    """Return a number, or None for NaN."""
    return None if math.isnan(value) else float(value)


def shown(cell: Cell) -> str:
    """Return a cell for the eye."""
    if cell is None:
        return "–"
    if isinstance(cell, bool):
        return "yes" if cell else ""
    return cell if isinstance(cell, str) else f"{cell:.4g}"


def _exact(cell: Cell) -> str:
    if cell is None:
        return ""
    if isinstance(cell, bool):
        return "true" if cell else "false"
    return cell if isinstance(cell, str) else repr(cell)
