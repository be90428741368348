"""The reader thread and its reconnects, on a pseudo-terminal and on a port that misbehaves on purpose."""

import os
import threading
import tty
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from drivers.clock import SystemClock, nanoseconds
from drivers.errors import NotConnectedError
from drivers.link import LinkChange, LinkItem, Received
from drivers.serial_link import SerialLink
from drivers.threaded_link import ThreadedLink

DEADLINE_S = 60.0


def collect(
    link: ThreadedLink[bytes], enough: Callable[[list[LinkItem[bytes]]], bool]
) -> list[LinkItem[bytes]]:
    """Return what the link delivers until it is enough; fails at the deadline."""
    clock = SystemClock()
    deadline_ns = clock.now_ns() + nanoseconds(DEADLINE_S)
    items: list[LinkItem[bytes]] = []
    while not enough(items):
        assert clock.now_ns() < deadline_ns, f"only got {items}"
        clock.sleep_until(clock.now_ns() + nanoseconds(0.001))
        items.extend(link.receive())
    return items


def bytes_of(items: list[LinkItem[bytes]]) -> bytes:
    return b"".join(item.payload for item in items if isinstance(item, Received))


class Terminal:
    """A pseudo-terminal behind a symlink, as a serial adapter behind its by-id name."""

    def __init__(self, folder: Path) -> None:
        self.path = folder / "port"
        self.master = -1
        self.plug_in()

    def plug_in(self) -> None:
        self.master, slave = os.openpty()
        tty.setraw(slave)
        self.path.unlink(missing_ok=True)
        self.path.symlink_to(os.ttyname(slave))
        os.close(slave)

    def pull_out(self) -> None:
        if self.master >= 0:
            os.close(self.master)
        self.master = -1


@pytest.fixture
def terminal(tmp_path: Path) -> Iterator[Terminal]:
    terminal = Terminal(tmp_path)
    yield terminal
    terminal.pull_out()


@pytest.fixture
def link(terminal: Terminal) -> Iterator[SerialLink]:
    link = SerialLink(str(terminal.path), 115200, SystemClock(), reconnect_limit_s=5.0)
    yield link
    link.close()


def test_bytes_pass_both_ways_and_are_stamped(terminal: Terminal, link: SerialLink) -> None:
    before_ns = SystemClock().now_ns()
    link.open(timeout_s=0.5)
    os.write(terminal.master, b"hello")
    items = collect(link, lambda items: len(bytes_of(items)) == 5)
    assert bytes_of(items) == b"hello"
    assert all(before_ns < item.t_ns <= SystemClock().now_ns() for item in items)
    assert link.send(b"reply")
    assert os.read(terminal.master, 100) == b"reply"


def test_replug_is_reported_once_each_way_and_data_goes_on(terminal: Terminal, link: SerialLink) -> None:
    link.open(timeout_s=0.5)
    terminal.pull_out()
    items = collect(link, lambda items: len(items) > 0)
    assert [item.up for item in items if isinstance(item, LinkChange)] == [False]
    assert not link.send(b"into the void")
    terminal.plug_in()
    items = collect(link, lambda items: any(isinstance(item, LinkChange) for item in items))
    assert [item.up for item in items if isinstance(item, LinkChange)] == [True]
    os.write(terminal.master, b"again")
    assert bytes_of(collect(link, lambda items: len(bytes_of(items)) == 5)) == b"again"


def test_gives_up_after_the_limit(terminal: Terminal) -> None:
    link = SerialLink(str(terminal.path), 115200, SystemClock(), reconnect_limit_s=0.1)
    link.open(timeout_s=0.5)
    terminal.pull_out()
    terminal.path.unlink()
    items = collect(link, lambda items: len(items) == 2)
    assert [item.gave_up for item in items if isinstance(item, LinkChange)] == [False, True]
    link.close()


def test_a_port_that_another_program_has_opened_is_a_clear_error(terminal: Terminal) -> None:
    first = SerialLink(str(terminal.path), 9600, SystemClock(), reconnect_limit_s=1.0)
    first.open(timeout_s=0.5)
    second = SerialLink(str(terminal.path), 9600, SystemClock(), reconnect_limit_s=1.0)
    with pytest.raises(NotConnectedError, match="another program has opened it: end that program"):
        second.open(timeout_s=0.0)
    second.close()
    first.close()


def test_missing_port_is_a_clear_error(tmp_path: Path) -> None:
    link = SerialLink(str(tmp_path / "nothing"), 9600, SystemClock(), reconnect_limit_s=1.0)
    with pytest.raises(NotConnectedError, match=r"cannot open serial port .*nothing"):
        link.open(timeout_s=0.0)
    link.close()


