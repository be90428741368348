"""Pages with commands and their output: do what a page describes, and compare what it shows.

A block without a language holds commands; a block `text` after it shows their output, with `...` for what is
left out, and a block `text NAME` shows lines of a file. A block of Python or TOML is a file if its first line
is `# NAME`; `# at the end of NAME` adds to a file, `# in NAME, instead of ...` replaces a line, and
`# in NAME, below ...` adds after a line.
"""

import contextlib
import html
import io
import os
import re
import runpy
import shlex
import shutil
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import pytest

from rover_hil.app.app import main
from tests.rover_hil.command import PROGRESS

ROOT = Path(__file__).resolve().parents[2]
BLOCK = re.compile(r"^```(?P<info>[^\n]*)\n(?P<text>.*?)^```$", re.MULTILINE | re.DOTALL)
FILE = re.compile(r"# (?P<name>[\w/]+\.\w+)\n")
ADDED = re.compile(r"# at the end of (?P<name>\S+)\n")
CHANGED = re.compile(r"# in (?P<name>\S+), (?P<place>instead of|below) (?P<old>[^\n]*)\n")
NUMBER = re.compile(r"\d+\.\d+|\d+(?= (?:mm|cm|m|s|%|deg|degrees|cycles)\b)")


@dataclass(frozen=True)
class Shown:
    """What a page shows, and what there was.

    Attributes:
        name: The last command before, or the file.
        shown: Text of the page.
        was: Output of the commands, or the text of the file.
    """

    name: str
    shown: str
    was: str

    def missing(self) -> list[str]:
        """Return the parts of the page that were not printed; line breaks do not count."""
        parts = re.split(r"^\.\.\.$", self.shown, flags=re.MULTILINE)
        was = words(self.was)
        return [part for part in map(words, parts) if part not in was]


def words(text: str) -> str:
    """Return a text with single spaces."""
    return " ".join(text.split())


def read_page(name: str) -> str:
    """Return the text of a page, by its path from the repository."""
    return (ROOT / name).read_text("utf-8")


def blocks_of(text: str) -> list[tuple[str, str]]:
    """Return language, with a file's name if there is one, and text of each block of a page."""
    return [(match["info"], match["text"]) for match in BLOCK.finditer(text)]


def do(text: str, folder: Path, answers: Mapping[str, str] | None = None) -> list[Shown]:
    """Do what a page describes, in a folder; returns what it shows, with what there was.

    Raises:
        AssertionError: A command failed, or a line that is replaced does not exist.
    """
    shown = []
    name, out = "", ""
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        for info, block in blocks_of(text):
            if not info:
                lines = block.splitlines()
                name = lines[-1]
                out = "".join(printed(line, (answers or {}).get(line, "")) for line in lines)
            elif info == "text":
                shown.append(Shown(name, block, out))
            elif info.startswith("text "):
                shown.append(Shown(info[5:], block, text_of(Path(info[5:]))))
            else:
                write(block)
    return shown


def write(block: str) -> None:
    """Write a file of a page, add to it, or change it at a line; another block does nothing."""
    if match := CHANGED.match(block):
        path = Path(match["name"])
        text = path.read_text("utf-8")
        old = match["old"].strip("`")
        assert text.count(f"\n{old}") == 1, f"{old} in {path}"
        kept = f"\n{old}" if match["place"] == "below" else ""
        path.write_text(text.replace(f"\n{old}", f"{kept}\n{block[match.end() :].rstrip()}"), "utf-8")
    elif match := ADDED.match(block):
        with Path(match["name"]).open("a", encoding="utf-8") as file:
            file.write(f"\n{block[match.end() :]}")
    elif match := FILE.match(block):
        Path(match["name"]).write_text(block, "utf-8")


def printed(line: str, answers: str = "") -> str:
    """Run a command of a page: `rover-hil`, `python` or `cp`; returns what it prints.

    Raises:
        AssertionError: The command failed.
    """
    arguments = shlex.split(line, comments=True)
    if arguments[0] == "cp":
        source, target = (Path(argument) for argument in arguments[1:])
        shutil.copy(source if source.exists() else ROOT / source, target)
        return ""
    if arguments[0] == "python":
        runpy.run_path(arguments[1])
        return ""
    out = io.StringIO()
    with (
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(out),
        pytest.MonkeyPatch.context() as patch,
    ):
        patch.setattr(sys, "argv", arguments)
        patch.setattr(sys, "stdin", io.StringIO(answers))
        with pytest.raises(SystemExit) as ended:
            main()
    assert not ended.value.code, f"{line}: {out.getvalue()}"
    return PROGRESS.sub("", out.getvalue())


def text_of(path: Path) -> str:
    """Return the text of a file; of a page of HTML, what a reader sees of it without its scripts."""
    text = path.read_text("utf-8")
    if path.suffix != ".html":
        return text
    text = re.sub(r"<(script|style)\b.*?</\1>", " ", text, flags=re.DOTALL)
    return html.unescape(re.sub(r"<[^>]*>", " ", text))


def unknown_numbers(text: str, folder: Path) -> set[str]:
    """Return the numbers of the prose that are in no block of the page and in no report in a folder.

    A number counts if it has decimals, or a unit behind it.
    """
    prose = BLOCK.sub("", text)
    known = " ".join(block for _, block in blocks_of(text))
    for name, _, files in os.walk(folder):
        known += "".join(text_of(Path(name) / file) for file in files if file.endswith(".html"))
    # What is known may have more digits before and behind: compare whole numbers.
    return set(NUMBER.findall(prose)) - set(re.findall(r"\d+(?:\.\d+)?", known))
