"""The page on the models says what the models say."""

from pathlib import Path

import pytest

from benchmarks.gap.models import MODELS, card_lines

PAGE = Path(__file__).parents[3] / "docs/reference/gap_models.md"


@pytest.mark.parametrize("name", MODELS)
def test_the_page_has_the_tables_of_the_cards(name: str) -> None:
    lines = set(PAGE.read_text().splitlines())
    missing = [line for line in card_lines(name) if line not in lines]
    assert not missing, "print them again: python -m benchmarks.gap.models cards"
