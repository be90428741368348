"""However a run ends, the drive is commanded to stop: all of it, to the end."""

import errno
import os
import signal
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from drivers.can.frame import unpack_can_frame
from drivers.clock import VirtualClock
from drivers.errors import LogError
from drivers.link import LinkChange
from rover_hil.config import load_config
from rover_hil.recording.writer import LogWriter
from rover_hil.run.composition import ReplayLinks, Rig, build_replay_rig
from rover_hil.run.driving import _execute
from rover_hil.run.end_signals import EndRequest, held_signals
from rover_hil.run.executive import End, Executive, RunResult
from rover_hil.run.replay_link import ReplayLink

SET_POINTS = (0x110, 0x111, 0x112, 0x113)
THIRD_CYCLE = 2 * len(SET_POINTS) + 1
IN_THE_STOP = 3 * len(SET_POINTS) + 3


class Bench:
    """The loop of the el-dorado on silent devices."""

    def __init__(self, folder: Path) -> None:
        config = load_config("el-dorado")
        clock = VirtualClock()
        self.log = LogWriter(folder / "run.mcap", clock.now_ns(), b"{}", {}, "virtual")
        self.rig: Rig
        self.links: ReplayLinks
        self.rig, self.links = build_replay_rig(config, clock, self.log)
        self.rig.connect(0.0)
        self.rate_hz = config.loop.rate_hz
        self.request = EndRequest()
        self.executive = Executive(self.rig, self.log, self.rate_hz, end_request=self.request)

    def run(self, limit_s: float) -> RunResult:
        """Run as the program does, with signals held."""
        with held_signals() as request:
            executive = Executive(self.rig, self.log, self.rate_hz, end_request=request)
            return _execute(executive, self.log, limit_s, request)

    @property
    def wheels(self) -> ReplayLink[bytes]:
        return self.links.bytes_links["wheels"]

    def identifiers(self) -> list[int]:
        frames = [unpack_can_frame(payload) for payload in self.wheels.sent]
        return [frame.can_id for frame in frames if frame is not None]

    def before_sending(self, actions: dict[int, Callable[[], None]]) -> None:
        """Call an action just before the n-th payload is sent, counted from 1."""
        send_now, count = self.wheels.send, 0

        def send(payload: bytes) -> bool:
            nonlocal count
            count += 1
            actions.get(count, lambda: None)()
            return send_now(payload)

        self.wheels.send = send  # type: ignore[method-assign]


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    bench = Bench(tmp_path)
    yield bench
    bench.log.close()


def interrupt() -> None:
    os.kill(os.getpid(), signal.SIGINT)


@pytest.mark.parametrize(
    ("number", "end", "reason"),
    [
        (signal.SIGINT, End.STOPPED_BY_USER, "stopped by the user"),
        (signal.SIGTERM, End.TERMINATED, "ended from outside (SIGTERM)"),
        (signal.SIGHUP, End.TERMINATED, "the terminal or connection was lost (SIGHUP)"),
    ],
)
def test_a_signal_ends_the_run_after_the_cycle(
    bench: Bench, number: signal.Signals, end: End, reason: str
) -> None:
    handler = signal.getsignal(number)
    bench.before_sending({THIRD_CYCLE: lambda: os.kill(os.getpid(), number)})
    result = bench.run(5.0)
    assert (result.end, result.reason, result.cycles) == (end, reason, 3)
    assert tuple(bench.identifiers()) == SET_POINTS * 6
    assert signal.getsignal(number) is handler


def test_a_lost_connection_does_not_end_a_run_under_nohup(bench: Bench) -> None:
    previous = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        bench.before_sending({THIRD_CYCLE: lambda: os.kill(os.getpid(), signal.SIGHUP)})
        assert bench.run(0.1).end is End.TIME_OVER
    finally:
        signal.signal(signal.SIGHUP, previous)


def test_a_second_signal_does_not_wait_for_the_cycle_but_the_drive_is_stopped(bench: Bench) -> None:
    bench.before_sending({THIRD_CYCLE: interrupt, THIRD_CYCLE + 1: interrupt})
    with pytest.raises(KeyboardInterrupt):
        bench.run(5.0)
    assert tuple(bench.identifiers()[-12:]) == SET_POINTS * 3
    assert len(bench.wheels.sent) == THIRD_CYCLE + 12


def test_no_signal_interrupts_the_stopping_of_the_drive(bench: Bench) -> None:
    bench.before_sending({THIRD_CYCLE: interrupt, IN_THE_STOP: interrupt, IN_THE_STOP + 1: interrupt})
    result = bench.run(5.0)
    assert result.end is End.STOPPED_BY_USER
    assert tuple(bench.identifiers()) == SET_POINTS * 6


def test_when_the_log_cannot_be_written_all_wheels_are_stopped(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    def no_space(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    def fill_disk() -> None:
        monkeypatch.setattr(bench.log._file, "add_message", no_space)
        bench.log.write_json("/any", 1, {})
        bench.log._thread.join()

    bench.before_sending({THIRD_CYCLE: fill_disk})
    with pytest.raises(LogError, match="No space left"):
        bench.executive.run(5.0)
    assert tuple(bench.identifiers()) == SET_POINTS * 6


def test_a_log_that_is_deleted_while_the_rover_drives_stops_all_wheels(bench: Bench, tmp_path: Path) -> None:
    bench.before_sending({THIRD_CYCLE: (tmp_path / "run.mcap").unlink})
    with pytest.raises(LogError, match="was deleted during the run"):
        bench.executive.run(5.0)
    assert tuple(bench.identifiers()[-12:]) == SET_POINTS * 3


def test_an_error_inside_the_loop_stops_all_wheels(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise ZeroDivisionError

    bench.before_sending({THIRD_CYCLE: lambda: monkeypatch.setattr(bench.rig.loop, "step", fail)})
    with pytest.raises(ZeroDivisionError):
        bench.executive.run(5.0)
    assert tuple(bench.identifiers()) == SET_POINTS * 6


def test_a_device_without_a_role_that_is_given_up_does_not_end_the_run(bench: Bench) -> None:
    bench.links.image_links["camera"].feed(LinkChange(bench.rig.clock.now_ns(), False, "gave up", True))
    assert bench.executive.run(3.0).end is End.TIME_OVER


def test_a_device_in_a_role_that_is_given_up_ends_the_run(bench: Bench) -> None:
    bench.links.bytes_links["imu"].feed(LinkChange(bench.rig.clock.now_ns(), False, "unplugged", True))
    result = bench.executive.run(3.0)
    assert result.end is End.DEVICE_FAILED
    assert result.reason == "device 'imu' has failed: unplugged"
    assert result.cycles < 200


def test_the_loop_asks_the_log_between_two_cycles_whether_the_disk_hangs(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    sent_before: list[int] = []
    monkeypatch.setattr(
        bench.log, "wait_while_disk_hangs", lambda _: sent_before.append(len(bench.wheels.sent))
    )
    result = bench.executive.run(0.1)
    assert len(sent_before) == result.cycles > 3
    assert all(count % len(SET_POINTS) == 0 for count in sent_before)


def test_ctrl_c_while_the_disk_hangs_ends_the_run(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    answers: list[bool] = []

    def wait(is_ended: Callable[[], bool]) -> None:
        answers.append(is_ended())
        bench.request.note(signal.SIGINT)
        answers.append(is_ended())

    monkeypatch.setattr(bench.log, "wait_while_disk_hangs", wait)
    result = bench.executive.run(5.0)
    assert (result.end, result.cycles, answers) == (End.STOPPED_BY_USER, 1, [False, True])
