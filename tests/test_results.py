"""Recorded figures: one number per cell, pages made from them, and the page of the figures to decide by."""

import re
from datetime import date
from pathlib import Path

import pytest

from benchmarks.results import TITLES
from benchmarks.results.pages import COLUMNS, FOLDER, ResultsError, page, read_rows
from benchmarks.safety.faults.__main__ import COLUMNS as COLUMNS_OF_FAULTS

ROOT = Path(__file__).parents[1]
NUMBER = re.compile(r"-?\d+(\.\d+)?(e-?\d+)?")
OTHER_PAGES = {"gates", "constants", "faults", "faults_two_processes"}
"""Written by their benchmarks, with columns of their own."""
WORDS, FIGURES = 900, 20


def rows() -> list[tuple[str, dict[str, str]]]:
    return [(name, row) for name in TITLES for row in read_rows(FOLDER / f"{name}.csv")]


def test_every_file_has_a_title_and_every_page_a_file() -> None:
    assert {path.stem for path in FOLDER.glob("*.csv")} == set(TITLES)
    assert {path.stem for path in FOLDER.glob("*.md")} == set(TITLES) | OTHER_PAGES


@pytest.mark.parametrize("name", TITLES)
def test_the_page_is_what_the_generator_writes(name: str) -> None:
    assert (FOLDER / f"{name}.md").read_text("utf-8") == page(name)


@pytest.mark.parametrize("name", TITLES)
def test_a_cell_holds_one_number_and_a_row_one_figure(name: str) -> None:
    every = read_rows(FOLDER / f"{name}.csv")
    numbers = [row[column] for row in every for column in ("figure", "bar", "peer")]
    assert [cell for cell in numbers if cell and not NUMBER.fullmatch(cell)] == []
    assert [row for row in every if not row["figure"]] == []
    assert [row["what"] for row in every if not row["what"] or len(row["what"]) > 110] == []
    assert [row["unit"] for row in every if len(row["unit"]) > 12] == []
    assert len({row["what"] for row in every}) == len(every)
    assert all(date.fromisoformat(row["date"]) for row in every)
    assert [row["what"] for row in every if ("peer:" in row["what"]) > bool(row["peer"])] == []


def is_there(command: str) -> bool:
    """Return whether what a command runs is in this repository."""
    if target := re.fullmatch(r"make ([\w-]+)", command):
        return re.search(rf"^{target[1]}:", (ROOT / "Makefile").read_text("utf-8"), re.MULTILINE) is not None
    if script := re.match(r"node ([\w/.-]+) ", command):
        return (ROOT / script[1]).is_file()
    module = re.match(r"python -m (benchmarks\.[\w.]+)", command)
    path = ROOT / module[1].replace(".", "/") if module else ROOT / "none"
    return path.with_suffix(".py").is_file() or (path / "__main__.py").is_file()


def test_every_command_exists() -> None:
    assert sorted({row["command"] for _, row in rows() if not is_there(row["command"])}) == []


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("what,figure\n", r"columns are what,figure, must be what,figure,unit"),
        (",".join(COLUMNS) + "\na,1\n", r"x\.csv:2: 2 cells, must be 7"),
        ("", r"columns are , must be"),
    ],
)
def test_another_file_is_refused_with_its_line(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "x.csv"
    path.write_text(text)
    with pytest.raises(ResultsError, match=message):
        read_rows(path)


@pytest.mark.parametrize("name", ["faults", "faults_two_processes"])
def test_the_fault_matrix_has_the_columns_of_its_command_and_one_number_per_cell(name: str) -> None:
    lines = (FOLDER / f"{name}.md").read_text("utf-8").splitlines()
    head, _, *table = [line for line in lines if line.startswith("|")]
    assert head == f"| {COLUMNS_OF_FAULTS} |"
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in table]
    assert {len(row) for row in cells} == {COLUMNS_OF_FAULTS.count("|") + 1}
    assert [cell for row in cells for cell in row[3:] if len(re.findall(r"\d+(?:\.\d+)?", cell)) > 1] == []


def decisive_rows() -> list[tuple[str, dict[str, str]]]:
    """Return the rows of docs/results.md: the file that each links, and its cells."""
    text = (ROOT / "docs/results.md").read_text("utf-8")
    lines = [line for line in text.splitlines() if line.startswith("|")]
    cells = [[cell.strip() for cell in line.strip().strip("|").split("|")] for line in lines]
    found = []
    for what, figure, unit, bar, peer, link in (row for row in cells if "](" in row[-1]):
        target = re.search(r"benchmarks/results/(\w+)\.md", link)
        assert target, link
        found.append((target[1], {"what": what, "figure": figure, "unit": unit, "bar": bar, "peer": peer}))
    return found


def test_the_figures_to_decide_by_are_those_of_the_rows() -> None:
    decisive = decisive_rows()
    assert len(decisive) == FIGURES
    recorded = [
        (name, {column: row[column] for column in ("what", "figure", "unit", "bar", "peer")})
        for name, row in rows()
    ]
    assert [row for row in decisive if row not in recorded] == []


def test_the_figures_to_decide_by_name_what_is_not_good() -> None:
    text = (ROOT / "docs/results.md").read_text("utf-8")
    assert len(text.split()) <= WORDS
    assert "not reached" in text
