"""A CAN adapter of the kernel, slcan on a pseudo-terminal, whose other side the test plays.

The cards that qemu emulates know no errors. This driver of the kernel turns what its adapter reports into
error frames, the controller's state and a lost carrier like that of any card. Source: drivers/net/can/slcan.
"""

import fcntl
import os
import pty
import struct
import termios
import tty
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from tests.kernel.can_wire import Wire
from tests.kernel.system import load, run, wait_until

N_SLCAN = 17
NETWORK = Path("/sys/class/net")


@dataclass(frozen=True)
class Adapter:
    """The adapter's side of the serial line, and the bus that the kernel makes of it."""

    end: int
    wire: Wire

    def report(self, *lines: str) -> None:
        """Send lines as the adapter does, e.g. "sb255000" for bus-off with two error counters."""
        os.write(self.end, "".join(f"{line}\r" for line in lines).encode())

    def report_frame(self, can_id: int, data: bytes) -> None:
        """Report a frame of another node."""
        self.report(f"t{can_id:03X}{len(data)}{data.hex().upper()}")

    def read(self) -> list[str]:
        """Return what the kernel has sent to the adapter."""
        data = b""
        with suppress(BlockingIOError):
            data = os.read(self.end, 65_536)
        return [line for line in data.decode().split("\r") if line]


@contextmanager
def slcan_adapter() -> Iterator[Adapter]:
    """Yield an adapter whose interface is up."""
    load("can_raw", "slcan")
    before = set(NETWORK.iterdir())
    end, port = pty.openpty()
    os.set_blocking(end, False)
    tty.setraw(port)
    fcntl.ioctl(port, termios.TIOCSETD, struct.pack("=i", N_SLCAN))
    (interface,) = set(NETWORK.iterdir()) - before
    wire = Wire(interface.name, interface.name)
    wire.up()
    yield Adapter(end, wire)
    wire.down()
    os.close(port)
    os.close(end)
    wait_until(lambda: not interface.exists())
    run("rmmod slcan")
