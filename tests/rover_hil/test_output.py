"""Outputs that are full, closed, or lead nowhere: one sentence, and nothing is lost."""

import errno
import io
import os
import pty
import subprocess
import sys
import termios
from pathlib import Path

import pytest

from rover_hil.console import output
from rover_hil.console.output import can_tell, output_problem
from tests.cases import first_often
from tests.rover_hil.command import Command, assert_one_sentence

PROGRAM = Path(sys.executable).with_name("rover-hil")
FULL = Path("/dev/full")


def run_shell(line: str, folder: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        ["/bin/sh", "-c", line.replace("rover-hil", str(PROGRAM))],
        check=False,
        cwd=folder,
        capture_output=True,
        text=True,
    )


@pytest.mark.skipif(not FULL.is_char_device(), reason="needs /dev/full")
@pytest.mark.parametrize(
    "arguments", first_often(["--version", "--help", "sample", "terrain climb --slope-deg 5 --json"])
)
def test_a_full_standard_output_is_one_sentence(arguments: str, tmp_path: Path) -> None:
    done = run_shell(f"rover-hil {arguments} > /dev/full", tmp_path)
    assert done.returncode == 2
    assert_one_sentence(done.stderr, "cannot write the output: No space left on device", "make room")


@pytest.mark.slow
@pytest.mark.skipif(not FULL.is_char_device(), reason="needs /dev/full")
def test_a_full_standard_error_keeps_the_exit_code(tmp_path: Path) -> None:
    assert run_shell("rover-hil terrain climb --soil none 2> /dev/full", tmp_path).returncode == 2


@pytest.mark.slow
def test_closed_outputs(tmp_path: Path) -> None:
    assert run_shell("rover-hil terrain climb --slope-deg 5 >&- 2>&-", tmp_path).returncode == 0


@pytest.mark.slow
def test_a_closed_input_is_no_terminal_that_confirms(tmp_path: Path) -> None:
    done = run_shell("rover-hil calibrate imu robotino --out x.toml <&-", tmp_path)
    assert done.returncode == 2
    assert_one_sentence(done.stderr, "this would move", "add --drive")


@pytest.mark.slow
def test_a_reader_that_has_left_gets_no_traceback(tmp_path: Path) -> None:
    done = run_shell("rover-hil terrain climb --slope-deg 5 --json | true", tmp_path)
    assert "Traceback" not in done.stderr
    assert "Exception ignored" not in done.stderr


@pytest.mark.skipif(not FULL.is_char_device(), reason="needs /dev/full")
def test_an_error_of_another_file_is_none_of_the_output(monkeypatch: pytest.MonkeyPatch) -> None:
    error = OSError(errno.ENOSPC, "some reason")
    assert output_problem(error) == ""
    monkeypatch.setattr(os, "dup2", lambda *_: None)
    with FULL.open("wb", buffering=0) as full:
        monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(full, write_through=True))
        assert output_problem(OSError(errno.ENOSPC, "some reason", "a file")) == ""
        assert output_problem(ValueError()) == ""
        assert "some reason; make room there" in output_problem(error)


@pytest.mark.parametrize("force", [(), ("--force",)])
def test_a_device_is_never_replaced(command: Command, tmp_path: Path, force: tuple[str, ...]) -> None:
    os.mkfifo(tmp_path / "pipe")
    assert command("check", "robotino", "--schema", "pipe", *force) == 2
    assert_one_sentence(command.error, "pipe is a pipe or a device: name a file or a folder with --schema")
    assert command("run", "robotino", "--virtual", "--out", "pipe", *force) == 2
    assert_one_sentence(command.error, "pipe")
    assert (tmp_path / "pipe").is_fifo()


def test_a_terminal_that_ctrl_s_has_stopped_is_not_written_to(monkeypatch: pytest.MonkeyPatch) -> None:
    device, terminal = pty.openpty()
    monkeypatch.setattr(output, "STANDARD_ERROR", terminal)
    try:
        assert can_tell()
        termios.tcflow(terminal, termios.TCOOFF)
        assert not can_tell()
        termios.tcflow(terminal, termios.TCOON)
        assert can_tell()
    finally:
        os.close(device)
        os.close(terminal)
    assert not can_tell()  # closed


def test_a_pipe_that_nobody_empties_is_not_written_to(monkeypatch: pytest.MonkeyPatch) -> None:
    reading, writing = os.pipe()
    monkeypatch.setattr(output, "STANDARD_ERROR", writing)
    os.set_blocking(writing, False)
    try:
        assert can_tell()
        os.write(writing, bytes(1 << 24))  # as much as there is room for
        assert not can_tell()
    finally:
        os.close(reading)
        os.close(writing)
