"""A first, simple scene: sandy ground and the trace of one wheel, seen by a camera above that wheel.

What it leaves out: the ground is flat and parallel to the rover's body (no pitch, roll or sinkage in the
picture) and repeats after about 1.5 m; the trace is an evenly darker strip without lugs, rims or fading, and
only its last 2.5 m are seen; there are no shadows, stones or parts of the rover.
"""

import math
from collections import deque
from typing import TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.errors import ConfigError
from drivers.samples import Image
from sim_backends.camera import CameraEmulatorSettings
from sim_backends.ground_texture import sand_texture
from sim_backends.plant import Truth

Matrix: TypeAlias = NDArray[np.float64]

TEXTURE_SIZE = 1024
METRES_PER_TEXEL = 0.0015
TRACE_STEP_M = 0.01
TRACE_POINTS = 256
TRACE_DARKENING = 45
CLOSEST_DEPTH_M = 0.05
FARTHEST_DEPTH_M = 3.0
NOISE_SHIFT = 64
SUBPIXEL_BITS = 4


def ground_to_image(emulator: CameraEmulatorSettings, width: int, height: int) -> Matrix:
    """Return the homography from ground points (x, y, 1) in m, x forward, y left, to pixels.

    The third component of its result is the depth along the optical axis in m.
    """
    tilt = math.radians(emulator.tilt_deg)
    focal_px = width / 2 / math.tan(math.radians(emulator.horizontal_view_deg) / 2)
    intrinsics = np.array([[focal_px, 0, (width - 1) / 2], [0, focal_px, (height - 1) / 2], [0, 0, 1]])
    axes = np.array([[0, 1, 0], [math.sin(tilt), 0, -math.cos(tilt)], [-math.cos(tilt), 0, -math.sin(tilt)]])
    relative = np.array(
        [[1, 0, -emulator.wheel_x_m], [0, 1, -emulator.wheel_y_m], [0, 0, -emulator.height_m]]
    )
    return np.asarray(intrinsics @ axes @ relative)


class GroundScene:
    """The ground as the rover moves over it.

    Args:
        emulator: Where the camera is.
        width: Width of the picture in pixels.
        height: Height of the picture in pixels.
        rng: Makes the ground and the noise of the pixels.

    Raises:
        ConfigError: The horizon is in view.
    """

    def __init__(
        self, emulator: CameraEmulatorSettings, width: int, height: int, rng: np.random.Generator
    ) -> None:
        self._size = (width, height)
        self._rng = rng
        self._ground_to_image = ground_to_image(emulator, width, height)
        margin = math.ceil(_reach_m(self._ground_to_image, self._size) / METRES_PER_TEXEL)
        self._texture = np.pad(sand_texture(TEXTURE_SIZE, rng), margin, mode="wrap")
        first_m = -margin * METRES_PER_TEXEL
        self._texel_to_world = np.array(
            [[METRES_PER_TEXEL, 0, first_m], [0, METRES_PER_TEXEL, first_m], [0, 0, 1]]
        )
        noise = rng.normal(0, emulator.noise_grey, (height + NOISE_SHIFT, width + NOISE_SHIFT))
        self._noise = np.round(noise).astype(np.int16)
        half_m = emulator.trace_width_m / 2
        self._wheel_edges = np.array(
            [
                [emulator.wheel_x_m, emulator.wheel_x_m],
                [emulator.wheel_y_m + half_m, emulator.wheel_y_m - half_m],
                [1, 1],
            ]
        )
        self._trace: deque[Matrix] = deque(maxlen=TRACE_POINTS)

    def render(self, truth: Truth) -> Image:
        """Return the picture, BGR, from where the rover is; the trace grows from call to call."""
        tile_m = TEXTURE_SIZE * METRES_PER_TEXEL
        tile_to_body = np.linalg.inv(_body_to_world(truth.x_m % tile_m, truth.y_m % tile_m, truth.yaw_rad))
        texel_to_image = self._ground_to_image @ tile_to_body @ self._texel_to_world
        grey = np.asarray(cv2.warpPerspective(self._texture, texel_to_image, self._size), np.uint8)
        grey = np.where(self._draw_trace(truth), grey - np.minimum(grey, TRACE_DARKENING), grey)
        width, height = self._size
        row, column = self._rng.integers(0, NOISE_SHIFT, 2)
        noise = self._noise[row : row + height, column : column + width]
        noisy = cv2.add(grey, noise, dtype=cv2.CV_8U)
        return np.asarray(cv2.cvtColor(noisy, cv2.COLOR_GRAY2BGR), np.uint8)

    def _draw_trace(self, truth: Truth) -> NDArray[np.bool_]:
        """Return which pixels see the trace, and note where the wheel is now."""
        body_to_world = _body_to_world(truth.x_m, truth.y_m, truth.yaw_rad)
        edges = body_to_world @ self._wheel_edges
        if not self._trace or np.linalg.norm((edges - self._trace[-1]).mean(axis=1)) >= TRACE_STEP_M:
            self._trace.append(edges)
        world_to_image = self._ground_to_image @ np.linalg.inv(body_to_world)
        points = world_to_image @ np.stack([*self._trace, edges])
        in_front = (points[:, 2] > CLOSEST_DEPTH_M).all(axis=1)
        depth_m = np.maximum(points[:, 2:], CLOSEST_DEPTH_M)
        pixels = np.round(points[:, :2] / depth_m * 2**SUBPIXEL_BITS).astype(np.int32)
        seen = np.zeros(self._size[::-1], np.uint8)
        for older in np.flatnonzero(in_front[:-1] & in_front[1:]):
            before, after = pixels[older].T, pixels[older + 1].T
            cv2.fillConvexPoly(seen, np.vstack([before, after[::-1]]), 255, shift=SUBPIXEL_BITS)
        return seen > 0


def _body_to_world(x_m: float, y_m: float, yaw_rad: float) -> Matrix:
    cosine, sine = math.cos(yaw_rad), math.sin(yaw_rad)
    return np.array([[cosine, -sine, x_m], [sine, cosine, y_m], [0, 0, 1]])


def _reach_m(homography: Matrix, size: tuple[int, int]) -> float:
    """Return the distance from the rover's origin to the farthest ground in view."""
    width, height = size
    corners = np.array([[0, width, 0, width], [0, 0, height, height], [1, 1, 1, 1]])
    ground = np.linalg.inv(homography) @ corners
    # The third component is one over the depth: negative above the horizon.
    if (ground[2] < 1 / FARTHEST_DEPTH_M).any():
        msg = (
            f"simulated camera sees ground more than {FARTHEST_DEPTH_M:g} m away, or the horizon: "
            f"raise its tilt_deg or lower its height_m"
        )
        raise ConfigError(msg)
    return float(np.hypot(*(ground[:2] / ground[2])).max())
