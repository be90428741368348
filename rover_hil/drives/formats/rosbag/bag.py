"""The messages of a bag on the mapped topics, in the order of their recording.

Where the clock of the recorder was set back meanwhile, the order and the times are those of the stamps in
their headers.

A bag comes from anybody. Its own message definitions are not used, only those of the library, so that no code
is made from a file.
"""

from array import array
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

from drivers.clock import NANOSECONDS_PER_SECOND
from drivers.errors import ConfigError, LogError
from drivers.files import MEGABYTE
from rover_hil.drives.files.unreadable import UnreadableError
from rover_hil.drives.formats.rosbag.cut_mcap import CutMcap, is_cut
from rover_hil.drives.formats.rosbag.topic_count import check_topic_count
from rover_hil.drives.formats.rosbag.topics import Topics
from rover_hil.recording.mcap_records import MAGIC

MOST_MESSAGE_BYTES = 64 * MEGABYTE
LONGEST_S = 1e6
"""A bag is not longer, nor is a pause in it."""
LEAST_SET_BACK_NS = 100_000_000
"""A clock that is set back by less looks like the jitter of the recorder."""
EVEN = 0.2
"""Before and after it the recording is behind the stamps by the same, within this share of the step."""
LEAST_MESSAGES = 10
"""Before and after it, of each section: a single stamp may be wrong by itself."""
SAME_TIME_NS = 2_000_000_000
"""Sections show the step at the same time, but for the time between two of their messages."""
BEGINS = {".bag": b"#ROSBAG V", ".mcap": MAGIC, ".db3": b"SQLite format 3\0"}
METADATA = "metadata.yaml"
STORED = (".mcap", ".db3")
PACKED = (".zstd", ".zst", ".gz", ".bz2", ".lz4")
FIXES = {
    ".bag": "`rosbag reindex {path}` makes its index again, `rosbag fix` copies what is intact",
    ".mcap": "`mcap recover {path} -o recovered.mcap` saves what is intact",
    ".db3": "`sqlite3 {path} .recover | sqlite3 recovered.db3` saves what is intact",
    "": "`ros2 bag reindex {path}` makes its metadata.yaml again",
}
"""What helps where a bag is damaged, by the ending of its name; "" for a folder."""


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
    """The clock of the recorder was set back, once.

    Attributes:
        by_ns: By so much.
        at_ns: At this time of the recording.
        behind_ns: By section, by how much the recording is behind the stamps before that.
    """

    by_ns: int
    at_ns: int
    behind_ns: dict[str, int]

    def is_after(self, section: str, t_ns: int, stamp_ns: int) -> bool:
        """Return whether a message was recorded after the clock was set back."""
        return t_ns - stamp_ns - self._usual_ns(section) < -self.by_ns // 2

    def time_ns(self, section: str, stamp_ns: int) -> int:
        """Return when a message would have been recorded by the clock before."""
        return max(0, stamp_ns + self._usual_ns(section))

    def _usual_ns(self, section: str) -> int:
        return self.behind_ns.get(section, min(self.behind_ns.values()))


