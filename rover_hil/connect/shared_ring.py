"""Messages from one process to another through shared memory: no call of the system, and nobody waits."""

import ctypes
import struct
import zlib
from multiprocessing.sharedctypes import RawArray

_NUMBER, _SIGNS, _HEADER = struct.Struct("@Q"), struct.Struct("@QQ"), struct.Struct("@QII")
"""Number of a message from 1 on, size, checksum, which begins with the number: zeros are no message.

The checksum is one without tables: those of another would have to come into the caches first. Numbers in the
native order are read and written as a whole, not byte by byte.
"""

_FRONT = _NUMBER.size + _SIGNS.size


class SharedRing:
    """A queue with one writer and one reader, of a fixed number of places.

    In front of the places are the number of the last message that was taken, that of the last one that was
    put, and the number of heartbeats of the writer.

    A call of the system costs tens of microseconds where other programs have used the caches since the last
    one. It reaches another process as an argument of `multiprocessing.Process`.

    Args:
        places: Most messages that wait.
        place_bytes: Longest message.
    """

    def __init__(self, places: int, place_bytes: int) -> None:
        self.places = places
        self.place_bytes = place_bytes
        self._memory = RawArray(ctypes.c_char, _FRONT + places * (_HEADER.size + place_bytes))

    def view(self) -> memoryview:
        """Return the memory."""
        return memoryview(self._memory).cast("B")

    def begin_of(self, number: int) -> int:
        """Return where the place of a message begins."""
        return _FRONT + (number % self.places) * (_HEADER.size + self.place_bytes)


class RingWriter:
    """The writer of a ring."""

    def __init__(self, ring: SharedRing) -> None:
        self._ring = ring
        self._view = ring.view()
        self._next = 1
        self._taken = self._signs = 0
        self._begins = [ring.begin_of(number) for number in range(ring.places)]

    def give_sign(self) -> None:
        """Give a heartbeat."""
        self._signs += 1
        _SIGNS.pack_into(self._view, _NUMBER.size, self._next - 1, self._signs)

    def put(self, data: bytes) -> bool:
        """Add a message; return whether there was room for it."""
        number, ring = self._next, self._ring
        if number - self._taken > ring.places:
            (self._taken,) = _NUMBER.unpack_from(self._view)
        if number - self._taken > ring.places or len(data) > ring.place_bytes:
            return False
        begin = self._begins[number % ring.places]
        content = begin + _HEADER.size
        self._view[content : content + len(data)] = data
        _HEADER.pack_into(self._view, begin, 0, len(data), zlib.adler32(data, number))
        _NUMBER.pack_into(self._view, begin, number)  # last: it makes the message a new one
        self._next = number + 1
        _SIGNS.pack_into(self._view, _NUMBER.size, number, self._signs)
        return True


class RingReader:
    """The reader of a ring.

    It knows a new message by its number and its checksum. So one whose bytes have not all arrived yet is left
    for the next look, on processors that reorder writes too.

    Attributes:
        count: Heartbeats of the writer, at the last look.
    """

    def __init__(self, ring: SharedRing) -> None:
        self._ring = ring
        self._view = ring.view()
        self._begin = ring.begin_of(1)
        self._next = 1
        self.count = 0

    def look(self) -> bool:
        """Return whether there may be a message, and count the heartbeats."""
        last, self.count = _SIGNS.unpack_from(self._view, _NUMBER.size)
        return bool(last >= self._next)

    def take(self) -> bytes | None:
        """Return the oldest message that was not taken, or None for none."""
        number, size, checksum = _HEADER.unpack_from(self._view, self._begin)
        if number != self._next or size > self._ring.place_bytes:
            return None
        content = self._begin + _HEADER.size
        data = bytes(self._view[content : content + size])
        if zlib.adler32(data, number) != checksum:
            return None
        _NUMBER.pack_into(self._view, 0, number)
        self._next = number + 1
        self._begin = self._ring.begin_of(self._next)
        return data
