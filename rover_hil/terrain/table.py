"""A table of results: printed, as CSV, and as JSON records, from one definition."""

import csv
import io
import math
from collections.abc import Sequence
from typing import NamedTuple

from rich import box
from rich.table import Table as RichTable

Cell = float | str | bool | None
REASON = "reason"


class Table(NamedTuple):
    """Rows of numbers and words.

    Attributes:
        name: Of the CSV file, without ending.
        title: Above the table.
        columns: Names with units, also the keys of records.
        rows: One cell per column; None where there is no value. A last column `reason` says why, and is empty
            where there is nothing to say.
        keys: How many of the first columns name a row.
    """

    name: str
    title: str
    columns: tuple[str, ...]
    rows: Sequence[tuple[Cell, ...]]
    keys: int = 1

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
        """Return the table for the terminal, without reasons: see `notes`."""
        table = RichTable(title=self.title, title_justify="left", box=box.SIMPLE, padding=0)
        shown_columns = [column for column in self.columns if column != REASON]
        for column in shown_columns:
            table.add_column(_words(column), justify="right")
        for row in self.rows:
            table.add_row(*(shown(cell) for cell in row[: len(shown_columns)]))
        return table

    def notes(self) -> list[str]:
        """Return each reason in the table once, with the rows that it is for."""
        names: dict[str, list[str]] = {}
        for row in self.rows if self.columns[-1] == REASON else ():
            if row[-1]:
                names.setdefault(str(row[-1]), []).append(self._name(row))
        return [f"{', '.join(rows)}: {reason}" for reason, rows in names.items()]

    def _name(self, row: tuple[Cell, ...]) -> str:
        """Return what names a row: a text, or numbers with the names of their columns."""
        if isinstance(row[0], str):
            return row[0]
        named = zip(self.columns[: self.keys], row, strict=False)
        return " and ".join(f"{_words(column)} {shown(cell)}" for column, cell in named)


def _words(column: str) -> str:
    return column.replace("_", " ")


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
