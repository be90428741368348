"""Logs of autopilots by their published formats; it shares no code with the program or its libraries.

ULog: docs.px4.io, "ULog File Format". DataFlash: ardupilot.org, "Onboard Message Log Format", and the
comments of `AP_Logger/LogStructure.h`.
"""

import struct
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

ULOG_TYPES = {"uint64_t": "Q", "float": "f", "double": "d", "int32_t": "i", "uint8_t": "B"}
DATAFLASH_TYPES = {"Q": "Q", "f": "f", "d": "d", "L": "i", "B": "B", "i": "i", "C": "H", "c": "h"}


@dataclass(frozen=True)
class Kind:
    """A kind of message: name, and type and name of each field; the first field is its time."""

    name: str
    fields: Sequence[tuple[str, str]]
    instance: int = 0


Message = tuple[int, Sequence[float]]
"""Number of its kind, and its numbers."""


def ulog(kinds: Sequence[Kind], messages: Iterable[Message], *, dropout_after: int | None = None) -> bytes:
    """Return a ULog file; a field `name[n]` takes n numbers."""
    content = b"\x55\x4c\x6f\x67\x01\x12\x35" + b"\x01" + struct.pack("<Q", 0)
    content += _ulog_message("B", bytes(40))
    for kind in {kind.name: kind for kind in kinds}.values():
        fields = "".join(_ulog_field(*each) for each in kind.fields)
        content += _ulog_message("F", f"{kind.name}:{fields}".encode())
    for number, kind in enumerate(kinds):
        content += _ulog_message("A", struct.pack("<BH", kind.instance, number) + kind.name.encode())
    for place, (number, values) in enumerate(messages):
        layout = "<H" + "".join(_ulog_layout(kind) for kind, _ in kinds[number].fields)
        content += _ulog_message("D", struct.pack(layout, number, *values))
        if place == dropout_after:
            content += _ulog_message("O", struct.pack("<H", 120))
    return content


def _ulog_field(kind: str, name: str) -> str:
    stem, _, count = kind.partition("[")
    return f"{stem}[{count} {name};" if count else f"{kind} {name};"


def _ulog_layout(kind: str) -> str:
    stem, _, count = kind.partition("[")
    return f"{count.rstrip(']')}{ULOG_TYPES[stem]}" if count else ULOG_TYPES[stem]


def _ulog_message(kind: str, payload: bytes) -> bytes:
    return struct.pack("<HB", len(payload), ord(kind)) + payload


def dataflash(kinds: Sequence[Kind], messages: Iterable[Message]) -> bytes:
    """Return a DataFlash file; the field `I` of a kind is its instance."""
    content = _format(0x80, 89, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns")
    content += _format(0x81, 3 + 8 + 1 + 16 + 16, "FMTU", "QBNN", "TimeUS,FmtType,UnitIds,MultIds")
    for number, kind in enumerate(kinds):
        letters = "".join(letter for letter, _ in kind.fields)
        size = 3 + struct.calcsize("<" + "".join(DATAFLASH_TYPES[letter] for letter in letters))
        content += _format(0x90 + number, size, kind.name, letters, ",".join(name for _, name in kind.fields))
        units = "".join("#" if name == "I" else "-" for _, name in kind.fields).encode()
        content += b"\xa3\x95\x81" + struct.pack("<QB16s16s", 0, 0x90 + number, units, b"-" * len(units))
    for number, values in messages:
        layout = "<" + "".join(DATAFLASH_TYPES[letter] for letter, _ in kinds[number].fields)
        whole = [
            round(value) if letter not in "fd" else value
            for (letter, _), value in zip(kinds[number].fields, values, strict=True)
        ]
        content += struct.pack("<BBB", 0xA3, 0x95, 0x90 + number) + struct.pack(layout, *whole)
    return content


def _format(number: int, length: int, name: str, letters: str, columns: str) -> bytes:
    body = struct.pack("<BB4s16s64s", number, length, name.encode(), letters.encode(), columns.encode())
    return b"\xa3\x95\x80" + body
