"""The process of the watchdog, function by function: silence, hang, stop frames, cause."""

import ctypes
import errno
import gc
import json
import os
import pty
import select
import signal
import socket
import subprocess
import sys
import termios
import tty
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import cast

import pytest

from drivers.can.frame import CanFrame, pack_can_frame
from rover_hil.run import watchdog_program as program
from rover_hil.run.watchdog_program import (
    ARMED,
    BEATS,
    CHECKING,
    HANG_PERIODS,
    OVER,
    PERIOD_MS,
    READY,
    REPEAT_PERIODS,
    RESTING,
    SIGNS,
    STATE,
    STOPS,
    WAITS,
    Order,
    Page,
    Port,
    ProcThreads,
    Silence,
    Watch,
    slcan_line,
)

SILENT = 15
FRAME = pack_can_frame(CanFrame(0x123, b"\x01\xab"))
LONG_FRAME = pack_can_frame(CanFrame(0x123_4567, bytes(8), is_extended=True))


def open_files() -> list[str]:
    return sorted(path.name for path in Path("/proc/self/fd").iterdir())


class Threads:
    """Threads that work a given share of the time."""

    def __init__(self, share: float = 1.0) -> None:
        self.share = share
        self.asked = 0

    def worked_share(self) -> float:
        self.asked += 1
        return self.share


def judge(silence: Silence, signs: int, waits: int = 0) -> str:
    """Return what is to be done in a period: s for stop, b for the begin of a silence, h for a hang."""
    silence.count(signs, waits)
    return "s" * silence.must_stop + "b" * silence.begins + "h" * silence.hangs


def test_the_constants_are_what_the_documents_say() -> None:
    assert (PERIOD_MS, HANG_PERIODS, REPEAT_PERIODS) == (10, 100, 5)
    assert os.sysconf("SC_CLK_TCK") * PERIOD_MS == 1000


def test_the_drive_is_stopped_after_the_silence_and_again_and_the_loop_is_ended_a_second_later() -> None:
    silence = Silence(SILENT, Threads())
    assert judge(silence, 7) == ""
    assert [judge(silence, 7) for _ in range(SILENT - 1)] == [""] * (SILENT - 1)
    assert judge(silence, 7) == "sb"
    later = [judge(silence, 7) for _ in range(HANG_PERIODS + 1)]
    assert later[:HANG_PERIODS] == ["s" if n % 5 == 0 else "" for n in range(1, HANG_PERIODS)] + ["h"]
    assert later[HANG_PERIODS] == "h"


def test_each_sign_begins_anew() -> None:
    silence = Silence(SILENT, Threads())
    for signs in range(1, 4):
        assert [judge(silence, signs) for _ in range(SILENT)] == [""] * SILENT
    assert judge(silence, 3) == "sb"
    assert judge(silence, 4) == ""
    assert [judge(silence, 4) for _ in range(SILENT)] == [""] * (SILENT - 1) + ["sb"]


def test_the_threads_are_looked_at_in_a_silence_only() -> None:
    threads = Threads()
    silence = Silence(SILENT, threads)
    for _ in range(SILENT):
        judge(silence, 1)
    assert threads.asked == 0
    judge(silence, 1)
    assert threads.asked == 1


def test_a_loop_that_could_not_work_is_stopped_and_not_ended() -> None:
    threads = Threads(0.0)
    silence = Silence(SILENT, threads)
    done = [judge(silence, 1) for _ in range(50 * HANG_PERIODS)]
    assert done.count("sb") == 1
    assert not any("h" in each for each in done)
    threads.share = 0.25
    done = [judge(silence, 1) for _ in range(4 * HANG_PERIODS)]
    assert done == [""] * (4 * HANG_PERIODS - 1) + ["h"]


def test_repeated_stops_end_after_a_second_so_that_the_drive_s_own_time_out_acts() -> None:
    silence = Silence(SILENT, Threads(0.0))
    done = [judge(silence, 1) for _ in range(5 * HANG_PERIODS)]
    assert sum("s" in each for each in done) == HANG_PERIODS // REPEAT_PERIODS