def test_open_waits_for_a_port_that_appears(tmp_path: Path) -> None:
    class LatePort(MisbehavingPort):
        def _open_handle(self) -> None:
            self.attempts += 1
            if self.attempts < 3:
                raise OSError("not there yet")

        def _read(self) -> Received[bytes] | None:
            self._clock.sleep_until(self._clock.now_ns() + nanoseconds(0.01))
            return None

    link = LatePort()
    link.open(timeout_s=2.0)
    assert link.attempts == 3
    link.close()


class MisbehavingPort(ThreadedLink[bytes]):
    """Raises whatever a library might raise, from the place that the test chooses."""

    def __init__(self) -> None:
        super().__init__("misbehaving port", SystemClock(), reconnect_limit_s=0.05)
        self.attempts = 0

    def _open_handle(self) -> None:
        self.attempts += 1
        if self.attempts > 1:
            raise KeyError("no more handles")

    def _close_handle(self) -> None:
        pass

    def _read(self) -> Received[bytes] | None:
        raise TypeError("surprise")

    def _write(self, payload: bytes) -> bool:
        raise RuntimeError("cannot write")


def test_any_exception_in_the_reader_reaches_the_user() -> None:
    link = MisbehavingPort()
    link.open(timeout_s=0.0)
    items = collect(link, lambda items: len(items) == 2)
    reasons = [item.reason for item in items if isinstance(item, LinkChange)]
    assert reasons[0] == "surprise"
    assert reasons[1].startswith("gave up: ")
    assert not link.send(b"x")
    link.close()
    link.close()


def test_giving_up_at_once_says_what_broke() -> None:
    link = MisbehavingPort()
    link._reconnect_limit_ns = 0
    link.open(timeout_s=0.0)
    items = collect(link, lambda items: len(items) == 2)
    reasons = [item.reason for item in items if isinstance(item, LinkChange)]
    assert reasons == ["surprise", "gave up: surprise"]
    link.close()


def test_a_full_queue_loses_data_but_never_a_break_or_recovery() -> None:
    class SmallQueue(MisbehavingPort):
        queue_limit = 3

    link = SmallQueue()
    link._report(up=False, reason="unplugged")
    link._append(Received(1, b"1"))
    link._report(up=True, reason="reopened")
    for number in range(2, 6):
        link._append(Received(number, b"%d" % number))
    down, up, *rest = link.receive()
    assert isinstance(down, LinkChange)
    assert isinstance(up, LinkChange)
    assert (down.up, up.up) == (False, True)
    assert bytes_of(rest) == b"5"
    assert link.dropped == 4


class SlowlyReopening(MisbehavingPort):
    """Breaks at the first read; the second opening waits until the test lets it go on."""

    def __init__(self) -> None:
        super().__init__()
        self.reopening = threading.Event()
        self.may_reopen = threading.Event()
        self.closed_after_reopening = threading.Event()

    def _open_handle(self) -> None:
        self.attempts += 1
        if self.attempts > 1:
            self.reopening.set()
            self.may_reopen.wait(DEADLINE_S)

    def _close_handle(self) -> None:
        if self.attempts > 1 and self.may_reopen.is_set():
            self.closed_after_reopening.set()


def test_a_handle_opened_after_close_is_closed_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("drivers.threaded_link.JOIN_TIMEOUT_S", 0.05)
    link = SlowlyReopening()
    link.open(timeout_s=0.0)
    assert link.reopening.wait(DEADLINE_S)
    link.close()
    link.may_reopen.set()
    assert link.closed_after_reopening.wait(DEADLINE_S)


def test_a_link_whose_reader_has_not_ended_is_not_opened_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("drivers.threaded_link.JOIN_TIMEOUT_S", 0.05)
    link = SlowlyReopening()
    link.open(timeout_s=0.0)
    assert link.reopening.wait(DEADLINE_S)
    link.close()
    with pytest.raises(NotConnectedError, match=r"cannot open misbehaving port: .* still being closed"):
        link.open(timeout_s=0.1)
    assert link.attempts == 2
    link.may_reopen.set()
    link.open(timeout_s=DEADLINE_S)
    assert link.attempts == 3
    readers = [thread for thread in threading.enumerate() if thread.name == "reader misbehaving port"]
    assert len(readers) <= 1
    link.close()


def test_a_break_that_only_send_meets_is_reported() -> None:
    class QuietReader(MisbehavingPort):
        def _open_handle(self) -> None:
            self.attempts += 1

        def _read(self) -> Received[bytes] | None:
            self._clock.sleep_until(self._clock.now_ns() + nanoseconds(0.01))
            return None

    link = QuietReader()
    link.open(timeout_s=0.0)
    assert not link.send(b"x")
    changes = [item for item in collect(link, lambda items: len(items) == 2) if isinstance(item, LinkChange)]
    assert [(change.up, change.reason) for change in changes] == [(False, "cannot write"), (True, "reopened")]
    assert link.attempts == 2
    link.close()