class Bag:
    """A bag of ROS 1 (`.bag`) or ROS 2 (a folder, `.mcap`, `.db3`).

    Args:
        path: The bag.
        topics: What is wanted.

    Attributes:
        is_unfinished: Whether the recorder was killed: `metadata.yaml` is missing.
        cut: Names of its files without their end.
        outside: Number of messages that `messages` leaves out, because they were recorded while the clock was
            not set: at time 0, or more than `LONGEST_S` before or after the others.

    Raises:
        ConfigError: The library is missing.
        LogError: The bag cannot be read, lacks a mapped topic, or a topic is of another type.
    """

    def __init__(self, path: Path, topics: Topics) -> None:
        if not path.exists():
            raise LogError(f"no file or folder {path}: correct the path; it starts at the current folder")
        self._path = path
        self._files = _files_of(path)
        self.is_unfinished = path.is_dir() and not (path / METADATA).exists()
        self.cut = [file.name for file in self._files if file.suffix == ".mcap" and is_cut(file)]
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
        self._end_ns = 0
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
        step = self.set_back
        return end_ns - first_ns if step is None else self._end_ns

    @property
    def set_back(self) -> ClockStep | None:
        """By how much, and when, the clock of the recorder was set back; None where it was not.

        Only where all messages have stamps in their headers, which give the times then, and each section for
        itself shows the same step.

        Raises:
            LogError: As for `messages`.
        """
        if not self._is_clock_judged:
            self._set_back = self._judge_clock()
            self._is_clock_judged = True
        return self._set_back

    def _judge_clock(self) -> ClockStep | None:
        first_ns, _ = self._span()
        steps: dict[str, ClockStep] = {}
        # Pictures are many bytes, and no better a clock.
        for section in sorted(self.sections - {"camera"}):
            stamps_ns, times_ns = array("q"), array("q")
            for message in self._recorded(section):
                if message.stamp_ns is None or message.stamp_ns + first_ns <= 0:
                    return None
                stamps_ns.append(message.stamp_ns)
                times_ns.append(message.t_ns)
            step = _step_back(section, stamps_ns, times_ns)
            if step is None:
                return None
            steps[section] = step
        by_ns = [step.by_ns for step in steps.values()]
        at_ns = [step.at_ns for step in steps.values()]
        if not steps or max(by_ns) - min(by_ns) > EVEN * min(by_ns) or max(at_ns) - min(at_ns) > SAME_TIME_NS:
            return None
        behind_ns = {section: step.behind_ns[section] for section, step in steps.items()}
        found = ClockStep(min(by_ns), min(at_ns), behind_ns)
        self._end_ns = max(each.t_ns for each in self._by_stamps(found, None))
        return found

    def messages(self, section: str | None = None) -> Iterator[BagMessage]:
        """Yield the messages on the mapped topics, or on that of one section.

        Raises:
            LogError: The bag is damaged, needs too much memory, lacks a topic, or one is of another type.
        """
        step = self.set_back
        yield from self._recorded(section) if step is None else self._by_stamps(step, section)

    def _by_stamps(self, step: ClockStep, section: str | None) -> Iterator[BagMessage]:
        """Yield what was recorded before the clock was set back, then the rest, at their stamps."""
        last_ns = 0
        for is_after in (False, True):
            for message in self._recorded(section):
                stamp_ns = message.t_ns if message.stamp_ns is None else message.stamp_ns
                if step.is_after(message.section, message.t_ns, stamp_ns) is is_after:
                    # The jitter of the stamps puts no message before the one that was recorded ahead of it.
                    last_ns = max(last_ns, step.time_ns(message.section, stamp_ns))
                    yield message._replace(t_ns=last_ns, stamp_ns=last_ns)

    def _recorded(self, section: str | None) -> Iterator[BagMessage]:
        """Yield the messages at the times of their recording, in its order."""
        first_ns, end_ns = self._span()
        last_ns = 0
        sections = {topic.topic: name for name, topic, _ in self._topics.mapped()}
        for connection, recorded_ns, data in self._stored(section):
            if not first_ns <= recorded_ns <= end_ns:
                continue
            content = self._content(data, connection.topic, connection.msgtype)
            t_ns = recorded_ns - first_ns
            if t_ns < last_ns:
                raise LogError(
                    f"{self._path} is damaged: a message on {connection.topic} was recorded "
                    f"{(last_ns - t_ns) / 1e9:.6g} s before the one ahead of it: {self._fix}"
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
        readers = [self._reader(file) for file in self._files]
        try:
            for reader in readers:
                with self._named_failures():
                    reader.open()
            self._check_topics([each for reader in readers for each in reader.connections])
            topics = {topic.topic for name, topic, _ in self._topics.mapped() if section in (None, name)}
            for reader in readers:
                connections = [each for each in reader.connections if each.topic in topics]
                if connections:
                    yield from self._messages_of(reader, connections)
        finally:
            with self._named_failures():
                for reader in readers:
                    reader.close()

    def _messages_of(self, reader: Any, connections: Sequence[Any]) -> Iterator[tuple[Any, int, bytes]]:
        with self._named_failures():
            messages = reader.messages(connections)
        while True:
            with self._named_failures():
                message = next(messages, None)
            if message is None:
                return
            connection, recorded_ns, _ = message
            if not isinstance(recorded_ns, int):
                raise LogError(
                    f"{self._path} is damaged: the time of a message on {connection.topic} is "
                    f"{str(recorded_ns)[:40]!r}, not a number: {self._fix}"
                )
            yield message

    def _reader(self, file: Path) -> Any:
        if file.name in self.cut:
            return CutMcap(file)
        with self._named_failures():
            if self._is_ros1:
                from rosbags.rosbag1 import Reader as Ros1Reader

                return Ros1Reader(file)
            from rosbags.rosbag2 import Reader as Ros2Reader

            return Ros2Reader(file)

    def _check_topics(self, connections: Sequence[Any]) -> None:
        """Check the mapped topics; a topic has a connection for each node that publishes on it.

        Raises:
            LogError: The bag lacks one, or one is of another type.
        """
        there: dict[str, list[str]] = {}
        for connection in connections:
            there.setdefault(connection.topic, []).append(connection.msgtype)
        for section, topic, types in self._topics.mapped():
            if topic.topic not in there:
                known = ", ".join(sorted(there)[:20]) or "none"
                raise LogError(
                    f"{self._path} holds no topic {topic.topic}, named by [{section}]; its topics are {known}"
                )
            unfit_type = next((kind for kind in there[topic.topic] if kind not in types), None)
            if unfit_type is not None:
                raise LogError(
                    f"{self._path}: topic {topic.topic} is {unfit_type}, [{section}] needs "
                    f"{' or '.join(types)}: name another topic"
                )

    def _content(self, data: bytes, topic: str, kind: str) -> Any:
        if len(data) > MOST_MESSAGE_BYTES:
            raise LogError(
                f"{self._path}: a {kind} of {len(data)} bytes, "
                f"{MOST_MESSAGE_BYTES} are allowed: leave the topic out"
            )
        try:
            if self._is_ros1:
                return self._store.deserialize_ros1(data, kind)
            return self._store.deserialize_cdr(data, kind)
        except MemoryError:
            raise
        # The library raises whatever the data make it stumble over.
        except Exception as error:
            raise LogError(
                f"{self._path} is damaged: a message on {topic} does not hold what a {kind} does: {self._fix}"
            ) from error

    @property
    def _fix(self) -> str:
        suffix = self._path.suffix if self._path.is_file() else ""
        return FIXES[suffix].format(path=self._path)

    @contextmanager
    def _named_failures(self) -> Iterator[None]:
        try:
            yield
        except (LogError, MemoryError):
            raise
        except UnreadableError as error:
            raise LogError(f"{self._path} is damaged: {error}: {self._fix}") from error
        # The library raises whatever a damaged bag makes it stumble over.
        except Exception as error:
            raise LogError(f"{self._path} is damaged, or was never closed: {self._fix}") from error


def _files_of(path: Path) -> list[Path]:
    """Return a bag as the library opens it; the files of a folder that a killed recorder left, in order.

    Raises:
        LogError: It is no bag, or not one that can be read as it is.
    """
    if not path.is_dir():
        _check_file(path)
        return [path]
    files = sorted((each for each in path.iterdir() if each.suffix in STORED), key=_number)
    if not files:
        packed = next((each for each in path.iterdir() if each.suffix in PACKED), None)
        if packed is not None:
            raise LogError(f"{path} is compressed as a whole: unpack {packed.name} with `zstd -d`")
        raise LogError(f"{path} is no bag: it holds no .mcap or .db3 file of messages: correct the path")
    if (path / METADATA).exists() and not any(file.suffix == ".mcap" and is_cut(file) for file in files):
        return [path]
    for file in files:
        _check_file(file)
    return files


def _number(file: Path) -> tuple[int, str]:
    """Return by what the files of a bag are in order: bag_0, bag_1, ..., bag_10."""
    number = file.stem.rpartition("_")[2]
    return int(number) if number.isdecimal() else 0, file.name


def _check_file(path: Path) -> None:
    """Check that a file is one of the formats.

    Raises:
        LogError: It is none.
    """
    if path.suffix == ".active":
        raise LogError(
            f"{path} was left by a recorder of ROS 1 that was killed: `rosbag reindex {path}` makes its "
            "index; then name it .bag"
        )
    if path.suffix in PACKED:
        raise LogError(f"{path} is packed: unpack it, with `zstd -d` or `gunzip`")
    if path.suffix not in BEGINS:
        raise LogError(f"{path} is no bag: give a .bag, .mcap or .db3 file, or the folder with metadata.yaml")
    with path.open("rb") as stream:
        begin = stream.read(len(BEGINS[path.suffix]))
    if begin != BEGINS[path.suffix]:
        what = "is empty" if not begin else f"does not begin like a {path.suffix} file"
        raise LogError(f"{path} {what}: give another file")


def _step_back(section: str, stamps_ns: Sequence[int], times_ns: Sequence[int]) -> ClockStep | None:
    """Return where the time of recording falls behind the stamps of a section at once, and stays there."""
    if len(stamps_ns) < 2 * LEAST_MESSAGES:
        return None
    order = sorted(range(len(stamps_ns)), key=stamps_ns.__getitem__)
    behind_ns = [times_ns[place] - stamps_ns[place] for place in order]
    steps_ns = [after - before for before, after in pairwise(behind_ns)]
    place = min(range(len(steps_ns)), key=steps_ns.__getitem__)
    by_ns = -steps_ns[place]
    parts = behind_ns[: place + 1], behind_ns[place + 1 :]
    if by_ns < LEAST_SET_BACK_NS or min(map(len, parts)) < LEAST_MESSAGES:
        return None
    if any(max(part) - min(part) > EVEN * by_ns for part in parts):
        return None
    if times_ns[order[place + 1]] >= times_ns[order[place]]:
        return None  # what had waited came at once: the clock itself went on
    return ClockStep(by_ns, times_ns[order[place]], {section: int(median(parts[0]))})
