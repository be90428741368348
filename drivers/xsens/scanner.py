"""Cuts Xbus messages out of a byte stream: FA FF, message, length, data, sum. All bytes after FA sum to 0."""

from typing import NamedTuple

from drivers.driver import Rejection

HEAD = b"\xfa\xff"
EXTENDED = 0xFF
"""Length byte that says: the length follows in two bytes."""
LARGEST_DATA = 1024
"""More than any output configuration needs; a damaged length is noticed after at most so many bytes."""

_FRAMING = Rejection("framing")
_CHECKSUM = Rejection("checksum")


class Message(NamedTuple):
    """One message of the device."""

    kind: int
    data: bytes


class MessageScanner:
    """Finds messages; keeps less than one."""

    def __init__(self) -> None:
        self._rest = b""
        self._is_lost = False

    def reset(self) -> None:
        """Forget a half-received message."""
        self._rest = b""
        self._is_lost = False

    def feed(self, payload: bytes) -> list[Message | Rejection]:
        """Return the messages that `payload` completes, and a rejection for each run of other bytes."""
        data = self._rest + payload
        messages: list[Message | Rejection] = []
        position = 0
        while position < len(data):
            end = _end_of(data, position)
            if end is None:
                break
            if end > 0 and sum(data[position + 1 : end]) & 0xFF == 0:
                header = 6 if data[position + 3] == EXTENDED else 4
                messages.append(Message(data[position + 2], data[position + header : end - 1]))
                self._is_lost = False
                position = end
                continue
            if not self._is_lost:
                messages.append(_CHECKSUM if end else _FRAMING)
            self._is_lost = True
            next_head = data.find(HEAD[0], position + 1)
            position = len(data) if next_head < 0 else next_head
        self._rest = data[position:]
        return messages


def _end_of(data: bytes, start: int) -> int | None:
    """Return where a message from `start` ends, 0 where none begins, None where it is not complete."""
    if not data.startswith(HEAD[: len(data) - start], start):
        return 0
    if len(data) < start + 4:
        return None
    header, size = start + 4, data[start + 3]
    if size == EXTENDED:
        header += 2
        if len(data) < header:
            return None
        size = int.from_bytes(data[start + 4 : header], "big")
        if not EXTENDED <= size <= LARGEST_DATA:
            return 0
    end = header + size + 1
    return end if end <= len(data) else None
