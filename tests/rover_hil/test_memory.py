"""Too little memory is one sentence; what was driven stays readable, and the report can be written later."""

import resource
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from controllers.control_loop import StepOutput
from drivers.files import MEGABYTE
from rover_hil.console import memory
from rover_hil.console.memory import (
    ShortOfMemoryError,
    prepare_linear_algebra,
    require_loading_memory,
    sentence_of,
)
from rover_hil.drive import run_surroundings
from rover_hil.recording.reader import LogReader
from rover_hil.recording.writer import LogWriter
from tests.rover_hil.command import Command, assert_one_sentence

PROGRAM = Path(sys.executable).with_name("rover-hil")


@pytest.fixture
def little_memory() -> Iterator[None]:
    """Leave this process 64 MB more than it has."""
    pages = int(Path("/proc/self/statm").read_text("ascii").split()[0])
    before = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (pages * resource.getpagesize() + 64 * MEGABYTE, before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_AS, before)


@pytest.mark.usefixtures("little_memory")
def test_what_will_not_fit_does_not_begin() -> None:
    with pytest.raises(ShortOfMemoryError, match="too little to begin"):
        require_loading_memory()
    with pytest.raises(ShortOfMemoryError, match="too little to begin"):
        prepare_linear_algebra()


@pytest.mark.usefixtures("little_memory")
def test_any_error_counts_under_a_limit_that_is_reached() -> None:
    assert "this shell limits it to" in sentence_of(ImportError("failed to map segment from shared object"))
    assert sentence_of(ShortOfMemoryError("ours")) == ""


def test_without_a_limit_only_errors_of_memory_count() -> None:
    require_loading_memory()
    assert sentence_of(ImportError("no module")) == ""
    assert sentence_of(OSError(2, "no such file")) == ""
    assert sentence_of(OSError(12, "Cannot allocate memory")).startswith("too little memory")
    assert sentence_of(MemoryError()).startswith("too little memory")


def test_a_limit_too_low_to_begin_is_one_sentence_and_leaves_nothing(tmp_path: Path) -> None:
    line = f"ulimit -v 300000; exec {PROGRAM} run robotino --virtual --out a"
    done = subprocess.run(
        ["/bin/sh", "-c", line], check=False, cwd=tmp_path, capture_output=True, text=True, timeout=60
    )
    assert done.returncode == 2
    assert_one_sentence(done.stderr, "limits the memory to 292 MB", "ulimit -v")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.usefixtures("unrendered")
def test_memory_that_ends_in_a_drive_leaves_a_log_and_the_command_for_its_report(
    command: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    shown: list[StepOutput] = []

    def show(output: StepOutput, *_: object) -> None:
        shown.append(output)
        if len(shown) == 2:
            raise MemoryError

    with monkeypatch.context() as patch:
        patch.setattr(run_surroundings, "display", lambda *_: show)
        assert command("run", "robotino", "--virtual", "--duration", "60", "--out", "a") == 2
    assert_one_sentence(
        command.error, "too little memory", "commanded to stop", "`rover-hil replay a/run.mcap --out a`"
    )
    assert list(LogReader(Path("a/run.mcap")).messages())
    assert command("replay", "a/run.mcap", "--out", "a") == 0
    assert Path("a/report.html").exists()


def test_memory_that_ends_in_the_report_leaves_the_command_for_it(
    command: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> str:
        raise MemoryError

    monkeypatch.setattr(run_surroundings, "write_report", fail)
    assert command("run", "robotino", "--virtual", "--duration", "4", "--out", "a") == 2
    assert_one_sentence(command.error, "the drive has ended", "`rover-hil replay a/run.mcap --out a`")


@pytest.mark.usefixtures("unrendered")
def test_memory_that_ends_in_the_thread_of_the_log(command: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise MemoryError

    monkeypatch.setattr(LogWriter, "_put_truth", fail)
    assert command("run", "robotino", "--virtual", "--duration", "60", "--out", "a") == 2
    assert_one_sentence(command.error, "cannot write log a/run.mcap: no memory is left", "rover-hil replay")
    assert memory.sentence_of(MemoryError())