def test_a_loop_that_waits_on_purpose_is_stopped_and_not_ended() -> None:
    silence = Silence(SILENT, Threads())
    done = [judge(silence, 1, waits=n // 10) for n in range(20 * HANG_PERIODS)]
    assert done.count("sb") == 1
    assert not any("h" in each for each in done)
    done = [judge(silence, 1, waits=5) for _ in range(HANG_PERIODS + 1)]
    assert done == [""] * HANG_PERIODS + ["h"]


def test_waits_before_the_silence_do_not_count() -> None:
    silence = Silence(SILENT, Threads())
    judge(silence, 1, waits=3)
    done = [judge(silence, 1, waits=3) for _ in range(SILENT + HANG_PERIODS)]
    assert done[-2:] == ["", "h"] or done[-2:] == ["s", "h"]


def test_what_was_worked_in_an_earlier_silence_does_not_count() -> None:
    silence = Silence(SILENT, Threads())
    for signs in range(1, 4):
        judge(silence, signs)
        done = [judge(silence, signs) for _ in range(SILENT + HANG_PERIODS - 1)]
        assert not any("h" in each for each in done)


def test_at_rest_nothing_counts() -> None:
    silence = Silence(SILENT, Threads())
    for _ in range(SILENT + HANG_PERIODS + 1):
        judge(silence, 1)
    assert silence.hangs
    silence.rest()
    assert [judge(silence, 1) for _ in range(SILENT)] == [""] * (SILENT - 1) + ["sb"]


def test_without_any_sign_the_silence_begins_with_the_first_period() -> None:
    silence = Silence(SILENT, Threads())
    assert [judge(silence, 0) for _ in range(SILENT)] == [""] * (SILENT - 1) + ["sb"]
    silence = Silence(SILENT, Threads())
    assert [judge(silence, 1) for _ in range(SILENT)] == [""] * SILENT


def put_stat(folder: Path, task: int, state: str, user: int, system: int, name: str = "rover-hil") -> None:
    task_folder = folder / "5" / "task" / str(task)
    task_folder.mkdir(parents=True, exist_ok=True)
    text = f"{task} ({name}) {state} 1 2 3 4 -1 6 7 8 9 10 {user} {system} 13 14 20 0\n"
    (task_folder / "stat").write_text(text)


@pytest.mark.parametrize("state", ["S", "D"])
def test_a_thread_that_sleeps_or_waits_for_a_disk_could_have_worked(tmp_path: Path, state: str) -> None:
    put_stat(tmp_path, 5, state, 100, 50)
    threads = ProcThreads(5, str(tmp_path))
    assert threads.worked_share() == 1.0
    assert threads.worked_share() == 1.0


@pytest.mark.parametrize("state", ["T", "t"])
def test_a_process_that_someone_stopped_could_not(tmp_path: Path, state: str) -> None:
    put_stat(tmp_path, 5, state, 100, 50)
    put_stat(tmp_path, 6, "S", 100, 50)
    assert ProcThreads(5, str(tmp_path)).worked_share() == 0.0


def test_a_thread_that_is_ready_to_run_worked_for_as_long_as_it_had_a_processor(tmp_path: Path) -> None:
    put_stat(tmp_path, 5, "R", 100, 50)
    threads = ProcThreads(5, str(tmp_path))
    assert threads.worked_share() == 0.0
    assert threads.worked_share() == 0.0
    put_stat(tmp_path, 5, "R", 101, 50)
    assert threads.worked_share() == 1.0
    put_stat(tmp_path, 5, "R", 101, 51)
    assert threads.worked_share() == 1.0
    put_stat(tmp_path, 5, "R", 103, 55)
    assert threads.worked_share() == 1.0
    assert threads.worked_share() == 0.0


def test_where_one_thread_gets_no_processor_the_others_may_wait_for_it(tmp_path: Path) -> None:
    put_stat(tmp_path, 5, "S", 100, 50)
    put_stat(tmp_path, 6, "R", 10, 5)
    put_stat(tmp_path, 7, "R", 10, 5)
    threads = ProcThreads(5, str(tmp_path))
    threads.worked_share()
    put_stat(tmp_path, 7, "R", 11, 5)
    assert threads.worked_share() == 0.0
    put_stat(tmp_path, 6, "R", 11, 5)
    put_stat(tmp_path, 7, "R", 12, 5)
    assert threads.worked_share() == 1.0


def test_a_name_with_brackets_and_spaces_is_no_riddle(tmp_path: Path) -> None:
    put_stat(tmp_path, 5, "T", 100, 50, name="a) S (b")
    assert ProcThreads(5, str(tmp_path)).worked_share() == 0.0


def test_a_line_that_cannot_be_read_is_left_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    put_stat(tmp_path, 5, "T", 100, 50)
    (tmp_path / "5/task/4").mkdir()
    (tmp_path / "5/task/4/stat").write_text("nonsense")
    assert ProcThreads(5, str(tmp_path)).worked_share() == 0.0
    monkeypatch.setattr(os, "listdir", lambda _: ["4", "5"])
    assert ProcThreads(5, str(tmp_path)).worked_share() == 0.0


def test_where_the_system_does_not_show_threads_a_hang_is_ended(tmp_path: Path) -> None:
    assert ProcThreads(5, str(tmp_path)).worked_share() == 1.0
    put_stat(tmp_path, 5, "T", 100, 50)
    (tmp_path / "5/task/6").mkdir()  # a thread that has just ended
    assert ProcThreads(5, str(tmp_path)).worked_share() == 1.0


def test_this_process_sleeps_and_a_busy_one_works() -> None:
    threads = ProcThreads(os.getpid())
    assert threads.worked_share() in (0.0, 1.0)
    files = len(open_files())
    threads.worked_share()
    assert len(open_files()) == files


def test_a_process_that_is_stopped_is_seen() -> None:
    with subprocess.Popen([sys.executable, "-c", "while True: pass"]) as busy:
        threads = ProcThreads(busy.pid)
        busy.send_signal(signal.SIGSTOP)
        os.waitid(os.P_PID, busy.pid, os.WSTOPPED | os.WNOWAIT)
        assert threads.worked_share() == 0.0
        busy.kill()


@pytest.mark.parametrize(
    ("payload", "line"),
    [
        (FRAME, b"t123201AB\r"),
        (LONG_FRAME, b"T0123456780000000000000000\r"),
        (pack_can_frame(CanFrame(0x7, b"")), b"t0070\r"),
    ],
)
def test_a_can_frame_as_a_line_of_an_adapter(payload: bytes, line: bytes) -> None:
    assert slcan_line(payload) == line


@pytest.fixture
def terminal() -> Iterator[tuple[int, str]]:
    """Give the device's side of a serial port, and the path of the host's."""
    device, host = pty.openpty()
    path = os.ttyname(host)
    os.close(host)
    os.set_blocking(device, False)
    yield device, path
    os.close(device)


def test_a_serial_port_gets_the_bytes_unchanged(terminal: tuple[int, str]) -> None:
    device, path = terminal
    port = Port("serial", path, 115_200, [b"REC\n", b"rec\n"])
    assert port.check() == ""
    assert port.stop() == ""
    assert os.read(device, 100) == b"REC\nrec\n"


def test_a_serial_port_keeps_its_rate_where_that_has_no_name(terminal: tuple[int, str]) -> None:
    _, path = terminal
    keeping = os.open(path, os.O_RDWR | os.O_NOCTTY)
    try:
        tty.setraw(keeping)
        *_, in_speed, out_speed, _ = termios.tcgetattr(keeping)
        for baud_rate in (123, 0):  # 0 would hang up
            assert Port("serial", path, baud_rate, [b"x"]).stop() == ""
            assert termios.tcgetattr(keeping)[4:6] == [in_speed, out_speed]
        assert Port("serial", path, 57_600, [b"x"]).stop() == ""
        input_mode, output, control, local, in_speed, out_speed, _ = termios.tcgetattr(keeping)
        assert (input_mode, output, local) == (0, 0, 0)
        assert control & termios.CSIZE == termios.CS8
        assert not control & (termios.PARENB | termios.CSTOPB)
        assert control & termios.CREAD
        assert control & termios.CLOCAL
        assert (in_speed, out_speed) == (termios.B57600, termios.B57600)
    finally:
        os.close(keeping)


def test_a_serial_port_is_asked_for_eight_bits_and_no_carrier(
    terminal: tuple[int, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[Sequence[object]] = []
    monkeypatch.setattr(termios, "tcsetattr", lambda file, when, modes: asked.append(modes))
    Port("serial", terminal[1], 9600, [b"x"]).stop()
    ((*modes, _),) = asked
    assert modes == [0, 0, termios.CS8 | termios.CREAD | termios.CLOCAL, 0, termios.B9600, termios.B9600]


def test_the_check_sends_nothing(tmp_path: Path) -> None:
    path = tmp_path / "port"
    path.touch()
    port = Port("serial", str(path), 115_200, [b"abc"])
    assert port.check() == ""
    assert path.read_bytes() == b""
    assert port.stop() == ""
    assert path.read_bytes() == b"abc"


def test_an_adapter_gets_lines_after_the_end_of_a_half_sent_one(tmp_path: Path) -> None:
    path = tmp_path / "port"
    path.touch()
    assert Port("slcan", str(path), 0, [FRAME, LONG_FRAME]).stop() == ""
    assert path.read_bytes() == b"\rt123201AB\rT0123456780000000000000000\r"


def test_a_port_that_cannot_be_opened_is_named(tmp_path: Path) -> None:
    path = str(tmp_path / "none")
    port = Port("serial", path, 115_200, [b"abc"])
    assert port.check() == f"it cannot open {path} to stop the drive: No such file or directory"
    assert port.stop() == f"{path}: No such file or directory"


def test_a_port_that_takes_only_a_part_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "port"
    path.touch()
    monkeypatch.setattr(os, "write", lambda file, data: len(data) - 1)
    assert Port("serial", str(path), 115_200, [b"abc"]).stop() == f"{path}: {os.strerror(errno.EAGAIN)}"


class FullBus:
    """A network interface whose queue has room for a frame after some attempts, or never."""

    def __init__(self, full_times: int, error: int = errno.ENOBUFS) -> None:
        self.sent: list[bytes] = []
        self.tried = 0
        self._full_times, self._error = full_times, error

    def send(self, payload: bytes) -> None:
        self.tried += 1
        if payload == FRAME and self.tried <= self._full_times:
            raise OSError(self._error, os.strerror(self._error))
        self.sent.append(payload)


def test_a_frame_waits_for_room_and_keeps_no_other_back(monkeypatch: pytest.MonkeyPatch) -> None:
    waits: list[tuple[object, ...]] = []
    monkeypatch.setattr(select, "select", lambda *arguments: waits.append(arguments))
    for error in (errno.ENOBUFS, errno.EAGAIN):
        bus = FullBus(19, error)
        program.send_frames(cast(socket.socket, bus), [FRAME, LONG_FRAME])
        assert bus.sent == [FRAME, LONG_FRAME]
    assert waits == 38 * [((), (), (), 0.001)]
    bus = FullBus(20)
    with pytest.raises(OSError, match="No buffer space"):
        program.send_frames(cast(socket.socket, bus), [FRAME, LONG_FRAME])
    assert bus.sent == [LONG_FRAME]
    bus = FullBus(1, errno.ENETDOWN)
    with pytest.raises(OSError, match="Network is down"):
        program.send_frames(cast(socket.socket, bus), [FRAME, LONG_FRAME])
    assert bus.sent == []


def test_no_handle_stays_open(tmp_path: Path, terminal: tuple[int, str]) -> None:
    before = open_files()
    path = tmp_path / "port"
    path.touch()
    for each in (str(path), terminal[1]):
        Port("serial", each, 115_200, [b"a"]).stop()
        Port("serial", each, 115_200, [b"a"]).check()
    Port("socketcan", "none0", 0, [FRAME]).stop()
    assert open_files() == before


def test_a_port_is_opened_without_waiting_for_a_carrier_or_taking_its_signals(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "port"
    path.touch()
    opened: list[int] = []
    real = os.open

    def open_file(name: str, flags: int) -> int:
        opened.append(flags)
        return real(name, flags)

    monkeypatch.setattr(os, "open", open_file)
    assert Port("serial", str(path), 115_200, [b"abc"]).stop() == ""
    assert opened == [os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK]


def test_a_drive_that_nobody_else_reaches_gets_nothing() -> None:
    port = Port("none", "/nowhere", 0, [FRAME])
    assert port.check() == ""
    assert port.stop() == ""


class Bus:
    """A CAN socket that keeps what is done to it."""

    def __init__(self, *how: int) -> None:
        self.calls: list[tuple[object, ...]] = [("open", *how)]

    def __enter__(self) -> "Bus":
        return self

    def __exit__(self, *error: object) -> None:
        self.calls.append(("close",))

    def __getattr__(self, name: str) -> Callable[..., None]:
        return lambda *arguments: self.calls.append((name, *arguments))


def test_a_network_interface_gets_frames_and_nothing_is_received(monkeypatch: pytest.MonkeyPatch) -> None:
    buses: list[Bus] = []

    def open_bus(*how: int) -> Bus:
        buses.append(Bus(*how))
        return buses[-1]

    monkeypatch.setattr(socket, "socket", open_bus)
    port = Port("socketcan", "can7", 0, [FRAME, LONG_FRAME])
    assert port.check() == port.stop() == ""
    begin = [
        ("open", socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW),
        ("setsockopt", socket.SOL_CAN_RAW, socket.CAN_RAW_FILTER, b""),
        ("setblocking", False),
        ("bind", ("can7",)),
    ]
    assert buses[0].calls == [*begin, ("close",)]
    assert buses[1].calls == [*begin, ("send", FRAME), ("send", LONG_FRAME), ("close",)]


def test_an_interface_that_does_not_exist_is_named() -> None:
    assert (
        Port("socketcan", "none0", 0, [FRAME]).check().startswith("it cannot open none0 to stop the drive: ")
    )


class Bench:
    """A watch on a process that sleeps, whose periods a test counts.

    Attributes:
        loop: That process.
        port: File that stands for the port of the drive.
    """

    def __init__(self, folder: Path, monkeypatch: pytest.MonkeyPatch, *, kind: str = "serial") -> None:
        self.loop = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"])
        self.loop_file = os.pidfd_open(self.loop.pid)
        self.page_file = os.memfd_create("page")
        os.truncate(self.page_file, program.PAGE_SIZE)
        self.page = Page(self.page_file)
        self.port = folder / "port"
        self.port.touch()
        self.note = folder / "note.txt"
        self.answer_file, self._answers = os.pipe()
        self.screen_file, self._screen = os.pipe()
        for file in (self.answer_file, self.screen_file):
            os.set_blocking(file, False)
        self.order: Order = {
            "page": self.page_file,
            "loop": self.loop_file,
            "loop_id": self.loop.pid,
            "silent_periods": 3,
            "port": kind,
            "path": str(self.port),
            "baud_rate": 115_200,
            "payloads": [b"REC".hex(), b"rec".hex()],
            "note": str(self.note),
        }
        monkeypatch.setattr(program, "ProcThreads", self._threads)
        monkeypatch.setattr(program, "REPEAT_S", 0.0)
        self.threads = Threads()
        self.waits_ms: list[int] = []
        self.watched = -1

    def _threads(self, process_id: int) -> Threads:
        self.watched = process_id
        return self.threads

    def run(self, period: Callable[[int], None]) -> None:
        """Watch; call `period` with its number before each period."""
        self.waits_ms = waits_ms = []
        watch = Watch(self.order, self.page, self._answers, self._screen)
        real = watch._loop

        class Poll:
            def poll(self, wait_ms: int) -> list[tuple[int, int]]:
                waits_ms.append(wait_ms)
                if wait_ms != PERIOD_MS:
                    return real.poll(60_000)
                period(len(waits_ms) - 1)
                return real.poll(0)

        watch._loop = Poll()  # type: ignore[assignment]
        watch.run()

    def kill(self) -> None:
        self.loop.kill()
        assert select.select([self.loop_file], [], [], 60.0)[0]

    def answers(self) -> list[str]:
        return os.read(self.answer_file, 4096).decode().splitlines()

    def shown(self) -> str:
        try:
            return os.read(self.screen_file, 4096).decode()
        except BlockingIOError:
            return ""

    def close(self) -> None:
        self.loop.kill()
        self.loop.wait()
        for file in (
            self.loop_file,
            self.page_file,
            self.answer_file,
            self._answers,
            self.screen_file,
            self._screen,
        ):
            os.close(file)


@pytest.fixture
def bench(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Bench]:
    bench = Bench(tmp_path, monkeypatch)
    yield bench
    bench.close()


def test_it_says_ready_counts_its_periods_and_ends_when_the_loop_is_over(bench: Bench) -> None:
    beats: list[int] = []

    def period(number: int) -> None:
        beats.append(bench.page[BEATS])
        if number == 4:
            bench.page[STATE] = OVER

    bench.run(period)
    assert beats == [0, 1, 2, 3, 4]
    assert bench.page[BEATS] == 5
    assert bench.answers() == [READY]
    assert bench.watched == bench.loop.pid
    assert set(bench.waits_ms) == {PERIOD_MS}
    assert bench.port.read_bytes() == b""
    assert bench.shown() == ""
    assert not bench.note.exists()
    assert bench.loop.poll() is None


def test_counts_go_on_where_it_replaces_another(bench: Bench) -> None:
    bench.page[BEATS], bench.page[STOPS], bench.page[STATE] = 70, 8, ARMED

    def period(number: int) -> None:
        if number == 4:
            bench.page[STATE] = OVER

    bench.run(period)
    assert bench.page[BEATS] == 75
    assert bench.page[STOPS] == 9


def test_it_answers_whether_the_port_can_be_opened(bench: Bench) -> None:
    def period(number: int) -> None:
        if number == 3:
            assert bench.page[STATE] == RESTING
            bench.port.unlink()
        if number in (2, 4):
            bench.page[STATE] = CHECKING
        if number == 5:
            bench.page[STATE] = OVER

    bench.run(period)
    first, second, third = bench.answers()
    assert (first, second) == (READY, READY)
    assert third == f"it cannot open {bench.port} to stop the drive: No such file or directory"


def test_a_silent_loop_s_drive_is_stopped_and_counted_and_watched_on(bench: Bench) -> None:
    stops: list[int] = []

    def period(number: int) -> None:
        bench.page[STATE] = ARMED
        stops.append(bench.page[STOPS])
        if number == 5:
            assert bench.port.read_bytes() == b"RECrec"
            bench.page[SIGNS] += 1
        if number == 10:
            bench.page[STATE] = OVER

    bench.run(period)
    assert stops == [0, 0, 0, 1, 1, 1, 1, 1, 1, 2, 2]
    assert bench.loop.poll() is None
    assert bench.shown() == ""


def test_at_rest_silence_is_none(bench: Bench) -> None:
    def period(number: int) -> None:
        bench.page[STATE] = ARMED if number in (0, 1, 20, 21) else RESTING
        if number == 23:
            bench.page[STATE] = OVER

    bench.run(period)
    assert bench.page[STOPS] == 0
    assert bench.port.read_bytes() == b""


def test_a_loop_that_waits_is_not_ended(bench: Bench) -> None:
    def period(number: int) -> None:
        bench.page[STATE] = ARMED
        bench.page[WAITS] = number
        if number == 5 * HANG_PERIODS:
            bench.page[STATE] = OVER

    bench.run(period)
    assert bench.page[STOPS] == HANG_PERIODS // REPEAT_PERIODS
    assert bench.loop.poll() is None


def test_a_loop_that_hangs_is_ended_its_drive_stopped_and_the_cause_told(bench: Bench) -> None:
    bench.page[STATE] = ARMED
    bench.run(lambda number: None)
    assert bench.loop.wait(60.0) == -signal.SIGKILL
    assert len(bench.waits_ms) == 3 + HANG_PERIODS + 1
    assert bench.waits_ms[-1] == 2000
    cause = "watchdog: the loop gave no heartbeat for over a second and was ended; the drive was stopped\n"
    assert bench.shown() == cause
    assert bench.note.read_text() == cause
    assert bench.note.stat().st_mode & 0o777 & ~0o022 == 0o644
    stops = bench.port.read_bytes()
    assert stops == b"RECrec"  # a file is written from its beginning each time


def test_when_the_loop_is_killed_the_drive_is_stopped_at_once_and_the_cause_told(bench: Bench) -> None:
    def period(number: int) -> None:
        bench.page[STATE] = ARMED
        if number == 2:
            bench.kill()

    bench.run(period)
    assert len(bench.waits_ms) == 3
    assert bench.port.read_bytes() == b"RECrec"
    cause = "watchdog: the process of the loop was killed or has crashed; the drive was stopped\n"
    assert bench.shown() == cause
    assert bench.note.read_text() == cause


def test_when_a_loop_at_rest_is_killed_nothing_is_sent(bench: Bench) -> None:
    bench.run(lambda number: bench.kill())
    assert bench.port.read_bytes() == b""
    assert bench.shown() == ""
    assert not bench.note.exists()


def test_a_drive_that_cannot_be_stopped_is_told(bench: Bench) -> None:
    def period(number: int) -> None:
        bench.page[STATE] = ARMED
        bench.port.unlink()
        bench.kill()

    bench.run(period)
    assert bench.shown().endswith(
        f"; the drive could not be stopped ({bench.port}: No such file or directory): its own time-out must\n"
    )


def test_a_drive_that_only_its_own_time_out_stops_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench = Bench(tmp_path, monkeypatch, kind="none")
    bench.order["note"] = ""

    def period(number: int) -> None:
        bench.page[STATE] = ARMED
        bench.kill()

    bench.run(period)
    assert bench.shown().endswith("; no other process reaches the drive: its own time-out must stop it\n")
    assert bench.port.read_bytes() == b""
    bench.close()


def test_a_serial_drive_is_stopped_at_its_rate(bench: Bench, terminal: tuple[int, str]) -> None:
    device, bench.order["path"] = terminal
    bench.order["baud_rate"] = 9600

    def period(number: int) -> None:
        bench.page[STATE] = ARMED
        bench.kill()

    keeping = os.open(terminal[1], os.O_RDWR | os.O_NOCTTY)
    try:
        bench.run(period)
        assert os.read(device, 6) == b"RECrec"  # the repeats arrive when the system hands them over
        assert termios.tcgetattr(keeping)[5] == termios.B9600
    finally:
        os.close(keeping)


def test_after_the_end_of_the_loop_the_drive_is_stopped_for_a_second(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    tried: list[str] = []
    failures = iter(["busy", "busy"])

    def stop() -> str:
        tried.append(bench.note.read_text() if bench.note.exists() else "")
        return next(failures, "")

    def period(number: int) -> None:
        bench.page[STATE] = ARMED
        bench.kill()

    monkeypatch.setattr(Port, "stop", lambda port: stop())
    bench.run(period)
    assert len(tried) == 21
    assert tried[:3] == ["", "", ""]
    assert all("; the drive was stopped\n" in each for each in tried[3:])


def test_a_terminal_that_ctrl_s_has_stopped_holds_nothing(terminal: tuple[int, str]) -> None:
    screen = os.open(terminal[1], os.O_RDWR | os.O_NOCTTY)
    try:
        termios.tcflow(screen, termios.TCOOFF)
        program.write(screen, "a cause\n")
        termios.tcflow(screen, termios.TCOON)
        program.write(screen, "a cause\n")
        assert os.read(terminal[0], 100) == b"a cause\r\n"
    finally:
        os.close(screen)


def test_a_display_that_was_cut_off_gets_its_cursor_back(bench: Bench, terminal: tuple[int, str]) -> None:
    device, path = terminal
    screen = os.open(path, os.O_RDWR | os.O_NOCTTY)
    tty.setraw(screen)
    os.close(bench._screen)
    bench._screen = screen

    def period(number: int) -> None:
        bench.page[STATE] = ARMED
        bench.kill()

    bench.run(period)
    shown = os.read(device, 4096)
    assert shown.startswith(b"\r\n\x1b[?25hwatchdog: the process of the loop was killed")


def test_a_note_replaces_an_older_one_and_a_folder_that_is_gone_changes_nothing(tmp_path: Path) -> None:
    path = tmp_path / "note.txt"
    path.write_text("a longer note of an earlier run")
    program.write_note(str(path), "a cause")
    assert path.read_text() == "a cause\n"
    files = open_files()
    program.write_note(str(tmp_path / "gone" / "note.txt"), "a cause")
    program.write_note(str(path), "a cause")
    assert open_files() == files


def test_a_screen_that_nobody_reads_changes_nothing() -> None:
    reading, writing = os.pipe()
    os.close(reading)
    program.write(writing, "a cause\n")
    os.close(writing)


def test_the_page_holds_64_bits_in_each_place(bench: Bench) -> None:
    bench.page[STOPS] = 2**64 - 1
    bench.page[SIGNS] = 1
    assert [bench.page[place] for place in (SIGNS, WAITS, STATE, BEATS, STOPS)] == [1, 0, 0, 0, 2**64 - 1]
    assert Page(bench.page_file)[STOPS] == 2**64 - 1


@pytest.mark.parametrize(
    ("policy", "priority", "taken"),
    [(os.SCHED_FIFO, 50, [51]), (os.SCHED_RR, 7, [8]), (os.SCHED_FIFO, 99, [99]), (os.SCHED_OTHER, 0, [])],
)
def test_it_runs_before_a_loop_in_a_real_time_class(
    monkeypatch: pytest.MonkeyPatch, policy: int, priority: int, taken: list[int]
) -> None:
    got: list[int] = []

    def check_own(process_id: int) -> None:
        assert process_id == 0

    def get_scheduler(process_id: int) -> int:
        check_own(process_id)
        return policy

    def get_param(process_id: int) -> os.sched_param:
        check_own(process_id)
        return os.sched_param(priority)

    def set_param(process_id: int, parameter: os.sched_param) -> None:
        check_own(process_id)
        got.append(parameter.sched_priority)

    monkeypatch.setattr(os, "sched_getscheduler", get_scheduler)
    monkeypatch.setattr(os, "sched_getparam", get_param)
    monkeypatch.setattr(os, "sched_setparam", set_param)
    program.take_priority()
    assert got == taken

    def refuse(process_id: int, parameter: os.sched_param) -> None:
        raise PermissionError

    monkeypatch.setattr(os, "sched_setparam", refuse)
    program.take_priority()  # it stays where it is


def test_it_keeps_out_signals_swap_and_collections_then_watches(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    did: list[object] = []
    note = did.append

    class Library:
        def __init__(self, name: str | None) -> None:
            assert name is None

        def mlockall(self, flags: int) -> None:
            note(("mlockall", flags))

    def run(watch: Watch) -> None:
        note((watch._order, watch._answers, watch._screen))

    monkeypatch.setattr(signal, "signal", lambda number, handler: note((number, handler)))
    monkeypatch.setattr(ctypes, "CDLL", Library)
    monkeypatch.setattr(program, "take_priority", lambda: note("priority"))
    for act in ("collect", "freeze", "disable"):
        monkeypatch.setattr(gc, act, lambda act=act: note(act))
    monkeypatch.setattr(sys, "argv", ["watchdog_program.py", json.dumps(bench.order)])
    monkeypatch.setattr(Watch, "run", run)
    program.main()
    ignored = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGPIPE)
    assert did == [
        *((number, signal.SIG_IGN) for number in ignored),
        "priority",
        ("mlockall", 1),
        "collect",
        "freeze",
        "disable",
        (bench.order, 1, 2),
    ]
