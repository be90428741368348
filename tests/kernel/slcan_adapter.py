"""A CAN adapter of the kernel, slcan on a pseudo-terminal, whose other side the test plays.

The cards that qemu emulates know no errors. This driver of the kernel turns what its adapter reports into
error frames, the controller's state and a lost carrier like that of any card. Source: drivers/net/can/slcan.
"""

import fcntl
import os
import pty
import struct
import termios
import threading
import tty
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from tests.kernel.can_wire import Wire
from tests.kernel.system import DEADLINE_S, load, run, wait_until

N_SLCAN = 17
NETWORK = Path("/sys/class/net")


class Adapter:
    """The adapter's side of the serial line; it reads all the time, for the driver waits until it has.

    Args:
        end: The line, open.
        wire: The bus that the kernel makes of it.
    """

    def __init__(self, end: int, wire: Wire) -> None:
        self.wire = wire
        self._end = end
        self._received = bytearray()
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()

    def report(self, *lines: str) -> None:
        """Send lines as the adapter does, e.g. "sb000255" for bus-off with the two error counters."""
        os.write(self._end, "".join(f"{line}\r" for line in lines).encode())

    def report_frame(self, can_id: int, data: bytes) -> None:
        """Report a frame of another node."""
        self.report(f"t{can_id:03X}{len(data)}{data.hex().upper()}")

    def take(self) -> list[str]:
        """Return the lines that the kernel has sent since the last call."""
        data, self._received = self._received, bytearray()
        return [line for line in data.decode().split("\r") if line]

    def _read(self) -> None:
        with suppress(OSError):  # the kernel has closed its side
            while data := os.read(self._end, 4096):
                self._received.extend(data)

    def end(self) -> None:
        """Wait until the kernel has closed its side, then close this one."""
        self._thread.join(DEADLINE_S)
        os.close(self._end)


@contextmanager
def slcan_adapter() -> Iterator[Adapter]:
    """Yield an adapter whose interface is up."""
    load("can_raw", "slcan")
    before = set(NETWORK.iterdir())
    end, port = pty.openpty()
    tty.setraw(port)
    fcntl.ioctl(port, termios.TIOCSETD, struct.pack("=i", N_SLCAN))
    (interface,) = set(NETWORK.iterdir()) - before
    wire = Wire(interface.name, interface.name)
    adapter = Adapter(end, wire)
    wire.up()
    yield adapter
    wire.down()
    os.close(port)
    adapter.end()
    wait_until(lambda: not interface.exists())
    run("rmmod slcan")
