"""The command line, and recordings that several files of tests read."""

import fcntl
import os
from pathlib import Path

import pytest

from rover_hil.config import load_config
from rover_hil.run.driving import run_virtual
from tests.rover_hil.command import Command

EL_DORADO_S = 12.0


@pytest.fixture
def command(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> Command:
    """Return the command line, run in an empty folder."""
    monkeypatch.chdir(tmp_path)
    return Command(monkeypatch, capsys)


@pytest.fixture(scope="session")
def el_dorado_log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a log of the shipped four-wheel rover, driven once for all workers of a session."""
    folder = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        folder = folder.parent
    path = folder / "el_dorado.mcap"
    with (folder / "el_dorado.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not path.exists():
            part = path.with_stem("part")
            run_virtual(load_config("el-dorado"), part, EL_DORADO_S, None)
            part.rename(path)
    return path
