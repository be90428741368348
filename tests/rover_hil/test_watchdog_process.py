"""The loop's side of the watchdog, with real processes: start, heartbeats, loss, end."""

import gc
import json
import mmap
import os
import select
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from drivers.clock import SystemClock, nanoseconds
from drivers.emergency_stop import EmergencyStop, PortKind, StopPort
from rover_hil.recording.watchdog_note import note_path
from rover_hil.run import watchdog_process, watchdog_program
from rover_hil.run.watchdog_process import WatchdogError, WatchdogProcess
from rover_hil.run.watchdog_program import ARMED, CHECKING, OVER, RESTING, SIGNS, STATE, STOPS, WAITS

PATIENCE_S = 60.0
LONG_S = 600.0
"""So long a test may be silent: the watchdog must not end the tests."""
CLOCK = SystemClock()
START_NS = 1_000
SILENT_NS = nanoseconds(0.5)
PAUSE_NS = nanoseconds(0.5)
LOST = "watchdog: its process has ended with code -9"


IS_MUTATED = "MUTANT_UNDER_TEST" in os.environ
ROOT = Path(__file__).parents[3 if IS_MUTATED else 2]
"""Of the program as it is: mutmut changes a copy in a folder of its own."""


@pytest.fixture(autouse=True)
def program_as_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    """Run the watchdog's process unchanged while mutmut changes the loop's side: it imports no packages."""
    if IS_MUTATED:
        monkeypatch.setattr(watchdog_program, "__file__", str(ROOT / "rover_hil/run/watchdog_program.py"))


def wait_for(condition: Callable[[], bool]) -> None:
    deadline_ns = CLOCK.now_ns() + nanoseconds(PATIENCE_S)
    while not condition():
        assert CLOCK.now_ns() < deadline_ns
        CLOCK.sleep_until(CLOCK.now_ns() + 5_000_000)


def stop_of(port: Path) -> EmergencyStop:
    return EmergencyStop(StopPort(PortKind.SERIAL, str(port), 115_200), (b"REC", b"rec"))


@pytest.fixture
def port(tmp_path: Path) -> Path:
    path = tmp_path / "port"
    path.touch()
    return path


@pytest.fixture
def watchdog(port: Path) -> Iterator[WatchdogProcess]:
    with WatchdogProcess(stop_of(port), LONG_S) as watchdog:
        yield watchdog


def process_of(watchdog: WatchdogProcess) -> "subprocess.Popen[bytes]":
    process = watchdog._process
    assert process is not None
    return process


def open_files() -> list[str]:
    """Return the open files of this process, without those that earlier tests have left to the collector."""
    gc.collect()
    return sorted(path.name for path in Path("/proc/self/fd").iterdir())


def test_it_lives_while_the_context_lasts_and_leaves_nothing_behind(port: Path) -> None:
    files = open_files()
    watchdog = WatchdogProcess(stop_of(port), LONG_S)
    assert watchdog.count == 0
    with watchdog:
        process = process_of(watchdog)
        begun = watchdog.count
        wait_for(lambda: watchdog.count > begun)
        assert process.poll() is None
    assert process.returncode == 0  # it ended by itself
    watchdog.close()
    assert open_files() == files


def test_one_that_does_not_end_is_killed(port: Path) -> None:
    with WatchdogProcess(stop_of(port), LONG_S) as watchdog:
        process = process_of(watchdog)
        process.send_signal(signal.SIGSTOP)
    assert process.returncode == -signal.SIGKILL


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGPIPE])
def test_signals_that_end_the_loop_do_not_end_it_before(
    watchdog: WatchdogProcess, number: signal.Signals
) -> None:
    process = process_of(watchdog)
    process.send_signal(number)
    seen = watchdog.count
    wait_for(lambda: watchdog.count > seen + 2)
    assert process.poll() is None


def test_it_is_in_a_session_of_its_own_that_no_key_of_a_terminal_reaches(watchdog: WatchdogProcess) -> None:
    process_id = process_of(watchdog).pid
    assert os.getsid(process_id) == process_id != os.getsid(0)


