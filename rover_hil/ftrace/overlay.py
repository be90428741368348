"""Overlay: trace and angle drawn into the frames."""

from pathlib import Path
from typing import TypeAlias

import cv2
import numpy as np
from cv2.typing import MatLike

from controllers.ftrace.estimator import TraceAngle
from controllers.ground_motion.ground_patch import Floats, project
from controllers.ground_motion.rig import RigGeometry
from drivers.errors import ConfigError
from drivers.samples import Image

VIDEOS = {".mp4": "mp4v", ".avi": "MJPG"}
Colour: TypeAlias = tuple[int, int, int]
FOUND, KEPT = (0, 220, 0), (0, 160, 255)
LETTERS = cv2.FONT_HERSHEY_SIMPLEX
EDGE_POINTS = 24
TEXT_ROWS = 32
"""Darkened, so that the text is readable on any ground."""


class OverlayWriter:
    """Writes a video (`.mp4`, `.avi`) or a folder of pictures.

    Args:
        path: Video file or folder to make; must not exist.
        size: Width and height of the pictures.
        frame_rate_hz: Of the video.

    Raises:
        ConfigError: The video cannot be written.
    """

    def __init__(self, path: Path, size: tuple[int, int], frame_rate_hz: float) -> None:
        self._path = path
        self._video: cv2.VideoWriter | None = None
        suffix = path.suffix.lower()
        if suffix not in VIDEOS:
            path.mkdir()
            return
        code = cv2.VideoWriter.fourcc(*VIDEOS[suffix])
        self._video = cv2.VideoWriter(str(path), code, frame_rate_hz, size)
        if not self._video.isOpened():
            raise ConfigError(f"cannot write video {path.name}: choose another --overlay")

    def add(self, number: int, picture: Image) -> None:
        """Write the BGR picture of one frame."""
        if self._video is not None:
            self._video.write(picture)
        else:
            cv2.imwrite(str(self._path / f"{number:05d}.png"), picture)

    def close(self) -> None:
        """Finish the video."""
        if self._video is not None:
            self._video.release()


def draw_direction(picture: Image, theta_rad: float, rig: RigGeometry, *, detected: bool) -> None:
    """Draw the edges of the trace that an angle at the wheel's contact gives, into a BGR frame of the rig.

    The trace is drawn straight, as far back as the rig uses the ground.

    Args:
        picture: Shape (height, width, 3); changed.
        theta_rad: Angle of the wheel's velocity from its axis, counter-clockwise.
        rig: Calibration of the camera.
        detected: Green, else orange.
    """
    yaw_rad = rig.steer_rad + theta_rad
    forward, left = (
        np.array([np.cos(angle), np.sin(angle), 0.0]) for angle in (yaw_rad, yaw_rad + np.pi / 2)
    )
    back_m = np.linspace(0.0, rig.behind_m, EDGE_POINTS)[:, None]
    centre_m = rig.contact_m * (1.0, 1.0, 0.0) - back_m * forward
    _draw_edges(picture, centre_m, left, rig, rig.wheel_width_m, FOUND if detected else KEPT)


def draw(grey: Image, angle: TraceAngle, rig: RigGeometry, width_m: float) -> Image:
    """Return the frame with the edges of the trace, green if detected and orange if kept, and its angle."""
    picture = cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR)
    text = "no trace"
    if angle.theta_rad is not None and angle.distance_m is not None:
        colour = FOUND if angle.detected else KEPT
        left = np.array([-np.sin(rig.steer_rad), np.cos(rig.steer_rad), 0.0])
        _draw_edges(picture, angle.path_m, left, rig, width_m, colour)
        degrees = np.degrees(angle.theta_rad)
        text = f"theta {degrees:+.1f} deg  d {angle.distance_m:.3f} m  confidence {angle.confidence:.2f}"
    picture[:TEXT_ROWS] = picture[:TEXT_ROWS] // 3
    cv2.putText(picture, text, (8, 22), LETTERS, 0.6, (255, 255, 255), 1, cv2.LINE_AA)
    return np.asarray(picture, np.uint8)


def _draw_edges(
    picture: MatLike,
    centre_m: Floats,
    left: Floats,
    rig: RigGeometry,
    width_m: float,
    colour: tuple[int, int, int],
) -> None:
    for side in (-0.5, 0.5):
        pixels, ahead = project(rig, centre_m + side * width_m * left)
        line = np.round(pixels[ahead]).astype(np.int32).reshape(-1, 1, 2)
        cv2.polylines(picture, [line], isClosed=False, color=colour, thickness=2, lineType=cv2.LINE_AA)
