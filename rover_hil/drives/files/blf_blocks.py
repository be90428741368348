"""Reads the containers of a BLF file by numpy: many frames at once where they lie in a row."""

from collections.abc import Callable, Iterator
from typing import Any

import can
import numpy as np

from rover_hil.drives.arrays import Array
from rover_hil.drives.files.unreadable import UnreadableError

_MARK = b"LOBJ"
_LEAST_OBJECT, _LEAST_FRAME, _LARGEST_FRAME = 16, 48, 96
_FIELDS = {
    "mark": ("S4", 0),
    "version": ("<u2", 6),
    "size": ("<u4", 8),
    "kind": ("<u4", 12),
    "clock": ("<u4", 16),
    "ticks": ("<u8", 24),
    "channel": ("<u2", 32),
    "flags": ("u1", 34),
    "length": ("u1", 35),
    "identifier": ("<u4", 36),
    "data": (("u1", 8), 40),
}
"""Of a classic frame: format and place, as in OBJ_HEADER_BASE, OBJ_HEADER_V1 and CAN_MSG of python-can."""
_FRAME_KINDS = (1, 86)
_TEN_MICROSECONDS = 1
_REMOTE = 0x80
_GREATEST_EXACT = 2**53
"""Whole numbers up to here are exact, so that their quotient is rounded once, as python-can's decimal is."""
_FIRST_RUN = 32


class BlfBlocks(can.BLFReader):
    """The reader of python-can; runs of classic data frames go to `on_run` in one piece.

    Iterating yields what lies between them in the file: remote and error frames, frames of CAN FD.

    Args:
        raw: The file, opened.
        on_run: Called with the times of n frames in s, and their records with the fields `channel` (counted
            from 1), `length` (up to 8), `identifier` (bit 31: extended) and `data` (8 bytes).
    """

    def __init__(self, raw: Any, on_run: Callable[[Array, np.ndarray[Any, Any]], None]) -> None:
        super().__init__(raw)
        self._on_run = on_run

    def _parse_data(self, data: bytes) -> Iterator[can.Message]:
        """Yield the frames of a container that are in no run; `_pos` is then the end of the last object."""
        most = _FIRST_RUN
        position = self._pos = 0
        while True:
            start = data.find(_MARK, position, position + 8)
            count, size = (0, 0) if start < 0 else self._take_run(data, start, most)
            most = 2 * most if count == most else _FIRST_RUN
            if count:
                position = self._pos = start + count * size
                continue
            end = start + size if size and start + size <= len(data) else len(data)
            try:
                yield from super()._parse_data(data[position:end])
            finally:
                self._pos += position
            if end == len(data):
                return
            position = self._pos

    def _take_run(self, data: bytes, start: int, most: int) -> tuple[int, int]:
        """Take the frames in a row from `start` on; return their number and the size of the first object.

        Raises:
            UnreadableError: That size is no possible one.
        """
        size = int.from_bytes(data[start + 8 : start + 12], "little")
        if start + 12 <= len(data) and size < _LEAST_OBJECT:
            raise UnreadableError(f"an object of {size} bytes")
        count = min(most, (len(data) - start) // size) if _LEAST_FRAME <= size <= _LARGEST_FRAME else 0
        if not count or size % 4:
            return 0, size
        records = np.frombuffer(data, _record(size), count, start)
        is_plain = (
            (records["mark"] == _MARK)
            & (records["version"] == 1)
            & (records["size"] == size)
            & np.isin(records["kind"], _FRAME_KINDS)
            & (records["ticks"] <= _GREATEST_EXACT)
            & (records["flags"] & _REMOTE == 0)
            & (records["length"] <= 8)
        )
        count = count if is_plain.all() else int(np.argmin(is_plain))
        records = records[:count]
        ticks_per_s = np.where(records["clock"] == _TEN_MICROSECONDS, 1e5, 1e9)
        self._on_run(records["ticks"] / ticks_per_s + self.start_timestamp, records)
        return count, size


def _record(size: int) -> np.dtype[Any]:
    formats, places = zip(*_FIELDS.values(), strict=True)
    return np.dtype({"names": [*_FIELDS], "formats": formats, "offsets": places, "itemsize": size})
