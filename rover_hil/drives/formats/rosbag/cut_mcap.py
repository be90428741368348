"""Read an MCAP file without its end, as a killed recorder leaves it: all records that are intact.

Layout of the records: the MCAP specification, mcap.dev/spec. The other files are read by the library, which
needs the end.
"""

import struct
from collections.abc import Collection, Iterator
from operator import itemgetter
from pathlib import Path
from typing import BinaryIO, NamedTuple

from mcap.opcode import Opcode

from drivers.files import CHUNK_BYTES, RECORD_BYTES
from rover_hil.drives.files.unreadable import UnreadableError
from rover_hil.recording.mcap_records import HEAD, MAGIC, MESSAGE_HEAD, UNPACKERS

GROUP = 1000
"""So many messages that are in no chunk are put in order at once; those of a chunk are."""
_CHUNK_HEAD = struct.Struct("<QQQI")


class CutConnection(NamedTuple):
    """A channel, with the attributes of a connection of the library that are used."""

    id: int
    topic: str
    msgtype: str


_Message = tuple[CutConnection, int, bytes]
"""As the library gives them: connection, time of recording and data."""


class CutMcap:
    """An MCAP file without its end; the same questions as to the reader of the library.

    Args:
        path: The file.

    Attributes:
        connections: Of the intact part; there after `open`.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self.connections: list[CutConnection] = []

    def open(self) -> None:
        """Find the connections.

        Raises:
            UnreadableError: There is none.
        """
        schemas: dict[int, str] = {}
        channels: dict[int, CutConnection] = {}
        for group in self._groups({Opcode.SCHEMA, Opcode.CHANNEL}):
            for kind, content in group:
                (number,) = struct.unpack_from("<H", content)
                if kind == Opcode.SCHEMA:
                    schemas[number] = _text(content, 2)
                else:
                    (schema,) = struct.unpack_from("<H", content, 2)
                    channels[number] = CutConnection(number, _text(content, 4), schemas.get(schema, ""))
        self.connections = list(channels.values())
        if not channels:
            raise UnreadableError("nothing ahead of where it was cut is whole")

    def close(self) -> None:
        """Do nothing: the file is only open while it is read."""

    def messages(self, connections: Collection[CutConnection]) -> Iterator[_Message]:
        """Yield messages in the order of their times, as far as neighbouring chunks are out of order."""
        wanted = {connection.id: connection for connection in connections}
        waiting: list[_Message] = []
        for group in self._groups({Opcode.MESSAGE}):
            messages: list[_Message] = []
            for _, content in group:
                channel, _, t_ns, _ = MESSAGE_HEAD.unpack_from(content)
                if channel in wanted:
                    messages.append((wanted[channel], t_ns, content[MESSAGE_HEAD.size :]))
            if not messages:
                continue
            first_ns = min(map(itemgetter(1), messages))
            waiting.sort(key=itemgetter(1))
            yield from (message for message in waiting if message[1] <= first_ns)
            waiting = [message for message in waiting if message[1] > first_ns] + messages
        yield from sorted(waiting, key=itemgetter(1))

    def _groups(self, kinds: Collection[int]) -> Iterator[list[tuple[int, bytes]]]:
        """Yield the intact records of some kinds, those of a chunk together."""
        loose: list[tuple[int, bytes]] = []
        with self._path.open("rb") as stream:
            for kind, content in _file_records(stream):
                if kind == Opcode.CHUNK:
                    if loose:
                        yield loose
                        loose = []
                    yield [record for record in _records_in(_unpacked(content)) if record[0] in kinds]
                elif kind in kinds:
                    loose.append((kind, content))
                    if len(loose) >= GROUP:
                        yield loose
                        loose = []
        if loose:
            yield loose


def is_cut(path: Path) -> bool:
    """Return whether a file begins like an MCAP file, but does not end like one."""
    with path.open("rb") as stream:
        begins = stream.read(len(MAGIC)) == MAGIC
        size = stream.seek(0, 2)
        stream.seek(max(len(MAGIC), size - len(MAGIC)))
        return begins and stream.read() != MAGIC


def _file_records(stream: BinaryIO) -> Iterator[tuple[int, bytes]]:
    """Yield kind and content of the records of a file; of the last one what is there of a chunk."""
    stream.seek(len(MAGIC))
    while len(head := stream.read(HEAD.size)) == HEAD.size:
        kind, length = HEAD.unpack(head)
        if length > RECORD_BYTES:
            return
        content = stream.read(length)
        if len(content) == length or kind == Opcode.CHUNK:
            yield kind, content


def _records_in(data: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield the whole records in a chunk."""
    place = 0
    while place + HEAD.size <= len(data):
        kind, length = HEAD.unpack_from(data, place)
        place += HEAD.size
        if place + length > len(data):
            return
        yield kind, data[place : place + length]
        place += length


def _unpacked(content: bytes) -> bytes:
    """Return what a chunk holds, as far as it is there.

    Raises:
        UnreadableError: It cannot be unpacked, or is larger than the limit.
    """
    place = _CHUNK_HEAD.size + 4
    if len(content) < place:
        return b""
    compression = _text(content, _CHUNK_HEAD.size)
    place += len(compression) + 8
    if len(content) <= place:
        return b""
    if compression not in UNPACKERS:
        raise UnreadableError("its chunks are neither lz4 nor zstd")
    try:
        data = UNPACKERS[compression](content[place:])
    # The libraries raise whatever a damaged part makes them stumble over.
    except Exception as problem:
        raise UnreadableError("a chunk cannot be unpacked") from problem
    if len(data) > CHUNK_BYTES:
        raise UnreadableError("a chunk is larger than the limit unpacked")
    return data


def _text(content: bytes, place: int) -> str:
    (length,) = struct.unpack_from("<I", content, place)
    return content[place + 4 : place + 4 + length].decode("utf-8", "replace")
