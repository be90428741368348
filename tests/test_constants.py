"""Every number of estimators, monitors and stop rules has a row that says what a change of it does."""

import re
from pathlib import Path

import pytest

from benchmarks.gates.constants import numbers

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs/results/constants.md"
ROWS = {
    cells[0]: cells[1:]
    for cells in (
        [cell.strip() for cell in line.strip().strip("|").split("|")]
        for line in PAGE.read_text(encoding="utf-8").split("## Numbers")[1].splitlines()
        if line.startswith("|")
    )
}
NUMBERS = {number.title: number for number in numbers()}


def test_the_page_has_a_row_for_each_number_and_no_other() -> None:
    assert ROWS.keys() - {"number", "---"} == NUMBERS.keys()


@pytest.mark.parametrize("title", NUMBERS)
def test_the_row_was_made_with_the_value_of_today_and_has_a_date(title: str) -> None:
    value, *changes, date = ROWS[title]
    assert value == NUMBERS[title].text
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
