"""Malformed files for `rover-hil import`: sound ones of every format, mutated, and such as take a machine.

Everything is made by code; the files are small, or sparse in what they take to make.
"""

import gzip
import io
import random
import re
import sqlite3
import struct
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from functools import cache, partial
from pathlib import Path

import numpy as np
import zstandard
from rosbags.rosbag2 import StoragePlugin
from scipy.io import savemat

from benchmarks.datasets.bad_files import Bad, bus_log
from benchmarks.malformed.tables import honest_tables
from tests.rover_hil.flight_logs import Kind, dataflash, ulog
from tests.rover_hil.test_import_rosbag import write_bag

ROWS = 400
NESTED = 40
CELL_BYTES = 2**31 - 1
RECORD_BYTES = 2**31
METADATA_BYTES = 16 * 2**20
TOPICS = 1_000_000
GUESSED_COLUMNS = 300_000
EMPTY_MESSAGES = 10_000_000
PX4 = (
    Kind("WENC", (("uint64_t", "timestamp"), ("float", "Dist0"), ("float", "Dist1"))),
    Kind("other", (("uint64_t", "timestamp"), ("float[3]", "x"))),
)
ARDUPILOT = (Kind("WENC", (("Q", "TimeUS"), ("f", "Dist0"), ("f", "Dist1"))),)


def of_bytes(name: str, kind: str, file_name: str, make: Callable[[], bytes]) -> Bad:
    """Return a file with given content."""

    def write(folder: Path) -> Path:
        path = folder / file_name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(make())
        return path

    return Bad(name, kind, write)


# Files that take the machine.


def nested_ulog(levels: int = NESTED) -> bytes:
    """Return a ULog whose formats hold the next one twice: 2^levels fields."""
    names = ["WENC", *(f"n{level}" for level in range(1, levels))]
    kinds = [
        Kind(name, ((inner, "a"), (inner, "b")))
        for name, inner in zip(names, [*names[1:], "last"], strict=True)
    ]
    text = ulog([*kinds, Kind("last", (("uint64_t", "timestamp"),))], [])
    announced = text.index(b"A\0\0\0WENC")
    return text[: announced + 8]


def empty_ulog(count: int = EMPTY_MESSAGES, size: int = 0) -> bytes:
    """Return a ULog that holds headers of messages without content."""
    return ulog((), []) + (struct.pack("<HB", size, ord("I")) + bytes(size)) * count


def _varint(value: int) -> bytes:
    parts = bytearray()
    while value > 127:
        parts.append(value & 127 | 128)
        value >>= 7
    return bytes([*parts, value])


def _number(value: int) -> bytes:
    return _varint(value * 2)


def _thrift(*fields: tuple[int, int, bytes]) -> bytes:
    """Return a struct of Thrift's compact protocol: number, type and content of each field."""
    content, last = b"", 0
    for number, kind, raw in fields:
        content += bytes([(number - last) << 4 | kind]) + raw
        last = number
    return content + b"\0"


def _text(value: bytes) -> bytes:
    return _varint(len(value)) + value


def _thrift_list(kind: int, parts: Sequence[bytes]) -> bytes:
    return bytes([len(parts) << 4 | kind]) + b"".join(parts)


def parquet_cell(size: int = CELL_BYTES) -> bytes:
    """Return a Parquet file with one cell, a text of that many zeros, packed by zstd."""
    i32, i64, binary, list_, struct_ = 5, 6, 8, 9, 12
    unpacked = 4 + size
    packer = zstandard.ZstdCompressor(level=1).compressobj()
    parts = [packer.compress(struct.pack("<I", size))]
    parts += [packer.compress(bytes(min(2**24, size - start))) for start in range(0, size, 2**24)]
    packed = b"".join([*parts, packer.flush()])
    head = _thrift(
        (1, i32, _number(0)),
        (2, i32, _number(unpacked)),
        (3, i32, _number(len(packed))),
        (5, struct_, _thrift(*[(n, i32, _number(v)) for n, v in ((1, 1), (2, 0), (3, 3), (4, 3))])),
    )
    column = _thrift(
        (1, i32, _number(6)),
        (2, list_, _thrift_list(i32, [_number(0)])),
        (3, list_, _thrift_list(binary, [_text(b"t")])),
        (4, i32, _number(6)),
        (5, i64, _number(1)),
        (6, i64, _number(unpacked + len(head))),
        (7, i64, _number(len(packed) + len(head))),
        (9, i64, _number(4)),
    )
    group = _thrift(
        (1, list_, _thrift_list(struct_, [_thrift((2, i64, _number(4)), (3, struct_, column))])),
        (2, i64, _number(unpacked + len(head))),
        (3, i64, _number(1)),
    )
    schema = [
        _thrift((4, binary, _text(b"schema")), (5, i32, _number(1))),
        _thrift((1, i32, _number(6)), (3, i32, _number(0)), (4, binary, _text(b"t"))),
    ]
    footer = _thrift(
        (1, i32, _number(2)),
        (2, list_, _thrift_list(struct_, schema)),
        (3, i64, _number(1)),
        (4, list_, _thrift_list(struct_, [group])),
    )
    return b"PAR1" + head + packed + footer + struct.pack("<I", len(footer)) + b"PAR1"


