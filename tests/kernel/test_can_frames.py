"""Frames over SocketCAN: content, order, time stamps, and what is lost on the way."""

import socket
import threading

import pytest

from drivers.can.frame import CanFrame, pack_can_frame, unpack_can_frame
from drivers.can.link import CanLink
from drivers.clock import NANOSECONDS_PER_SECOND, nanoseconds
from drivers.link import Received
from tests.kernel.can_wire import Wire, collect, frame, numbers
from tests.kernel.system import CLOCK, pause, step_wall_clock, wait_until

KINDS = [
    CanFrame(0x123, bytes(range(8))),
    CanFrame(0x7FF, b""),
    CanFrame(0x1ABCDEF0, b"\xff\x00", is_extended=True),
    CanFrame(0x42, b"", is_remote=True),
]
BURST = 2000
DRIVES = 4
RATE_HZ = 100
MINUTE_S = 60


def test_every_kind_of_frame_passes_both_ways(wire: Wire) -> None:
    link = wire.link()
    link.open(1.0)
    with wire.node() as node:
        for kind in KINDS:
            node.send(pack_can_frame(kind))
        items = collect(link, len(KINDS), Received)
        assert [item.payload for item in items if isinstance(item, Received)] == [
            pack_can_frame(kind) for kind in KINDS
        ]
        node.settimeout(1.0)
        for kind in KINDS:
            assert link.send(pack_can_frame(kind))
            assert unpack_can_frame(node.recv(16)) == kind
    link.close()


def test_an_error_frame_of_the_controller_is_handed_on(vcan: Wire) -> None:
    link = vcan.link()
    link.open(1.0)
    with vcan.node() as node:
        node.send(pack_can_frame(CanFrame(0x40, bytes(8), is_error=True)))
        (item,) = collect(link, 1, Received)
    link.close()
    assert isinstance(item, Received)
    found = unpack_can_frame(item.payload)
    assert found is not None
    assert found.is_error
    assert found.can_id == 0x40


@pytest.mark.parametrize("step_s", [3600.0, -3600.0, 0.5, -0.5])
def test_stamps_are_monotonic_and_fresh_across_a_step_of_the_wall_clock(wire: Wire, step_s: float) -> None:
    link = wire.link()
    link.open(1.0)
    before_ns = CLOCK.now_ns()
    sent_ns = []
    with wire.node() as node:
        for number in range(40):
            if number == 20:
                step_wall_clock(step_s)
            sent_ns.append(CLOCK.now_ns())
            node.send(frame(number))
            pause(0.005)
        items = collect(link, 40, Received)
    link.close()
    step_wall_clock(-step_s)
    assert numbers(items) == list(range(40))
    stamps_ns = [item.t_ns for item in items]
    assert [before_ns, *stamps_ns] == sorted([before_ns, *stamps_ns])
    late_ns = [stamp - sent for stamp, sent in zip(stamps_ns, sent_ns, strict=True)]
    assert max(late_ns) < 50_000_000
    assert min(late_ns) > -1_000_000


def test_frames_that_the_kernel_had_no_room_for_are_counted(wire: Wire) -> None:
    link = wire.link()
    link.open(1.0)
    with wire.node() as node:
        with link._items_lock:  # a reader that gets no processor
            for number in range(BURST):
                _send_patiently(node, frame(number))
            pause(0.5)
        received = _drain(link)
        node.send(frame(BURST))
        received += _drain(link)
    link.close()
    assert received[-1] == BURST
    assert link.dropped == BURST + 1 - len(received)
    assert link.dropped > BURST / 2


def test_four_drives_at_100_hz_lose_nothing_in_a_minute(vcan: Wire) -> None:
    link = vcan.link()
    link.open(1.0)
    sender = threading.Thread(target=_send_like_drives, args=(vcan,))
    sender.start()
    found: list[int] = []
    wanted = DRIVES * RATE_HZ * MINUTE_S

    def is_done() -> bool:
        found.extend(numbers(link.receive()))
        pause(0.02)
        return len(found) >= wanted

    wait_until(is_done, 2.0 * MINUTE_S)
    sender.join()
    link.close()
    assert found == list(range(wanted))
    assert link.dropped == 0


def _send_like_drives(wire: Wire) -> None:
    with wire.node() as node:
        start_ns = CLOCK.now_ns()
        for turn in range(RATE_HZ * MINUTE_S):
            CLOCK.sleep_until(start_ns + turn * NANOSECONDS_PER_SECOND // RATE_HZ)
            for drive in range(DRIVES):
                node.send(frame(turn * DRIVES + drive))


def _send_patiently(node: socket.socket, payload: bytes) -> None:
    """Send when the queue of the interface has room."""
    deadline_ns = CLOCK.now_ns() + nanoseconds(5.0)
    while CLOCK.now_ns() < deadline_ns:
        try:
            node.send(payload)
        except OSError:
            pause(0.001)
        else:
            return
    pytest.fail("the interface takes no more frames")


def _drain(link: CanLink) -> list[int]:
    """Return what arrives until nothing has come for 0.2 s."""
    found: list[int] = []
    quiet_ns = CLOCK.now_ns() + nanoseconds(0.2)
    while CLOCK.now_ns() < quiet_ns:
        new = numbers(link.receive())
        if new:
            found.extend(new)
            quiet_ns = CLOCK.now_ns() + nanoseconds(0.2)
        pause(0.005)
    return found
