"""Modes of a CAN controller in which nothing is sent, read from the kernel over rtnetlink."""

import socket
import struct
import sys
from collections.abc import Iterator

RTM_GETLINK = 18
NLM_F_REQUEST = 1
NETLINK_HEADER = struct.Struct("=IHHII")
LINK_HEADER = struct.Struct("=BxHiII")
ATTRIBUTE_HEADER = struct.Struct("=HH")
ATTRIBUTE_TYPE_MASK = 0x3FFF
IFLA_LINKINFO = 18
IFLA_INFO_DATA = 2
IFLA_CAN_CTRLMODE = 5
REPLY_SIZE = 65_536
TIMEOUT_S = 1.0

SILENT_MODES = {0x01: "loopback", 0x02: "listen-only"}
"""Bits of `struct can_ctrlmode` of linux/can/netlink.h, with their names in `ip link`."""


def read_silent_modes(interface: str) -> tuple[str, ...]:
    """Return the modes of a network interface in which no frame reaches the bus: normally none.

    Raises:
        OSError: There is no such interface, or the kernel refuses the request.
    """
    body = LINK_HEADER.pack(socket.AF_UNSPEC, 0, socket.if_nametoindex(interface), 0, 0)
    head = NETLINK_HEADER.pack(NETLINK_HEADER.size + len(body), RTM_GETLINK, NLM_F_REQUEST, 1, 0)
    with socket.socket(socket.AF_NETLINK, socket.SOCK_RAW, socket.NETLINK_ROUTE) as netlink:
        netlink.settimeout(TIMEOUT_S)
        netlink.send(head + body)
        return silent_modes_in(netlink.recv(REPLY_SIZE))


def silent_modes_in(reply: bytes) -> tuple[str, ...]:
    """Return the modes that a reply to RTM_GETLINK contains; none where the interface has no such modes."""
    link = _attribute(reply[NETLINK_HEADER.size + LINK_HEADER.size :], IFLA_LINKINFO)
    mode = _attribute(_attribute(link, IFLA_INFO_DATA), IFLA_CAN_CTRLMODE)
    if len(mode) < 8:
        return ()
    flags = int.from_bytes(mode[4:8], sys.byteorder)
    return tuple(name for bit, name in SILENT_MODES.items() if flags & bit)


def _attribute(data: bytes, wanted: int) -> bytes:
    return next((value for kind, value in _attributes(data) if kind == wanted), b"")


def _attributes(data: bytes) -> Iterator[tuple[int, bytes]]:
    while len(data) >= ATTRIBUTE_HEADER.size:
        length, kind = ATTRIBUTE_HEADER.unpack_from(data)
        if length < ATTRIBUTE_HEADER.size:
            return
        yield kind & ATTRIBUTE_TYPE_MASK, data[ATTRIBUTE_HEADER.size : length]
        data = data[(length + 3) & ~3 :]
