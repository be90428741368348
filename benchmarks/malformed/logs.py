"""Malformed logs: a real small log, changed at the level of bytes, records, chunks, JSON and values."""

import base64
import json
import random
import struct
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TypeAlias

import lz4.frame
import zstandard
from mcap.opcode import Opcode

from benchmarks.malformed.values import change_somewhere, raw_json
from rover_hil.config import Config, load_config
from rover_hil.recording.mcap_records import HEAD, MAGIC, MESSAGE_HEAD
from rover_hil.recording.reader import LogReader
from rover_hil.recording.schema import LOG_SCHEMA, VIEW
from rover_hil.run.driving import run_virtual

RUN_S = 1.6
BOMB_BYTES = 3_200_000_000


@dataclass(frozen=True)
class LogParts:
    """What a log holds: its metadata, its attachments by name, and its messages."""

    metadata: Mapping[str, str]
    attachments: Mapping[str, bytes]
    messages: tuple[tuple[str, int, bytes], ...]

    def config(self) -> dict[str, object]:
        """Return the configuration as a table."""
        table: dict[str, object] = json.loads(self.attachments["config.json"])
        return table

    def with_config(self, config: object) -> "LogParts":
        """Return the log with another configuration, a table or the bytes of one."""
        text = config if isinstance(config, bytes) else json.dumps(config).encode()
        return replace(self, attachments={**self.attachments, "config.json": text})

    def with_message(self, topic: str, data: bytes, place: int = 50) -> "LogParts":
        """Return the log with one more message, or where the topic is there, with its first one replaced."""
        for index, (known, t_ns, _) in enumerate(self.messages):
            if known == topic:
                return self._with(index, (topic, t_ns, data))
        first, after = self.messages[:place], self.messages[place:]
        return replace(self, messages=(*first, (topic, after[0][1], data), *after))

    def _with(self, index: int, message: tuple[str, int, bytes]) -> "LogParts":
        return replace(self, messages=(*self.messages[:index], message, *self.messages[index + 1 :]))


DEEP = b"[" * 200_000 + b"]" * 200_000


def write_base_log(name: str, path: Path) -> Path:
    """Drive a shipped rover for a moment on simulated time; return the log."""
    table = load_config(name).model_dump(by_alias=True)
    table["safety"]["settle_s"] = 0.5
    run_virtual(Config.model_validate(table), path, RUN_S, None)
    return path


def read_parts(path: Path) -> LogParts:
    log = LogReader(path)
    messages = tuple(
        (message.topic, message.t_ns, message.data)
        for message in log.stored_messages()
        if not message.topic.startswith(VIEW)
    )
    metadata = {
        "schema": LOG_SCHEMA,
        "start_ns": str(log.start_ns),
        "origin": log.origin,
        "wall_offset_ns": "0",
    }
    return LogParts(metadata, dict(log.attachments), messages)


def encode(parts: LogParts, compression: str | None = None) -> bytes:
    """Return the file; its messages in one chunk where a compression is named."""
    topics = {topic: number for number, topic in enumerate(dict.fromkeys(t for t, _, _ in parts.messages))}
    channels = b"".join(
        record(Opcode.CHANNEL, struct.pack("<HH", number, 0) + text(topic) + text("json") + bytes(4))
        for topic, number in topics.items()
    )
    messages = b"".join(
        record(Opcode.MESSAGE, MESSAGE_HEAD.pack(topics[topic], 0, t_ns % 2**64, t_ns % 2**64) + data)
        for topic, t_ns, data in parts.messages
    )
    head = MAGIC + record(Opcode.HEADER, text("") + text("malformed"))
    head += record(Opcode.METADATA, text("rover_hil") + mapping(parts.metadata))
    for name, data in parts.attachments.items():
        content = bytes(16) + text(name) + text("") + struct.pack("<Q", len(data)) + data + bytes(4)
        head += record(Opcode.ATTACHMENT, content)
    body = channels + messages
    if compression is not None:
        body = chunk(compression, len(body), pack(compression, body))
    return head + body + record(Opcode.DATA_END, bytes(4))