@cache
def sound_mf4() -> bytes:
    """Return a sound MF4 file of a CAN bus."""
    return bus_log(".mf4")


MF4_LISTS = {"data groups": b"##DG", "groups": b"##CG", "channels": b"##CN", "data": b"##DL"}
"""Lists of an MF4 file, by the identifier of their blocks."""


def mf4_list(block: bytes) -> bytes:
    """Return an MF4 file whose list of such blocks points at itself."""
    raw = bytearray(sound_mf4())
    if block == b"##DL":
        return _with_data_list(raw)
    place = raw.index(block)
    struct.pack_into("<Q", raw, place + 24, place)
    return bytes(raw)


def _with_data_list(raw: bytearray) -> bytes:
    group, place = raw.index(b"##DG"), -(-len(raw) // 8) * 8
    raw += bytes(place - len(raw))
    (data,) = struct.unpack_from("<Q", raw, group + 24 + 16)
    raw += struct.pack("<4s4xQQQQBBHIQ", b"##DL", 24 + 16 + 16, 2, place, data, 0, 0, 0, 1, 0)
    struct.pack_into("<Q", raw, group + 24 + 16, place)
    return bytes(raw)


def mf4_record(size: int = RECORD_BYTES) -> bytes:
    """Return an MF4 file with records of that many bytes."""
    raw = bytearray(sound_mf4())
    place = 0
    while (place := raw.find(b"##CG", place + 1)) >= 0:
        (links,) = struct.unpack_from("<Q", raw, place + 16)
        struct.pack_into("<I", raw, place + 24 + 8 * links + 24, size)
    return bytes(raw)


def _bag(folder: Path, *, plugin: str | None) -> Path:
    if plugin is None:
        return write_bag(folder / "drive.bag")
    return write_bag(folder / "drive", plugin=StoragePlugin[plugin])


def long_metadata(folder: Path, size: int = METADATA_BYTES) -> Path:
    """Write a bag whose metadata.yaml names as many parts as fit."""
    bag = _bag(folder, plugin="MCAP")
    line = "- drive.mcap\n"
    with (bag / "metadata.yaml").open("a") as stream:
        stream.write("more:\n" + line * (size // len(line)))
    return bag


def compressed_whole(folder: Path, size: int = 2**28) -> Path:
    """Write a bag of a few kB that its library would unpack into that many bytes."""
    bag = _bag(folder, plugin="SQLITE3")
    (storage,) = bag.glob("*.db3")
    packer = zstandard.ZstdCompressor(level=1).compressobj()
    parts = [packer.compress(bytes(2**24)) for _ in range(0, size, 2**24)]
    storage.with_name(f"{storage.name}.zstd").write_bytes(b"".join([*parts, packer.flush()]))
    storage.unlink()
    text = (bag / "metadata.yaml").read_text()
    text = text.replace(storage.name, f"{storage.name}.zstd")
    text = re.sub("compression_format:.*", "compression_format: zstd", text)
    (bag / "metadata.yaml").write_text(re.sub("compression_mode:.*", r'compression_mode: "f\\x69le"', text))
    return bag


def topics_in_metadata(folder: Path, count: int = TOPICS) -> Path:
    """Write a bag whose metadata.yaml names that many topics."""
    bag = _bag(folder, plugin="MCAP")
    text = (bag / "metadata.yaml").read_text()
    mark = "  topics_with_message_count:\n"
    topic = (
        "  - topic_metadata: {{name: /t{0}, type: std_msgs/msg/Bool, serialization_format: cdr, "
        "offered_qos_profiles: []}}\n    message_count: 0\n"
    )
    before, _, after = text.partition(mark)
    assert after
    with (bag / "metadata.yaml").open("w") as stream:
        stream.write(before + mark)
        stream.writelines(topic.format(number) for number in range(count))
        stream.write(after)
    return bag


def topics_in_sqlite(folder: Path, count: int = TOPICS) -> Path:
    """Write a bag of SQLite with that many topics."""
    bag = next(_bag(folder, plugin="SQLITE3").glob("*.db3"))
    with closing(sqlite3.connect(bag)) as database:
        columns = [row[1] for row in database.execute("PRAGMA table_info(topics)")]
        first = database.execute("SELECT * FROM topics LIMIT 1").fetchone()
        rows = (
            tuple(
                1000 + number if name == "id" else f"/t{number}" if name == "name" else value
                for name, value in zip(columns, first, strict=True)
            )
            for number in range(count)
        )
        marks = ",".join("?" * len(columns))
        database.executemany(f"INSERT INTO topics VALUES ({marks})", rows)  # noqa: S608 - marks only
        database.commit()
    return bag


def _string(text: bytes) -> bytes:
    return struct.pack("<I", len(text)) + text


def topics_in_mcap(folder: Path, count: int = TOPICS) -> Path:
    """Write a bag of MCAP with that many channels."""
    path = folder / "drive.mcap"

    def record(kind: int, content: bytes) -> bytes:
        return struct.pack("<BQ", kind, len(content)) + content

    with path.open("wb") as stream:
        stream.write(b"\x89MCAP0\r\n" + record(1, _string(b"ros2") + _string(b"")))
        schema = struct.pack("<H", 1) + _string(b"std_msgs/msg/Bool") + _string(b"ros2msg") + _string(b"")
        stream.write(record(3, schema))
        for number in range(count):
            head = struct.pack("<HH", number % 65_536, 1)
            stream.write(record(4, head + _string(b"/t%d" % number) + _string(b"cdr") + _string(b"")))
        stream.write(record(15, bytes(4)) + record(2, bytes(20)) + b"\x89MCAP0\r\n")
    return path


def topics_in_ros1(folder: Path, count: int = TOPICS, **ahead: bytes) -> Path:
    """Write a bag of ROS 1 with that many connections, and fields ahead of their number."""
    path = folder / "drive.bag"

    def header(**fields: bytes) -> bytes:
        parts = [name.encode() + b"=" + value for name, value in fields.items()]
        content = b"".join(struct.pack("<I", len(part)) + part for part in parts)
        return struct.pack("<I", len(content)) + content

    def first(index: int) -> bytes:
        numbers = {
            "index_pos": struct.pack("<Q", index),
            "conn_count": struct.pack("<I", count),
            "chunk_count": struct.pack("<I", 0),
        }
        head = header(op=b"\x03", **ahead, **numbers)
        return b"#ROSBAG V2.0\n" + head + struct.pack("<I", room := max(0, 4096 - len(head))) + b" " * room

    with path.open("wb") as stream:
        stream.write(first(len(first(0))))
        for number in range(count):
            topic = b"/t%d" % number
            stream.write(header(op=b"\x07", conn=struct.pack("<I", number), topic=topic))
            stream.write(
                header(topic=topic, type=b"std_msgs/Bool", md5sum=b"0" * 32, message_definition=b"bool data")
            )
    return path


def many_columns(count: int = GUESSED_COLUMNS) -> bytes:
    """Return a table as text with that many columns."""
    rows = [",".join(f"c{number}" for number in range(count))]
    rows += [",".join(str(0.05 * row + number) for number in range(count)) for row in range(4)]
    return "\n".join(rows).encode()


def machine_takers() -> Iterator[Bad]:
    """Yield the files that once took gigabytes or minutes."""
    yield of_bytes("formats nested 40 deep", "flight", "nested.ulg", nested_ulog)
    yield of_bytes("headers of messages only", "flight", "headers.ulg", empty_ulog)
    yield of_bytes("messages of one byte only", "flight", "bytes.ulg", partial(empty_ulog, size=1))
    yield of_bytes("one cell of 2 GB", "table", "cell.parquet", parquet_cell)
    for name, block in MF4_LISTS.items():
        yield of_bytes(f"list of {name} in itself", "can", "list.mf4", partial(mf4_list, block))
    yield of_bytes("a record of 2 GB", "can", "record.mf4", mf4_record)
    yield Bad("16 MB of metadata.yaml", "bag", long_metadata)
    yield Bad("compressed as a whole", "bag", partial(compressed_whole, size=2**36))
    for make in (topics_in_metadata, topics_in_sqlite, topics_in_mcap, topics_in_ros1):
        yield Bad(f"a million {make.__name__}", "bag", make)
    yield of_bytes("guesses of 300,000 columns", "propose", "wide.csv", many_columns)
    yield of_bytes("300,000 columns", "table", "wide.csv", many_columns)


# Sound files, and their mutations.


def _columns() -> dict[str, np.ndarray]:
    t_s = 0.05 * np.arange(ROWS)
    return {"t": t_s, "l": 5.0 * t_s, "r": 5.5 * t_s}


def _csv() -> bytes:
    columns = _columns()
    rows = zip(*(column.tolist() for column in columns.values()), strict=True)
    return "\n".join([",".join(columns), *(",".join(map(repr, row)) for row in rows)]).encode()


def _saved(suffix: str) -> bytes:
    columns, buffer = _columns(), io.BytesIO()
    if suffix == ".npy":
        np.save(buffer, np.column_stack(list(columns.values())))
    elif suffix == ".npz":
        np.savez_compressed(buffer, **columns)  # type: ignore[arg-type]
    elif suffix == ".mat":
        savemat(buffer, columns)
    else:
        import pyarrow as pa
        import pyarrow.parquet as pq

        pq.write_table(pa.table(columns), buffer)
    return buffer.getvalue()


def _flight(suffix: str) -> bytes:
    messages = [(0, (50_000 * n + 1, 0.05 * n, 0.055 * n)) for n in range(ROWS)]
    return ulog(PX4, messages) if suffix == ".ulg" else dataflash(ARDUPILOT, messages)


def _can_log(suffix: str) -> bytes:
    return sound_mf4() if suffix == ".mf4" else bus_log(suffix)


def _robotino() -> bytes:
    return next(table.text for table in honest_tables() if table.name == "record").encode()


def _bag_file(plugin: str | None) -> bytes:
    with tempfile.TemporaryDirectory() as name:
        bag = _bag(Path(name), plugin=plugin)
        return (bag if bag.is_file() else next(bag.glob("*.[md][cb]*"))).read_bytes()


SOUND: dict[str, tuple[tuple[str, ...], Callable[[], bytes]]] = {
    ".csv": (("table", "propose"), _csv),
    ".csv.gz": (("table",), lambda: gzip.compress(_csv())),
    **{
        suffix: (("table", "propose"), partial(_saved, suffix))
        for suffix in (".npy", ".npz", ".mat", ".parquet")
    },
    **{
        suffix: (("can", "list"), partial(_can_log, suffix))
        for suffix in (".log", ".asc", ".blf", ".trc", ".mf4")
    },
    **{suffix: (("flight",), partial(_flight, suffix)) for suffix in (".ulg", ".bin")},
    ".bag": (("bag",), partial(_bag_file, None)),
    ".mcap": (("bag",), partial(_bag_file, "MCAP")),
    ".db3": (("bag",), partial(_bag_file, "SQLITE3")),
    "_robotino.csv": (("robotino",), _robotino),
}
"""Commands and content of a sound file, by the end of its name."""
_sound = cache(lambda suffix: SOUND[suffix][1]())


def mutated(raw: bytes, generator: random.Random) -> bytes:
    """Return bytes with damage of one kind."""
    kind = generator.choice(("bits", "bits", "bytes", "number", "cut", "out", "twice", "zeros"))
    data = bytearray(raw)
    place = generator.randrange(len(data))
    length = generator.choice((1, 8, 64, 1000))
    if kind == "bits":
        for _ in range(generator.choice((1, 3, 30))):
            data[generator.randrange(len(data))] ^= 1 << generator.randrange(8)
    elif kind == "bytes":
        for _ in range(generator.choice((1, 5, 50))):
            data[generator.randrange(len(data))] = generator.choice((0, 1, 127, 128, 255))
    elif kind == "number":
        number = generator.choice((2**31, 2**31 - 1, 2**32 - 1, 2**63, 2**64 - 1, 0, 1))
        size = generator.choice((4, 8))
        data[place : place + size] = (number % 256**size).to_bytes(size, "little")
    elif kind == "cut":
        del data[place:]
    elif kind == "out":
        del data[place : place + length]
    elif kind == "twice":
        data[place:place] = data[place : place + length]
    else:
        data[place : place + length] = bytes(length)
    return bytes(data)


def mutations(count: int, generator: random.Random) -> Iterator[Bad]:
    """Yield that many mutated files of each format; half of the damage is in the first 2000 bytes."""
    for suffix, (kinds, _) in SOUND.items():
        for number in range(count):
            seed, is_head = generator.random(), generator.random() < 0.5

            def make(suffix: str = suffix, seed: float = seed, is_head: bool = is_head) -> bytes:
                raw, chance = _sound(suffix), random.Random(seed)
                if is_head:
                    return mutated(raw[:2000], chance) + raw[2000:]
                return mutated(raw, chance)

            yield of_bytes(f"{suffix} {number}", generator.choice(kinds), f"drive{suffix}", make)


def bag_folders(count: int, generator: random.Random) -> Iterator[Bad]:
    """Yield bags as folders with a mutated metadata.yaml."""
    for number in range(count):
        seed = generator.random()

        def write(folder: Path, seed: float = seed) -> Path:
            bag = _bag(folder, plugin="MCAP")
            text = (bag / "metadata.yaml").read_bytes()
            (bag / "metadata.yaml").write_bytes(mutated(text, random.Random(seed)))
            return bag

        yield Bad(f"metadata.yaml {number}", "bag", write)
