"""CAN interfaces of the kernel: a virtual one, and two emulated PCI cards on one wire."""

import socket
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from drivers.can.link import CanLink
from drivers.link import LinkChange, LinkItem, Received
from tests.kernel.system import CLOCK, load, run, wait_until, write

BIT_RATE = 500_000
CARD_DRIVER = Path("/sys/bus/pci/drivers/kvaser_pci")
SEND_BUFFER = 1 << 22
IFF_UP = 1


@dataclass(frozen=True)
class Wire:
    """A CAN bus: the interface of the link, and that of another node, which may be the same."""

    near: str
    far: str

    def up(self, mode: str = "") -> None:
        """Bring up what is down, the link's own interface in a mode of `ip link set ... type can`."""
        for name in sorted({self.near, self.far}):
            if int(Path(f"/sys/class/net/{name}/flags").read_text(), 16) & IFF_UP:
                continue
            settings = "" if name.startswith("vcan") else f" type can bitrate {BIT_RATE}"
            run(f"ip link set {name} up{settings}{mode if name == self.near else ''}")

    def down(self) -> None:
        run(f"ip link set {self.near} down")

    def remove(self) -> None:
        """Make the interface of the link vanish, as when its adapter is pulled."""
        if self.near.startswith("vcan"):
            run(f"ip link delete {self.near}")
        else:
            write(CARD_DRIVER / "unbind", _card_of(self.near))

    def make(self) -> None:
        """Make the interface of the link again."""
        if self.near.startswith("vcan"):
            run(f"ip link add {self.near} type vcan")
        else:
            write(CARD_DRIVER / "bind", _card_without_interface())

    def link(self) -> CanLink:
        return CanLink("socketcan", self.near, BIT_RATE, CLOCK, reconnect_limit_s=60.0)

    @contextmanager
    def node(self) -> Iterator[socket.socket]:
        """Yield a raw socket of another node."""
        with socket.socket(socket.PF_CAN, socket.SOCK_RAW, socket.CAN_RAW) as raw:
            raw.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER)
            raw.bind((self.far,))
            yield raw


@contextmanager
def cards() -> Iterator[Wire]:
    """Yield the bus of two PCI cards, both up."""
    load("can_raw", "kvaser_pci", "sch_tbf")
    wire = Wire("can0", "can1")
    wire.up()
    yield wire
    run("rmmod kvaser_pci")


def frame(number: int) -> bytes:
    """Return a frame, as the kernel and the link exchange them, that carries a number."""
    return struct.pack("=IB3x8s", 0x123, 8, number.to_bytes(8, "big"))


def number_of(payload: bytes) -> int:
    return int.from_bytes(payload[8:16], "big")


def collect(
    link: CanLink, count: int, kind: type[LinkChange] | type[Received[bytes]]
) -> list[LinkItem[bytes]]:
    """Return the first so many items of one kind."""
    found: list[LinkItem[bytes]] = []

    def is_done() -> bool:
        found.extend(item for item in link.receive() if isinstance(item, kind))
        return len(found) >= count

    wait_until(is_done)
    return found


def numbers(items: list[LinkItem[bytes]]) -> list[int]:
    return [number_of(item.payload) for item in items if isinstance(item, Received)]


def directions(items: list[LinkItem[bytes]]) -> list[bool]:
    """Return for each change of the link whether it came up."""
    return [item.up for item in items if isinstance(item, LinkChange)]


def _card_of(name: str) -> str:
    return Path(f"/sys/class/net/{name}/device").resolve().name


def _card_without_interface() -> str:
    bound = {path.name for path in CARD_DRIVER.iterdir()}
    cards = [path.parent.name for path in Path("/sys/bus/pci/devices").glob("*/vendor") if _is_kvaser(path)]
    (card,) = set(cards) - bound
    return card


def _is_kvaser(vendor: Path) -> bool:
    return vendor.read_text().strip() == "0x10e8"