Named: TypeAlias = tuple[str, Callable[[], bytes]]


def record(opcode: int, content: bytes) -> bytes:
    return HEAD.pack(opcode, len(content)) + content


DATA_END = record(Opcode.DATA_END, bytes(4))


def text(value: str) -> bytes:
    return struct.pack("<I", len(value.encode())) + value.encode()


def mapping(table: Mapping[str, str]) -> bytes:
    content = b"".join(text(key) + text(value) for key, value in table.items())
    return struct.pack("<I", len(content)) + content


def chunk(compression: str, size_bytes: int, packed: bytes) -> bytes:
    content = struct.pack("<QQQI", 0, 0, size_bytes, 0) + text(compression)
    return record(Opcode.CHUNK, content + struct.pack("<Q", len(packed)) + packed)


def pack(compression: str, data: bytes) -> bytes:
    if compression == "zstd":
        return zstandard.ZstdCompressor().compress(data)
    return bytes(lz4.frame.compress(data)) if compression == "lz4" else data


def bomb(compression: str, size_bytes: int) -> bytes:
    """Return a small packed text of that many zeros."""
    if compression == "lz4":
        compressor = lz4.frame.LZ4FrameCompressor()
        parts = [compressor.begin(), *(compressor.compress(bytes(2**24)) for _ in range(size_bytes >> 24))]
        return b"".join([*parts, compressor.flush()])
    packer = zstandard.ZstdCompressor(level=1).compressobj()
    return b"".join([*(packer.compress(bytes(2**24)) for _ in range(size_bytes >> 24)), packer.flush()])


def named_logs(parts: LogParts, device: str) -> Iterator[Named]:
    """Yield each hand-made log with its name.

    Args:
        parts: A real log.
        device: The one of its devices that turns the wheels.
    """
    yield from _messages(parts, device)
    yield from _times(parts)
    yield from _heads(parts, device)
    yield from _chunks(parts)
    yield from _records(parts)
    yield from _payloads(parts, device)


def _with_message(parts: LogParts, topic: str, data: bytes) -> bytes:
    return encode(parts.with_message(topic, data))


def _messages(parts: LogParts, device: str) -> Iterator[Named]:
    for name, data in {
        "no_keys": b"{}",
        "a_list": b"[]",
        "a_number": b"1",
        "deep": DEEP,
        "deep_tables": b'{"a":' * 100_000 + b"1" + b"}" * 100_000,
        "not_text": b"\xff\xfe\x00",
        "empty": b"",
        "million_numbers": b"[" + b"1," * 999_999 + b"1]",
        "huge_number": b'{"t_ns":' + b"9" * 4000 + b"}",
        "9_mb": b'{"a":"' + b"x" * 9_000_000 + b'"}',
    }.items():
        for topic in (f"/link/{device}", "/samples", "/estimate", "/command", "/truth", "/health", "/end"):
            yield f"{name}_on_{topic[1:].replace('/', '_')}", partial(_with_message, parts, topic, data)
    million = b'{"WheelSample":[' + b"1," * 900_000 + b"1]}"
    yield "million_wrong_samples", partial(_with_message, parts, "/samples", million)
    for topic in ("", "/", "/raw/", "/raw/ghost", "/link/ghost", "//", "x" * 190, "/raw/" + "\x1b[31m" * 20):
        yield f"topic_{len(topic)}_{topic[1:5].strip('/')}", partial(_with_message, parts, topic, b"{}")
    yield "topic_of_a_megabyte", partial(_with_message, parts, "/" + "t" * 1_000_000, b"{}")


