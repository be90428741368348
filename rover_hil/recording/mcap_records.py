"""Records of an MCAP file in the order of writing, whoever wrote it, within the limits of `drivers.files`."""

import io
import struct
import zlib
from collections.abc import Callable, Iterator
from typing import BinaryIO

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, DataEnd, Message, Metadata

from drivers.files import CHUNK_BYTES, MEGABYTE, RECORD_BYTES, UNPACKED_BYTES, UNPACKED_PER_BYTE

MAGIC = b"\x89MCAP0\r\n"
HEAD = struct.Struct("<BQ")
MESSAGE_HEAD = struct.Struct("<HIQQ")

Record = Attachment | Channel | DataEnd | Message | Metadata


class DamagedRecordError(ValueError):
    """A record is not as the format demands; the message says what is wrong with it."""


def read_records(stream: BinaryIO, size_bytes: int) -> Iterator[Record]:
    """Yield the records that a log needs, up to and with the end of its data.

    The iterator ends without the end of the data where the file was cut off.

    Args:
        stream: The file, at its beginning.
        size_bytes: Its size.

    Raises:
        DamagedRecordError: A record or a checksum is wrong, or more than the limits allow.
    """
    magic = stream.read(len(MAGIC))
    if magic != MAGIC:
        raise DamagedRecordError("it does not begin as one")
    checksum = zlib.crc32(magic)
    unpacked_bytes = 0
    while len(head := stream.read(HEAD.size)) == HEAD.size:
        opcode, length = HEAD.unpack(head)
        if length > RECORD_BYTES:
            raise DamagedRecordError(f"a record of {length} bytes")
        if length > size_bytes - stream.tell():
            return
        content = stream.read(length)
        if opcode == Opcode.CHUNK:
            data = _unpack(content)
            unpacked_bytes += len(data)
            if unpacked_bytes > UNPACKED_BYTES + UNPACKED_PER_BYTE * size_bytes:
                raise DamagedRecordError(
                    f"its compressed parts hold more than {UNPACKED_PER_BYTE} times the size of the file"
                )
            yield from _records_in(data)
        elif (record := _parse(opcode, content)) is not None:
            if isinstance(record, DataEnd) and record.data_section_crc not in (0, checksum):
                raise DamagedRecordError("its checksum does not match its content")
            yield record
            if isinstance(record, DataEnd):
                return
        checksum = zlib.crc32(content, zlib.crc32(head, checksum))


_READERS: dict[int, Callable[[ReadDataStream], Record]] = {
    Opcode.ATTACHMENT: Attachment.read,
    Opcode.CHANNEL: Channel.read,
    Opcode.DATA_END: DataEnd.read,
    Opcode.METADATA: Metadata.read,
}
_NOT_SOUND = (McapError, struct.error, UnicodeDecodeError, OverflowError)


def _parse(opcode: int, content: bytes) -> Record | None:
    """Return a record; None for one of a kind that a log does not need.

    Raises:
        DamagedRecordError: Its content is not that of its kind.
    """
    if opcode == Opcode.MESSAGE:
        if len(content) < MESSAGE_HEAD.size:
            raise DamagedRecordError("a message without a head")
        channel, sequence, log_time, publish_time = MESSAGE_HEAD.unpack_from(content)
        return Message(channel, log_time, content[MESSAGE_HEAD.size :], publish_time, sequence)
    if opcode not in _READERS:
        return None
    try:
        return _READERS[opcode](ReadDataStream(io.BytesIO(content)))
    except _NOT_SOUND as error:
        raise DamagedRecordError(f"a {Opcode(opcode).name.lower()} record is not sound") from error


def _unpack(content: bytes) -> bytes:
    """Return the records in a chunk, unpacked.

    Raises:
        DamagedRecordError: They cannot be unpacked, have another checksum, or are more than `CHUNK_BYTES`.
    """
    try:
        chunk = Chunk.read(ReadDataStream(io.BytesIO(content)))
        data = UNPACKERS[chunk.compression](chunk.data)
    except KeyError:
        raise DamagedRecordError("a compressed part is neither lz4 nor zstd") from None
    except (*_NOT_SOUND, RuntimeError, EOFError, zstandard.ZstdError) as error:
        raise DamagedRecordError("a compressed part cannot be unpacked") from error
    if len(data) > CHUNK_BYTES:
        limit = f"{CHUNK_BYTES / MEGABYTE:g} MB"
        raise DamagedRecordError(f"a compressed part holds more than {limit}, the limit")
    if chunk.uncompressed_crc not in (0, zlib.crc32(data)):
        raise DamagedRecordError("its checksum does not match its content")
    return data


def _unpack_zstd(data: bytes) -> bytes:
    decompressor = zstandard.ZstdDecompressor(max_window_size=CHUNK_BYTES)
    return decompressor.stream_reader(data).read(CHUNK_BYTES + 1)


def _unpack_lz4(data: bytes) -> bytes:
    return bytes(lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=CHUNK_BYTES + 1))


UNPACKERS: dict[str, Callable[[bytes], bytes]] = {"": bytes, "zstd": _unpack_zstd, "lz4": _unpack_lz4}


def _records_in(data: bytes) -> Iterator[Record]:
    place = 0
    while place < len(data):
        if len(data) - place < HEAD.size:
            raise DamagedRecordError("a record in a compressed part is cut off")
        opcode, length = HEAD.unpack_from(data, place)
        place += HEAD.size
        if length > len(data) - place:
            raise DamagedRecordError("a record in a compressed part is cut off")
        record = _parse(opcode, data[place : place + length])
        if isinstance(record, Channel | Message):
            yield record
        place += length
