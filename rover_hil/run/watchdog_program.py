"""The process that watches the loop: stops the drive when the loop is silent, ends a loop that hangs.

`watchdog_process.py` starts it as a script, with Python's standard library and nothing else. It shares a page
of memory with the loop, counts periods of `PERIOD_MS` and reads no clock: a machine that was suspended, or a
time in which this process itself did not run, is no silence of the loop.
"""

import errno
import gc
import json
import mmap
import os
import re
import select
import signal
import socket
import sys
import termios
from collections.abc import Sequence
from contextlib import suppress
from typing import Protocol, TypedDict

PERIOD_MS = 10
HANG_PERIODS = 100
"""A silent loop that could have worked for so long hangs, and is ended."""
REPEAT_PERIODS = 5
"""A silent loop's drive is stopped again so often, for a second: a frame may be lost. Then its own time-out
may act."""
REPEAT_S = REPEAT_PERIODS * PERIOD_MS / 1000.0
FULL_S, FULL_TIMES = 0.001, 20
"""Wait where the queue of a network interface is full, and how often."""
ANSWERS, SCREEN = 1, 2
"""Numbers of the files for answers to the loop's side and for the user."""
END_MS = 2000
"""Longest wait for a process to be gone after SIGKILL."""

PAGE_SIZE = 4096
SIGNS, WAITS, STATE, BEATS, STOPS = range(5)
"""Places in the shared page, 64 bits each.

SIGNS: Cycles of the loop that commanded the drive; written by the loop.
WAITS: Signs of a loop that waits for its log, on purpose, and commands nothing.
STATE: What the loop wants, `RESTING` and so on.
BEATS: Periods of this process; written by it.
STOPS: How often it has stopped the drive.
"""
RESTING, CHECKING, ARMED, OVER = range(4)
"""RESTING: the drive is not commanded. CHECKING: open the port and answer. ARMED: watch. OVER: end."""

READY = "ready"
_STOPPED_STATES = "Tt"
_STAT = re.compile(rb".*\) (\S)(?: \S+){10} (\d+) (\d+) ", re.DOTALL)


class Order(TypedDict):
    """What the loop's side gives this process at its start.

    Attributes:
        page: Number of the file of the shared page.
        loop: Number of the pidfd of the loop's process.
        loop_id: Its process id.
        silent_periods: The drive is stopped after so many periods without a sign.
        port: Kind of the drive's port, see `drivers/emergency_stop.py`.
        path: Path of a serial port, or name of a network interface.
        baud_rate: Of a serial port, in bit/s.
        payloads: What stops the drive, as hexadecimal digits.
        note: Path of the file that gets the cause when the loop is ended or gone; empty for none.
    """

    page: int
    loop: int
    loop_id: int
    silent_periods: int
    port: str
    path: str
    baud_rate: int
    payloads: Sequence[str]
    note: str


class Threads(Protocol):
    """The threads of the loop's process."""

    def worked_share(self) -> float:
        """Return in which share of the time since the last call they could have worked, 0 to 1."""
        ...


class Silence:
    """Judges from the counts of the loop, period by period, whether it is silent and whether it hangs.

    Silence alone is no hang: on a loaded machine a healthy loop waits for a processor. Only time counts in
    which the loop could have worked.

    Args:
        silent_periods: The drive is stopped after so many periods without a sign.
        threads: What the loop's threads do.

    Attributes:
        must_stop: Whether the drive is to be stopped in this period.
        begins: Whether it is the first time in this silence.
        hangs: Whether the loop is to be ended.
    """

    def __init__(self, silent_periods: int, threads: Threads) -> None:
        self._silent_periods = silent_periods
        self._threads = threads
        self._signs = 0
        self._silent = 0
        self._waits: int
        self._worked: float
        """Both are of a silence, and set where it begins."""
        self.must_stop: bool
        self.begins: bool
        self.hangs: bool

    def rest(self) -> None:
        """Count no period: the loop commands nothing."""
        self._silent = 0

    def count(self, signs: int, waits: int) -> None:
        """Judge one period by the counts at its end."""
        self.must_stop = self.begins = self.hangs = False
        if signs != self._signs:
            self._signs = signs
            self._silent = 0
            return
        self._silent += 1
        since = self._silent - self._silent_periods
        if since < 0:
            return
        worked = self._threads.worked_share()
        self.begins = since == 0
        self.must_stop = since < HANG_PERIODS and since % REPEAT_PERIODS == 0
        if self.begins or waits != self._waits:
            self._waits = waits
            self._worked = 0.0
        else:
            self._worked += worked
        self.hangs = self._worked >= HANG_PERIODS


