"""The messages of a bag on the mapped topics, in the order of their recording.

A bag comes from anybody. Its own message definitions are not used, only those of the library, so that no code
is made from a file; and the memory that reading may take is limited (`bounded_memory`).
"""

import resource
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

from drivers.clock import NANOSECONDS_PER_SECOND
from drivers.errors import ConfigError, LogError
from drivers.files import MEGABYTE
from rover_hil.importing.rosbag.topics import Topics

MOST_MEMORY_BYTES = 2048 * MEGABYTE
"""In addition to what the program has when it begins to read."""
MOST_MESSAGE_BYTES = 64 * MEGABYTE
LONGEST_S = 1e6
FIX = "record it again, or copy it with `rosbag reindex` or `ros2 bag convert`"


class BagMessage(NamedTuple):
    """A message.

    Attributes:
        section: Of the file of topics.
        kind: Message type, as ROS 2 writes it.
        t_ns: Time of recording since the first message.
        stamp_ns: Time in its header since the same instant; None without a header.
        content: The message with the fields of its type.
    """

    section: str
    kind: str
    t_ns: int
    stamp_ns: int | None
    content: Any


class Bag:
    """A bag of ROS 1 (`.bag`) or ROS 2 (a folder, `.mcap`, `.db3`).

    Args:
        path: The bag.
        topics: What is wanted.

    Raises:
        ConfigError: The library is missing.
        LogError: The bag cannot be read, lacks a mapped topic, or a topic is of another type.
    """

    def __init__(self, path: Path, topics: Topics) -> None:
        if not path.exists():
            raise LogError(f"no file or folder {path}: correct the path; it starts at the current folder")
        self._path = path
        self._is_ros1 = path.suffix == ".bag"
        try:
            from rosbags.typesys import Stores, get_typestore
        except ImportError as error:
            raise ConfigError("import rosbag needs rosbags: `pip install rover-hil[rosbag]`") from error
        self._store = get_typestore(Stores.ROS1_NOETIC if self._is_ros1 else Stores.ROS2_HUMBLE)
        self._topics = topics

    @property
    def sections(self) -> frozenset[str]:
        """Sections of the file of topics that are wanted."""
        return frozenset(section for section, _, _ in self._topics.mapped())

    def messages(self) -> Iterator[BagMessage]:
        """Yield the messages on the mapped topics.

        Raises:
            LogError: The bag is damaged, needs too much memory, lacks a topic, or one is of another type.
        """
        reader = self._reader()
        with self._named_failures():
            reader.open()
        try:
            with self._named_failures():
                wanted = self._connections(reader)
                messages = reader.messages(list(wanted.values()))
            sections = {topic.topic: section for section, topic, _ in self._topics.mapped()}
            first_ns, last_ns = -1, 0
            while True:
                with self._named_failures():
                    found = next(messages, None)
                    if found is None:
                        break
                    connection, recorded_ns, data = found
                    content = self._content(data, connection.msgtype)
                if not isinstance(recorded_ns, int):
                    raise LogError(
                        f"{self._path} is damaged: the time of a message on {connection.topic} is "
                        f"{str(recorded_ns)[:40]!r}, not a number: {FIX}"
                    )
                first_ns = recorded_ns if first_ns < 0 else first_ns
                t_ns = recorded_ns - first_ns
                if not last_ns <= t_ns <= LONGEST_S * NANOSECONDS_PER_SECOND:
                    raise LogError(
                        f"{self._path} is damaged: a message on {connection.topic} was recorded "
                        f"{t_ns / 1e9:.6g} s after the first one: {FIX}"
                    )
                last_ns = t_ns
                stamp = getattr(getattr(content, "header", None), "stamp", None)
                stamp_ns = None
                if stamp is not None:
                    stamp_ns = stamp.sec * NANOSECONDS_PER_SECOND + stamp.nanosec - first_ns
                yield BagMessage(sections[connection.topic], connection.msgtype, t_ns, stamp_ns, content)
        finally:
            with self._named_failures():
                reader.close()

    def _reader(self) -> Any:
        with self._named_failures():
            if self._is_ros1:
                from rosbags.rosbag1 import Reader as Ros1Reader

                return Ros1Reader(self._path)
            from rosbags.rosbag2 import Reader as Ros2Reader

            return Ros2Reader(self._path)

    def _connections(self, reader: Any) -> Mapping[str, Any]:
        if getattr(reader, "compression_mode", None) == "file":
            raise LogError(f"{self._path} is compressed as a whole: unpack it with `ros2 bag convert`")
        there = {connection.topic: connection for connection in reader.connections}
        found = {}
        for section, topic, types in self._topics.mapped():
            connection = there.get(topic.topic)
            if connection is None:
                known = ", ".join(sorted(there)[:20]) or "none"
                raise LogError(
                    f"{self._path} holds no topic {topic.topic}, named by [{section}]; its topics are {known}"
                )
            if connection.msgtype not in types:
                raise LogError(
                    f"{self._path}: topic {topic.topic} is {connection.msgtype}, [{section}] needs "
                    f"{' or '.join(types)}: name another topic"
                )
            found[section] = connection
        return found

    def _content(self, data: bytes, kind: str) -> Any:
        if len(data) > MOST_MESSAGE_BYTES:
            raise LogError(
                f"{self._path}: a {kind} of {len(data)} bytes, {MOST_MESSAGE_BYTES} are allowed: leave the "
                "topic out"
            )
        if self._is_ros1:
            return self._store.deserialize_ros1(data, kind)
        return self._store.deserialize_cdr(data, kind)

    @contextmanager
    def _named_failures(self) -> Iterator[None]:
        try:
            yield
        except LogError:
            raise
        except MemoryError as error:
            raise LogError(
                f"{self._path} needs more than {MOST_MEMORY_BYTES // MEGABYTE} MB of memory: {FIX}"
            ) from error
        except Exception as error:
            raise LogError(f"{self._path} is damaged or is no bag ({_reason(error)}): {FIX}") from error


def _reason(error: Exception) -> str:
    return " ".join(f"{type(error).__name__} {error}".split())[:120]


@contextmanager
def bounded_memory() -> Iterator[None]:
    """Limit the memory of this program to what it has and `MOST_MEMORY_BYTES` more."""
    pages = int(Path("/proc/self/statm").read_text("ascii").split()[0])
    before = resource.getrlimit(resource.RLIMIT_AS)
    allowed = [limit for limit in before if limit != resource.RLIM_INFINITY]
    limit = min([pages * resource.getpagesize() + MOST_MEMORY_BYTES, *allowed])
    resource.setrlimit(resource.RLIMIT_AS, (limit, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, before)
