"""The command line, run in this process, and as a process of its own."""

import re
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path

import pytest
import typer.main

from rover_hil.app.app import main

PROGRAM = (sys.executable, "-c", "from rover_hil.app.app import main; main()")
PROGRESS = re.compile(r"^ *\d+\.\d s  .*\n", re.MULTILINE)
"""Lines of a step that takes two seconds, as any may on a busy machine."""
_get_command = cache(typer.main.get_command)
"""The commands and their options are put together once, not in each test."""


class Command:
    """Runs commands and keeps what they print, except the progress."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
        self._monkeypatch = monkeypatch
        monkeypatch.setattr("typer.main.get_command", _get_command)
        self._capsys = capsys
        self.out = ""
        self.error = ""

    def __call__(self, *arguments: str) -> int:
        self._monkeypatch.setattr(sys, "argv", ["rover-hil", *arguments])
        with pytest.raises(SystemExit) as caught:
            main()
        self.out, error = self._capsys.readouterr()
        self.error = PROGRESS.sub("", error)
        return caught.value.code if isinstance(caught.value.code, int) else 0


def assert_one_sentence(error: str, *words: str) -> None:
    error = error.removeprefix("slip unknown: up to 60 % of the distance may be lost\n")  # of a run
    assert error.startswith("rover-hil: ")
    assert error.count("\n") == 1
    assert "Traceback" not in error
    for word in words:
        assert word in error


@contextmanager
def started(folder: Path, *arguments: str) -> Iterator[subprocess.Popen[str]]:
    """Start a command in a folder, and kill it in the end; its output, errors too, can be read."""
    with subprocess.Popen(
        [*PROGRAM, *arguments],
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    ) as process:
        try:
            yield process
        finally:
            process.kill()
