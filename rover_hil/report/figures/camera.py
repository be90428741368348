"""Frames of the camera at events of a run, with the edges of the wheel's trace."""

import base64
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from drivers.camera.settings import CameraSettings
from drivers.errors import LogError
from drivers.samples import Image
from rover_hil.recording.images import capture_time_ns, decode_image
from rover_hil.recording.reader import LogMessage, LogReader
from rover_hil.recording.schema import RAW
from rover_hil.report.run_data import RunData
from rover_hil.report.summary import Summary
from rover_hil.report.tracks import Series

MOST_STOPS = 4
JPEG_QUALITY = 70
SAME_FRAME_S = 1e-3
WIDEST = 800
"""Wider frames are shown with every second pixel."""


class Event(NamedTuple):
    """What happened when."""

    t_s: float
    words: str


class CameraPicture(NamedTuple):
    """A frame at an event, as an address that holds it, "" for none; `trace` describes the trace in it."""

    words: str
    camera: str
    trace: str
    source: str


def camera_pictures(run: RunData, summary: Summary) -> list[CameraPicture]:
    """Return the newest frame at each event, in the order of time; none for a rover without a camera.

    The camera is that of `roles.camera`, else the first one. The trace is drawn as the angle found in the
    frame gives it.

    Raises:
        LogError: The log cannot be read again.
    """
    cameras = [name for name, device in run.config.devices.items() if isinstance(device, CameraSettings)]
    if not cameras:
        return []
    camera = run.config.roles.camera or cameras[0]
    log = LogReader(run.path)
    pictures = []
    for event, message in _frames_at(log, f"{RAW}{camera}", _events(run, summary)):
        words = f"{event.t_s:.1f} s: {event.words}"
        frame = _frame(message)
        if frame is None:
            pictures.append(CameraPicture(words, camera, "the frame cannot be decoded", ""))
            continue
        taken_ns = capture_time_ns(message.data)
        t_ns = message.t_ns if taken_ns is None else taken_ns
        angle_rad = _angle_at(run, (t_ns - log.start_ns) / 1e9)
        pictures.append(CameraPicture(words, camera, *_picture(run, camera, frame, angle_rad)))
    return pictures


def _frame(message: LogMessage) -> Image | None:
    """Return the pixels of a frame; None for one that came damaged, or is damaged in the log."""
    try:
        frame = decode_image(message.data).image
    except LogError:
        return None
    return frame if frame.size else None


def _events(run: RunData, summary: Summary) -> list[Event]:
    events = [
        Event(stop.start_s, f"safety stop: {'; '.join(stop.reasons)}") for stop in summary.stops[:MOST_STOPS]
    ]
    if run.drift is not None:
        for words, series, factor, unit in (
            ("largest slip", run.drift.slip, 100.0, "%"),
            ("largest slip angle", run.drift.angle, float(np.degrees(1.0)), "deg"),
        ):
            largest = _largest(series, run.drift.reasons)
            if largest is not None:
                events.append(Event(largest[0], f"{words}, {factor * largest[1]:.0f} {unit}"))
    events.append(Event(run.duration_s, "end of the run"))
    return sorted(events)


def _largest(series: Series, reasons: Sequence[str]) -> tuple[float, float] | None:
    """Return time and value of the largest magnitude where nothing makes it unsure."""
    if len(reasons) != len(series.t_s):
        return None
    values = np.where([not reason for reason in reasons], np.abs(series.value), 0.0)
    if not values.any():
        return None
    index = int(np.argmax(values))
    return float(series.t_s[index]), float(series.value[index])


def _frames_at(log: LogReader, topic: str, events: Sequence[Event]) -> Iterator[tuple[Event, LogMessage]]:
    """Yield the newest frame at or before each event, or the first one."""
    waiting = list(events)
    newest: LogMessage | None = None
    for message in log.messages():
        if message.topic != topic:
            continue
        t_s = (message.t_ns - log.start_ns) / 1e9
        while waiting and t_s > waiting[0].t_s:
            yield waiting.pop(0), newest or message
        if not waiting:
            return
        newest = message
    if newest is not None:
        for event in waiting:
            yield event, newest


def _angle_at(run: RunData, t_s: float) -> float | None:
    """Return the angle of the trace that was found in the frame of a time; None without one."""
    if run.drift is None or not len(run.drift.trace.t_s):
        return None
    trace = run.drift.trace
    index = int(np.argmin(np.abs(trace.t_s - t_s)))
    return float(trace.value[index]) if abs(trace.t_s[index] - t_s) < SAME_FRAME_S else None


def _picture(run: RunData, camera: str, frame: Image, angle_rad: float | None) -> tuple[str, str]:
    """Return what is known of the trace in a frame, and the frame with it, as an address that holds it."""
    # Only for rovers with a camera: OpenCV takes long to load.
    import cv2

    from rover_hil.ftrace.overlay import draw_direction

    rig = None if run.config.scomp is None else run.config.scomp.rig
    trace = ""
    if rig is not None and camera == run.config.roles.camera:
        trace = "no trace found in it"
        if angle_rad is not None and frame.shape[:2] == (rig.image.height, rig.image.width):
            frame = np.repeat(frame[..., None], 3, axis=2) if frame.ndim == 2 else frame.copy()
            draw_direction(frame, angle_rad, rig.geometry(), detected=True)
            trace = f"trace at {np.degrees(angle_rad):+.1f} deg"
    if frame.shape[1] > WIDEST:
        frame = frame[::2, ::2]
    _, jpeg = cv2.imencode(".jpg", frame, (cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY))
    return trace, f"data:image/jpeg;base64,{base64.b64encode(jpeg.tobytes()).decode()}"
