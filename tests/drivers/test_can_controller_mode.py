"""Modes of a CAN controller in replies of the kernel."""

import struct

import pytest

from drivers.can import link as can_link
from drivers.can.controller_mode import read_silent_modes, silent_modes_in
from drivers.can.link import CanLink
from drivers.clock import SystemClock
from drivers.errors import NotConnectedError


def attribute(kind: int, value: bytes) -> bytes:
    return struct.pack("=HH", 4 + len(value), kind) + value + bytes(-len(value) % 4)


def reply(flags: int) -> bytes:
    mode = attribute(5, struct.pack("=II", 0, flags))
    info = attribute(1, b"can\0") + attribute(2, attribute(4, bytes(4)) + mode)
    return bytes(16 + 16) + attribute(3, b"can0\0") + attribute(18 | 0x8000, info)


@pytest.mark.parametrize(
    ("flags", "modes"),
    [(0, ()), (0x01, ("loopback",)), (0x02, ("listen-only",)), (0x37, ("loopback", "listen-only"))],
)
def test_modes_of_a_reply(flags: int, modes: tuple[str, ...]) -> None:
    assert silent_modes_in(reply(flags)) == modes


@pytest.mark.parametrize("data", [b"", reply(3)[:40], bytes(100), reply(3)[:-4], b"\xff" * 64])
def test_damaged_replies_have_no_modes(data: bytes) -> None:
    assert silent_modes_in(data) == ()


def test_an_interface_that_is_no_can_controller_has_no_modes() -> None:
    assert read_silent_modes("lo") == ()


def test_a_silent_controller_is_refused_with_its_remedy(monkeypatch: pytest.MonkeyPatch) -> None:
    class Socket:
        def getsockopt(self, level: int, option: int) -> int:
            return 0

    class Bus:
        socket = Socket()
        is_shut_down = False

        def shutdown(self) -> None:
            self.is_shut_down = True

    bus = Bus()
    monkeypatch.setattr("socket.if_nametoindex", lambda name: 3)
    monkeypatch.setattr(can_link, "SocketcanBus", lambda channel: bus)
    monkeypatch.setattr(can_link, "read_silent_modes", lambda channel: ("listen-only",))
    link = CanLink("socketcan", "can0", 500_000, SystemClock(), 1.0)
    with pytest.raises(NotConnectedError, match=r"listen-only mode.* up type can listen-only off"):
        link.open(0.0)
    assert bus.is_shut_down
