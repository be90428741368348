"""The messages of a bag on the mapped topics, in the order of their recording.

Where the clock of the recorder was set back meanwhile, the order and the times are those of the stamps in
their headers.

A bag comes from anybody. Its own message definitions are not used, only those of the library, so that no code
is made from a file.
"""

import heapq
from array import array
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import count, pairwise
from pathlib import Path
from typing import Any, NamedTuple

from drivers.clock import NANOSECONDS_PER_SECOND
from drivers.errors import ConfigError, LogError
from drivers.files import MEGABYTE
from rover_hil.importing.rosbag.topic_count import check_topic_count
from rover_hil.importing.rosbag.topics import Topics

MOST_MESSAGE_BYTES = 64 * MEGABYTE
LONGEST_S = 1e6
"""A bag is not longer, nor is a pause in it."""
LEAST_SET_BACK_NS = 100_000_000
"""A clock that is set back by less looks like the jitter of the recorder."""
EVEN = 0.2
"""Before and after it the recording is behind the stamps by the same, within this share of the step."""
STORED = (".mcap", ".db3")
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


class ClockStep(NamedTuple):
    """The clock of the recorder was set back.

    Attributes:
        by_ns: By so much.
        at_ns: At this time after the first stamp.
        first_stamp_ns: The first stamp, since the first recording.
    """

    by_ns: int
    at_ns: int
    first_stamp_ns: int


