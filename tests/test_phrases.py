"""The phrases that CONTRIBUTING forbids are in no document, docstring, comment or message."""

import ast
import io
import re
import tokenize
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FOLDERS = (
    "benchmarks",
    "controllers",
    "docs",
    "drivers",
    "rover_hil",
    "sim_backends",
    "tests",
    ".ci",
    ".github",
)
ENDS = frozenset(
    {"", ".c", ".cpp", ".css", ".csv", ".html", ".js", ".json", ".md", ".mjs", ".py", ".sh", ".toml", ".yml"}
)
RECORDED = ("tests/rover_hil/data/", "tests/test_phrases.py")
"""Files as an older version wrote them, which readers must accept; and this test."""
NAME = re.compile(r"`[^`\s]*`|\.\w+|^\s*\w+(?:, \w+)*: |^\w+$", re.MULTILINE)
"""An identifier, key, topic, command or option: quoted without a space, after a dot, before the colon of an
argument, or alone as a string."""


def forbidden_phrases() -> list[str]:
    """Return the first column of the table in CONTRIBUTING; a row may have several forms of a phrase."""
    text = (ROOT / "CONTRIBUTING.md").read_text("utf-8")
    table = text.split("| forbidden phrase | write |\n|---|---|\n")[1].split("\n\n")[0]
    return [phrase for row in table.splitlines() for phrase in row.split("|")[1].strip().split(", ")]


def pattern_of(phrases: list[str], between: str) -> re.Pattern[str]:
    """Return what finds the phrases, with `between` for the space or hyphen between two words."""
    spelled = (between.join(map(re.escape, re.split("[ -]", phrase))) for phrase in phrases)
    return re.compile(rf"\b(?:{'|'.join(spelled)})s?\b", re.IGNORECASE)


PHRASE = pattern_of(forbidden_phrases(), r"[\s-]+")
PERHAPS = pattern_of(forbidden_phrases(), r"\W+(?:[a-z]+[\"'])?")
"""Also finds a phrase across the quotes and comment signs of two lines: fast, where most files have none."""


def phrases_in(text: str, *, is_python: bool = False) -> list[str]:
    """Return what a file has of the forbidden phrases, outside of names and of the table itself."""
    if not PERHAPS.search(text):
        return []
    prose = "\n\n".join(_python_prose(text)) if is_python else text
    prose = re.sub(r"(?m)^\| forbidden phrase (?:.*\n)*?\n", "", prose)
    return list(dict.fromkeys(" ".join(found.split()) for found in PHRASE.findall(NAME.sub("", prose))))


def _python_prose(source: str) -> Iterator[str]:
    """Yield the comments of Python code, those that follow each other as one, and its strings."""
    comment, last_line = "", -1
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type == tokenize.COMMENT:
            if token.start[0] != last_line + 1:
                yield comment
                comment = ""
            comment, last_line = f"{comment} {token.string.lstrip('# ')}", token.start[0]
    yield comment
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield node.value
        elif isinstance(node, ast.JoinedStr):
            yield "".join(part.value if isinstance(part, ast.Constant) else "0" for part in node.values)  # type: ignore[misc]


def texts_of(folder: str) -> Iterator[Path]:
    """Yield the text files of a folder; those of the project itself for an empty name."""
    files = (ROOT / folder).rglob("*") if folder else ROOT.glob("*")
    for file in sorted(files):
        is_made = file.name.startswith(".coverage") or "__pycache__" in file.parts
        if file.is_file() and file.suffix in ENDS and not is_made:
            yield file


def test_the_list_is_complete() -> None:
    assert {"sign of life", "set-point", "in place of", "is told"} <= set(forbidden_phrases())


def test_a_phrase_is_found_in_prose_and_not_in_a_name() -> None:
    assert phrases_in("It sends Set-points, in place\nof speeds.") == ["Set-points", "in place of"]
    assert phrases_in("It gave no `sign of life`.") == ["sign of life"]
    assert phrases_in("The key `set-point` is missing.") == []
    assert phrases_in("<td>{{ summary.oddities }}</td>") == []


@pytest.mark.parametrize(
    "source",
    [
        'def f():\n    """Return\n    a set-point."""\n',
        "x = 1  # the\n# set-point\n",
        'x = "the set-" "point"\n',
        'x = f"the {x} set-" f"point"\n',
    ],
)
def test_a_phrase_is_found_in_docstrings_comments_and_messages(source: str) -> None:
    assert phrases_in(source, is_python=True) == ["set-point"]


def test_a_phrase_is_not_found_in_identifiers() -> None:
    source = '''
class A:
    """It has a name.

    Attributes:
        oddities: What it is.
    """

    oddities = sign_of_life(record["oddities"])
'''
    assert phrases_in(source, is_python=True) == []


@pytest.mark.parametrize("folder", ["", *FOLDERS])
def test_a_folder_has_no_forbidden_phrase(folder: str) -> None:
    broken: dict[str, list[str]] = {}
    for file in texts_of(folder):
        name = file.relative_to(ROOT).as_posix()
        if not name.startswith(RECORDED):
            found = phrases_in(file.read_text("utf-8"), is_python=file.suffix == ".py")
            broken |= {name: found} if found else {}
    assert broken == {}
