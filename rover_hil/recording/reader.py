"""Read a log in the order it was written, also one that a killed run left unfinished."""

import json
import math
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeAlias, TypeVar

from mcap.records import Attachment, Channel, DataEnd, Message, Metadata
from pydantic import TypeAdapter, ValidationError

from drivers.errors import LogError
from drivers.files import (
    ATTACHMENTS_BYTES,
    LARGEST_WHOLE_NUMBER,
    MEGABYTE,
    MESSAGE_JSON_BYTES,
    UNPACKED_PIXELS,
    UNPACKED_PIXELS_PER_BYTE,
    open_file,
    parse_json,
)
from rover_hil.recording.images import picture_payload, pixels_in
from rover_hil.recording.made_with import FACTS
from rover_hil.recording.mcap_records import DamagedRecordError, Record, read_records
from rover_hil.recording.schema import (
    BYTES,
    BYTES_SHAPE,
    CAMERA,
    CONFIG_ATTACHMENT,
    HEALTH,
    LOG_SCHEMA,
    PICTURE_SHAPE,
    RAW,
    SENT,
    UNSENT,
    VIEW,
)

RecordT = TypeVar("RecordT")
Place: TypeAlias = tuple[str | None, ...]
"""Keys that lead to a value of a record; None for each element of a list."""

LAST_NS = LARGEST_WHOLE_NUMBER // 2
"""Latest time in a log, so that a difference of two times has 64 bits too."""
MOST_TOPIC_CHARACTERS = 200
_TOPICS = {"received": RAW, "sent": SENT, "unsent": UNSENT}


@dataclass(frozen=True, slots=True)
class LogMessage:
    """One message: its topic, monotonic time and bytes."""

    topic: str
    t_ns: int
    data: bytes

    def json(self) -> object:
        """Return the message's content, for topics that hold JSON.

        Raises:
            LogError: The bytes are not JSON.
        """
        self.check_size()
        try:
            return parse_json(self.data)
        except ValueError as error:
            raise LogError(
                f"message on {self.topic} at {self.t_ns} ns is not valid JSON: the log is damaged"
            ) from error

    def check_size(self) -> None:
        """Check that the message is not larger than one that holds JSON can be.

        Raises:
            LogError: It is.
        """
        if len(self.data) > MESSAGE_JSON_BYTES:
            limit = f"{MESSAGE_JSON_BYTES / MEGABYTE:g} MB"
            raise LogError(f"message on {self.topic} at {self.t_ns} ns is larger than {limit}, the limit")