def test_what_its_process_is_told(port: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    calls: list[tuple[list[str], dict[str, Any]]] = []

    def popen(command: list[str], **options: Any) -> None:
        calls.append((command, options))
        raise OSError("enough")

    monkeypatch.setattr(subprocess, "Popen", popen)
    monkeypatch.chdir(tmp_path)
    for expiry_s, note in ((0.15, Path("note.txt")), (0.001, None), (0.154, None)):
        with pytest.raises(WatchdogError), WatchdogProcess(stop_of(port), expiry_s, note):
            pass
    (command, options), *_ = calls
    order = json.loads(command[4])
    assert command[:4] == [sys.executable, "-I", "-S", watchdog_program.__file__]
    assert options["pass_fds"] == (order["page"], order["loop"])
    assert options["start_new_session"] is True
    assert options["stdin"] == subprocess.DEVNULL
    assert options["stdout"] == subprocess.PIPE
    assert options["stderr"] == 2
    assert set(options) == {"pass_fds", "start_new_session", "stdin", "stdout", "stderr"}
    del order["page"], order["loop"]
    assert order == {
        "loop_id": os.getpid(),
        "silent_periods": 15,
        "port": "serial",
        "path": str(port),
        "baud_rate": 115_200,
        "payloads": ["524543", "726563"],
        "note": str(tmp_path / "note.txt"),
    }
    orders = [json.loads(command[4]) for command, _ in calls[1:]]
    assert [(each["silent_periods"], each["note"]) for each in orders] == [(1, ""), (15, "")]


def test_the_port_is_checked_before_anything_moves(watchdog: WatchdogProcess, port: Path) -> None:
    watchdog.check_port()
    assert port.read_bytes() == b""
    port.unlink()
    with pytest.raises(WatchdogError) as caught:
        watchdog.check_port()
    assert str(caught.value) == (
        f"the watchdog is not ready: it cannot open {port} to stop the drive: No such file or directory; "
        "the rover must not move"
    )


def test_one_that_is_over_is_not_ready(port: Path) -> None:
    with WatchdogProcess(stop_of(port), LONG_S) as watchdog:
        watchdog.close()
        with pytest.raises(WatchdogError, match="is not ready: it has ended; the rover must not move"):
            watchdog.check_port()


def test_without_shared_memory_nothing_moves(port: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    files = open_files()
    watchdog = WatchdogProcess(stop_of(port), LONG_S)

    def refuse(*arguments: object) -> int:
        raise OSError("no memory")

    for name, where in (("memfd_create", os), ("truncate", os), ("mmap", mmap)):
        with monkeypatch.context() as patch:
            patch.setattr(where, name, refuse)
            with pytest.raises(WatchdogError) as caught, watchdog:
                pass
        assert str(caught.value) == (
            "the watchdog gets no shared memory (no memory): end other programs, or give this one more"
        )
        assert open_files() == files


@pytest.mark.parametrize(
    ("program", "reason"),
    [
        (None, "[Errno 2] No such file or directory: '{path}'"),
        ("exit 3", "it has ended with code 3"),
        ("echo no", "no"),
        ("exec sleep 600", "no answer within 0.3 s"),
    ],
)
def test_a_process_that_does_not_start_is_one_sentence_and_leaves_nothing(
    port: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, program: str | None, reason: str
) -> None:
    files = open_files()
    path = tmp_path / "python"
    if program is not None:
        path.write_text(f"#!/bin/sh\n{program}\n")
        path.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(path))
    if "sleep" in reason or "answer" in reason:
        monkeypatch.setattr(watchdog_process, "START_S", 0.3)
    with pytest.raises(WatchdogError) as caught, WatchdogProcess(stop_of(port), LONG_S):
        pass
    told = reason.format(path=path)
    assert str(caught.value) == f"the watchdog cannot be started ({told}): the rover must not move"
    assert open_files() == files


def test_limits_are_what_the_documents_say() -> None:
    limits = watchdog_process.START_S, watchdog_process.SILENT_S, watchdog_process.RESTARTS
    assert limits == (10.0, 0.5, 3)
    assert note_path(Path("out/run.mcap")) == Path("out/run.watchdog.txt")


def test_the_states_that_it_gives_to_the_process(port: Path, tmp_path: Path) -> None:
    note = tmp_path / "note.txt"
    note.write_text("of an earlier run")
    with WatchdogProcess(stop_of(port), LONG_S, note) as watchdog:
        counts = watchdog._counts
        assert counts[STATE] == RESTING
        watchdog.check_port()
        assert note.exists()
        watchdog.arm()
        assert not note.exists()
        assert (counts[STATE], counts[SIGNS], counts[WAITS]) == (ARMED, 1, 0)
        watchdog.feed()
        watchdog.feed()
        watchdog.note_waiting()
        watchdog.note_waiting()
        assert (counts[STATE], counts[SIGNS], counts[WAITS]) == (ARMED, 3, 2)
        watchdog.rest()
        assert counts[STATE] == RESTING
        watchdog.arm()
        assert (counts[STATE], counts[SIGNS]) == (ARMED, 4)
    assert counts[STATE] == OVER
    assert CHECKING not in (RESTING, ARMED, OVER)


def test_each_stop_of_the_drive_is_reported_once(watchdog: WatchdogProcess) -> None:
    assert not watchdog.has_stopped_drive()
    watchdog._counts[STOPS] = 2
    assert watchdog.has_stopped_drive()
    assert not watchdog.has_stopped_drive()


def test_one_that_is_stopped_is_missed_after_half_a_second_until_it_goes_on(
    watchdog: WatchdogProcess,
) -> None:
    process = process_of(watchdog)
    os.kill(process.pid, signal.SIGSTOP)
    os.waitid(os.P_PID, process.pid, os.WSTOPPED | os.WNOWAIT)
    assert watchdog.stop_reason(START_NS) == ""
    assert watchdog.stop_reason(START_NS + SILENT_NS) == ""
    assert watchdog.stop_reason(START_NS + SILENT_NS + 1) == "watchdog: no heartbeat for 0.5 s"
    os.kill(process.pid, signal.SIGCONT)
    wait_for(lambda: watchdog.stop_reason(START_NS + SILENT_NS + 2) == "")
    assert process_of(watchdog) is process


def kill(watchdog: WatchdogProcess, now_ns: int = START_NS) -> None:
    process = process_of(watchdog)
    os.kill(process.pid, signal.SIGKILL)
    os.waitid(os.P_PID, process.pid, os.WEXITED | os.WNOWAIT)
    watchdog.stop_reason(now_ns)  # has seen its last beats


def test_one_that_has_died_is_named_and_started_again_three_times(watchdog: WatchdogProcess) -> None:
    for now_ns in range(START_NS, START_NS + 3 * PAUSE_NS, PAUSE_NS):
        before = process_of(watchdog)
        kill(watchdog, now_ns)
        wait_for(lambda now_ns=now_ns: watchdog.stop_reason(now_ns) == LOST)  # type: ignore[misc]
        assert process_of(watchdog) is not before
        wait_for(lambda now_ns=now_ns: watchdog.stop_reason(now_ns) == "")  # type: ignore[misc]
    kill(watchdog, now_ns)
    wait_for(lambda: watchdog.stop_reason(now_ns) == LOST)
    seen = watchdog.count
    CLOCK.sleep_until(CLOCK.now_ns() + nanoseconds(0.3))
    assert watchdog.stop_reason(START_NS + 9 * SILENT_NS) == LOST
    assert watchdog.count == seen
    watchdog.close()
    assert watchdog.stop_reason(START_NS) != ""


def test_the_rover_rests_where_none_can_be_started_again(
    watchdog: WatchdogProcess, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(sys, "executable", str(tmp_path / "none"))
    kill(watchdog)
    wait_for(lambda: watchdog.stop_reason(START_NS) == LOST)
    assert watchdog.stop_reason(START_NS + 9 * SILENT_NS) == LOST


def test_a_start_that_fails_is_tried_again_after_a_pause(
    watchdog: WatchdogProcess, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    with monkeypatch.context() as patch:
        patch.setattr(sys, "executable", str(tmp_path / "none"))
        kill(watchdog)
        wait_for(lambda: watchdog.stop_reason(START_NS) == LOST)
    assert watchdog.stop_reason(START_NS + PAUSE_NS - 1) == LOST
    assert watchdog.stop_reason(START_NS + PAUSE_NS) == LOST
    process = process_of(watchdog)
    os.kill(process.pid, signal.SIGKILL)  # before or after its first heartbeat
    os.waitid(os.P_PID, process.pid, os.WEXITED | os.WNOWAIT)
    wait_for(lambda: watchdog.stop_reason(START_NS + 2 * PAUSE_NS) == LOST)
    wait_for(lambda: watchdog.stop_reason(START_NS + 2 * PAUSE_NS) == "")


def test_a_new_one_watches_on(watchdog: WatchdogProcess) -> None:
    watchdog.arm()
    kill(watchdog)
    wait_for(lambda: watchdog.stop_reason(START_NS) == LOST)
    assert watchdog._counts[STATE] == ARMED


LOOP = """
import ctypes, os, re, sys
from pathlib import Path
from drivers.clock import SystemClock
from drivers.emergency_stop import EmergencyStop, PortKind, StopPort
from rover_hil.run.watchdog_process import WatchdogProcess
stop = EmergencyStop(StopPort(PortKind.SERIAL, sys.argv[1], 115_200), (b"REC", b"rec"))
clock = SystemClock()
with WatchdogProcess(stop, 0.15, Path(sys.argv[2])) as watchdog:
    watchdog.check_port()
    watchdog.arm()
    print(watchdog._process.pid, flush=True)
    act = sys.argv[3]
    while True:
        watchdog.feed()
        if act == "sleeps with the lock":
            ctypes.PyDLL(None).sleep(600)
        elif act == "computes with the lock":
            re.match("(a+)+$", "a" * 60 + "b")
        elif act == "ends":
            sys.exit(5)
        clock.sleep_until(clock.now_ns() + 20_000_000)
"""


def begin(port: Path, act: str) -> tuple["subprocess.Popen[str]", int]:
    """Start a loop; return it and a pidfd of its watchdog."""
    loop = subprocess.Popen(
        [sys.executable, "-c", LOOP, str(port), str(port.with_name("note.txt")), act],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | {"PYTHONPATH": ""},
        cwd=ROOT,
    )
    assert loop.stdout is not None
    return loop, os.pidfd_open(int(loop.stdout.readline()))


def is_gone(file: int) -> bool:
    found = bool(select.select([file], [], [], PATIENCE_S)[0])
    os.close(file)
    return found


@pytest.mark.slow
@pytest.mark.parametrize("act", ["sleeps with the lock", "computes with the lock"])
def test_a_loop_that_is_stuck_in_c_is_ended_and_the_cause_told(port: Path, act: str) -> None:
    loop, watchdog = begin(port, act)
    _, shown = loop.communicate(timeout=PATIENCE_S)
    assert loop.returncode == -signal.SIGKILL
    assert is_gone(watchdog)
    cause = "watchdog: the loop gave no heartbeat for over a second and was ended; the drive was stopped\n"
    assert shown == port.with_name("note.txt").read_text() == cause
    assert port.read_bytes() == b"RECrec"


@pytest.mark.slow
def test_a_loop_that_is_stopped_from_outside_has_its_drive_stopped_and_goes_on(port: Path) -> None:
    loop, watchdog = begin(port, "drives")
    loop.send_signal(signal.SIGSTOP)
    wait_for(lambda: port.read_bytes() == b"RECrec")
    CLOCK.sleep_until(CLOCK.now_ns() + nanoseconds(1.5))
    loop.send_signal(signal.SIGCONT)
    assert loop.poll() is None
    loop.kill()
    _, shown = loop.communicate(timeout=PATIENCE_S)
    assert is_gone(watchdog)
    assert shown.startswith("watchdog: the process of the loop was killed or has crashed")


@pytest.mark.slow
def test_a_loop_that_ends_by_itself_takes_its_watchdog_along(port: Path) -> None:
    loop, watchdog = begin(port, "ends")
    _, shown = loop.communicate(timeout=PATIENCE_S)
    assert loop.returncode == 5
    assert is_gone(watchdog)
    assert shown == ""
    assert port.read_bytes() == b""
