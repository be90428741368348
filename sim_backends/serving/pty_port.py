"""A serial device on a pseudo-terminal behind a fixed path."""

import contextlib
import os
import select
import tty
from pathlib import Path

from drivers.errors import NotConnectedError
from sim_backends.serving.made_folders import MadeFolders
from sim_backends.serving.port import Port

PSEUDO_TERMINALS = "/dev/pts/"
READ_SIZE = 65_536


class PtyPort(Port[bytes]):
    """A pseudo-terminal whose client side is a symbolic link at the path the host opens.

    Left out: baud rate and parity of the host's end (any are accepted) and modem lines. As on a UART, what
    does not fit into the buffer (about 20 kB) is lost.

    Args:
        path: Path that the host opens; missing folders are made, and removed again on `close`. Only
            the dangling link of a simulator that has ended is ever replaced.
    """

    def __init__(self, path: str) -> None:
        self.where = path
        self._path = Path(path)
        self._target = ""
        self._master: int | None = None
        self._poll = select.poll()
        self._folders = MadeFolders()

    def open(self) -> None:
        """Create the pseudo-terminal and point the link at it; does nothing when it is open."""
        if self._master is not None:
            return
        self._require_free_path()
        try:
            self._folders.make(self._path.parent)
            self._path.unlink(missing_ok=True)
            self._master, slave = os.openpty()
            tty.setraw(slave)
            self._target = os.ttyname(slave)
            os.close(slave)  # while the host has it closed, the master reports a hang-up
            os.set_blocking(self._master, False)
            self._poll.register(self._master, select.POLLIN)
            self._path.symlink_to(self._target)
        except OSError as error:
            self.close()
            raise NotConnectedError(f"cannot serve a serial port at {self.where}: {error}") from error

    def close(self) -> None:
        """Destroy the pseudo-terminal, remove the link and the folders made for it."""
        if self._master is not None:
            if self._path.is_symlink() and str(self._path.readlink()) == self._target:
                self._path.unlink()
            self._poll.unregister(self._master)
            os.close(self._master)
            self._master = None
        self._folders.remove()

    def read(self) -> list[bytes]:
        """Return what the host has written, as one chunk."""
        data = b""
        if self._master is not None:
            with contextlib.suppress(OSError):  # nothing to read, or no host has the port open
                data = os.read(self._master, READ_SIZE)
        return [data] if data else []

    def has_listener(self) -> bool:
        """Return whether a host has the port open."""
        if self._master is None:
            return False
        return not any(event & select.POLLHUP for _, event in self._poll.poll(0))

    def write(self, payload: bytes) -> bool:
        """Write what fits into the buffer; False when that is not all."""
        if self._master is None:
            return False
        try:
            return os.write(self._master, payload) == len(payload)
        except OSError:
            return False

    def _require_free_path(self) -> None:
        taken = self._path.exists()
        if self._path.is_symlink():
            taken = taken or not str(self._path.readlink()).startswith(PSEUDO_TERMINALS)
        if taken:
            raise NotConnectedError(
                f"cannot serve a serial port at {self.where}: the path is taken; end the simulator that "
                "serves it, remove it, or change the device's port"
            )