class ProcThreads:
    """The threads of a process, by `/proc`.

    A thread that sleeps, waits for a disk, or runs could have worked. One that is ready to run and did not
    get a processor could not, and neither could those that may wait for it. A process that someone has
    stopped (SIGSTOP, a debugger) does nothing by itself: it is no hang.

    Args:
        process_id: The process.
        folder: Where the system shows its processes.
    """

    def __init__(self, process_id: int, folder: str = "/proc") -> None:
        self._tasks = f"{folder}/{process_id}/task"
        self._ticks: dict[str, int] = {}

    def worked_share(self) -> float:
        """Return the share; 1 where the system does not show the threads, so that a hang is ended."""
        share = 1.0
        ticks: dict[str, int] = {}
        try:
            for task in os.listdir(self._tasks):
                stat_match = _STAT.match(_read(f"{self._tasks}/{task}/stat"))
                if stat_match is None:
                    continue
                state = stat_match[1].decode()
                ticks[task] = int(stat_match[2]) + int(stat_match[3])
                if state in _STOPPED_STATES:
                    share = 0.0
                elif state == "R":
                    worked = ticks[task] - self._ticks.get(task, ticks[task])
                    share = min(share, worked)  # counted in hundredths of a second, a period each
        except OSError:
            share = 1.0
        self._ticks = ticks
        return share


def _read(path: str) -> bytes:
    file = os.open(path, os.O_RDONLY)
    try:
        return os.read(file, PAGE_SIZE)
    finally:
        os.close(file)


class Port:
    """The port of the drive, opened for each stop: an open handle would keep the name of a lost port in use.

    Args:
        kind: "serial", "slcan", "socketcan", or "none" where no other process reaches the drive.
        path: Path of the serial port, or name of the network interface.
        baud_rate: Line speed in bit/s; a rate that the system has no name for stays as the loop set it.
        payloads: What stops the drive.
    """

    def __init__(self, kind: str, path: str, baud_rate: int, payloads: Sequence[bytes]) -> None:
        self._kind = kind
        self._path = path
        self._speed = getattr(termios, f"B{baud_rate}", termios.B0)
        self._payloads = [slcan_line(payload) for payload in payloads] if kind == "slcan" else [*payloads]
        if kind == "slcan":
            self._payloads.insert(0, b"\r")  # ends a line that the loop did not complete

    def check(self) -> str:
        """Return why the port cannot be opened; "" where it can."""
        try:
            self._send(())
        except OSError as error:
            return f"it cannot open {self._path} to stop the drive: {error.strerror or error}"
        return ""

    def stop(self) -> str:
        """Send what stops the drive; return why it could not be sent, "" where it was."""
        try:
            self._send(self._payloads)
        except OSError as error:
            return f"{self._path}: {error.strerror or error}"
        return ""

    def _send(self, payloads: Sequence[bytes]) -> None:
        if self._kind == "socketcan":
            with socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW) as bus:
                bus.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FILTER, b"")
                bus.setblocking(False)
                bus.bind((self._path,))
                send_frames(bus, payloads)
        elif self._kind != "none":
            # Without waiting for a carrier, and without the lock with which the loop keeps others out.
            file = os.open(self._path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
            try:
                if payloads:
                    _set_raw(file, self._speed)
                    data = b"".join(payloads)
                    if os.write(file, data) < len(data):
                        raise BlockingIOError(errno.EAGAIN, os.strerror(errno.EAGAIN))
            finally:
                os.close(file)


def send_frames(bus: socket.socket, payloads: Sequence[bytes]) -> None:
    """Send frames; one for which the queue has no room within 20 ms keeps no other back.

    Raises:
        OSError: A frame could not be sent.
    """
    failure: OSError | None = None
    for payload in payloads:
        for _ in range(FULL_TIMES):
            try:
                bus.send(payload)
                break
            except OSError as error:
                if error.errno not in (errno.ENOBUFS, errno.EAGAIN):
                    raise
                failed = error
            select.select((), (), (), FULL_S)
        else:
            failure = failed
    if failure is not None:
        raise failure


def slcan_line(payload: bytes) -> bytes:
    """Return the text line of a CAN frame in the 16 bytes of `struct can_frame`."""
    can_id = int.from_bytes(payload[:4], "little")
    data = payload[8 : 8 + payload[4]].hex().upper()
    head = f"T{can_id & 0x1FFF_FFFF:08X}" if can_id & 0x8000_0000 else f"t{can_id:03X}"
    return f"{head}{payload[4]}{data}\r".encode()


def _set_raw(file: int, speed: int) -> None:
    """Let bytes pass unchanged: a port that the loop has closed may have other settings.

    A speed of B0 would hang up: then the port keeps that of the loop.
    """
    with suppress(termios.error):  # not a terminal
        *_, in_speed, out_speed, special = termios.tcgetattr(file)
        if speed != termios.B0:
            in_speed = out_speed = speed
        control = termios.CS8 | termios.CREAD | termios.CLOCAL
        termios.tcsetattr(file, termios.TCSANOW, [0, 0, control, 0, in_speed, out_speed, special])


class Page:
    """The page of memory that the two processes share.

    Args:
        file: Its file.
    """

    def __init__(self, file: int) -> None:
        self._counts = memoryview(mmap.mmap(file, PAGE_SIZE)).cast("Q")

    def __getitem__(self, place: int) -> int:
        return self._counts[place]

    def __setitem__(self, place: int, value: int) -> None:
        self._counts[place] = value


class Watch:
    """Watches one loop until it is over, gone or ended.

    Args:
        order: What to do.
        page: The shared page.
        answers: File number for answers to the loop's side.
        screen: That for the user.
    """

    def __init__(self, order: Order, page: Page, answers: int, screen: int) -> None:
        self._order = order
        self._page = page
        self._answers = answers
        self._screen = screen
        self._silence = Silence(order["silent_periods"], ProcThreads(order["loop_id"]))
        payloads = [bytes.fromhex(payload) for payload in order["payloads"]]
        self._port = Port(order["port"], order["path"], order["baud_rate"], payloads)
        self._loop = select.poll()
        self._loop.register(order["loop"])
        self._beats = page[BEATS]  # the counts of a process that this one replaces go on
        self._stops = page[STOPS]

    def run(self) -> None:
        """Watch, period by period."""
        self._say(READY)
        while not self._loop.poll(PERIOD_MS):
            self._beats += 1
            self._page[BEATS] = self._beats
            state = self._page[STATE]
            if state == OVER:
                return
            if state == CHECKING:
                self._page[STATE] = RESTING
                self._say(self._port.check() or READY)
            if state == ARMED:
                if self._hangs():
                    self._end_loop()
                    return
            else:
                self._silence.rest()
        if self._page[STATE] == ARMED:
            self._conclude("the process of the loop was killed or has crashed")

    def _say(self, line: str) -> None:
        write(self._answers, f"{line}\n")

    def _hangs(self) -> bool:
        silence = self._silence
        silence.count(self._page[SIGNS], self._page[WAITS])
        if silence.must_stop:
            self._port.stop()
            self._stops += 1
            self._page[STOPS] = self._stops
        return silence.hangs

    def _end_loop(self) -> None:
        signal.pidfd_send_signal(self._order["loop"], signal.SIGKILL)
        self._loop.poll(END_MS)
        self._conclude("the loop gave no heartbeat for over a second and was ended")

    def _conclude(self, cause: str) -> None:
        """Stop the drive, report the cause, and stop it again for a second: a frame may be lost."""
        repeats = HANG_PERIODS // REPEAT_PERIODS
        while (failure := self._port.stop()) and repeats:
            repeats -= 1
            select.select((), (), (), REPEAT_S)
        self._report(cause, failure)
        for _ in range(repeats):
            select.select((), (), (), REPEAT_S)
            self._port.stop()

    def _report(self, cause: str, failure: str) -> None:
        if failure:
            stopped = f"the drive could not be stopped ({failure}): its own time-out must"
        elif self._order["port"] == "none":
            stopped = "no other process reaches the drive: its own time-out must stop it"
        else:
            stopped = "the drive was stopped"
        sentence = f"watchdog: {cause}; {stopped}"
        if self._order["note"]:
            write_note(self._order["note"], sentence)
        # A display was cut off: a line of its own, and the cursor.
        before = "\r\n\x1b[?25h" if os.isatty(self._screen) else ""
        write(self._screen, f"{before}{sentence}\n")


def write_note(path: str, sentence: str) -> None:
    """Leave the cause beside the log; a disk that takes nothing changes nothing."""
    try:
        file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o644)
    except OSError:
        return
    write(file, f"{sentence}\n")
    os.close(file)


