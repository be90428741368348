"""The published tables in `benchmarks/results/gates.md`: read, compared, written."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TypeAlias

PAGE = Path(__file__).parents[1] / "results" / "gates.md"
FLOORS, FIELDS, FAULTS = "Floors", "Field figures", "Faults"
CAMERA_FLOORS = "Floors with a ground camera"
DRIVES = "Recorded drives"
LOST_FLOORS = 3.0 / 20.0
"""Share of the floors of a row that it may lose."""
GROWTH = 0.10
LEAST_GROWTH = {FLOORS: 2.0, CAMERA_FLOORS: 2.0, FIELDS: 0.005, DRIVES: 0.05}
"""In the unit of the table, mm, m and deg: another processor changes the last digits."""
COUNTS = ("within", "finished")
MEDIANS = ("path mm", "closure mm")
GROWING = {FLOORS: MEDIANS, CAMERA_FLOORS: MEDIANS, FIELDS: ("median",), DRIVES: ("end m", "yaw deg", "NEES")}

Row: TypeAlias = Mapping[str, str]
Table: TypeAlias = Mapping[str, Row]
"""Rows by the text of their first cell."""


class PageError(ValueError):
    """The page of the published tables cannot be read."""


def read_tables(page: str) -> dict[str, Table]:
    """Return the tables of a page by their headings.

    Raises:
        PageError: A line of a table has another number of cells than its head.
    """
    tables: dict[str, Table] = {}
    for section in page.split("\n## ")[1:]:
        heading, _, text = section.partition("\n")
        lines = [_cells(line) for line in text.splitlines() if line.startswith("|")]
        if lines:
            head, _, *rows = lines
            try:
                tables[heading] = {row[0]: dict(zip(head[1:], row[1:], strict=True)) for row in rows}
            except ValueError as error:
                raise PageError(f"{PAGE}: a row of '{heading}' has another number of cells") from error
    return tables


def _cells(line: str) -> list[str]:
    return [cell.strip() for cell in line.strip().strip("|").split("|")]


def write_table(page: str, heading: str, table: Table) -> str:
    """Return the page with the table below a heading replaced.

    Raises:
        PageError: There is no such heading with a table.
    """
    before, title, after = page.partition(f"\n## {heading}\n")
    lines = after.splitlines(keepends=True)
    rows = [number for number, line in enumerate(lines) if line.startswith("|")]
    end = next((number for number, line in enumerate(lines) if line.startswith("## ")), len(lines))
    rows = [number for number in rows if number < end]
    if not title or not rows:
        raise PageError(f"{PAGE} has no table below '{heading}'")
    text = "".join(f"{line}\n" for line in markdown(table))
    return before + title + "".join(lines[: rows[0]]) + text + "".join(lines[rows[-1] + 1 :])


def markdown(table: Table) -> Iterator[str]:
    """Yield the lines of a table."""
    head = ["", *next(iter(table.values()))]
    yield f"| {' | '.join(head)} |"
    yield "|" + "---|" * len(head)
    for name, row in table.items():
        yield f"| {' | '.join([name, *row.values()])} |"


def falls(heading: str, published: Table, measured: Table) -> Iterator[str]:
    """Yield what has become worse than published, one sentence each."""
    for name in published.keys() - measured.keys():
        yield f"{name}: not measured"
    for name, row in measured.items():
        if name not in published:
            yield f"{name}: not published"
            continue
        before = published[name]
        if heading == FAULTS:
            if before["verdict"] == "ok" and row["verdict"] != "ok":
                yield f"{name}: verdict {row['verdict']}, was ok"
            continue
        for column in COUNTS if heading in (FLOORS, CAMERA_FLOORS) else ():
            lost = int(before[column]) - int(row[column])
            if lost > LOST_FLOORS * int(before["floors"]):
                yield f"{name}: {row[column]} floors {column}, were {before[column]}"
        for column in GROWING[heading]:
            was, now = float(before[column]), float(row[column])
            if now > was + max(GROWTH * was, LEAST_GROWTH[heading]):
                yield f"{name}: {column} {now:g}, was {was:g}"
