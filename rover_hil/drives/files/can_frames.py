"""The frames of a recorded CAN bus as arrays, read by the readers of python-can."""

import io
import logging
import re
import struct
from array import array
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from importlib.util import find_spec
from operator import or_
from pathlib import Path
from typing import Any, BinaryIO, TypeAlias

import can
import numpy as np
from numpy.typing import NDArray

from drivers.can.frame import ERROR_FLAG, EXTENDED_FLAG, EXTENDED_ID_MASK, FRAME_SIZE, REMOTE_FLAG
from drivers.errors import ConfigError, LogError
from drivers.files import (
    CAN_CONTAINER_BYTES,
    CAN_FRAMES,
    CAN_LINE_CHARACTERS,
    CAN_LOG_BYTES,
    MEGABYTE,
    open_packed,
)
from rover_hil.drives.arrays import Array
from rover_hil.drives.clocks import unwrapped
from rover_hil.drives.files.blf_blocks import BlfBlocks
from rover_hil.drives.files.cell_numbers import clock_seconds
from rover_hil.drives.files.csv_table import header_lines, read_csv
from rover_hil.drives.files.mf4_blocks import check_blocks
from rover_hil.drives.files.unreadable import UnreadableError

Identifiers: TypeAlias = NDArray[np.uint32]
Bytes: TypeAlias = NDArray[np.uint8]

LARGEST_PAYLOAD = 8
PORTION = 65_536
"""So many frames are packed at a time."""
LONGEST_STEP_BACK_S = 1.0
"""Loggers write what several buses or buffers hold out of order by no more than this."""
CANDUMP_TOO = (".txt", ".candump", ".dump")
"""What candump prints is sent into files of these names, too."""
SAVVYCAN = "Time Stamp"
"""First column of a CSV file of SavvyCAN."""
_BLF_HEADER, _BLF_OBJECT = struct.Struct("<4sL"), struct.Struct("<4sHHLL")
_BLF_CONTAINER = 10
_CANDUMP = re.compile(rb"^\((\d+\.\d+)\) (\S+) ([0-9A-Fa-f]+)#([0-9A-Fa-f]*)(?: [RTrt])?\r?$", re.MULTILINE)
_ASC_TIMED = re.compile(r"^\s*(\d+\.\d+)(?=\s)")
_LOGGED = re.compile(r"^\s*\([^)]+\)\s+\S+\s+[0-9A-Fa-f]+#")
"""A frame in a log of candump."""
_SCREEN = re.compile(
    r"^\s*\((\d+\.\d+|\d{4}-\d\d-\d\d \d\d:\d\d:\d\d\.\d+)\)\s+(\S+)\s+(?:[RT]X\s+\S+\s+\S+\s+)?"
    r"([0-9A-Fa-f]{3,8})\s+\[(\d+)\]\s*((?:[0-9A-Fa-f]{2}\s*)*)"
)
"""What candump prints, where it is not told to write a log."""
_SCREEN_WITHOUT_TIME = re.compile(r"^\s*\S+\s+[0-9A-Fa-f]{3,8}\s+\[\d+\]")
MOST_BACK = 0.1
"""Share of frames that are not later than the one before, from which on printed times are differences."""
FORMATS = {
    ".log": "`candump -L` or `candump -l` writes (1700000000.000000) can0 123#0102",
    ".asc": "export it as ASC again",
    ".blf": "export it as BLF again",
    ".trc": "save the trace again in PCAN-View",
    ".csv": "save it again as CSV of python-can or SavvyCAN",
    ".mf4": "a logger that was cut off left it unfinished: finalise it with the converter of its maker",
}
"""What helps where a file is no log of the format, or damaged."""
BLOCK_BYTES = MEGABYTE // 8
"""Of a text log, read at once."""

