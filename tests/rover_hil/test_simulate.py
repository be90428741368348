"""The simulated rover as its own process, driven over its ports."""

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from drivers.clock import SystemClock, nanoseconds
from drivers.driver import WheelDrive
from drivers.errors import ConfigError, LinkTimeoutError
from drivers.robotino_board.settings import RobotinoBoardSettings
from drivers.samples import WheelCommand, WheelSample
from rover_hil.command_line.simulate import simulate

START_LIMIT_S = 30.0
COMMAND = "from rover_hil.command_line.app import main; main()"


@contextmanager
def simulated(folder: Path) -> Iterator[subprocess.Popen[str]]:
    process = subprocess.Popen(
        [sys.executable, "-c", COMMAND, "simulate", "robotino"],
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


def first_wheel_position(board: WheelDrive) -> float:
    for _ in range(100):
        sample = board.wait_next(WheelSample, 20.0)
        if sample.wheel == 0 and sample.position_rad is not None:
            return sample.position_rad
    msg = "wheel 0 is never reported"
    raise LinkTimeoutError(msg)


@pytest.mark.parametrize("end", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_it_serves_until_it_is_told_to_end_and_leaves_nothing(tmp_path: Path, end: signal.Signals) -> None:
    port = tmp_path / "ports" / "board"
    clock = SystemClock()
    settings = RobotinoBoardSettings(type="robotino_board", port=str(port))
    with simulated(tmp_path) as process:
        board = settings.make_driver("board", settings.make_link(clock), clock)
        board.connect(START_LIMIT_S)
        with board:
            position_rad = 0.0
            deadline_ns = clock.now_ns() + nanoseconds(10.0)
            while position_rad < 1.0 and clock.now_ns() < deadline_ns:
                now_ns = clock.now_ns()
                board.command(
                    WheelCommand(
                        t_ns=now_ns, expires_ns=now_ns + nanoseconds(1.0), speed_rad_s=(8.0, 8.0, 8.0)
                    )
                )
                position_rad = first_wheel_position(board)
            assert position_rad >= 1.0
        process.send_signal(end)
        output, _ = process.communicate(timeout=10.0)
    assert process.returncode == 0
    assert "ports/board" in output
    assert "rover-hil run robotino" in output
    assert str(tmp_path) in output
    assert "Traceback" not in output
    assert list((tmp_path / "ports").iterdir()) == []


def test_it_ends_after_the_duration(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    clock = SystemClock()
    start_ns = clock.now_ns()
    assert simulate("robotino", 0.3) == 0
    assert clock.now_ns() - start_ns >= nanoseconds(0.3)
    assert "board 0 sent 0 lost" in capsys.readouterr().out
    assert os.listdir("ports") == []  # noqa: PTH208


def test_a_configuration_without_a_simulation_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "rover.toml"
    shipped = Path(__file__).parents[2] / "rover_hil" / "config" / "shipped" / "configs" / "robotino.toml"
    path.write_text(shipped.read_text().split("[simulation]")[0])
    with pytest.raises(ConfigError, match="simulation: this key is missing"):
        simulate(str(path), 0.1)
