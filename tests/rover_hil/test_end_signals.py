"""A signal always ends the program, also where the exception of its handler is swallowed."""

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from rover_hil.config import load_config
from rover_hil.recording.schema import end_record
from rover_hil.run import driving, end_signals
from rover_hil.run.composition import Rig, build_virtual_rig
from rover_hil.run.driving import run_virtual
from rover_hil.run.end_signals import EndRequest, Terminated, held_signals, take_signals
from rover_hil.run.executive import RunResult

ENDS = ((signal.SIGINT, KeyboardInterrupt), (signal.SIGTERM, Terminated), (signal.SIGHUP, Terminated))
WORDS = {
    signal.SIGINT: (130, "rover-hil: interrupted by ctrl-C\n"),
    signal.SIGTERM: (143, "rover-hil: ended by SIGTERM\n"),
    signal.SIGHUP: (143, "rover-hil: the terminal or connection was lost (SIGHUP)\n"),
}
SWALLOWED_SIGNAL = """
import os, sys
class Swallow:
    def find_spec(self, name, path=None, target=None):
        if name == {name!r}:
            try:
                os.kill(os.getpid(), {number})
            except BaseException:
                pass
sys.meta_path.insert(0, Swallow())
sys.argv = ["rover-hil", *{arguments!r}]
from rover_hil.app.program import main
main()
"""


@pytest.fixture(autouse=True)
def program(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Take the signals as the program does, and forget them afterwards."""
    monkeypatch.setattr(end_signals, "END_REQUEST", EndRequest())
    previous = {number: signal.getsignal(number) for number, _ in ENDS}
    take_signals()
    yield
    for number, handler in previous.items():
        signal.signal(number, handler)


def send(number: int) -> None:
    os.kill(os.getpid(), number)


@pytest.mark.parametrize(("number", "kind"), ENDS)
def test_while_held_only_the_flag_is_set_and_the_signal_acts_at_the_end(
    number: signal.Signals, kind: type[BaseException]
) -> None:
    numbers: list[int | None] = []

    def work() -> None:
        with held_signals() as request:
            send(number)
            numbers.append(request.number)

    with pytest.raises(kind):
        work()
    assert numbers == [number]


@pytest.mark.parametrize(("number", "kind"), ENDS)
def test_after_a_signal_that_was_swallowed_nothing_is_driven(
    tmp_path: Path, number: signal.Signals, kind: type[BaseException]
) -> None:
    with suppress(BaseException):
        send(number)
    with pytest.raises(kind):
        run_virtual(load_config("robotino"), tmp_path / "run.mcap", 5.0, None)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("number", "kind"), ENDS)
def test_a_signal_before_the_drive_opens_keeps_it_closed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: signal.Signals, kind: type[BaseException]
) -> None:
    def build(*arguments: Any) -> object:
        with suppress(BaseException):
            send(number)
        return build_virtual_rig(*arguments)

    monkeypatch.setattr(driving, "build_virtual_rig", build)
    monkeypatch.setattr(Rig, "connect", lambda *arguments: pytest.fail("opened"))
    with pytest.raises(kind):
        run_virtual(load_config("robotino"), tmp_path / "run.mcap", 5.0, None)
    assert list(tmp_path.iterdir()) == []


def test_a_signal_while_the_drive_opens_ends_the_run_in_its_first_cycle(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    connect_now = Rig.connect

    def connect(rig: Rig, timeout_s: float) -> None:
        with suppress(BaseException):
            send(signal.SIGTERM)
        connect_now(rig, timeout_s)

    monkeypatch.setattr(Rig, "connect", connect)
    result = run_virtual(load_config("robotino"), tmp_path / "run.mcap", 5.0, None)
    assert (result.reason, result.cycles) == ("ended from outside (SIGTERM)", 1)


@pytest.mark.parametrize(("number", "kind"), ENDS)
def test_a_signal_after_the_last_cycle_is_not_lost(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: signal.Signals, kind: type[BaseException]
) -> None:
    ends: list[str] = []

    def record(result: RunResult) -> Any:
        send(number)
        ends.append(str(result.end))
        return end_record(result)

    monkeypatch.setattr(driving, "end_record", record)
    with pytest.raises(kind):
        run_virtual(load_config("robotino"), tmp_path / "run.mcap", 0.1, None)
    assert ends == ["time over"]
    assert (tmp_path / "run.mcap").is_file()


def test_the_signal_that_ended_a_run_acts_once(tmp_path: Path) -> None:
    def show(*_: object) -> None:
        send(signal.SIGTERM)

    config = load_config("robotino")
    result = run_virtual(config, tmp_path / "a.mcap", 5.0, show)
    assert (result.reason, result.cycles) == ("ended from outside (SIGTERM)", 1)
    assert run_virtual(config, tmp_path / "b.mcap", 0.1, None).reason.startswith("time over")


def test_ignored_signals_stay_ignored() -> None:
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    take_signals()
    send(signal.SIGHUP)
    send(signal.SIGINT)
    with held_signals() as request:
        send(signal.SIGHUP)
        assert request.number is None


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "name", "number"),
    [
        pytest.param(
            *(arguments.split(), name, number),
            marks=() if name == "pydantic" or number == signal.SIGTERM else pytest.mark.nightly,
        )
        for arguments, name in (
            ("run robotino --virtual --out a", "pydantic"),
            ("run robotino --virtual --out a", "controllers.control_loop"),
            ("run robotino --virtual --out a", "scipy.linalg.lapack"),
            ("compare a b", "rover_hil.report.compare.command"),
            ("calibrate wheels robotino --virtual --out a", "rover_hil.ready.wheels.fit"),
        )
        for number in WORDS
    ],
)
def test_a_signal_that_is_swallowed_while_modules_load_ends_the_program(
    tmp_path: Path, arguments: list[str], name: str, number: signal.Signals
) -> None:
    text = SWALLOWED_SIGNAL.format(name=name, number=int(number), arguments=arguments)
    done = subprocess.run(
        [sys.executable, "-c", text], check=False, capture_output=True, text=True, cwd=tmp_path
    )
    assert (done.returncode, done.stderr) == WORDS[number]
    assert list(tmp_path.iterdir()) == []