class Bag:
    """A bag of ROS 1 (`.bag`) or ROS 2 (a folder, `.mcap`, `.db3`).

    Args:
        path: The bag.
        topics: What is wanted.

    Attributes:
        is_unfinished: Whether the recorder was killed: `metadata.yaml` is missing.
        outside: Number of messages that `messages` leaves out, because they were recorded while the clock was
            not set: at time 0, or more than `LONGEST_S` before or after the others.

    Raises:
        ConfigError: The library is missing.
        LogError: The bag cannot be read, lacks a mapped topic, or a topic is of another type.
    """

    def __init__(self, path: Path, topics: Topics) -> None:
        if not path.exists():
            raise LogError(f"no file or folder {path}: correct the path; it starts at the current folder")
        self._path = _whole_bag(path)
        self.is_unfinished = self._path != path
        self._is_ros1 = path.suffix == ".bag"
        try:
            from rosbags.typesys import Stores, get_typestore
        except ImportError as error:
            raise ConfigError("import rosbag needs rosbags: `pip install rover-hil[rosbag]`") from error
        check_topic_count(path)
        self._store = get_typestore(Stores.ROS1_NOETIC if self._is_ros1 else Stores.ROS2_HUMBLE)
        self._topics = topics
        self._span_ns: tuple[int, int] | None = None
        self._set_back: ClockStep | None = None
        self._is_clock_judged = False
        self.outside = 0

    @property
    def sections(self) -> frozenset[str]:
        """Sections of the file of topics that are wanted."""
        return frozenset(section for section, _, _ in self._topics.mapped())

    @property
    def duration_ns(self) -> int:
        """Time of the last message on the mapped topics.

        Raises:
            LogError: As for `messages`.
        """
        first_ns, end_ns = self._span()
        return end_ns - first_ns

    @property
    def set_back(self) -> ClockStep | None:
        """By how much, and when, the clock of the recorder was set back; None where it was not.

        Only where all messages have stamps in their headers; they give the times then.

        Raises:
            LogError: As for `messages`.
        """
        if not self._is_clock_judged:
            # Pictures are many bytes, and no better a clock.
            pairs = [
                (each.stamp_ns, each.t_ns)
                for section in sorted(self.sections - {"camera"})
                for each in self._recorded(section)
            ]
            stamped = [(stamp_ns, t_ns) for stamp_ns, t_ns in pairs if stamp_ns is not None]
            if len(stamped) == len(pairs):
                self._set_back = _step_back(sorted(stamped))
            self._is_clock_judged = True
        return self._set_back

    def messages(self, section: str | None = None) -> Iterator[BagMessage]:
        """Yield the messages on the mapped topics, or on that of one section.

        Raises:
            LogError: The bag is damaged, needs too much memory, lacks a topic, or one is of another type.
        """
        step = self.set_back
        if step is None:
            yield from self._recorded(section)
            return
        waiting: list[tuple[int, int, BagMessage]] = []
        numbers = count()
        for message in self._recorded(section):
            stamp_ns = message.t_ns if message.stamp_ns is None else message.stamp_ns
            stamped_ns = max(0, stamp_ns - step.first_stamp_ns)
            heapq.heappush(waiting, (stamped_ns, next(numbers), message._replace(t_ns=stamped_ns)))
            # The recording is out of order by no more than the step.
            while waiting and waiting[0][0] < message.t_ns - 2 * step.by_ns:
                yield heapq.heappop(waiting)[2]
        while waiting:
            yield heapq.heappop(waiting)[2]

    def _recorded(self, section: str | None) -> Iterator[BagMessage]:
        """Yield the messages at the times of their recording, in its order."""
        first_ns, end_ns = self._span()
        last_ns = 0
        sections = {topic.topic: name for name, topic, _ in self._topics.mapped()}
        for connection, recorded_ns, data in self._stored(section):
            if not first_ns <= recorded_ns <= end_ns:
                continue
            with self._named_failures():
                content = self._content(data, connection.msgtype)
            t_ns = recorded_ns - first_ns
            if t_ns < last_ns:
                raise LogError(
                    f"{self._path} is damaged: a message on {connection.topic} was recorded "
                    f"{(last_ns - t_ns) / 1e9:.6g} s before the one ahead of it: {FIX}"
                )
            last_ns = t_ns
            stamp = getattr(getattr(content, "header", None), "stamp", None)
            stamp_ns = None
            if stamp is not None:
                stamp_ns = stamp.sec * NANOSECONDS_PER_SECOND + stamp.nanosec - first_ns
            yield BagMessage(sections[connection.topic], connection.msgtype, t_ns, stamp_ns, content)

    def _span(self) -> tuple[int, int]:
        """Return the times of the first and the last message that were recorded while the clock was set."""
        if self._span_ns is None:
            with self._named_failures():
                times_ns = array("q", (recorded_ns for _, recorded_ns, _ in self._stored(None)))
            parts: list[list[int]] = []
            for t_ns in sorted(t_ns for t_ns in times_ns if t_ns > 0):
                if parts and t_ns - parts[-1][1] <= LONGEST_S * NANOSECONDS_PER_SECOND:
                    parts[-1][1:] = t_ns, parts[-1][2] + 1
                else:
                    parts.append([t_ns, t_ns, 1])
            first_ns, end_ns, count = max(parts, key=lambda part: part[2], default=[0, 0, 0])
            self._span_ns = first_ns, end_ns
            self.outside = len(times_ns) - count
        return self._span_ns

    def _stored(self, section: str | None) -> Iterator[tuple[Any, int, bytes]]:
        """Yield connection, time of recording and data of the messages on the mapped topics."""
        reader = self._reader()
        with self._named_failures():
            reader.open()
        try:
            with self._named_failures():
                messages = reader.messages(self._connections(reader, section))
            while True:
                with self._named_failures():
                    first_message = next(messages, None)
                if first_message is None:
                    return
                connection, recorded_ns, _ = first_message
                if not isinstance(recorded_ns, int):
                    raise LogError(
                        f"{self._path} is damaged: the time of a message on {connection.topic} is "
                        f"{str(recorded_ns)[:40]!r}, not a number: {FIX}"
                    )
                yield first_message
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

    def _connections(self, reader: Any, wanted: str | None) -> list[Any]:
        """Return the connections of the mapped topics; a topic has one for each node that publishes on it."""
        there: dict[str, list[Any]] = {}
        for connection in reader.connections:
            there.setdefault(connection.topic, []).append(connection)
        connections: list[Any] = []
        for section, topic, types in self._topics.mapped():
            if topic.topic not in there:
                known = ", ".join(sorted(there)[:20]) or "none"
                raise LogError(
                    f"{self._path} holds no topic {topic.topic}, named by [{section}]; its topics are {known}"
                )
            unfit_type = next(
                (each.msgtype for each in there[topic.topic] if each.msgtype not in types), None
            )
            if unfit_type is not None:
                raise LogError(
                    f"{self._path}: topic {topic.topic} is {unfit_type}, [{section}] needs "
                    f"{' or '.join(types)}: name another topic"
                )
            if wanted in (None, section):
                connections += there[topic.topic]
        return connections

    def _content(self, data: bytes, kind: str) -> Any:
        if len(data) > MOST_MESSAGE_BYTES:
            raise LogError(
                f"{self._path}: a {kind} of {len(data)} bytes, "
                f"{MOST_MESSAGE_BYTES} are allowed: leave the topic out"
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
        except Exception as error:
            raise LogError(f"{self._path} is damaged or is no bag ({_reason(error)}): {FIX}") from error


def _whole_bag(path: Path) -> Path:
    """Return the bag; of a folder without `metadata.yaml`, as a killed recorder leaves it, its only file.

    Raises:
        LogError: Such a folder holds no such file, or several.
    """
    if not path.is_dir() or (path / "metadata.yaml").exists():
        return path
    stored = sorted(each for each in path.iterdir() if each.suffix in STORED)
    if len(stored) == 1:
        return stored[0]
    if not stored:
        raise LogError(
            f"{path} is no bag: it holds neither metadata.yaml nor a file of messages: correct the path"
        )
    raise LogError(
        f"{path} has no metadata.yaml, as a killed recorder leaves it, and {len(stored)} files of messages: "
        f"`ros2 bag reindex {path}` makes it again"
    )


def _step_back(pairs: list[tuple[int, int]]) -> ClockStep | None:
    """Return where the time of recording falls behind the stamps at once, and stays there.

    Args:
        pairs: Stamp and time of recording, in the order of the stamps.
    """
    if len(pairs) < 2:
        return None
    behind_ns = [recorded_ns - stamp_ns for stamp_ns, recorded_ns in pairs]
    steps_ns = [after - before for before, after in pairwise(behind_ns)]
    place = min(range(len(steps_ns)), key=steps_ns.__getitem__)
    by_ns = -steps_ns[place]
    if by_ns < LEAST_SET_BACK_NS:
        return None
    for part in (behind_ns[: place + 1], behind_ns[place + 1 :]):
        if max(part) - min(part) > EVEN * by_ns:
            return None
    first_ns = pairs[0][0]
    return ClockStep(by_ns, pairs[place + 1][0] - first_ns, first_ns)


def _reason(error: Exception) -> str:
    return " ".join(f"{type(error).__name__} {error}".split())[:120]
