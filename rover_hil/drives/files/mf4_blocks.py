"""Check, before an MF4 file is read, that its lists end and that its records fit into memory.

Layout of the blocks: ASAM MDF 4.1, chapter 4. A block has an identifier, its length, and links to others.
"""

import struct
from collections.abc import Iterator
from typing import BinaryIO

from rover_hil.drives.files.unreadable import UnreadableError

MOST_RECORD_BYTES = 16 * 2**20
"""Of one group; a record of a CAN bus has about 100."""
_FIRST_BLOCK = 64
_HEAD = struct.Struct("<4s4xQQ")
_LINK_BYTES = 8
_MOST_LINKS = 1_000_000
_OWNED = {
    b"##HD": (0, 1, 2, 3, 4),
    b"##DG": (0, 1, 2),
    b"##CG": (0, 1, 4),
    b"##CN": (0, 1, 4, 5),
    b"##HL": (0,),
    b"##LD": None,
    b"##DL": None,
    b"##SR": (0, 1),
    b"##CH": (0, 1),
    b"##FH": (0,),
    b"##AT": (0,),
    b"##EV": (0,),
    b"##DT": (),
    b"##DZ": (),
    b"##SD": (),
    b"##DV": (),
}
"""The links of a block to what belongs to it alone, the next of its list first; None for all of its links."""
_SHARED = frozenset({b"##CC", b"##CA", b"##SI", b"##TX", b"##MD"})
"""Blocks that several others may name."""
_CONVERSION = b"##CC"
_GROUP = b"##CG"
_CHANNEL = b"##CN"
_SIGNAL_DATA = 5
"""Place of the link of a channel to its data, which may be those of a group or of an attachment."""
_OF_OTHERS = frozenset({b"##CG", b"##AT", b"##EV"})
_GROUP_RECORD = struct.Struct("<QQHHIII")
"""Record identifier, number of records, flags, separator, reserved, bytes of data and of invalidation."""
_IS_VARIABLE = 1


def check_blocks(file: BinaryIO) -> None:
    """Check the blocks of an MF4 file; the place in the file is its start again.

    Raises:
        UnreadableError: A list contains itself, or a record is larger than `MOST_RECORD_BYTES`.
    """
    seen: set[int] = set()
    waiting = [(_FIRST_BLOCK, False)]
    while waiting:
        place, is_signal_data = waiting.pop()
        kind, links = _block(file, place)
        if is_signal_data and kind in _OF_OTHERS:
            continue
        if kind in _SHARED:
            if kind == _CONVERSION:
                _check_conversion(file, place)
            continue
        if place in seen:
            raise UnreadableError(f"the list of block {kind[2:].decode()} at byte {place} contains itself")
        seen.add(place)
        if kind == _GROUP:
            _check_record(file, place, len(links))
        waiting += _owned(kind, links)
    file.seek(0)


def _owned(kind: bytes, links: tuple[int, ...]) -> Iterator[tuple[int, bool]]:
    places = _OWNED.get(kind, ())
    for number in range(len(links)) if places is None else places:
        if number < len(links) and links[number]:
            yield links[number], kind == _CHANNEL and number == _SIGNAL_DATA


def _block(file: BinaryIO, place: int) -> tuple[bytes, tuple[int, ...]]:
    """Return identifier and links of a block; no links where there is none."""
    file.seek(place)
    head = file.read(_HEAD.size)
    if len(head) < _HEAD.size:
        return b"", ()
    kind, _, count = _HEAD.unpack(head)
    if kind not in _OWNED and kind not in _SHARED:
        return kind, ()
    if count > _MOST_LINKS:
        raise UnreadableError(f"block {kind[2:].decode()} at byte {place} has {count:,} links")
    raw = file.read(count * _LINK_BYTES)
    return kind, struct.unpack(f"<{len(raw) // _LINK_BYTES}Q", raw[: len(raw) // _LINK_BYTES * _LINK_BYTES])


def _check_conversion(file: BinaryIO, place: int) -> None:
    """Check that a conversion does not contain itself."""
    path, waiting = set[int](), [(place, False)]
    while waiting:
        place, is_left = waiting.pop()
        if is_left:
            path.discard(place)
            continue
        kind, links = _block(file, place)
        if kind != _CONVERSION:
            continue
        if place in path:
            raise UnreadableError(f"the conversion at byte {place} contains itself")
        path.add(place)
        waiting += [(place, True), *((link, False) for link in links[3:] if link)]


def _check_record(file: BinaryIO, place: int, links: int) -> None:
    file.seek(place + _HEAD.size + links * _LINK_BYTES)
    raw = file.read(_GROUP_RECORD.size)
    if len(raw) < _GROUP_RECORD.size:
        return
    _, _, flags, _, _, data, invalidation = _GROUP_RECORD.unpack(raw)
    if data + invalidation > MOST_RECORD_BYTES and not flags & _IS_VARIABLE:
        raise UnreadableError(
            f"a record of the group at byte {place} has {data + invalidation:,} bytes, more than "
            f"{MOST_RECORD_BYTES:,}, the limit"
        )
