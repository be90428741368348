"""Serial lines of the kernel: a USB gadget that is a modem, and an emulated FTDI adapter on a UART."""

import os
import termios
import tty
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from drivers.link import LinkChange, LinkItem, Received
from drivers.serial_link import SerialLink
from tests.kernel.system import CLOCK, is_done, load, run, wait_until, write

BAUD_RATE = 115_200
INPUT_SPEED, OUTPUT_SPEED = 4, 5
FRAME_BITS = 10
"""Of a byte on the line: start, eight data bits, stop."""


@dataclass(frozen=True)
class Line:
    """A serial line: the port of the link, that of the other end, and the adapter between them."""

    near: Path
    far: Path

    @property
    def adapter(self) -> Path:
        """Folder of the USB device in /sys."""
        folder = Path("/sys/class/tty", self.near.name, "device").resolve()
        return next(parent for parent in folder.parents if (parent / "idVendor").is_file())

    def link(self) -> SerialLink:
        return SerialLink(str(self.near), BAUD_RATE, CLOCK, reconnect_limit_s=60.0)

    @contextmanager
    def other_end(self) -> Iterator[int]:
        """Yield the other end, open, raw and without waiting."""
        end = os.open(self.far, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        tty.setraw(end)
        _set_baud_rate(end)
        try:
            yield end
        finally:
            os.close(end)


@contextmanager
def modem() -> Iterator[Line]:
    """Yield a USB modem: a gadget of this machine on a bus without wires."""
    load("dummy_hcd", "usb_f_acm", "g_serial", "cdc_acm")
    line = Line(Path("/dev/ttyACM0"), Path("/dev/ttyGS0"))
    wait_until(lambda: line.near.exists() and line.far.exists())
    yield line
    wait_until(lambda: is_done("rmmod g_serial"))
    run("rmmod dummy_hcd")


def _set_baud_rate(end: int) -> None:
    attributes = termios.tcgetattr(end)
    attributes[INPUT_SPEED] = attributes[OUTPUT_SPEED] = termios.B115200
    termios.tcsetattr(end, termios.TCSANOW, attributes)


def unplug(adapter: Path) -> None:
    write(adapter / "authorized", "0")


def plug_in(adapter: Path) -> None:
    write(adapter / "authorized", "1")


def collect_bytes(link: SerialLink, count: int) -> bytes:
    """Return the first so many bytes."""
    found = bytearray()

    def is_done() -> bool:
        for item in link.receive():
            if isinstance(item, Received):
                found.extend(item.payload)
        return len(found) >= count

    wait_until(is_done)
    return bytes(found)


def collect_changes(link: SerialLink) -> list[LinkChange]:
    """Return the next changes of the link, at least one."""
    found: list[LinkItem[bytes]] = []

    def is_done() -> bool:
        found.extend(item for item in link.receive() if isinstance(item, LinkChange))
        return bool(found)

    wait_until(is_done)
    return [item for item in found if isinstance(item, LinkChange)]


def read_all(end: int, count: int) -> bytes:
    """Return so many bytes that have reached the other end."""
    found = bytearray()

    def is_done() -> bool:
        with suppress(BlockingIOError):
            found.extend(os.read(end, 4096))
        return len(found) >= count

    wait_until(is_done)
    return bytes(found)


def seen_at_another_rate(data: bytes, sent_at: int, read_at: int) -> bytes:
    """Return what a UART reads that samples the levels of the line at a wrong rate."""
    levels = [level for byte in data for level in _levels(byte)] + [1] * FRAME_BITS
    step = sent_at / read_at

    def at(moment: float) -> int:
        index = int(moment)
        return levels[index] if index < len(levels) else 1

    found = bytearray()
    now = 0.0
    while now < len(levels):
        if at(now):
            now += step / 8
            continue
        bits = [at(now + step * (number + 1.5)) for number in range(8)]
        found.append(sum(bit << number for number, bit in enumerate(bits)))
        now += step * (FRAME_BITS - 0.5)
    return bytes(found)


def _levels(byte: int) -> list[int]:
    return [0, *(byte >> number & 1 for number in range(8)), 1]
