"""Write a run to one MCAP file that can be read even when the program was killed in the middle.

What is noted is turned into text, compressed and written by a thread of the log, in chunks of less than a
second. The loop only keeps what it hands over, and does not wait for the disk unless that hangs for seconds.
The layout is described in `docs/reference/log_format.md`.
"""

import errno
import os
import threading
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, Protocol, Self, TypeAlias

from controllers.control_loop import StepOutput
from drivers.clock import NANOSECONDS_PER_SECOND, seconds, stopwatch_ns, wall_time_ns
from drivers.driver import Health
from drivers.errors import LogError
from drivers.files import ATTACHMENTS_BYTES, MEGABYTE
from drivers.link import CameraImage, LinkChange, LinkItem
from drivers.samples import Sample
from rover_hil.recording import views
from rover_hil.recording.chunked_file import CHUNK_NS, ChunkedFile
from rover_hil.recording.images import picture_record, pixels_of
from rover_hil.recording.json_schema import topic_schema
from rover_hil.recording.made_with import made_with
from rover_hil.recording.schema import (
    BYTES,
    CAMERA,
    CONFIG_ATTACHMENT,
    ESTIMATE,
    HEALTH,
    LINK,
    LOG_SCHEMA,
    SAMPLES,
    TRUTH,
    VIEW_DIAGNOSTICS,
    VIEW_LOG,
    VIEW_PATH,
    VIEW_POSE,
    VIEW_TRUE_POSE,
    WATCHDOG,
    health_record,
)
from rover_hil.recording.text import estimate_text, quoted, samples_text, strict_json, truth_text

VIEW_PERIOD_NS = NANOSECONDS_PER_SECOND // 5
Mirror: TypeAlias = Callable[[str, int, bytes], None]

WAKE_S = 0.02
"""The log's thread wakes this often; work in small portions never keeps the loop waiting."""
LONGEST_PAUSE_NS = 2 * NANOSECONDS_PER_SECOND
"""When nothing could be written for so long, the loop waits between two cycles, and the watchdog stops the
drive: the rover does not drive on without its log. Shorter pauses of a disk cost nothing."""
AWAKE_AFTER_WAITS = 20
"""Where the program itself was stopped, the thread of the log wakes within so many `WAKE_S`: no disk hung."""
MOST_ITEMS = 20_000
MOST_PICTURES = 64
"""When more records or pictures wait to be written, whoever notes one waits too, for the memory."""
MOST_PAYLOAD_CHARACTERS = 500_000
"""Of one record; a record of a log has a limit."""


class TruePose(Protocol):
    """The part of a simulated rover's true state that is drawn."""

    @property
    def x_m(self) -> float:
        """Forward from the start."""
        ...

    @property
    def y_m(self) -> float:
        """Left of the start."""
        ...

    @property
    def yaw_rad(self) -> float:
        """Counter-clockwise."""
        ...


