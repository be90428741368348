"""Make the pages of recorded figures from their CSV files."""

import csv
from pathlib import Path

from benchmarks.results import TITLES

FOLDER = Path(__file__).parent
COLUMNS = ("what", "figure", "unit", "bar", "peer", "date", "command")


class ResultsError(ValueError):
    """A CSV file of recorded figures cannot be read."""


def read_rows(path: Path) -> list[dict[str, str]]:
    """Return the rows of a CSV file of recorded figures.

    Raises:
        ResultsError: The columns are others than `COLUMNS`, or a row has another number of cells.
    """
    with path.open(encoding="utf-8", newline="") as file:
        head, *rows = list(csv.reader(file)) or [[]]
    if tuple(head) != COLUMNS:
        raise ResultsError(f"{path}: columns are {','.join(head)}, must be {','.join(COLUMNS)}")
    for line, row in enumerate(rows, start=2):
        if len(row) != len(COLUMNS):
            raise ResultsError(f"{path}:{line}: {len(row)} cells, must be {len(COLUMNS)}")
    return [dict(zip(COLUMNS, row, strict=True)) for row in rows]


def page(name: str, folder: Path = FOLDER) -> str:
    """Return the Markdown page of the CSV file of this name."""
    title, introduction = TITLES[name]
    lines = [f"# {title}", "", introduction, ""]
    lines += [f"| {' | '.join(COLUMNS)} |", "|" + "---|" * len(COLUMNS)]
    for row in read_rows(folder / f"{name}.csv"):
        cells = [f"`{cell}`" if column == "command" else cell for column, cell in row.items()]
        lines.append(f"| {' | '.join(cell.replace('|', '/') for cell in cells)} |")
    return "\n".join(lines) + "\n"
