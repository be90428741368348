"""The link to a CAN bus: on the virtual bus, over a pseudo-terminal, and on a stand-in for SocketCAN."""

import errno
import os
import socket
import threading
from collections import deque
from collections.abc import Callable, Iterator
from pathlib import Path

import can
import pytest

from drivers.can import link as can_link
from drivers.can.frame import CanFrame, pack_can_frame
from drivers.can.link import GARBLED, CanLink
from drivers.can_wheels.settings import CanWheelsSettings
from drivers.clock import NANOSECONDS_PER_SECOND, SystemClock, wall_time_ns
from drivers.driver import SampleT, WheelDrive
from drivers.errors import NotConnectedError
from drivers.link import LinkChange, LinkItem, Received
from drivers.samples import LinkSample, WheelCommand, WheelSample
from tests.drivers.can_wheels_frames import generic_state
from tests.drivers.slcan_peer import SlcanPeer

CLOCK = SystemClock()
FRAMES = [
    CanFrame(0x123, bytes(range(8))),
    CanFrame(0x7FF, b""),
    CanFrame(0x1ABCDEF0, b"\xff\x00", is_extended=True),
    CanFrame(0x42, b"", is_remote=True),
]


def wait_until(is_done: Callable[[], bool]) -> None:
    deadline_ns = CLOCK.now_ns() + 60 * NANOSECONDS_PER_SECOND
    while not is_done():
        assert CLOCK.now_ns() < deadline_ns, "waited for a minute in vain"
        CLOCK.sleep_until(CLOCK.now_ns() + 2_000_000)


def receive(link: CanLink, count: int) -> list[LinkItem[bytes]]:
    items: list[LinkItem[bytes]] = []

    def is_done() -> bool:
        items.extend(link.receive())
        return len(items) >= count

    wait_until(is_done)
    return items


def next_sample(drive: WheelDrive, kind: type[SampleT]) -> SampleT:
    found: list[SampleT] = []

    def is_done() -> bool:
        found.extend(sample for sample in drive.poll() if isinstance(sample, kind))
        return bool(found)

    wait_until(is_done)
    return found[0]


def message(frame: CanFrame) -> can.Message:
    return can.Message(
        arbitration_id=frame.can_id,
        data=frame.data,
        is_extended_id=frame.is_extended,
        is_remote_frame=frame.is_remote,
        is_error_frame=frame.is_error,
    )


def make_link(interface: str, channel: str, reconnect_limit_s: float = 10.0) -> CanLink:
    return CanLink(interface, channel, 500_000, CLOCK, reconnect_limit_s)


# --- virtual


@pytest.fixture
def virtual() -> Iterator[tuple[CanLink, can.BusABC]]:
    link = make_link("virtual", "test_can_link")
    with can.Bus("test_can_link", interface="virtual", ignore_config=True) as bus:
        link.open(0.0)
        yield link, bus
        link.close()


def test_virtual_bus_carries_every_kind_of_frame_both_ways(virtual: tuple[CanLink, can.BusABC]) -> None:
    link, bus = virtual
    before_ns = CLOCK.now_ns()
    frames = [*FRAMES, CanFrame(0x44, bytes(8), is_error=True)]
    for frame in frames:
        bus.send(message(frame))
    items = receive(link, len(frames))
    assert [item.payload for item in items if isinstance(item, Received)] == [
        pack_can_frame(frame) for frame in frames
    ]
    stamps_ns = [before_ns, *(item.t_ns for item in items), CLOCK.now_ns()]
    assert stamps_ns == sorted(stamps_ns)
    for frame in FRAMES:
        assert link.send(pack_can_frame(frame))
        heard = bus.recv(1.0)
        assert heard is not None
        assert heard.equals(message(frame), timestamp_delta=None, check_channel=False, check_direction=False)


def test_what_is_no_frame_is_not_sent(virtual: tuple[CanLink, can.BusABC]) -> None:
    link, bus = virtual
    assert not link.send(b"short")
    assert not link.send(pack_can_frame(CanFrame(0x40, bytes(8), is_error=True)))
    assert bus.recv(0.0) is None


