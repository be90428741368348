"""Read a log in the order it was written, also one that a killed run left unfinished."""

import json
import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from mcap.exceptions import EndOfFile, McapError
from mcap.records import Attachment, Channel, DataEnd, McapRecord, Message, Metadata
from mcap.stream_reader import CRCValidationError, StreamReader
from pydantic import TypeAdapter, ValidationError

from drivers.errors import LogError
from rover_hil.recording.schema import CONFIG_ATTACHMENT, LOG_SCHEMA

RecordT = TypeVar("RecordT")

RECORD_SIZE_LIMIT = 256 * 2**20


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
        try:
            return json.loads(self.data)
        except ValueError as error:
            raise LogError(
                f"message on {self.topic} at {self.t_ns} ns is not valid JSON: the log is damaged"
            ) from error


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
                topics[record.id] = record.topic
            elif isinstance(record, Message):
                if record.channel_id not in topics:
                    raise LogError(
                        f"{self.path} is damaged: a message on an unknown channel {record.channel_id}"
                    )
                yield LogMessage(topics[record.channel_id], record.publish_time, record.data)

    def _read_header(self) -> tuple[dict[str, bytes], dict[str, str]]:
        attachments: dict[str, bytes] = {}
        metadata: dict[str, str] = {}
        for record in self._records():
            if isinstance(record, Attachment):
                attachments[record.name] = record.data
            elif isinstance(record, Metadata):
                metadata = dict(record.metadata)
            elif isinstance(record, Message):
                break
        return attachments, metadata

    def _records(self) -> Iterator[McapRecord]:
        try:
            stream = self.path.open("rb")
        except OSError as error:
            raise LogError(f"cannot read log {self.path}: {error.strerror}") from error
        with stream:
            reader = StreamReader(stream, validate_crcs=True, record_size_limit=RECORD_SIZE_LIMIT)
            try:
                for record in reader.records:
                    self.bytes_read = stream.tell()
                    if isinstance(record, DataEnd):
                        self.is_complete = True
                    yield record
            except EndOfFile:
                if stream.tell() == 0:
                    raise LogError(f"log {self.path} is empty") from None
            except CRCValidationError as error:
                raise LogError(
                    f"log {self.path} is damaged: its checksum does not match its content"
                ) from error
            except (McapError, struct.error, UnicodeDecodeError, ValueError, MemoryError) as error:
                if self.is_complete or not stream.read(1):
                    return  # only the index after the data is broken, or the last record was cut off
                raise LogError(f"log {self.path} is damaged or not an MCAP file: {error}") from error
