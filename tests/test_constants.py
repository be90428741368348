"""Every number of estimators, monitors, stop rules and `gap` has a row: what a change of it does."""

import re
from pathlib import Path

import pytest

from benchmarks.gates import gap_constants
from benchmarks.gates.constants import Number, numbers

ROOT = Path(__file__).parents[1]
NUMBERS = {number.title: number for number in numbers()}
GAP_NUMBERS = {number.title: number for number in numbers(folders=gap_constants.FOLDERS)}


PAGES = {
    "constants.md": ROOT / "benchmarks/results",
    "gap_constants.md": ROOT / "docs/contributing",
}


def rows_of(page: str) -> dict[str, list[str]]:
    """Return the rows of the table of numbers of a page, by number."""
    text = (PAGES[page] / page).read_text(encoding="utf-8").split("## Numbers")[1]
    lines = [line for line in text.splitlines() if line.startswith("|")][2:]
    cells = [[cell.strip() for cell in line.strip().strip("|").split("|")] for line in lines]
    return {first: others for first, *others in cells}


ROWS = rows_of("constants.md") | rows_of("gap_constants.md")


@pytest.mark.parametrize(
    ("page", "every"),
    [("constants.md", NUMBERS), ("gap_constants.md", GAP_NUMBERS)],
    ids=["rover", "gap"],
)
def test_the_page_has_a_row_for_each_number_and_no_other(page: str, every: dict[str, Number]) -> None:
    assert rows_of(page).keys() == every.keys()


@pytest.mark.parametrize("title", NUMBERS | GAP_NUMBERS)
def test_the_row_was_made_with_the_value_of_today_and_has_a_date(title: str) -> None:
    value, *changes, date = ROWS[title]
    assert value == (NUMBERS | GAP_NUMBERS)[title].text
    assert re.fullmatch(r"\d{4}-\d\d-\d\d", date)
    assert all(changes)


def test_numbers_are_found_wherever_they_stand(tmp_path: Path) -> None:
    folder = tmp_path / "controllers/safety"
    folder.mkdir(parents=True)
    (folder / "rule.py").write_text(
        "LIMIT = 2.0 * math.pi\nNAME = 'x'\nNONE = 0\n"
        "class RuleSettings(Settings):\n    after_s: Annotated[float, Field(ge=0.1)] = 0.5\n"
        "    is_on: bool = True\n"
        "class Rule:\n    count: int = 3\n"
    )
    assert [(number.title, number.text) for number in numbers(tmp_path)] == [
        ("safety.rule.LIMIT", "2.0 * math.pi"),
        ("safety.rule.RuleSettings.after_s", "0.5"),
    ]


@pytest.mark.parametrize("title", GAP_NUMBERS)
def test_a_number_of_gap_says_what_it_decides(title: str) -> None:
    assert gap_constants.meaning(GAP_NUMBERS[title]) == ROWS[title][1]