@pytest.mark.parametrize(
    "wrong",
    [
        can.Message(arbitration_id=1, is_extended_id=False, data=bytes(12), is_fd=True, dlc=12),
        can.Message(arbitration_id=1, is_extended_id=False, data=bytes(8), is_fd=True, dlc=8),
        can.Message(arbitration_id=1, is_extended_id=False, data=b"abc", dlc=2),
        can.Message(arbitration_id=1, is_extended_id=False, data=bytes(9), dlc=9),
        can.Message(arbitration_id=0xFFFFFFFF, is_extended_id=True, data=b""),
    ],
)
def test_frame_that_cannot_be_is_passed_on_as_garbled(
    virtual: tuple[CanLink, can.BusABC], wrong: can.Message
) -> None:
    link, bus = virtual
    bus.send(wrong)
    (item,) = receive(link, 1)
    assert isinstance(item, Received)
    assert item.payload == GARBLED


def test_closed_link_leaves_no_thread_and_no_bus(virtual: tuple[CanLink, can.BusABC]) -> None:
    link, bus = virtual
    link.close()
    link.close()
    assert not link.send(pack_can_frame(FRAMES[0]))
    bus.send(message(FRAMES[0]))
    assert link.receive() == []
    assert not [thread for thread in threading.enumerate() if "test_can_link" in thread.name]


def test_drive_on_the_virtual_bus() -> None:
    settings = CanWheelsSettings(interface="virtual", channel="drive", mapping="generic_wheel")
    drive = settings.make_driver("wheels", settings.make_link(CLOCK), CLOCK)
    assert isinstance(drive, WheelDrive)
    with can.Bus("drive", interface="virtual", ignore_config=True) as bus, drive:
        payload = generic_state(3, 4096, 100, 200, 0)
        bus.send(can.Message(arbitration_id=0x123, is_extended_id=False, data=payload[8:]))
        sample = next_sample(drive, WheelSample)
        assert sample.wheel == 3
        assert sample.speed_rad_s == pytest.approx(0.1)
        now_ns = CLOCK.now_ns()
        command = WheelCommand(
            t_ns=now_ns, expires_ns=now_ns + NANOSECONDS_PER_SECOND, speed_rad_s=(1.0, 2.0, 3.0, 99.0)
        )
        sent = drive.command(command)
        assert sent.delivered
        assert sent.speed_rad_s == pytest.approx((1.0, 2.0, 3.0, 32.767))
        heard = [bus.recv(1.0) for _ in range(4)]
        assert [one and one.arbitration_id for one in heard] == [0x110, 0x111, 0x112, 0x113]


# --- SocketCAN


class StandInBus(can.BusABC):
    """A bus whose frames and errors are prepared by the test."""

    def __init__(self) -> None:
        super().__init__("can0")
        self.heard: deque[can.Message | Exception] = deque()
        self.send_error: Exception | None = None
        self.is_shut_down = False

    def recv(self, timeout: float | None = None) -> can.Message | None:
        if not self.heard:
            CLOCK.sleep_until(CLOCK.now_ns() + 5_000_000)
            return None
        item = self.heard.popleft()
        if isinstance(item, Exception):
            raise item
        return item

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        if self.send_error is not None:
            raise self.send_error

    def shutdown(self) -> None:
        self.is_shut_down = True
        super().shutdown()


@pytest.fixture
def buses(monkeypatch: pytest.MonkeyPatch) -> list[StandInBus]:
    """Return the list of the buses that are opened instead of SocketCAN."""
    opened: list[StandInBus] = []

    def open_stand_in(channel: str) -> can.BusABC:
        opened.append(StandInBus())
        return opened[-1]

    monkeypatch.setattr(can_link, "_open_socketcan", open_stand_in)
    return opened


def test_missing_interface_is_one_sentence_and_leaves_nothing() -> None:
    link = make_link("socketcan", "nocan7")
    with pytest.raises(NotConnectedError, match=r"no network interface nocan7: .*ip link set nocan7 up"):
        link.open(0.0)
    assert link.receive() == []
    assert not [thread for thread in threading.enumerate() if "nocan7" in thread.name]


