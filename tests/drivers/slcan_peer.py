"""The adapter at the far end of a pseudo-terminal: speaks slcan as a USB adapter does."""

import os
import select
import threading
import tty
from pathlib import Path

from drivers.can.frame import CanFrame, pack_can_frame, unpack_can_frame


class SlcanPeer:
    """Creates a pty and a symlink to it; collects what the host sends.

    Attributes:
        commands: Lines that are no frames, e.g. "S6".
        frames: Frames from the host, 16 bytes each.
    """

    def __init__(self, link: Path) -> None:
        self.commands: list[str] = []
        self.frames: list[bytes] = []
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        link.unlink(missing_ok=True)
        link.symlink_to(os.ttyname(self._slave))
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def send(self, payload: bytes) -> None:
        """Send one frame to the host."""
        frame = unpack_can_frame(payload)
        assert frame is not None
        head = f"T{frame.can_id:08X}" if frame.is_extended else f"t{frame.can_id:03X}"
        if frame.is_remote:
            head = head.translate(str.maketrans("Tt", "Rr"))
        self.send_text(f"{head}{len(frame.data)}{frame.data.hex().upper()}\r")

    def send_text(self, text: str) -> None:
        """Send anything to the host, a byte for each character."""
        os.write(self._master, text.encode("latin-1"))

    def unplug(self) -> None:
        """Take the pty away; the symlink stays behind."""
        self._stopping.set()
        self._thread.join()
        os.close(self._slave)
        os.close(self._master)

    def _run(self) -> None:
        buffer = b""
        while not self._stopping.is_set():
            if not select.select([self._master], [], [], 0.02)[0]:
                continue
            *lines, buffer = (buffer + os.read(self._master, 4096)).split(b"\r")
            for line in lines:
                self._take(line.decode())

    def _take(self, line: str) -> None:
        if line[:1] not in ("t", "T", "r", "R") or not line:
            self.commands.append(line)
            return
        digits = 8 if line[0] in "TR" else 3
        can_id, data = int(line[1 : 1 + digits], 16), bytes.fromhex(line[2 + digits :])
        self.frames.append(pack_can_frame(CanFrame(can_id, data, digits == 8, line[0] in "rR")))
