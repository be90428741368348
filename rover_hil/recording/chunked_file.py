"""An MCAP file in compressed chunks with an index, each closed when the caller wants.

Layout according to the specification of MCAP, version 0: https://mcap.dev/spec. The library's own writer
closes a chunk only when it is full, so that a killed run would lose it.
"""

import io
import struct
import zlib
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import BinaryIO

import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    ChunkIndex,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

from drivers.clock import NANOSECONDS_PER_SECOND
from drivers.files import CHUNK_BYTES as LARGEST_CHUNK_BYTES
from drivers.files import UNPACKED_BYTES, UNPACKED_PER_BYTE, UNPACKED_PIXELS, UNPACKED_PIXELS_PER_BYTE
from rover_hil.recording.mcap_records import HEAD, MAGIC

CHUNK_NS = 7 * NANOSECONDS_PER_SECOND // 10
"""Longest time in a chunk. With the time to write it, a kill loses less than a second."""
CHUNK_BYTES = 2**20
"""A chunk is closed before it is larger, unless one message is."""
COMPRESSION = "zstd"
# Fitted on logs of the shipped Robotino: 15 % smaller than level 3 in about the same time. Numbers in text
# have many short matches that cost more than they save, so that only longer ones are used.
PARAMETERS = zstandard.ZstdCompressionParameters(
    window_log=20, chain_log=17, hash_log=17, search_log=4, min_match=6, strategy=zstandard.STRATEGY_LAZY2
)

_MESSAGE = struct.Struct("<BQHIQQ")
_MESSAGE_BYTES = _MESSAGE.size - HEAD.size
_INDEX_ENTRY = struct.Struct("<QQ")
_INDEX_HEAD = struct.Struct("<BQHI")
_CHUNK = struct.Struct("<QQQI")
_FOOTER = struct.Struct("<BQQQ")
_FOOTER_BYTES = 20


@dataclass(slots=True)
class _Chunk:
    """Records that are not yet in the file; times in ns since 1970."""

    first_ns: int
    last_ns: int = 0
    pixels: int = 0
    content: bytearray = field(default_factory=bytearray)
    index: dict[int, bytearray] = field(default_factory=dict)

    def add(self, channel: int, time_ns: int, data: bytes) -> None:
        content = self.content
        entries = self.index.get(channel)
        if entries is None:
            entries = self.index[channel] = bytearray()
        entries += _INDEX_ENTRY.pack(time_ns, len(content))
        content += _MESSAGE.pack(Opcode.MESSAGE, _MESSAGE_BYTES + len(data), channel, 0, time_ns, time_ns)
        content += data
        self.first_ns = min(self.first_ns, time_ns)
        self.last_ns = max(self.last_ns, time_ns)