def _times(parts: LogParts) -> Iterator[Named]:
    honest = [t_ns for _, t_ns, _ in parts.messages]
    count = len(honest)
    for name, times in {
        "reversed": honest[::-1],
        "same": [honest[count // 2]] * count,
        "zero": [0] * count,
        "latest": [2**62] * count,
        "beyond": [2**64 - 1] * count,
        "far_apart": [t_ns + number * 10**15 for number, t_ns in enumerate(honest)],
    }.items():
        messages = tuple(
            (topic, t_ns, data) for t_ns, (topic, _, data) in zip(times, parts.messages, strict=True)
        )
        yield f"times_{name}", partial(encode, replace(parts, messages=messages))
    yield "repeated_100_times", partial(encode, replace(parts, messages=parts.messages[:400] * 100))


def _heads(parts: LogParts, device: str) -> Iterator[Named]:
    for start in ("", "x", "-5", "9" * 30, "9" * 5000, "1e9", "\u0661", str(2**62)):
        metadata = {**parts.metadata, "start_ns": start}
        yield f"start_{start[:5]}_{len(start)}", partial(encode, replace(parts, metadata=metadata))
    yield "no_metadata", partial(encode, replace(parts, metadata={}))
    long_origin = {**parts.metadata, "origin": "o\x1b" * 10**6}
    yield "long_origin", partial(encode, replace(parts, metadata=long_origin))
    for key in ("max_age_s", "port", "type", "calibration", "mapping", "bit_rate", "../../../tmp/x"):
        extra = {f"data/{device}/{key}/x.toml": b"9999999"}
        changed = replace(parts, attachments={**parts.attachments, **extra})
        yield f"attachment_sets_{Path(key).name}", partial(encode, changed)
    for name in (f"data/{device}/mapping/..", f"data/{device}/mapping/" + "n" * 5000, "data/\0/a/b"):
        changed = replace(parts, attachments={name: b"x", **parts.attachments})
        yield f"attachment_name_{len(name)}", partial(encode, changed)
    big = {f"data/{device}/mapping/{number}": bytes(2**20) for number in range(40)}
    yield "40_mb_attached", partial(encode, replace(parts, attachments={**big, **parts.attachments}))
    without = {"config.json": parts.attachments["config.json"]}
    yield "no_data_files", partial(encode, replace(parts, attachments=without))
    for name, config in {
        "empty": b"",
        "list": b"[]",
        "deep": DEEP,
        "not_text": b"\xff",
        "repeated": b"{" + b'"a":1,' * 100_000 + b'"a":1}',
    }.items():
        yield f"config_{name}", partial(encode, parts.with_config(config))


def _chunks(parts: LogParts) -> Iterator[Named]:
    for compression in ("zstd", "lz4", "", "snappy"):
        yield f"chunk_{compression or 'plain'}", partial(encode, parts, compression)
    for compression in ("zstd", "lz4"):
        yield f"bomb_{compression}", partial(_with_bombs, parts, compression, BOMB_BYTES, 1)
        yield f"many_bombs_{compression}", partial(_with_bombs, parts, compression, 2**24, 200)
        yield f"million_messages_{compression}", partial(_with_many_messages, parts, compression)


def _payloads(parts: LogParts, device: str) -> Iterator[Named]:
    item = b'{"device":"%s","kind":"received","t_ns":1,"hex":"%s"}'
    for name, data in {
        "no_hexadecimal": b'{"payloads":[' + item % (device.encode(), b"xx") + b"]}",
        "a_ghost": b'{"payloads":[' + item % (b"ghost", b"00") + b"]}",
        "million_wrong": b'{"payloads":[' + b"1," * 900_000 + b"1]}",
        "many": b'{"payloads":[' + b",".join([item % (device.encode(), b"00")] * 30_000) + b"]}",
        "deep": DEEP,
    }.items():
        yield f"payloads_{name}", partial(_with_message, parts, "/bytes", data)
    for name, picture in {"bomb": png_bomb(30_000), "black": png_bomb(8000), "nothing": b""}.items():
        record = {
            "timestamp": {"sec": 0, "nsec": 0},
            "frame_id": "camera",
            "data": base64.b64encode(picture).decode(),
            "format": "png",
            "t_capture_ns": None,
        }
        data = json.dumps(record).encode()
        yield f"picture_{name}", partial(_with_message, parts, "/camera/camera", data)
        many = (("/camera/camera", parts.messages[-1][1], data),) * 60
        more = replace(parts, messages=parts.messages + many)
        yield f"pictures_{name}", partial(encode, more, "zstd")
    for offset in ("", "x", "-9", "9" * 30):
        changed = replace(parts, metadata={**parts.metadata, "wall_offset_ns": offset})
        yield f"offset_{offset[:2]}", partial(encode, changed)


def _with_bombs(parts: LogParts, compression: str, size_bytes: int, count: int) -> bytes:
    whole = encode(parts)[: -len(DATA_END)]
    return whole + chunk(compression, size_bytes, bomb(compression, size_bytes)) * count


def _with_many_messages(parts: LogParts, compression: str) -> bytes:
    t_ns = parts.messages[-1][1]
    small = record(Opcode.MESSAGE, MESSAGE_HEAD.pack(0, 0, t_ns, t_ns) + b"{}")
    many = small * (31_000_000 // len(small))
    return encode(parts)[: -len(DATA_END)] + chunk(compression, len(many), pack(compression, many))


def _records(parts: LogParts) -> Iterator[Named]:
    whole = encode(parts)
    for opcode in (*range(16), 0x80, 0xFF):
        for length in (0, 3, 2**31, 2**63, 2**64 - 1):
            yield f"record_{opcode}_{length:x}", partial(_with_head, whole, HEAD.pack(opcode, length))


def _with_head(whole: bytes, head: bytes) -> bytes:
    return whole[:2000] + head + whole[2000:]


def bitmap_head(width: int, height: int) -> bytes:
    return struct.pack("<2sIHHIIiiHHIIiiII", b"BM", 0, 0, 0, 54, 40, width, height, 1, 24, 0, 0, 0, 0, 0, 0)


def png_bomb(side: int) -> bytes:
    """Return a small PNG of one colour with side x side pixels."""
    import zlib

    def part(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    packer = zlib.compressobj(9)
    row = bytes(1 + side)
    data = b"".join([*(packer.compress(row) for _ in range(side)), packer.flush()])
    head = struct.pack(">IIBBBBB", side, side, 8, 0, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + part(b"IHDR", head) + part(b"IDAT", data) + part(b"IEND", b"")


def random_log(parts: LogParts, generator: random.Random) -> bytes:
    """Return a log with random damage of one kind."""
    kind = generator.choice(("bytes", "cut", "json", "json", "json", "config", "config", "order", "drop"))
    whole = bytearray(encode(parts, generator.choice((None, None, "zstd", "lz4"))))
    if kind == "bytes":
        for _ in range(generator.choice((1, 3, 30))):
            whole[generator.randrange(len(whole))] ^= 1 << generator.randrange(8)
        return bytes(whole)
    if kind == "cut":
        start, length = generator.randrange(len(whole)), generator.choice((1, 100, 10_000))
        return bytes(whole[:start] + (whole[start + length :] if generator.random() < 0.5 else b""))
    if kind == "config":
        return encode(parts.with_config(raw_json(change_somewhere(parts.config(), generator))))
    messages = list(parts.messages)
    if kind == "order":
        generator.shuffle(messages)
    elif kind == "drop":
        topic = generator.choice(messages)[0]
        messages = [message for message in messages if message[0] != topic or generator.random() < 0.3]
    else:
        for _ in range(generator.choice((1, 5, 100))):
            _change_message(messages, generator)
    return encode(replace(parts, messages=tuple(messages)))


def _change_message(messages: list[tuple[str, int, bytes]], generator: random.Random) -> None:
    topic = generator.choice(sorted({topic for topic, _, data in messages if data[:1] in (b"{", b"[")}))
    index = generator.choice([index for index, message in enumerate(messages) if message[0] == topic])
    _, t_ns, data = messages[index]
    try:
        value = json.loads(data)
    except (ValueError, RecursionError):
        return
    messages[index] = (topic, t_ns, raw_json(change_somewhere(value, generator)))