@pytest.mark.parametrize(
    ("pending", "told"),
    [(errno.ENETDOWN, "Network is down; bring it up with"), (errno.ENODEV, "No such device$")],
)
def test_interface_that_is_down_is_not_taken_for_open(
    monkeypatch: pytest.MonkeyPatch, pending: int, told: str
) -> None:
    class Socket:
        def getsockopt(self, level: int, option: int) -> int:
            assert (level, option) == (socket.SOL_SOCKET, socket.SO_ERROR)
            return pending

    bus = StandInBus()
    monkeypatch.setattr(bus, "socket", Socket(), raising=False)
    monkeypatch.setattr(socket, "if_nametoindex", lambda name: 3)
    monkeypatch.setattr(can_link, "SocketcanBus", lambda channel: bus)
    with pytest.raises(NotConnectedError, match=told):
        make_link("socketcan", "can0").open(0.0)
    assert bus.is_shut_down


def test_kernel_stamp_is_used_when_it_can_be_true(buses: list[StandInBus]) -> None:
    link = make_link("socketcan", "can0")
    link.open(0.0)
    wall_s, now_ns = wall_time_ns() / 1e9, CLOCK.now_ns()
    ages_s = (5.0, 0.5, -60.0, 1.0e6, 0.3)
    buses[0].heard.extend(can.Message(timestamp=wall_s - age_s, is_extended_id=False) for age_s in ages_s)
    stamps_ns = [item.t_ns for item in receive(link, len(ages_s))]
    later_ns = CLOCK.now_ns()
    link.close()
    assert now_ns <= stamps_ns[0] <= later_ns
    assert stamps_ns[1] == stamps_ns[0]  # 0.5 s old, but what came before it cannot be younger
    assert all(now_ns <= stamp_ns <= later_ns for stamp_ns in stamps_ns[2:])
    assert stamps_ns == sorted(stamps_ns)


def test_kernel_stamp_dates_a_frame_back(buses: list[StandInBus]) -> None:
    link = make_link("socketcan", "can0")
    link.open(0.0)
    wall_s, now_ns = wall_time_ns() / 1e9, CLOCK.now_ns()
    buses[0].heard.append(can.Message(timestamp=wall_s - 0.2, is_extended_id=False))
    (item,) = receive(link, 1)
    link.close()
    assert item.t_ns == pytest.approx(now_ns - 200_000_000, abs=5_000_000)


def test_interface_that_goes_down_is_reopened_with_a_new_bus(buses: list[StandInBus]) -> None:
    link = make_link("socketcan", "can0")
    link.open(0.0)
    buses[0].heard.append(can.CanOperationError("Failed to receive: Network is down", errno.ENETDOWN))
    down, up = receive(link, 2)
    assert isinstance(down, LinkChange)
    assert (down.up, down.gave_up) == (False, False)
    assert "Network is down" in down.reason
    assert isinstance(up, LinkChange)
    assert up.up
    assert len(buses) == 2
    assert buses[0].is_shut_down
    buses[1].heard.append(message(FRAMES[0]))
    (item,) = receive(link, 1)
    assert isinstance(item, Received)
    assert item.payload == pack_can_frame(FRAMES[0])
    link.close()
    assert buses[1].is_shut_down


def test_full_queue_loses_the_frame_not_the_link(buses: list[StandInBus]) -> None:
    link = make_link("socketcan", "can0")
    link.open(0.0)
    buses[0].send_error = can.CanOperationError("Failed to transmit: No buffer space", errno.ENOBUFS)
    assert not link.send(pack_can_frame(FRAMES[0]))
    buses[0].send_error = None
    assert link.send(pack_can_frame(FRAMES[0]))
    assert link.receive() == []
    link.close()


@pytest.mark.parametrize("number", [errno.ENETDOWN, errno.ENODEV])
def test_break_that_the_kernel_gives_to_send_is_reported(buses: list[StandInBus], number: int) -> None:
    link = make_link("socketcan", "can0")
    link.open(0.0)
    reason = f"Failed to transmit: {os.strerror(number)}"
    buses[0].send_error = can.CanOperationError(reason, number)
    assert not link.send(pack_can_frame(FRAMES[0]))
    down, up = receive(link, 2)
    assert isinstance(down, LinkChange)
    assert not down.up
    assert os.strerror(number) in down.reason
    assert isinstance(up, LinkChange)
    assert up.up
    link.close()


# --- slcan


@pytest.fixture
def adapter(tmp_path: Path) -> Iterator[SlcanPeer]:
    peer = SlcanPeer(tmp_path / "can")
    yield peer
    peer.unplug()


