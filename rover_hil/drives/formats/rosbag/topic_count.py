"""Check, before a bag is opened, what takes the library long: many topics, and to unpack it as a whole."""

import mmap
import sqlite3
import struct
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path

from drivers.errors import LogError
from drivers.files import MEGABYTE

MOST_TOPICS = 4_000
MOST_METADATA_BYTES = 4 * MEGABYTE
"""Of metadata.yaml; a topic or a part of a bag takes 0.3 to 1 kB in it."""
_ROS1_HEAD = b"#ROSBAG V"
_ROS1_COUNT = b"conn_count="
_ROS1_HEADER_BYTES = 4096
"""A sound first record, with the room behind its header, is as long."""
_ROS1_LINE_BYTES = 64
_MCAP_HEAD = b"\x89MCAP0\r\n"
_MCAP_RECORD = struct.Struct("<BQ")
_MCAP_CHANNEL = 4


def check_topic_count(path: Path) -> None:
    """Check a bag: the folder with its metadata, or a file.

    Raises:
        LogError: It names too many topics, its metadata is too long, or it is compressed as a whole.
    """
    metadata = path / "metadata.yaml"
    if metadata.is_file() and metadata.stat().st_size > MOST_METADATA_BYTES:
        raise LogError(
            f"{metadata} has {metadata.stat().st_size / MEGABYTE:.1f} MB, more than "
            f"{MOST_METADATA_BYTES / MEGABYTE:g} MB, the limit: write it again with `ros2 bag reindex`"
        )
    if metadata.is_file() and _is_compressed_whole(metadata):
        raise LogError(f"{path} is compressed as a whole: unpack it with `ros2 bag convert`")
    for file in sorted(path.iterdir()) if path.is_dir() else [path]:
        counted = _COUNTS.get(file.suffix)
        if counted is not None and file.is_file() and counted(file) > MOST_TOPICS:
            raise LogError(
                f"{file} names more than {MOST_TOPICS:,} topics, the limit: copy those that you need into "
                "another bag with `rosbag filter` or `ros2 bag convert`"
            )


def _is_compressed_whole(metadata: Path) -> bool:
    """Return whether the library would unpack the bag when it opens it."""
    from ruamel.yaml import YAML

    try:
        whole = YAML(typ="safe").load(metadata.read_text())
        return str(whole["rosbag2_bagfile_information"]["compression_mode"]).lower() == "file"
    except Exception:  # noqa: BLE001 - the library reports what is wrong with it
        return False


def _ros1_topics(file: Path) -> int:
    """Return the number of connections in the first record; 0 where the library finds none.

    Raises:
        LogError: The header of the record is too long.
    """
    with file.open("rb") as stream:
        line = stream.readline(_ROS1_LINE_BYTES)
        size = int.from_bytes(stream.read(4), "little")
        header = stream.read(min(size, _ROS1_HEADER_BYTES))
    if not line.startswith(_ROS1_HEAD):
        return 0
    if size > _ROS1_HEADER_BYTES:
        raise LogError(
            f"{file}: its first header has {size:,} bytes, more than {_ROS1_HEADER_BYTES:,}, the limit: "
            "write it again with `rosbag reindex`"
        )
    count = place = 0
    while place < len(header):
        field = header[place + 4 :][: int.from_bytes(header[place : place + 4], "little")]
        place += 4 + len(field)
        if field.startswith(_ROS1_COUNT):
            count = int.from_bytes(field[len(_ROS1_COUNT) :][:4], "little")
    return count


def _mcap_topics(file: Path) -> int:
    """Return the number of channels, at most one more than the limit; those in chunks are repeated behind."""
    count = 0
    for kind in _mcap_records(file):
        count += kind == _MCAP_CHANNEL
        if count > MOST_TOPICS:
            break
    return count


def _mcap_records(file: Path) -> Iterator[int]:
    """Yield the kind of each record."""
    if file.stat().st_size <= len(_MCAP_HEAD):
        return
    with file.open("rb") as stream, mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as content:
        place, end = len(_MCAP_HEAD), len(content) - _MCAP_RECORD.size
        while place <= end:
            kind, size = _MCAP_RECORD.unpack_from(content, place)
            yield kind
            place += _MCAP_RECORD.size + size


def _sqlite_topics(file: Path) -> int:
    """Return the number of topics, at most one more than the limit."""
    try:
        with closing(sqlite3.connect(f"{file.absolute().as_uri()}?immutable=1", uri=True)) as database:
            query = "SELECT count(*) FROM (SELECT 1 FROM topics LIMIT ?)"
            (count,) = database.execute(query, (MOST_TOPICS + 1,)).fetchone()
            return int(count)
    except sqlite3.Error:  # the library reports what is wrong with it
        return 0


_COUNTS: dict[str, Callable[[Path], int]] = {
    ".bag": _ros1_topics,
    ".mcap": _mcap_topics,
    ".db3": _sqlite_topics,
}
