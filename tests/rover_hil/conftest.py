"""The command line, and recordings that several files of tests read."""

from pathlib import Path

import pytest

from rover_hil.config import load_config
from rover_hil.run.driving import run_virtual
from tests.once import made_once
from tests.rover_hil.command import Command

EL_DORADO_S = 12.0
ROBOTINO_S = 2.0


@pytest.fixture
def command(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> Command:
    """Return the command line, run in an empty folder."""
    monkeypatch.chdir(tmp_path)
    return Command(monkeypatch, capsys)


@pytest.fixture(scope="session")
def el_dorado_log() -> Path:
    """Return a log of the shipped four-wheel rover, driven once for all workers of a session."""
    return made_once(
        "el_dorado.mcap", lambda part: run_virtual(load_config("el-dorado"), part, EL_DORADO_S, None)
    )


@pytest.fixture(scope="session")
def robotino_log() -> Path:
    """Return a log of the shipped three-wheel rover, driven once for all workers of a session."""
    return made_once(
        "robotino.mcap", lambda part: run_virtual(load_config("robotino"), part, ROBOTINO_S, None)
    )