class ChunkedFile:
    """A file being written, by one thread.

    Every method that writes raises OSError when the file cannot be written; what was written before can then
    be read as after a crash.

    Args:
        stream: The file, empty; the caller closes it.
        library: Name of the program, for the header.
    """

    def __init__(self, stream: BinaryIO, library: str) -> None:
        self._stream = stream
        self._compressor = zstandard.ZstdCompressor(compression_params=PARAMETERS)
        self._place = 0
        self._checksum = 0
        self._schemas: list[Schema] = []
        self._channels: list[Channel] = []
        self._attachments: list[AttachmentIndex] = []
        self._metadata: list[MetadataIndex] = []
        self._unpacked_bytes = 0
        self._pixels = 0
        self._chunk_count = 0
        self._chunk_index = bytearray()  # as bytes: they are kept until the end, ten thousand in two hours
        self._first_ns = 0
        self._last_ns = 0
        self._counts: dict[int, int] = {}
        self._open: _Chunk | None = None
        self._put(MAGIC + _encode(Header("", library)))

    def add_metadata(self, name: str, values: dict[str, str]) -> None:
        """Write a metadata record."""
        record = _encode(Metadata(name=name, metadata=values))
        self._metadata.append(MetadataIndex(offset=self._place, length=len(record), name=name))
        self._put(record)

    def add_attachment(self, name: str, time_ns: int, data: bytes) -> None:
        """Write an attachment."""
        record = _encode(
            Attachment(create_time=time_ns, log_time=time_ns, name=name, media_type="", data=data)
        )
        self._attachments.append(
            AttachmentIndex(
                offset=self._place,
                length=len(record),
                create_time=time_ns,
                log_time=time_ns,
                data_size=len(data),
                name=name,
                media_type="",
            )
        )
        self._put(record)

    def add_channel(self, topic: str, schema_name: str, schema: bytes) -> int:
        """Return the number of a new channel for JSON; its records are written with its first message."""
        known = {record.name: record.id for record in self._schemas}
        schema_id = known.get(schema_name)
        if schema_id is None:
            schema_id = len(self._schemas) + 1
            self._schemas.append(Schema(id=schema_id, name=schema_name, encoding="jsonschema", data=schema))
        number = len(self._channels)
        self._channels.append(
            Channel(id=number, topic=topic, message_encoding="json", schema_id=schema_id, metadata={})
        )
        return number

    def add_message(self, channel: int, time_ns: int, data: bytes, pixels: int = 0) -> None:
        """Note a message; a chunk that has become long is written first.

        Args:
            channel: Number of its channel.
            time_ns: Since 1970.
            data: Its content.
            pixels: How many pixels the picture in it unpacks to.
        """
        chunk = self._open
        if chunk is not None and (
            time_ns - chunk.first_ns >= CHUNK_NS or len(chunk.content) + len(data) >= CHUNK_BYTES
        ):
            self.flush()
            chunk = None
        if chunk is None:
            chunk = self._open = _Chunk(time_ns)
        if channel not in self._counts:
            self._introduce(chunk, channel)
        chunk.add(channel, time_ns, data)
        chunk.pixels += pixels

    def flush(self) -> None:
        """Write what has been noted."""
        chunk, self._open = self._open, None
        if chunk is not None:
            self._put_chunk(chunk)
        self._stream.flush()

    def finish(self) -> None:
        """Write what has been noted, and the index."""
        self.flush()
        self._put_end()
        self._stream.flush()

    def _introduce(self, chunk: _Chunk, number: int) -> None:
        self._counts[number] = 0
        channel = self._channels[number]
        chunk.content += _encode(self._schemas[channel.schema_id - 1]) + _encode(channel)

    def _put_chunk(self, chunk: _Chunk) -> None:
        self._pixels += chunk.pixels
        if len(chunk.content) > LARGEST_CHUNK_BYTES:
            self._put(bytes(chunk.content))
            self._counts[next(iter(chunk.index))] += 1
            return
        compression, packed = self._pack(bytes(chunk.content))
        checksum = zlib.crc32(chunk.content)
        start = self._place
        size = len(chunk.content)
        name = compression.encode()
        head = (
            _CHUNK.pack(chunk.first_ns, chunk.last_ns, size, checksum) + struct.pack("<I", len(name)) + name
        )
        length = len(head) + 8 + len(packed)
        self._put(HEAD.pack(Opcode.CHUNK, length) + head + struct.pack("<Q", len(packed)) + packed)
        chunk_end = self._place
        offsets: dict[int, int] = {}
        for channel, entries in chunk.index.items():
            offsets[channel] = self._place
            self._counts[channel] += len(entries) // _INDEX_ENTRY.size
            self._put(
                _INDEX_HEAD.pack(Opcode.MESSAGE_INDEX, 6 + len(entries), channel, len(entries)) + entries
            )
        self._chunk_index += _encode(
            ChunkIndex(
                chunk_length=chunk_end - start,
                chunk_start_offset=start,
                compression=compression,
                compressed_size=len(packed),
                message_end_time=chunk.last_ns,
                message_index_length=self._place - chunk_end,
                message_index_offsets=offsets,
                message_start_time=chunk.first_ns,
                uncompressed_size=size,
            )
        )
        self._first_ns = min(self._first_ns, chunk.first_ns) if self._chunk_count else chunk.first_ns
        self._last_ns = max(self._last_ns, chunk.last_ns)
        self._chunk_count += 1

    def _pack(self, content: bytes) -> tuple[str, bytes]:
        """Return the name of the compression and the packed chunk, within what a reader unpacks.

        A device that repeats itself packs a thousand times. A chunk that would go beyond the limit is stored
        as it is: its size makes room for a hundred times as much.
        """
        packed = self._compressor.compress(content)
        self._unpacked_bytes += len(content)
        size_bytes = self._place + len(packed)
        if (
            self._unpacked_bytes > UNPACKED_BYTES + UNPACKED_PER_BYTE * size_bytes
            or self._pixels > UNPACKED_PIXELS + UNPACKED_PIXELS_PER_BYTE * size_bytes
        ):
            return "", content
        return COMPRESSION, packed

    def _put_end(self) -> None:
        self._put(HEAD.pack(Opcode.DATA_END, 4) + struct.pack("<I", self._checksum))
        start = self._place
        summary = io.BytesIO()
        offsets: list[SummaryOffset] = []
        groups = (
            (Opcode.SCHEMA, _encode_all(self._schemas)),
            (Opcode.CHANNEL, _encode_all(self._channels)),
            (Opcode.STATISTICS, _encode(self._statistics())),
            (Opcode.CHUNK_INDEX, self._chunk_index),
            (Opcode.ATTACHMENT_INDEX, _encode_all(self._attachments)),
            (Opcode.METADATA_INDEX, _encode_all(self._metadata)),
        )
        for opcode, records in groups:
            begin = summary.tell()
            summary.write(records)
            if summary.tell() > begin:
                offsets.append(
                    SummaryOffset(
                        group_opcode=opcode, group_start=start + begin, group_length=summary.tell() - begin
                    )
                )
        offsets_start = start + summary.tell()
        for offset in offsets:
            summary.write(_encode(offset))
        summary.write(_FOOTER.pack(Opcode.FOOTER, _FOOTER_BYTES, start, offsets_start))
        checksum = zlib.crc32(summary.getvalue())
        self._put(summary.getvalue() + struct.pack("<I", checksum) + MAGIC)

    def _statistics(self) -> Statistics:
        return Statistics(
            attachment_count=len(self._attachments),
            channel_count=len(self._channels),
            channel_message_counts=self._counts,
            chunk_count=self._chunk_count,
            message_count=sum(self._counts.values()),
            message_end_time=self._last_ns,
            message_start_time=self._first_ns,
            metadata_count=len(self._metadata),
            schema_count=len(self._schemas),
        )

    def _put(self, data: bytes) -> None:
        self._stream.write(data)
        self._place += len(data)
        self._checksum = zlib.crc32(data, self._checksum)


def _encode(record: McapRecord) -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    content: bytes = builder.end()  # type: ignore[no-untyped-call]
    return content


def _encode_all(records: Iterable[McapRecord]) -> bytes:
    return b"".join(map(_encode, records))
