"""Check, before a ULog is read, that its formats do not expand to more than any log has."""

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import TypeAlias

from drivers.files import NESTING
from rover_hil.drives.files.unreadable import UnreadableError

MOST_FIELDS = 200_000
"""Of all messages that a log announces; a log of PX4 has about 10,000."""
MOST_EMPTY = 10_000
"""Messages without content, which no logger writes."""
CHECKED_MESSAGES = 100_000
"""Formats are at the start of a log; the rest takes too long to look at twice."""
_HEADER_BYTES = 16
_HEADER = struct.Struct("<HB")
_FORMAT, _ADDED = ord("F"), ord("A")
_FIRST_NAME_BYTE = 3
"""Of the message that announces others."""

_Fields: TypeAlias = list[tuple[str, int]]
"""Type and number of each field of a format."""


def check_formats(path: Path) -> None:
    """Check the first messages of a ULog.

    Raises:
        UnreadableError: They expand to too many fields, contain themselves, or are empty.
    """
    formats: dict[str, _Fields] = {}
    sizes: dict[str, int] = {}
    fields = empty = 0
    for kind, content in _messages(path):
        empty += len(content) < 2
        if empty > MOST_EMPTY:
            raise UnreadableError(f"more than {MOST_EMPTY:,} of its messages are empty")
        if kind == _FORMAT:
            name, _, text = content.decode("utf-8", "ignore").partition(":")
            formats[name] = [_field(each) for each in text.split(";") if each]
        elif kind == _ADDED:
            name = content[_FIRST_NAME_BYTE:].decode("utf-8", "ignore")
            fields += _size(name, formats, sizes, NESTING)
            if fields > MOST_FIELDS:
                raise UnreadableError(f"its messages have more than {MOST_FIELDS:,} fields, the limit")


def _messages(path: Path) -> Iterator[tuple[int, bytes]]:
    with path.open("rb") as file:
        file.seek(_HEADER_BYTES)
        for _ in range(CHECKED_MESSAGES):
            header = file.read(_HEADER.size)
            if len(header) < _HEADER.size:
                return
            size, kind = _HEADER.unpack(header)
            yield kind, file.read(size)


def _field(text: str) -> tuple[str, int]:
    kind, _, count = text.partition(" ")[0].partition("[")
    digits = count.partition("]")[0]
    return kind, int(digits) if digits.isdecimal() else 1


def _size(name: str, formats: dict[str, _Fields], sizes: dict[str, int], levels: int) -> int:
    """Return the number of fields of a format with those of the formats in it, at most beyond the limit."""
    if levels == 0:
        raise UnreadableError(f"its formats are nested deeper than {NESTING} levels")
    if name not in sizes:
        total = 0
        for kind, count in formats.get(name, ()):
            inner = _size(kind, formats, sizes, levels - 1) if kind in formats else 1
            total = min(total + count * inner, MOST_FIELDS + 1)
        sizes[name] = total
    return sizes[name]
