"""The simulated rover as its own process, driven over its ports."""

import os
import signal
import threading
from pathlib import Path

import pytest

from drivers.clock import SystemClock, nanoseconds
from drivers.driver import WheelDrive
from drivers.errors import ConfigError, NotConnectedError
from drivers.robotino_board.settings import RobotinoBoardSettings
from drivers.samples import WheelCommand, WheelSample
from rover_hil.config import read_config_text
from rover_hil.drive.run_surroundings import too_slow as run_too_slow
from rover_hil.drive.simulate import simulate, too_slow
from rover_hil.run.executive import RunResult
from tests.rover_hil.command import started

START_LIMIT_S = 60.0


def newest_position_rad(board: WheelDrive, default_rad: float) -> float:
    """Return the newest position of wheel 0 among the samples that have arrived."""
    positions_rad = [
        sample.position_rad
        for sample in board.poll()
        if isinstance(sample, WheelSample) and sample.wheel == 0 and sample.position_rad is not None
    ]
    return positions_rad[-1] if positions_rad else default_rad


@pytest.mark.parametrize("end", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
@pytest.mark.slow
def test_it_serves_until_it_is_told_to_end_and_leaves_nothing(tmp_path: Path, end: signal.Signals) -> None:
    port = tmp_path / "ports" / "board"
    clock = SystemClock()
    settings = RobotinoBoardSettings(type="robotino_board", port=str(port))
    with started(tmp_path, "simulate", "robotino") as process:
        board = settings.make_driver("board", settings.make_link(clock), clock)
        board.connect(START_LIMIT_S)
        with board:
            position_rad = 0.0
            deadline_ns = clock.now_ns() + nanoseconds(START_LIMIT_S)
            while position_rad < 1.0 and clock.now_ns() < deadline_ns:
                now_ns = clock.now_ns()
                expires_ns = now_ns + nanoseconds(1.0)
                board.command(WheelCommand(t_ns=now_ns, expires_ns=expires_ns, speed_rad_s=(8.0, 8.0, 8.0)))
                clock.sleep_until(now_ns + nanoseconds(0.02))
                position_rad = newest_position_rad(board, position_rad)
            assert position_rad >= 1.0
        process.send_signal(end)
        output, _ = process.communicate(timeout=START_LIMIT_S)
    assert process.returncode == 0
    assert "ports/board" in output
    assert "rover-hil run robotino" in output
    assert str(tmp_path) in output
    assert "Traceback" not in output
    assert list(tmp_path.iterdir()) == []


def test_it_ends_after_the_duration(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    clock = SystemClock()
    start_ns = clock.now_ns()
    assert simulate("robotino", 0.3) == 0
    assert clock.now_ns() - start_ns >= nanoseconds(0.3)
    assert "board 0 sent 0 lost" in capsys.readouterr().out
    assert list(tmp_path.iterdir()) == []


def test_it_serves_on_when_its_terminal_is_lost_under_nohup(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    clock = SystemClock()
    sent_ns: list[int] = []

    def lose_terminal() -> None:
        while not os.path.lexists(tmp_path / "ports" / "imu"):
            clock.sleep_until(clock.now_ns() + nanoseconds(0.01))
        os.kill(os.getpid(), signal.SIGHUP)
        sent_ns.append(clock.now_ns())

    thread = threading.Thread(target=lose_terminal)
    previous = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        thread.start()
        assert simulate("robotino", 1.0) == 0
    finally:
        thread.join()
        signal.signal(signal.SIGHUP, previous)
    assert clock.now_ns() - sent_ns[0] >= nanoseconds(0.5)


def test_it_leaves_nothing_when_a_port_cannot_be_served(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shipped = read_config_text("robotino")
    (tmp_path / "taken").write_text("a file of somebody else")
    config = tmp_path / "rover.toml"
    config.write_text(shipped.replace('"ports/imu"', '"taken"').replace('"ports/board"', '"a/b/board"'))
    monkeypatch.chdir(tmp_path)
    with pytest.raises(NotConnectedError, match="taken: the path is taken"):
        simulate("rover.toml", 0.1)
    assert {path.name for path in tmp_path.iterdir()} == {"rover.toml", "taken"}


def test_a_configuration_without_a_simulation_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "rover.toml"
    path.write_text(read_config_text("robotino").split("[simulation]")[0])
    with pytest.raises(ConfigError, match="simulation: this key is missing"):
        simulate(str(path), 0.1)


@pytest.mark.parametrize(
    ("skipped", "words"), [(300, ""), (4900, ""), (7500, "by a factor of 4.0: 7500 of 10000 cycles")]
)
def test_a_machine_that_does_not_keep_up_is_told_with_its_factor(skipped: int, words: str) -> None:
    told = too_slow(skipped, 10.0)
    assert bool(told) is bool(words)
    assert words in told


@pytest.mark.parametrize(("skipped", "words"), [(0, ""), (10, ""), (250, "by a factor of 1.33: 250 of 1000")])
def test_a_run_on_a_slow_machine_says_so_with_its_factor(skipped: int, words: str) -> None:
    told = run_too_slow(RunResult(cycles=1000 - skipped, skipped=skipped), 50.0)
    assert bool(told) is bool(words)
    assert words in told