logging.getLogger("can.io").addHandler(logging.NullHandler())
"""What python-can finds odd in a file is counted here, not printed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CanFrames:
    """CAN frames of up to 8 bytes in the order of their times, n of them.

    Attributes:
        path: The file they come from.
        t_s: Times as the file holds them, n.
        identifiers: With the flags of `drivers.can.frame`, n.
        lengths: Number of data bytes, n.
        data: Data bytes, zero behind the length, n x 8.
        channels: Names of the buses in the file.
        longer: Number of frames with more than 8 data bytes, which are not read.
        left_out: Number of frames with other lengths than they say.
        unread: Number of lines in which the reader found no frame: events, or damage.
        swapped: Number of frames that the file held behind a later one.
        findings: What was wrong with the times and was corrected, and how often.
    """

    path: Path
    t_s: Array
    identifiers: Identifiers
    lengths: Bytes
    data: Bytes
    channels: tuple[str, ...]
    longer: int = 0
    left_out: int = 0
    unread: int = 0
    swapped: int = 0
    findings: tuple[tuple[str, int], ...] = ()

    def __len__(self) -> int:
        return len(self.t_s)

    def by_identifier(self) -> dict[int, NDArray[np.intp]]:
        """Return the places of the frames of each identifier, with flags, in the order of these."""
        order = np.argsort(self.identifiers, kind="stable")
        identifiers, starts = np.unique(self.identifiers[order], return_index=True)
        return dict(zip(identifiers.tolist(), np.split(order, starts[1:]), strict=True))


def read_can_log(
    path: Path, *, channel: str | None = None, on_frames: Callable[[int], None] = lambda _: None
) -> CanFrames:
    """Return the frames in a log of a CAN bus, also packed (`.gz`).

    candump (`.log`), Vector ASC and BLF, PCAN TRC, CSV of python-can and of SavvyCAN, and MF4, which needs
    asammdf. Times, identifiers and data are those of python-can's reader.

    Args:
        path: The file; the ending of its name says what it is.
        channel: Use this bus only; None for the only one of the file.
        on_frames: Called now and then with the number of frames read.

    Raises:
        LogError: The file cannot be read, or holds several buses and none is chosen.
        ConfigError: A library is missing.
    """
    suffix = Path(path.name.removesuffix(".gz")).suffix.lower()
    suffix = ".log" if suffix in CANDUMP_TOO else suffix
    if suffix == ".csv" and header_lines(path, 1)[:1] and header_lines(path, 1)[0].startswith(SAVVYCAN):
        frames = _read_savvycan(path)
    elif suffix in _READERS:
        frames = _read(path, suffix, on_frames)
    else:
        raise LogError(
            f"{path}: no log of a CAN bus ends in '{suffix}': name a file that ends in "
            f"{', '.join(_READERS)}, or so and .gz"
        )
    if not len(frames):
        if frames.frames.longer:
            raise LogError(
                f"{path} holds {frames.frames.longer} CAN FD frames of more than {LARGEST_PAYLOAD} data "
                "bytes and no other: such frames are not supported"
            )
        raise LogError(f"{path} holds no CAN frame: {FORMATS[suffix]}")
    return _in_order(_of_channel(frames, channel))


class _Collector:
    """Gathers frames in flat arrays: an hour of a full bus has ten million."""

    def __init__(self) -> None:
        self.t_s, self.identifiers, self.places = array("d"), array("I"), array("h")
        self.lengths, self.data = bytearray(), bytearray()
        self.channels: dict[str, int] = {}
        self.longer = self.left_out = 0

    def add(self, message: can.Message) -> None:
        data = message.data
        length = 0 if message.is_remote_frame else message.dlc
        # A CAN FD frame of up to 8 bytes carries its data as a classic one does.
        if length > LARGEST_PAYLOAD and len(data) == length:
            self.longer += 1
            return
        if len(data) != length or not 0 <= message.arbitration_id <= EXTENDED_ID_MASK:
            self.left_out += 1
            return
        self.t_s.append(message.timestamp)
        self.identifiers.append(
            message.arbitration_id
            | message.is_extended_id * EXTENDED_FLAG
            | message.is_remote_frame * REMOTE_FLAG
            | message.is_error_frame * ERROR_FLAG
        )
        self.lengths.append(length)
        self.data += data.ljust(LARGEST_PAYLOAD, b"\0")
        name = "" if message.channel is None else str(message.channel)
        self.places.append(self.channels.setdefault(name, len(self.channels)))

    def add_all(self, messages: Iterable[can.Message], on_frames: Callable[[int], None]) -> None:
        """Add messages.

        Raises:
            UnreadableError: They are too many.
        """
        for message in messages:
            self.add(message)
            if not len(self.t_s) & 0xFFFF:
                on_frames(len(self.t_s))
            self._check_count()

    def _check_count(self) -> None:
        if len(self.t_s) > CAN_FRAMES:
            raise UnreadableError(f"it holds more than {CAN_FRAMES:,} frames, the limit: divide it")

    def add_run(self, t_s: Array, records: np.ndarray[Any, Any]) -> None:
        """Add the frames of a run of `BlfBlocks`.

        Raises:
            UnreadableError: They are too many.
        """
        identifiers = records["identifier"]
        flags = np.where(identifiers >> 31, np.uint32(EXTENDED_FLAG), np.uint32(0))
        is_held = np.arange(LARGEST_PAYLOAD) < records["length"][:, np.newaxis]
        self.t_s.frombytes(t_s.tobytes())
        self.identifiers.frombytes((identifiers & np.uint32(EXTENDED_ID_MASK) | flags).astype("u4").tobytes())
        self.lengths += records["length"].tobytes()
        self.data += (records["data"] * is_held).astype("u1").tobytes()
        numbers, places = np.unique(records["channel"].astype(np.int64) - 1, return_inverse=True)
        own = np.array([self._place(str(number)) for number in numbers.tolist()], np.int16)
        self.places.frombytes(own[places].tobytes())
        self._check_count()

    def add_lines(self, lines: Sequence[tuple[bytes, bytes, bytes, bytes]]) -> bool:
        """Add frames by time, channel, identifier and data in lines of candump.

        Returns False, and adds nothing, where one is no classic data frame with 3 or 8 digits of identifier.
        """
        times, channels, identifiers, data = zip(*lines, strict=True)
        numbers = [int(text, 16) for text in identifiers]
        sizes = set(map(len, data))
        if (
            not set(map(len, identifiers)) <= {3, 8}
            or max(numbers) > EXTENDED_ID_MASK
            or max(sizes) > 2 * LARGEST_PAYLOAD
            or any(size & 1 for size in sizes)
        ):
            return False
        self.t_s.extend(map(float, times))
        flags = [EXTENDED_FLAG if len(text) > 3 else 0 for text in identifiers]
        self.identifiers.extend(map(or_, numbers, flags))
        self.lengths.extend([len(text) >> 1 for text in data])
        self.data += bytes.fromhex(
            b"".join([text.ljust(2 * LARGEST_PAYLOAD, b"0") for text in data]).decode()
        )
        places = {text: self._place(text.decode()) for text in dict.fromkeys(channels)}
        self.places.extend([places[text] for text in channels])
        return True

    def _place(self, channel: str) -> int:
        name = str(int(channel)) if channel.isdigit() else channel
        return self.channels.setdefault(name, len(self.channels))

    def frames(self, path: Path, lines: int | None) -> tuple[CanFrames, NDArray[np.int16]]:
        count = len(self.t_s)
        frames = CanFrames(
            path=path,
            t_s=np.array(self.t_s, np.float64),
            identifiers=np.array(self.identifiers, np.uint32),
            lengths=np.frombuffer(bytes(self.lengths), np.uint8),
            data=np.frombuffer(bytes(self.data), np.uint8).reshape(count, LARGEST_PAYLOAD),
            channels=tuple(self.channels),
            longer=self.longer,
            left_out=self.left_out,
            unread=0 if lines is None else max(0, lines - count - self.longer - self.left_out),
        )
        return frames, np.array(self.places, np.int16)


@dataclass(frozen=True, slots=True)
class _OfChannels:
    """Frames, and the bus of each."""

    frames: CanFrames
    places: NDArray[np.int16]

    def __len__(self) -> int:
        return len(self.frames)


def _add_candump(raw: BinaryIO, collector: _Collector, on_frames: Callable[[int], None]) -> bool:
    """Add all frames of a candump log; returns False where a line is not one of a classic data frame.

    Several times as fast as the reader of python-can, which reads the others; tests compare the two.
    """
    begun, size = b"", 0
    while block := raw.read(BLOCK_BYTES):
        size += len(block)
        text, newline, begun = (begun + block).rpartition(b"\n")
        if not newline:
            return False
        frame_texts = _CANDUMP.findall(text + newline)
        is_plain = len(frame_texts) == text.count(b"\n") + 1 and collector.add_lines(frame_texts)
        if not is_plain or size > CAN_LOG_BYTES or len(collector.t_s) > CAN_FRAMES:
            return False
        on_frames(len(collector.t_s))
    return not begun and size > 0


class _Lines(io.TextIOBase):
    """A text file that counts its lines and refuses endless ones."""

    def __init__(self, raw: Any, suffix: str) -> None:
        self._text = io.TextIOWrapper(raw, "utf-8", errors="replace")
        self._suffix = suffix
        self.kept: re.Pattern[str] | None = None
        self._characters = 0
        self.number = 0
        self.content = 0
        self._elapsed_s: float | None = None

    def readline(self, size: int | None = -1, /) -> str:  # type: ignore[override]
        """Return the next line that holds a frame by `kept`; empty at the end."""
        while line := self._next_line():
            if self.kept is None or self.kept.match(line):
                break
        return line

    def _next_line(self) -> str:
        line = self._text.readline(CAN_LINE_CHARACTERS)
        if len(line) >= CAN_LINE_CHARACTERS:
            raise UnreadableError(f"a line is longer than {CAN_LINE_CHARACTERS:,} characters, the limit")
        self._characters += len(line)
        if self._characters > CAN_LOG_BYTES:
            raise UnreadableError(f"it is larger than {CAN_LOG_BYTES / MEGABYTE:g} MB, the limit: divide it")
        self.number += bool(line)
        self.content += bool(line.strip()) and line[0] not in ";/"
        if self._suffix == ".asc" and "timestamps relative" in line.casefold():
            self._elapsed_s = 0.0
        return line if self._elapsed_s is None else self._since_begin(line, self._elapsed_s)

    def _since_begin(self, line: str, elapsed_s: float) -> str:
        """Return a line of a Vector ASC file whose times count from the line before with its whole time."""
        if not (timed := _ASC_TIMED.match(line)):
            return line
        self._elapsed_s = elapsed_s + float(timed[1])
        return f"{self._elapsed_s:.6f}{line[timed.end() :]}"


def _read(path: Path, suffix: str, on_frames: Callable[[int], None]) -> _OfChannels:
    lines: _Lines | None = None
    collector = _Collector()
    try:
        with open_packed(path) as raw:
            if suffix == ".log":
                if _add_candump(raw, collector, on_frames):
                    return _OfChannels(*collector.frames(path, None))
                collector = _Collector()
                raw.seek(0)
            if suffix in _TEXT:
                lines = _Lines(raw, suffix)
            collector.add_all(_reader_of(raw, suffix, lines, collector), on_frames)
    except OSError as problem:
        raise LogError(f"cannot read {path}: {problem.strerror or problem}: give another file") from problem
    except (ConfigError, MemoryError):
        raise
    except UnreadableError as problem:
        raise LogError(f"cannot read {path}: {problem}") from problem
    # The readers raise whatever a damaged file makes them stumble over.
    except Exception as problem:
        place = f"after {len(collector.t_s)} frames" if lines is None else f"in line {lines.number}"
        raise LogError(
            f"{path}: {place} it is cut, damaged or no {suffix} log: {FORMATS[suffix]}"
        ) from problem
    return _OfChannels(*collector.frames(path, None if lines is None else lines.content))


def _reader_of(raw: Any, suffix: str, lines: _Lines | None, collector: _Collector) -> Iterable[can.Message]:
    """Return the reader of a file; what it does not yield goes to the collector."""
    if suffix == ".blf":
        _check_containers(raw)
        return BlfBlocks(raw, on_run=collector.add_run)
    if lines is None:
        return _READERS[suffix](raw)
    if suffix == ".log":
        if printed := _printed(raw):
            return printed(lines)
        lines.kept = _LOGGED
    return _READERS[suffix](lines)


def _check_containers(raw: Any) -> None:
    """Check that no part of a BLF file unpacks to more than any logger packs.

    Raises:
        UnreadableError: One may.
    """
    header = raw.read(_BLF_HEADER.size)
    position = _BLF_HEADER.unpack(header)[1] if len(header) == _BLF_HEADER.size else 0
    while position > 0:
        raw.seek(position)
        head = raw.read(_BLF_OBJECT.size)
        if len(head) < _BLF_OBJECT.size:
            break
        signature, _, _, size, kind = _BLF_OBJECT.unpack(head)
        if signature != b"LOBJ" or size < _BLF_OBJECT.size:
            break
        if kind == _BLF_CONTAINER and size > CAN_CONTAINER_BYTES:
            raise UnreadableError(
                f"a container has {size:,} bytes, more than {CAN_CONTAINER_BYTES:,}, the limit"
            )
        position += size + size % 4
    raw.seek(0)


def _printed(raw: Any) -> Callable[[Any], Iterable[can.Message]] | None:
    """Return the reader of what candump has printed; None for a log.

    Raises:
        UnreadableError: It was printed without times.
    """
    first = raw.read(CAN_LINE_CHARACTERS).decode("utf-8", "replace").lstrip().partition("\n")[0]
    raw.seek(0)
    if _SCREEN_WITHOUT_TIME.match(first):
        raise UnreadableError(
            "candump has printed it without times: record with `candump -L` or `candump -l`"
        )
    return _read_printed if _SCREEN.match(first) else None


def _read_printed(lines: Any) -> Iterator[can.Message]:
    """Yield the frames that candump has printed.

    Raises:
        UnreadableError: The times are differences.
    """
    before_s, back, count = -float("inf"), 0, 0
    while line := lines.readline():
        if not (printed := _SCREEN.match(line)):
            continue
        dated = clock_seconds([printed[1]])
        t_s, data = dated[0] if dated else float(printed[1]), bytes.fromhex("".join(printed[5].split()))
        count, back, before_s = count + 1, back + (t_s <= before_s), t_s
        identifier = int(printed[3], 16)
        yield can.Message(
            timestamp=t_s,
            channel=printed[2],
            arbitration_id=identifier & EXTENDED_ID_MASK,
            is_extended_id=len(printed[3]) > 3,
            is_error_frame="ERRORFRAME" in line,
            is_remote_frame="remote request" in line,
            dlc=int(printed[4]),
            data=data,
        )
    if back > MOST_BACK * count:
        raise UnreadableError(
            "its times are differences, as `candump -t d` prints them: record with `candump -L` or -l"
        )


def _mf4(raw: Any) -> Iterable[can.Message]:
    if find_spec("asammdf") is None:
        raise ConfigError("reading MF4 needs asammdf: pip install rover-hil[mf4]")
    content = io.BytesIO(raw.read())
    check_blocks(content)
    return can.MF4Reader(content)


_READERS: dict[str, Callable[[Any], Iterable[can.Message]]] = {
    ".log": can.CanutilsLogReader,
    ".asc": can.ASCReader,
    ".blf": can.BLFReader,
    ".trc": can.TRCReader,
    ".csv": can.CSVReader,
    ".mf4": _mf4,
}
_TEXT = {".log", ".asc", ".trc", ".csv"}


def _read_savvycan(path: Path) -> _OfChannels:
    table = read_csv(path)
    names = {name.lower(): name for name in table.names}
    collector = _Collector()
    columns = [names.get(name, "") for name in ("time stamp", "id", "extended", "bus", "len")]
    table.require((name for name in columns if name), "it is no CSV file of SavvyCAN")
    if "" in columns:
        raise LogError(f"{path} line {table.header_line}: it lacks a column of SavvyCAN: save it again")
    times_s = table.numbers(columns[0], is_needed=True) * 1e-6
    lengths = table.numbers(columns[4], is_needed=True)
    texts = [table.text(name) for name in columns[1:4]]
    data = [table.text(names[name]) for name in (f"d{byte}" for byte in range(1, 9)) if name in names]
    for row, (identifier, extended, bus) in enumerate(zip(*texts, strict=True)):
        length = int(lengths[row])
        try:
            collector.add(
                can.Message(
                    timestamp=float(times_s[row]),
                    arbitration_id=int(identifier, 16),
                    is_extended_id=extended.lower() in {"true", "1"},
                    dlc=length,
                    data=[int(column[row], 16) for column in data[:length]],
                    channel=bus,
                )
            )
        except ValueError as problem:
            raise LogError(f"{table.where(row)}: it holds no frame: correct or remove it") from problem
    return _OfChannels(*collector.frames(path, None))


def _of_channel(channels: _OfChannels, channel: str | None) -> CanFrames:
    frames = channels.frames
    names = ", ".join(name or "without a name" for name in frames.channels)
    if channel is None:
        if len(frames.channels) > 1:
            raise LogError(f"{frames.path} holds several buses, {names}: choose one with --channel")
        return frames
    if channel not in frames.channels:
        raise LogError(f"{frames.path} holds no bus '{channel}', only {names}: correct --channel")
    return _select(frames, np.flatnonzero(channels.places == frames.channels.index(channel)), 0)


def _in_order(frames: CanFrames) -> CanFrames:
    if not np.isfinite(frames.t_s).all():
        place = int(np.flatnonzero(~np.isfinite(frames.t_s))[0])
        raise LogError(f"{frames.path}: frame {place + 1} has no time: remove it")
    clock = unwrapped(frames.t_s)
    frames = replace(frames, t_s=clock.times_s, findings=clock.findings)
    latest_s = np.maximum.accumulate(frames.t_s)
    back_s = latest_s - frames.t_s
    place = int(np.argmax(back_s))
    if back_s[place] > LONGEST_STEP_BACK_S:
        raise LogError(
            f"{frames.path}: the time runs back by {back_s[place]:.3f} s at frame {place + 1}: it holds "
            "several recordings, or its clock was set; divide it there"
        )
    if not back_s.any():
        return frames
    return _select(frames, np.argsort(frames.t_s, kind="stable"), int(np.count_nonzero(back_s)))


def _select(frames: CanFrames, places: NDArray[np.intp], swapped: int) -> CanFrames:
    return CanFrames(
        path=frames.path,
        t_s=frames.t_s[places],
        identifiers=frames.identifiers[places],
        lengths=frames.lengths[places],
        data=frames.data[places],
        channels=frames.channels,
        longer=frames.longer,
        left_out=frames.left_out,
        unread=frames.unread,
        swapped=swapped,
        findings=frames.findings,
    )


def timed_payloads(
    frames: CanFrames, places: NDArray[np.intp], since_s: float
) -> Iterator[tuple[int, bytes]]:
    """Yield time since `since_s` in ns and payload of frames, in the layout of `drivers.can.frame`.

    Times are whole microseconds: a float holds no more of a date.
    """
    for start in range(0, len(places), PORTION):
        part = places[start : start + PORTION]
        times_ns = np.round((frames.t_s[part] - since_s) * 1e6).astype(np.int64) * 1000
        packed = np.zeros((len(part), FRAME_SIZE), np.uint8)
        packed[:, :4] = frames.identifiers[part].astype("<u4").view(np.uint8).reshape(-1, 4)
        packed[:, 4] = frames.lengths[part]
        packed[:, 8:] = frames.data[part]
        raw = packed.tobytes()
        pieces = (raw[first : first + FRAME_SIZE] for first in range(0, len(raw), FRAME_SIZE))
        yield from zip(times_ns.tolist(), pieces, strict=True)
