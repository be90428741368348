"""Frames of the cameras for the page: chosen by the loop, drawn and packed on the thread that sends them."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from controllers.ftrace.reading import TraceReading
from controllers.ground_motion.rig import RigGeometry
from drivers.clock import NANOSECONDS_PER_SECOND
from drivers.samples import FrameSample, Image
from rover_hil.bench.views import Picture
from rover_hil.run.executive import CycleView

PERIOD_NS = NANOSECONDS_PER_SECOND // 6
WIDEST = 800
"""Wider frames are shown with every second pixel."""
JPEG_QUALITY = 75


@dataclass(frozen=True, slots=True)
class CameraFrame:
    """A frame to be shown.

    Attributes:
        image: As in `FrameSample`.
        reading: The trace in it, or None.
        rig: Calibration of the camera; None without one.
    """

    camera: str
    image: Image
    reading: TraceReading | None
    rig: RigGeometry | None


class FrameChoice:
    """Chooses at most six frames per second of each camera.

    A frame of the rear camera waits for its trace, which comes some cycles later, until the next frame at the
    latest.

    Args:
        rear_camera: The camera of the rig, or None.
        rig: Its calibration, or None.
    """

    def __init__(self, rear_camera: str | None, rig: RigGeometry | None) -> None:
        self._rear_camera = rear_camera
        self._rig = rig
        self._waiting: FrameSample | None = None
        self._next_ns: dict[str, int] = {}

    def choose(self, view: CycleView) -> Iterator[CameraFrame]:
        """Yield the frames to be shown after a cycle."""
        for sample in view.samples:
            if not isinstance(sample, FrameSample) or sample.t_ns < self._next_ns.get(sample.device, 0):
                continue
            self._next_ns[sample.device] = sample.t_ns + PERIOD_NS
            if sample.device != self._rear_camera or self._rig is None:
                yield CameraFrame(sample.device, sample.image, None, None)
            else:
                if self._waiting is not None:
                    yield CameraFrame(sample.device, self._waiting.image, None, self._rig)
                self._waiting = sample
        reading = None if view.output.scomp is None else view.output.scomp.trace
        if self._waiting is not None and reading is not None and reading.t_ns == _time_ns(self._waiting):
            yield CameraFrame(self._waiting.device, self._waiting.image, reading, self._rig)
            self._waiting = None


def pack(frame: CameraFrame) -> Picture:
    """Return a frame as JPEG, with the edges of its trace."""
    # Only where frames are: OpenCV takes long to load.
    import cv2

    from rover_hil.ftrace.overlay import draw_direction

    image, words = frame.image, "no trace"
    reading, rig = frame.reading, frame.rig
    if rig is not None and reading is not None and reading.theta_rad is not None:
        image = np.repeat(image[..., None], 3, axis=2) if image.ndim == 2 else image.copy()
        draw_direction(image, reading.theta_rad, rig, detected=reading.detected)
        angle_deg = math.degrees(reading.theta_rad)
        words = f"{angle_deg:+.1f} deg from {reading.source}, confidence {reading.confidence:.2f}"
    if image.shape[1] > WIDEST:
        image = image[::2, ::2]
    _, jpeg = cv2.imencode(".jpg", image, (cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY))
    return {
        "kind": "picture",
        "camera": frame.camera,
        "words": "" if rig is None else words,
        "jpeg": jpeg.tobytes(),
    }


def _time_ns(frame: FrameSample) -> int:
    return frame.t_ns if frame.t_capture_ns is None else frame.t_capture_ns
