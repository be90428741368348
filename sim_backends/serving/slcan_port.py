"""A CAN bus behind a serial adapter that speaks LAWICEL's ASCII protocol (slcan), on a pseudo-terminal."""

from drivers.can.frame import (
    EXTENDED_ID_MASK,
    STANDARD_ID_MASK,
    CanFrame,
    pack_can_frame,
    unpack_can_frame,
)
from sim_backends.serving.port import Port
from sim_backends.serving.pty_port import PtyPort

OK = b"\r"
ERROR = b"\a"
LONGEST_LINE = 32
HEX_DIGITS = frozenset(b"0123456789ABCDEFabcdef")


class SlcanPort(Port[bytes]):
    """The adapter: commands C, O, S, s and frames t, T, r, R; payloads are 16-byte CAN frames.

    Source: LAWICEL CAN232 / CANUSB manual. Not modelled: listening only, time stamps, filters, status and
    version queries (answered with an error), and error frames, which the protocol cannot carry.

    Args:
        path: Path of the adapter's serial port on the host.
    """

    def __init__(self, path: str) -> None:
        self.where = f"{path} (slcan)"
        self._pty = PtyPort(path)
        self._received = b""
        self._channel_is_open = False

    def open(self) -> None:
        """Create the pseudo-terminal; the host opens the CAN channel."""
        self._pty.open()

    def close(self) -> None:
        """Destroy the pseudo-terminal."""
        self._pty.close()
        self._forget_host()

    def read(self) -> list[bytes]:
        """Execute the adapter's commands and return the CAN frames that the host has sent."""
        self._received += b"".join(self._pty.read())
        *lines, self._received = self._received.split(OK)
        self._received = self._received[-LONGEST_LINE:]
        frames = [frame for frame in map(self._execute, lines) if frame is not None]
        if not self._pty.has_listener():
            self._forget_host()
        return frames

    def has_listener(self) -> bool:
        """Return whether a host has the CAN channel open."""
        return self._channel_is_open and self._pty.has_listener()

    def write(self, payload: bytes) -> bool:
        """Send a CAN frame to the host; return False when the protocol or the buffer cannot take it."""
        frame = unpack_can_frame(payload)
        return frame is not None and not frame.is_error and self._pty.write(_line(frame))

    def _forget_host(self) -> None:
        self._received = b""
        self._channel_is_open = False

    def _execute(self, line: bytes) -> bytes | None:
        """Answer one command; return the CAN frame it sends, if any."""
        command = line[:1]
        frame = _frame(line) if self._channel_is_open else None
        if command in (b"O", b"C"):
            self._channel_is_open = command == b"O"
        understood = frame is not None or command in (b"", b"O", b"C", b"S", b"s")
        self._pty.write(OK if understood else ERROR)
        return None if frame is None else pack_can_frame(frame)


def _line(frame: CanFrame) -> bytes:
    letter = "r" if frame.is_remote else "t"
    head = f"{letter.upper()}{frame.can_id:08X}" if frame.is_extended else f"{letter}{frame.can_id:03X}"
    data = "" if frame.is_remote else frame.data.hex().upper()
    return f"{head}{len(frame.data)}{data}".encode() + OK


def _frame(line: bytes) -> CanFrame | None:
    """Return the frame that a line sends, or None when it is not a complete t, T, r or R command."""
    letter, digits = line[:1], line[1:]
    if letter not in (b"t", b"T", b"r", b"R") or not HEX_DIGITS.issuperset(digits):
        return None
    is_extended, is_remote = letter.isupper(), letter in (b"r", b"R")
    id_digits = 8 if is_extended else 3
    try:
        can_id = int(digits[:id_digits], 16)
        length = int(digits[id_digits : id_digits + 1])
        data = bytes.fromhex(digits[id_digits + 1 :].decode())
    except ValueError:
        return None
    if length > 8 or len(data) != (0 if is_remote else length):
        return None
    if can_id > (EXTENDED_ID_MASK if is_extended else STANDARD_ID_MASK):
        return None
    return CanFrame(can_id, bytes(length) if is_remote else data, is_extended, is_remote)
