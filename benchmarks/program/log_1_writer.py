"""The writer of `rover-hil-log/1` as it was in commit f273483, the peer of `benchmarks.program.log_cost`.

Messages are not chunked: each goes to the file as it is, and the file is flushed ten times a second, so
a killed run loses at most the last tenth of a second. The layout is described in
`docs/reference/log_format.md`.
"""

import os
import struct
import threading
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Self

from mcap.writer import Writer
from pydantic_core import to_json

from drivers.clock import wall_time_ns
from drivers.driver import Health
from drivers.errors import LogError
from drivers.link import CameraImage, LinkChange, LinkItem
from drivers.samples import FrameSample, Sample
from rover_hil.recording.schema import (
    CONFIG_ATTACHMENT,
    HEALTH,
    LINK,
    RAW,
    SAMPLES,
    SENT,
    UNSENT,
    frame_record,
    health_record,
)

FLUSH_PERIOD_NS = 100_000_000

JSON_SCHEMA = b'{"type":"object"}'


def _bitmap(image: CameraImage) -> bytes:
    import cv2

    stamp = struct.pack("<q", -1 if image.t_capture_ns is None else image.t_capture_ns)
    return stamp + cv2.imencode(".bmp", image.image)[1].tobytes()


class LogWriter:
    """A log being written; also the tap that sees raw data before it is parsed.

    When the file cannot be written, every method that writes raises LogError from then on: a run must not go
    on without its log. What was written before can be read as after a crash.

    Args:
        path: The file; must not exist.
        start_ns: Monotonic time of the start, the origin of the run.
        config_json: The effective configuration.
        attachments: Data files that the configuration names, by the name they get in the log.
        origin: What made this log: "virtual", "real", or what was imported.
        final_path: Where the file is moved to while it is written, for messages.

    Raises:
        FileExistsError: `path` exists; a log is never overwritten.
    """

    def __init__(
        self,
        path: Path,
        start_ns: int,
        config_json: bytes,
        attachments: Mapping[str, bytes],
        origin: str,
        *,
        final_path: Path | None = None,
    ) -> None:
        self._path = final_path or path
        self._stream = path.open("xb")
        self._failure = ""
        self._lock = threading.Lock()
        self._wall_offset_ns = wall_time_ns() - start_ns
        self._next_flush_ns = start_ns
        self._channels: dict[str, int] = {}
        # The index of a killed run is lost anyway, and the data checksum finds corruption on reading.
        self._writer = Writer(self._stream, use_chunking=False, enable_data_crcs=True)
        self._writer.start(profile="", library="rover_hil")
        # An empty schema is still one: PlotJuggler refuses a log with channels that have none.
        self._schema_ids = {
            "json": self._writer.register_schema("object", "jsonschema", JSON_SCHEMA),
            "raw": self._writer.register_schema("raw", "", b""),
        }
        self._writer.add_metadata(
            "rover_hil",
            {"schema": "rover-hil-log/1", "start_ns": str(start_ns), "origin": origin},
        )
        for name, data in {CONFIG_ATTACHMENT: config_json, **attachments}.items():
            self._writer.add_attachment(0, self._wall_offset_ns + start_ns, name, "", data)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """Finish the file; may be called again, also after it could not be written.

        Raises:
            LogError: The end of the file cannot be written.
        """
        with self._lock:
            if self._stream.closed:
                return
            try:
                self._writer.finish()  # type: ignore[no-untyped-call]
                self._stream.close()
            except OSError as error:
                raise self._give_up(error) from error

    def require_file(self) -> None:
        """Check that the file is still in a folder.

        Raises:
            LogError: It has been deleted; what is written to it is lost.
        """
        with self._lock:
            if self._stream.closed or os.fstat(self._stream.fileno()).st_nlink > 0:
                return
            self._failure = f"log {self._path} was deleted during the run: start again, with another --out"
            raise LogError(self._failure)

    def received(self, device: str, item: LinkItem[bytes] | LinkItem[CameraImage]) -> None:
        """Note what arrived from a device."""
        if isinstance(item, LinkChange):
            self.write_json(f"{LINK}{device}", item.t_ns, item)
            return
        payload = item.payload
        data = _bitmap(payload) if isinstance(payload, CameraImage) else payload
        self._write(f"{RAW}{device}", item.t_ns, data, encoding="raw")

    def sent(self, device: str, t_ns: int, payload: bytes, delivered: bool) -> None:
        """Note what was sent to a device, or could not be."""
        topic = SENT if delivered else UNSENT
        self._write(f"{topic}{device}", t_ns, payload, encoding="raw")

    def samples(self, t_ns: int, samples: Sequence[Sample]) -> None:
        """Note decoded samples."""
        record = _samples_record(samples)
        if record:
            self.write_json(SAMPLES, t_ns, record)

    def health(self, t_ns: int, healths: Sequence[Health]) -> None:
        """Note the health facts of all devices."""
        self.write_json(HEALTH, t_ns, [health_record(health) for health in healths])

    def write_json(self, topic: str, t_ns: int, record: object) -> None:
        """Write one record as JSON; dataclasses, mappings, sequences and numbers are allowed."""
        self._write(topic, t_ns, to_json(record), encoding="json")

    def _write(self, topic: str, t_ns: int, data: bytes, *, encoding: str) -> None:
        with self._lock:
            if self._failure:
                raise LogError(self._failure)
            if self._stream.closed:
                return
            try:
                self._write_message(topic, t_ns, data, encoding)
            except OSError as error:
                raise self._give_up(error) from error

    def _write_message(self, topic: str, t_ns: int, data: bytes, encoding: str) -> None:
        channel = self._channels.get(topic)
        if channel is None:
            schema_id = self._schema_ids[encoding]
            channel = self._channels[topic] = self._writer.register_channel(topic, encoding, schema_id)
        self._writer.add_message(channel, self._wall_offset_ns + t_ns, data, t_ns)
        if t_ns >= self._next_flush_ns:
            self._stream.flush()
            self._next_flush_ns = t_ns + FLUSH_PERIOD_NS

    def _give_up(self, error: OSError) -> LogError:
        # Nothing more goes to the file: a whole record after half a one would be damage in the middle.
        with suppress(OSError):
            self._stream.close()
        self._failure = f"cannot write log {self._path}: {error.strerror}; make room, or choose another --out"
        return LogError(self._failure)


def _samples_record(samples: Sequence[Sample]) -> dict[str, list[object]]:
    """Return samples grouped by kind; of a camera frame only what surrounds the pixels."""
    grouped: dict[str, list[object]] = {}
    for sample in samples:
        record = frame_record(sample) if isinstance(sample, FrameSample) else sample
        grouped.setdefault(type(sample).__name__, []).append(record)
    return grouped
