"""Read a log in the order it was written, also one that a killed run left unfinished."""

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from mcap.records import Attachment, Channel, DataEnd, Message, Metadata
from pydantic import TypeAdapter, ValidationError

from drivers.errors import LogError
from drivers.files import (
    ATTACHMENTS_BYTES,
    LARGEST_WHOLE_NUMBER,
    MEGABYTE,
    MESSAGE_JSON_BYTES,
    open_file,
    parse_json,
)
from rover_hil.recording.mcap_records import DamagedRecordError, Record, read_records
from rover_hil.recording.schema import CONFIG_ATTACHMENT, LOG_SCHEMA

RecordT = TypeVar("RecordT")

LAST_NS = LARGEST_WHOLE_NUMBER // 2
"""Latest time in a log, so that a difference of two times has 64 bits too."""
MOST_TOPIC_CHARACTERS = 200


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
        try:
            self.start_ns = int(metadata["start_ns"])
            self.origin = metadata["origin"]
            _check_time(self.start_ns)
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
        try:
            return shape.validate_json(message.data)
        except ValidationError as error:
            first = error.errors()[0]
            place = ".".join(map(str, first["loc"])) or "its content"
            raise LogError(
                f"{self.path} is damaged: {message.topic} at {message.t_ns} ns: {place}: {first['msg']}"
            ) from error

    def messages(self) -> Iterator[LogMessage]:
        """Yield every message in the order of writing.

        Raises:
            LogError: The file is damaged; messages before the damage have been yielded.
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
                if record.publish_time > LAST_NS:
                    raise LogError(f"{self.path} is damaged: a message at {record.publish_time} ns")
                yield LogMessage(topics[record.channel_id], record.publish_time, record.data)

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


def _check_time(t_ns: int) -> None:
    if not 0 <= t_ns <= LAST_NS:
        raise ValueError(f"{t_ns} ns is no time")