def write(file: int, text: str) -> None:
    """Write a text; whoever does not read it any more, or has stopped the terminal, changes nothing."""
    with suppress(OSError):
        if select.select((), (file,), (), 0.0)[1]:
            os.write(file, text.encode())


def take_priority() -> None:
    """Run before a loop that is in a real-time class: one that computes for ever would never yield."""
    policy = os.sched_getscheduler(0)
    if policy in (os.SCHED_FIFO, os.SCHED_RR):
        priority = os.sched_getparam(0).sched_priority
        highest = os.sched_get_priority_max(policy)
        with suppress(PermissionError):  # the user may take no more than the loop has
            os.sched_setparam(0, os.sched_param(min(priority + 1, highest)))


def stay_in_memory() -> None:
    """Keep what is loaded out of the swap, where the user may."""
    import ctypes  # only here: it is large

    ctypes.CDLL(None).mlockall(1)  # MCL_CURRENT; without the right nothing happens


def main() -> None:
    """Watch as the first argument of the command line orders."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGPIPE):
        signal.signal(number, signal.SIG_IGN)  # it ends with the loop, and not before
    order: Order = json.loads(sys.argv[1])
    watch = Watch(order, Page(order["page"]), ANSWERS, SCREEN)
    take_priority()
    stay_in_memory()
    gc.collect()
    gc.freeze()
    gc.disable()
    watch.run()


if __name__ == "__main__":
    main()