class LogWriter:
    """A log being written; also the tap that sees raw data before it is parsed.

    When the file cannot be written, every method that writes raises LogError within a second and from then
    on: a run must not go on without its log. What was written before can be read as after a crash.

    Args:
        path: The file; must not exist.
        start_ns: Monotonic time of the start, the origin of the run.
        config_json: The effective configuration.
        attachments: Data files that the configuration names, by the name they get in the log.
        origin: What made this log: "virtual", "real", or what was imported.
        final_path: Where the file is moved to while it is written, for messages.
        mirror: Gets each record too, in the log's thread: topic, time in ns since 1970, JSON. It must return
            at once.
        wall_start_ns: Time of the start in ns since 1970; the present by default.

    Attributes:
        on_wait: Called again and again while someone who notes a record must wait; it must note none.

    Raises:
        FileExistsError: `path` exists; a log is never overwritten.
        LogError: The file cannot be written, or could not be read: the configuration and its data files are
            larger than a log may hold.
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
        mirror: Mirror | None = None,
        wall_start_ns: int | None = None,
    ) -> None:
        self._path = final_path or path
        _check_attached(self._path, {CONFIG_ATTACHMENT: config_json, **attachments})
        self._stream = path.open("xb")
        self.on_wait: Callable[[], None] = lambda: None
        self._failure = ""
        self._mirror = mirror
        self._wall_offset_ns = (wall_time_ns() if wall_start_ns is None else wall_start_ns) - start_ns
        self._channels: dict[str, int] = {}
        self._payloads: list[str] = []
        self._payload_characters = 0
        self._payload_ns = 0
        self._items: deque[_Item] = deque()
        self._alive_ns = stopwatch_ns()
        self._is_awaited = False
        self._pause_ns = 0
        self._longest_pause_ns = 0
        self._is_ending = threading.Event()
        self._has_room = threading.Event()
        self._picture_room = threading.Semaphore(MOST_PICTURES)
        self._close_lock = threading.Lock()
        self._next_views_ns = {VIEW_POSE: start_ns, VIEW_TRUE_POSE: start_ns}
        self._shown = ("", "")
        self._is_suspected = False
        try:
            self._file = ChunkedFile(self._stream, "rover_hil")
            self._file.add_metadata(
                "rover_hil",
                {
                    "schema": LOG_SCHEMA,
                    "start_ns": str(start_ns),
                    "origin": origin,
                    "wall_offset_ns": str(self._wall_offset_ns),
                    **made_with(),
                },
            )
            for name, data in {CONFIG_ATTACHMENT: config_json, **attachments}.items():
                self._file.add_attachment(name, self._wall_offset_ns + start_ns, data)
            self._file.flush()
        except OSError as error:
            raise self._give_up(error) from error
        self._thread = threading.Thread(target=self._run, name="log", daemon=True)
        self._thread.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """Finish the file; may be called again, also after it could not be written.

        Raises:
            LogError: The end of the file cannot be written.
        """
        with self._close_lock:
            if self._stream.closed:
                return
            had_failed = bool(self._failure)
            self._is_ending.set()
            self._thread.join()
            try:
                self._stream.close()
            except OSError as error:
                self._note_failure(error)
            if self._failure and not had_failed:
                raise LogError(self._failure)

    def wait_while_disk_hangs(self, is_ended: Callable[[], bool]) -> None:
        """Return at once while the file is written; else, after two seconds, not before it is again.

        For the loop, between two cycles: what the watchdog notes meanwhile must not wait.

        Args:
            is_ended: Asked again and again whether someone has ended the run meanwhile: then nothing waits.
        """
        waits = 0
        while (pause_ns := stopwatch_ns() - self._alive_ns) > LONGEST_PAUSE_NS and self._thread.is_alive():
            if is_ended():
                self._longest_pause_ns = max(self._longest_pause_ns, pause_ns)
                return
            waits += 1
            self._is_awaited = waits > AWAKE_AFTER_WAITS
            self.on_wait()
            self._has_room.clear()
            self._has_room.wait(WAKE_S)

    @property
    def longest_pause_s(self) -> float:
        """Longest time in which nothing could be written, in s, of those that made the loop wait; else 0."""
        return seconds(self._longest_pause_ns)

    def require_file(self) -> None:
        """Check that the file is still in a folder.

        Raises:
            LogError: It has been deleted; what is written to it is lost.
        """
        if self._stream.closed or os.fstat(self._stream.fileno()).st_nlink > 0:
            return
        self._failure = f"log {self._path} was deleted during the run: start again, with another --out"
        raise LogError(self._failure)

    def received(self, device: str, item: LinkItem[bytes] | LinkItem[CameraImage]) -> None:
        """Note what arrived from a device."""
        if isinstance(item, LinkChange):
            self._note((LogWriter._put_link, device, item.t_ns, item))
        elif isinstance(item.payload, CameraImage):
            self._wait_for_pictures()
            self._note((LogWriter._put_picture, device, item.t_ns, item.payload))
        else:
            self._note((LogWriter._put_received, device, item.t_ns, item.payload))

    def sent(self, device: str, t_ns: int, payload: bytes, delivered: bool) -> None:
        """Note what was sent to a device, or could not be."""
        self._note((LogWriter._put_sent if delivered else LogWriter._put_unsent, device, t_ns, payload))

    def samples(self, t_ns: int, samples: Sequence[Sample]) -> None:
        """Note decoded samples; they are kept until they are written and must not change."""
        if samples:
            self._note((LogWriter._put_samples, SAMPLES, t_ns, samples))

    def estimate(self, output: StepOutput) -> None:
        """Note everything that a cycle computed."""
        self._note((LogWriter._put_estimate, ESTIMATE, output.t_ns, output))

    def truth(self, t_ns: int, truth: TruePose) -> None:
        """Note the true state of a simulated rover; it must not change."""
        self._note((LogWriter._put_truth, TRUTH, t_ns, truth))

    def health(self, t_ns: int, healths: Sequence[Health]) -> None:
        """Note the health facts of all devices."""
        self.write_json(HEALTH, t_ns, {"devices": [health_record(health) for health in healths]})
        diagnostics = views.diagnostics_view(self._wall_offset_ns + t_ns, healths)
        self._note((LogWriter._put_text, VIEW_DIAGNOSTICS, t_ns, diagnostics))

    def watchdog(self, t_ns: int) -> None:
        """Note that the watchdog stopped the drive."""
        self.write_json(WATCHDOG, t_ns, {"t_ns": t_ns})
        self._note_event(t_ns, views.WARNING, "watchdog", "the watchdog stopped the drive")

    def path(self, t_ns: int, points_m: Sequence[tuple[float, float]]) -> None:
        """Note the corners of the planned path, for viewers."""
        data = views.path_view(self._wall_offset_ns + t_ns, points_m)
        self._note((LogWriter._put_text, VIEW_PATH, t_ns, data))

    def write_json(self, topic: str, t_ns: int, record: object) -> None:
        """Write one record as JSON; dataclasses, mappings, sequences and numbers are allowed."""
        self._note((LogWriter._put_text, topic, t_ns, strict_json(record)))

    def _note(self, item: "_Item") -> None:
        if self._failure:
            raise LogError(self._failure)
        if self._stream.closed:
            return
        self._items.append(item)
        while len(self._items) > MOST_ITEMS and self._thread.is_alive():
            self.on_wait()
            self._has_room.clear()
            self._has_room.wait(WAKE_S)

    def _wait_for_pictures(self) -> None:
        while not self._picture_room.acquire(timeout=WAKE_S):
            self.on_wait()
            if not self._thread.is_alive():
                return

    def _note_event(self, t_ns: int, level: int, name: str, message: str) -> None:
        data = views.log_view(self._wall_offset_ns + t_ns, level, name, message)
        self._note((LogWriter._put_text, VIEW_LOG, t_ns, data))

    def _run(self) -> None:
        """Write what is noted until the log is closed; the body of the thread."""
        try:
            idle_s = 0.0
            is_ending = False
            while not is_ending:
                is_ending = self._is_ending.wait(WAKE_S)
                self._note_alive()
                self._write_items()
                # In time of the clock on the wall: what a caller that hangs has noted survives a kill, too.
                idle_s += WAKE_S
                if idle_s >= CHUNK_NS / NANOSECONDS_PER_SECOND:
                    idle_s = 0.0
                    self._file.flush()
            self._write_payloads()
            self._file.finish()
        except OSError as error:
            self._note_failure(error)
        except MemoryError:
            self._failure = (
                f"cannot write log {self._path}: no memory is left; `rover-hil replay {self._path} "
                "--out FOLDER` reports what was written"
            )
        except Exception as error:  # noqa: BLE001 - the caller must get every error
            self._note_failure(OSError(errno.EIO, str(error) or repr(error)))
        self._items.clear()
        self._has_room.set()

    def _write_items(self) -> None:
        items = self._items
        for _ in range(len(items)):
            put, name, t_ns, content = items.popleft()
            put(self, name, t_ns, content)
            self._note_alive()
            if self._pause_ns:
                text = f"nothing could be written for {seconds(self._pause_ns):.1f} s"
                self._put_event(t_ns, views.WARNING, "log", text)
                self._pause_ns = 0
            if len(items) < MOST_ITEMS:
                self._has_room.set()

    def _note_alive(self) -> None:
        """Note that the thread works, and a pause that was too long."""
        now_ns = stopwatch_ns()
        pause_ns, self._alive_ns = now_ns - self._alive_ns, now_ns
        if pause_ns > LONGEST_PAUSE_NS and self._is_awaited:
            self._is_awaited = False
            self._pause_ns = pause_ns
            self._longest_pause_ns = max(self._longest_pause_ns, pause_ns)

    def _put_received(self, device: str, t_ns: int, payload: bytes) -> None:
        self._put_payload("received", device, t_ns, payload)

    def _put_sent(self, device: str, t_ns: int, payload: bytes) -> None:
        self._put_payload("sent", device, t_ns, payload)

    def _put_unsent(self, device: str, t_ns: int, payload: bytes) -> None:
        self._put_payload("unsent", device, t_ns, payload)

    def _put_payload(self, kind: str, device: str, t_ns: int, payload: bytes) -> None:
        text = f'{{"device":{quoted(device)},"kind":"{kind}","t_ns":{t_ns},"hex":"{payload.hex()}"}}'
        if self._payload_characters + len(text) > MOST_PAYLOAD_CHARACTERS:
            self._write_payloads()
        self._payloads.append(text)
        self._payload_characters += len(text)
        self._payload_ns = max(self._payload_ns, t_ns)

    def _write_payloads(self) -> None:
        if self._payloads:
            data = f'{{"payloads":[{",".join(self._payloads)}]}}'.encode()
            self._payloads.clear()
            self._payload_characters = 0
            self._add(BYTES, self._payload_ns, data)
            self._payload_ns = 0

    def _put_text(self, topic: str, t_ns: int, data: bytes) -> None:
        # A replay feeds what arrived before a cycle's other records.
        self._write_payloads()
        self._add(topic, t_ns, data)

    def _put_samples(self, topic: str, t_ns: int, samples: Sequence[Sample]) -> None:
        self._put_text(topic, t_ns, samples_text(samples))

    def _put_estimate(self, topic: str, t_ns: int, output: StepOutput) -> None:
        self._put_text(topic, t_ns, estimate_text(output))
        self._put_pose(VIEW_POSE, t_ns, views.FRAME, output.estimate)
        shown = (output.mode.value, output.reason)
        if shown != self._shown:
            self._shown = shown
            level = views.WARNING if output.reason else views.INFORMATION
            self._put_event(t_ns, level, "mode", ": ".join(filter(None, shown)))
        if output.suspicion and not self._is_suspected:
            self._put_event(t_ns, views.WARNING, "suspicion", output.suspicion)
        self._is_suspected = bool(output.suspicion)

    def _put_truth(self, topic: str, t_ns: int, truth: TruePose) -> None:
        self._put_text(topic, t_ns, truth_text(truth))
        self._put_pose(VIEW_TRUE_POSE, t_ns, views.TRUE_FRAME, truth)

    def _put_link(self, device: str, t_ns: int, change: LinkChange) -> None:
        self._put_text(f"{LINK}{device}", t_ns, strict_json(change))
        word = "up" if change.up else "down"
        self._put_event(t_ns, views.WARNING, device, f"link {word}: {change.reason}")

    def _put_picture(self, device: str, t_ns: int, image: CameraImage) -> None:
        record = picture_record(device, self._wall_offset_ns + t_ns, image)
        self._write_payloads()
        self._add(f"{CAMERA}{device}", t_ns, strict_json(record), pixels_of(image))
        self._picture_room.release()

    def _put_pose(self, topic: str, t_ns: int, frame: str, pose: TruePose) -> None:
        if t_ns >= self._next_views_ns[topic]:
            self._next_views_ns[topic] = t_ns + VIEW_PERIOD_NS
            time_ns = self._wall_offset_ns + t_ns
            self._add(topic, t_ns, views.pose_view(time_ns, frame, pose.x_m, pose.y_m, pose.yaw_rad))

    def _put_event(self, t_ns: int, level: int, name: str, message: str) -> None:
        self._add(VIEW_LOG, t_ns, views.log_view(self._wall_offset_ns + t_ns, level, name, message))

    def _add(self, topic: str, t_ns: int, data: bytes, pixels: int = 0) -> None:
        channel = self._channels.get(topic)
        if channel is None:
            schema = topic_schema(topic)
            channel = self._channels[topic] = self._file.add_channel(topic, schema.name, schema.text)
        time_ns = self._wall_offset_ns + t_ns
        self._file.add_message(channel, time_ns, data, pixels)
        if self._mirror is not None:
            self._mirror(topic, time_ns, data)

    def _note_failure(self, error: OSError) -> None:
        if not self._failure:
            self._failure = (
                f"cannot write log {self._path}: {error.strerror}; make room, or choose another --out"
            )

    def _give_up(self, error: OSError) -> LogError:
        self._note_failure(error)
        with suppress(OSError):
            self._stream.close()
        return LogError(self._failure)


def _check_attached(path: Path, attachments: Mapping[str, bytes]) -> None:
    size_bytes = sum(len(name) + len(data) for name, data in attachments.items())
    if size_bytes > ATTACHMENTS_BYTES:
        limit = f"{ATTACHMENTS_BYTES / MEGABYTE:g} MB"
        raise LogError(
            f"cannot write log {path}: the configuration and the data files that it names hold "
            f"{size_bytes / MEGABYTE:.1f} MB, the limit is {limit}; use smaller ones"
        )


_Item: TypeAlias = tuple[Callable[[LogWriter, str, int, Any], None], str, int, Any]
"""What writes it, the device or topic, the time in ns, and the content."""
