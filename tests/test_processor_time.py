"""The limit of processor time sees a test that computes, and not one that only waits."""

import subprocess
import sys
from pathlib import Path

import pytest

from tests.cases import first_often

ROOT = Path(__file__).parents[1]
TESTS = """
import threading, time
import pytest

def compute():
    end_s = time.process_time() + 0.4
    while time.process_time() < end_s:
        pass

def test_computes():
    compute()

@pytest.mark.slow
def test_is_marked():
    compute()

def test_waits():
    threading.Event().wait(0.4)

@pytest.fixture
def shared():
    compute()

def test_uses_what_is_shared(shared):
    pass
"""


@pytest.mark.parametrize(("limit", "failed"), first_often([("0.005", ["test_computes"]), ("0", [])]))
def test_only_a_test_that_computes_without_a_marker_fails(
    tmp_path: Path, limit: str, failed: list[str]
) -> None:
    (tmp_path / "pytest.ini").write_text("[pytest]\nmarkers = slow\n", "utf-8")
    (tmp_path / "test_made.py").write_text(TESTS, "utf-8")
    command = (
        *(sys.executable, "-m", "pytest", "-q", "-p", "tests.processor_time"),
        *("-p", "no:cacheprovider", "--rootdir", str(tmp_path), "--processor-limit", limit, str(tmp_path)),
    )
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    lines = [line for line in done.stdout.splitlines() if line.startswith("FAILED")]
    assert [line.partition("::")[2].split()[0] for line in lines] == failed, done.stdout + done.stderr
    assert f"{4 - len(failed)} passed" in done.stdout
    assert ("more than 0.005 s" in done.stdout) is bool(failed)