class LogReader:
    """A log: header at once, messages on demand.

    Args:
        path: The file.

    Attributes:
        wall_offset_ns: Wall-clock minus monotonic time.
        made_with: What the log was made with, by the names in `recording.made_with.FACTS`; empty in older
            logs.
        is_complete: After `messages` has ended, whether the log was closed properly. A killed run's log
            is not, and holds everything up to its last flush.
        bytes_read: Position of `messages` in the file.

    Raises:
        LogError: The file is missing, is not an MCAP file, or not a log of this software.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.is_complete = False
        self.bytes_read = 0
        self.attachments: Mapping[str, bytes]
        self.attachments, metadata = self._read_header()
        if metadata.get("schema") != LOG_SCHEMA:
            raise LogError(f"{path} is not a log of this software: metadata 'schema' is not {LOG_SCHEMA}")
        self.made_with = {name: metadata[name] for name in FACTS if name in metadata}
        try:
            self.start_ns = int(metadata["start_ns"])
            self.origin = metadata["origin"]
            self.wall_offset_ns = int(metadata["wall_offset_ns"])
            _check_time(self.start_ns)
            if abs(self.wall_offset_ns) > LAST_NS:
                raise ValueError(f"{self.wall_offset_ns} ns is no offset")
        except (KeyError, ValueError) as error:
            raise LogError(f"log {path} is damaged: its metadata lack a start time or an origin") from error
        if CONFIG_ATTACHMENT not in self.attachments:
            raise LogError(f"{path} holds no configuration: it was cut off before the run began")
        self.config_json = self.attachments[CONFIG_ATTACHMENT]

    def parse(self, message: LogMessage, shape: TypeAdapter[RecordT]) -> RecordT:
        """Return the record in a message.

        Raises:
            LogError: The message has another shape.
        """
        message.check_size()
        return self._validated(message, shape)

    def _validated(self, message: LogMessage, shape: TypeAdapter[RecordT]) -> RecordT:
        data, repaired = message.data, set[Place]()
        while True:
            try:
                return shape.validate_json(data)
            except ValidationError as error:
                first = error.errors()[0]
                place = tuple(None if isinstance(key, int) else key for key in first["loc"])
                if first["type"] == "float_type" and first["input"] is None and place not in repaired:
                    repaired.add(place)
                    data = _with_numbers(data, place)
                    continue
                where = ".".join(map(str, first["loc"])) or "its content"
                raise LogError(
                    f"{self.path} is damaged: {message.topic} at {message.t_ns} ns: {where}: {first['msg']}"
                ) from error

    def messages(self) -> Iterator[LogMessage]:
        """Yield every message in the order of writing; payloads and pictures under topics of their device.

        What is there for viewers alone is left out.

        Raises:
            LogError: The file is damaged; messages before the damage have been yielded.
        """
        unpacked_pixels = 0
        for message in self.stored_messages():
            if message.topic == BYTES:
                yield from self._payloads(message)
            elif message.topic.startswith(CAMERA):
                picture = self._picture(message)
                unpacked_pixels += pixels_in(picture.data)
                self._check_pixels(unpacked_pixels)
                yield picture
            elif message.topic == HEALTH:
                yield replace(message, data=_inside(message, b'{"devices":', b"}"))
            elif not message.topic.startswith(VIEW):
                yield message

    def _payloads(self, message: LogMessage) -> Iterator[LogMessage]:
        for payload in self.parse(message, BYTES_SHAPE)["payloads"]:
            if not 0 <= payload["t_ns"] <= LAST_NS:
                raise LogError(f"{self.path} is damaged: a payload at {payload['t_ns']} ns")
            try:
                data = bytes.fromhex(payload["hex"])
            except ValueError:
                raise LogError(
                    f"{self.path} is damaged: {BYTES} at {message.t_ns} ns: bytes that are not hexadecimal"
                ) from None
            yield LogMessage(_TOPICS[payload["kind"]] + payload["device"], payload["t_ns"], data)

    def _picture(self, message: LogMessage) -> LogMessage:
        record = self._validated(message, PICTURE_SHAPE)
        device = message.topic.removeprefix(CAMERA)
        return LogMessage(RAW + device, message.t_ns, picture_payload(record))

    def _check_pixels(self, count: int) -> None:
        size_bytes = self.path.stat().st_size
        if count > UNPACKED_PIXELS + UNPACKED_PIXELS_PER_BYTE * size_bytes:
            raise LogError(
                f"log {self.path} is damaged: its pictures hold more than {UNPACKED_PIXELS_PER_BYTE} pixels "
                "for each byte of the file"
            )

    def stored_messages(self) -> Iterator[LogMessage]:
        """Yield every message as it is in the file, also those for viewers.

        Raises:
            LogError: As for `messages`.
        """
        topics: dict[int, str] = {}
        for record in self._records():
            if isinstance(record, Channel):
                if len(record.topic) > MOST_TOPIC_CHARACTERS:
                    raise LogError(f"{self.path} is damaged: a topic of {len(record.topic)} characters")
                topics[record.id] = record.topic
            elif isinstance(record, Message):
                if record.channel_id not in topics:
                    raise LogError(
                        f"{self.path} is damaged: a message on an unknown channel {record.channel_id}"
                    )
                t_ns = record.publish_time - self.wall_offset_ns
                if not 0 <= t_ns <= LAST_NS:
                    raise LogError(f"{self.path} is damaged: a message at {t_ns} ns")
                yield LogMessage(topics[record.channel_id], t_ns, record.data)

    def _read_header(self) -> tuple[dict[str, bytes], dict[str, str]]:
        attachments: dict[str, bytes] = {}
        metadata: dict[str, str] = {}
        attached_bytes = 0
        for record in self._records():
            if isinstance(record, Attachment):
                attachments[record.name] = record.data
                attached_bytes += len(record.name) + len(record.data)
                if attached_bytes > ATTACHMENTS_BYTES:
                    limit = f"{ATTACHMENTS_BYTES / MEGABYTE:g} MB"
                    raise LogError(f"log {self.path} holds more than {limit} of data files, the limit")
            elif isinstance(record, Metadata):
                metadata = dict(record.metadata)
            elif isinstance(record, Message):
                break
        return attachments, metadata

    def _records(self) -> Iterator[Record]:
        try:
            stream = open_file(self.path)
        except OSError as error:
            raise LogError(f"cannot read log {self.path}: {error.strerror}") from error
        with stream:
            size_bytes = os.fstat(stream.fileno()).st_size
            if size_bytes == 0:
                raise LogError(f"log {self.path} is empty")
            try:
                for record in read_records(stream, size_bytes):
                    self.bytes_read = stream.tell()
                    if isinstance(record, DataEnd):
                        self.is_complete = True
                    yield record
            except DamagedRecordError as error:
                raise LogError(f"log {self.path} is damaged or not an MCAP file: {error}") from error


def _inside(message: LogMessage, before: bytes, after: bytes) -> bytes:
    return message.data.removeprefix(before).removesuffix(after)


def _check_time(t_ns: int) -> None:
    if not 0 <= t_ns <= LAST_NS:
        raise ValueError(f"{t_ns} ns is no time")


def _with_numbers(data: bytes, place: Place) -> bytes:
    """Return a record with NaN for each null at a place: a number that was not finite."""
    record = json.loads(data)
    _fill(record, place)
    return json.dumps(record).encode()


def _fill(part: object, place: Place) -> None:
    key, *below = place
    if isinstance(part, list) and key is None:
        inner: dict[Any, object] = dict(enumerate(part))
    elif isinstance(part, dict) and key in part:
        inner = {key: part[key]}
    else:
        return
    for each, value in inner.items():
        if below:
            _fill(value, tuple(below))
        elif value is None:
            part[each] = math.nan
