"""Overlay: trace and angle drawn into the frames."""

from pathlib import Path

import cv2
import numpy as np

from controllers.ftrace.estimator import TraceAngle
from controllers.ftrace.rig import RigGeometry
from controllers.ftrace.rig_geometry import project
from drivers.errors import ConfigError
from drivers.samples import Image

VIDEOS = {".mp4": "mp4v", ".avi": "MJPG"}
FOUND, KEPT = (0, 220, 0), (0, 160, 255)
LETTERS = cv2.FONT_HERSHEY_SIMPLEX
TEXT_ROWS = 32
"""Darkened, so that the text is readable on any ground."""


class OverlayWriter:
    """Writes a video (`.mp4`, `.avi`) or a folder of pictures.

    Args:
        path: Video file or folder to make; must not exist.
        rig: Calibration of the camera.
        frame_rate_hz: Of the video.

    Raises:
        ConfigError: The video cannot be written.
    """

    def __init__(self, path: Path, rig: RigGeometry, frame_rate_hz: float) -> None:
        self._path, self._rig = path, rig
        self._video: cv2.VideoWriter | None = None
        suffix = path.suffix.lower()
        if suffix not in VIDEOS:
            path.mkdir()
            return
        code = cv2.VideoWriter.fourcc(*VIDEOS[suffix])
        self._video = cv2.VideoWriter(str(path), code, frame_rate_hz, (rig.width, rig.height))
        if not self._video.isOpened():
            raise ConfigError(f"cannot write video {path.name}: choose another --overlay")

    def add(self, number: int, grey: Image, angle: TraceAngle, width_m: float) -> None:
        """Draw one frame."""
        picture = draw(grey, angle, self._rig, width_m)
        if self._video is not None:
            self._video.write(picture)
        else:
            cv2.imwrite(str(self._path / f"{number:05d}.png"), picture)

    def close(self) -> None:
        """Finish the video."""
        if self._video is not None:
            self._video.release()


def draw(grey: Image, angle: TraceAngle, rig: RigGeometry, width_m: float) -> Image:
    """Return the frame with the edges of the trace, green if detected and orange if kept, and its angle."""
    picture = cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR)
    text = "no trace"
    if angle.theta_rad is not None and angle.distance_m is not None:
        colour = FOUND if angle.detected else KEPT
        left = np.array([-np.sin(rig.steer_rad), np.cos(rig.steer_rad), 0.0])
        for side in (-0.5, 0.5):
            edge = angle.path_m + side * width_m * left
            pixels, ahead = project(rig, edge)
            line = np.round(pixels[ahead]).astype(np.int32).reshape(-1, 1, 2)
            cv2.polylines(picture, [line], isClosed=False, color=colour, thickness=2, lineType=cv2.LINE_AA)
        degrees = np.degrees(angle.theta_rad)
        text = f"theta {degrees:+.1f} deg  d {angle.distance_m:.3f} m  confidence {angle.confidence:.2f}"
    picture[:TEXT_ROWS] = picture[:TEXT_ROWS] // 3
    cv2.putText(picture, text, (8, 22), LETTERS, 0.6, (255, 255, 255), 1, cv2.LINE_AA)
    return np.asarray(picture, np.uint8)