def test_slcan_sets_the_bit_rate_and_carries_frames_both_ways(adapter: SlcanPeer, tmp_path: Path) -> None:
    link = make_link("slcan", str(tmp_path / "can"))
    link.open(0.0)
    wait_until(lambda: "O" in adapter.commands)
    assert adapter.commands[:2] == ["C", "S6"]
    for frame in FRAMES:
        adapter.send(pack_can_frame(frame))
    items = receive(link, len(FRAMES))
    payloads = [pack_can_frame(frame) for frame in FRAMES]
    assert [item.payload for item in items if isinstance(item, Received)] == payloads
    assert all(link.send(payload) for payload in payloads)
    wait_until(lambda: len(adapter.frames) == len(payloads))
    assert adapter.frames == payloads
    link.close()
    wait_until(lambda: adapter.commands[-1] == "C")


@pytest.mark.parametrize(
    "text", ["t12\r", "t-010\r", "t1232AAXX\r", "tXYZ0\r", "t1239001122334455667788\r", "\xe9t\r"]
)
def test_garbled_line_is_passed_on_as_such_and_the_next_is_read(
    adapter: SlcanPeer, tmp_path: Path, text: str
) -> None:
    link = make_link("slcan", str(tmp_path / "can"))
    link.open(0.0)
    adapter.send_text(text)
    (garbled,) = receive(link, 1)
    adapter.send_text("t1231AA\r")
    (good,) = receive(link, 1)
    link.close()
    assert isinstance(garbled, Received)
    assert garbled.payload == GARBLED
    assert isinstance(good, Received)
    assert good.payload == pack_can_frame(CanFrame(0x123, b"\xaa"))


def test_frames_from_before_the_connection_are_not_taken_for_fresh(
    adapter: SlcanPeer, tmp_path: Path
) -> None:
    for _ in range(3):
        adapter.send(pack_can_frame(FRAMES[0]))
    link = make_link("slcan", str(tmp_path / "can"))
    link.open(0.0)
    adapter.send(pack_can_frame(FRAMES[1]))
    (item,) = receive(link, 1)
    link.close()
    assert isinstance(item, Received)
    assert item.payload == pack_can_frame(FRAMES[1])


def test_unplugged_adapter_comes_back_under_its_name(tmp_path: Path) -> None:
    path = tmp_path / "can"
    adapter = SlcanPeer(path)
    settings = CanWheelsSettings(interface="slcan", channel=str(path), mapping="generic_wheel")
    with settings.make_driver("wheels", settings.make_link(CLOCK), CLOCK) as drive:
        adapter.send(generic_state(0, 1, 2, 3, 0))
        assert next_sample(drive, WheelSample).speed_rad_s == pytest.approx(0.002)
        terminal = str(path.readlink())
        adapter.unplug()
        assert not next_sample(drive, LinkSample).up
        open_files = [str(file.readlink()) for file in Path("/proc/self/fd").iterdir() if file.is_symlink()]
        assert not [name for name in open_files if name.startswith(terminal)]
        adapter = SlcanPeer(path)
        assert next_sample(drive, LinkSample).up
        adapter.send(generic_state(0, 1, 4, 3, 0))
        assert next_sample(drive, WheelSample).speed_rad_s == pytest.approx(0.004)
        assert drive.health().breaks == 1
    adapter.unplug()


def test_missing_adapter_is_not_connected(tmp_path: Path) -> None:
    with pytest.raises(NotConnectedError, match=r"cannot open CAN bus .*nothing \(slcan\): "):
        make_link("slcan", str(tmp_path / "nothing")).open(0.0)


def test_a_second_program_cannot_take_an_slcan_adapter_from_the_first(
    adapter: SlcanPeer, tmp_path: Path
) -> None:
    first, second = (CanLink("slcan", str(tmp_path / "can"), 500_000, CLOCK, 1.0) for _ in range(2))
    first.open(timeout_s=1.0)
    with pytest.raises(NotConnectedError, match="another program uses"):
        second.open(timeout_s=0.0)
    adapter.send(pack_can_frame(FRAMES[0]))
    (item,) = receive(first, 1)
    assert isinstance(item, Received)
    first.close()
    second.open(timeout_s=1.0)
    second.close()
