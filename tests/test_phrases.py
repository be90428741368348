"""The phrases that CONTRIBUTING forbids are not in the documents that say how and why."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FOLDERS = ("how-to", "explanation", "decisions", "contributing")
PAGES = [
    ROOT / "CONTRIBUTING.md",
    ROOT / "CHANGELOG.md",
    ROOT / "docs/README.md",
    *(page for folder in FOLDERS for page in sorted((ROOT / "docs" / folder).glob("*.md"))),
]
GENERATED = "docs/contributing/gap_constants.md"
"""Made of docstrings; its words are those of the code."""
QUOTED = re.compile(r"```.*?```|`[^`]*`", re.DOTALL)


def forbidden_phrases() -> list[str]:
    """Return the first column of the table in CONTRIBUTING."""
    text = (ROOT / "CONTRIBUTING.md").read_text("utf-8")
    table = text.split("| forbidden phrase | write |\n|---|---|\n")[1].split("\n\n")[0]
    return [row.split("|")[1].strip() for row in table.splitlines()]


def phrases_in(text: str) -> list[str]:
    """Return the forbidden phrases in a page, outside of quoted messages, keys and the table itself."""
    prose = QUOTED.sub("", text)
    return [
        phrase
        for phrase in forbidden_phrases()
        if re.search(rf"(?m)^(?!\| {re.escape(phrase)} \|).*\b{re.escape(phrase)}s?\b", prose, re.IGNORECASE)
    ]


def test_the_list_is_complete() -> None:
    assert {"sign of life", "set-point", "in place of", "is told"} <= set(forbidden_phrases())


def test_a_phrase_is_found_in_prose_and_not_in_a_quotation() -> None:
    assert phrases_in("It sends Set-points, in place of speeds.") == ["set-point", "in place of"]
    assert phrases_in("`no sign of life`: the key `set-point` is missing.") == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_a_page_has_no_forbidden_phrase(page: Path) -> None:
    if page.relative_to(ROOT).as_posix() != GENERATED:
        assert phrases_in(page.read_text("utf-8")) == []
