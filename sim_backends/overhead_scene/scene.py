"""Images of the simulated overhead camera: the floor, and on it the rover with its marker.

Not modelled: lens distortion, rolling shutter, shadows, reflections and people. The rover is a level grey
disc around its marker, and the floor has no patches.
"""

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.overhead_camera.settings import OverheadCameraSettings
from drivers.samples import Image
from sim_backends.arrays import Array
from sim_backends.overhead_scene.settings import OverheadCameraEmulatorSettings
from sim_backends.world.plant import Truth

CELL_TEXELS = 16
OVERSAMPLING = 4
EXPOSURE_PARTS = 3
FLOOR_GREY = 150
FLOOR_SPOTS_GREY = 10.0
FLOOR_SPOT_PX = 6
DECK_GREY = 90
DECK_RADIUS_M = 0.18
DECK_POINTS = 64
NOISE_SHIFT = 64
SUBPIXEL_BITS = 4


class PinholeCamera:
    """Projects points of the world to pixels.

    Args:
        emulator: Pose of the camera.
        width: Width of the image in pixels.
        height: Height of the image in pixels.
    """

    def __init__(self, emulator: OverheadCameraEmulatorSettings, width: int, height: int) -> None:
        turn = math.radians(emulator.turn_deg)
        right = np.array([math.cos(turn), math.sin(turn), 0.0])
        up = np.array([-math.sin(turn), math.cos(turn), 0.0])
        ahead = np.array([0.0, 0.0, -1.0])
        ahead = ahead + math.tan(math.radians(emulator.tilt_x_deg)) * right
        ahead = ahead + math.tan(math.radians(emulator.tilt_y_deg)) * up
        ahead /= np.linalg.norm(ahead)
        right -= (right @ ahead) * ahead
        right /= np.linalg.norm(right)
        focal_px = width / 2 / math.tan(math.radians(emulator.horizontal_view_deg) / 2)
        intrinsics = np.array([[focal_px, 0, (width - 1) / 2], [0, focal_px, (height - 1) / 2], [0, 0, 1]])
        self._world_to_image = intrinsics @ np.array([right, np.cross(ahead, right), ahead])
        self._lens_m = np.array([emulator.camera_x_m, emulator.camera_y_m, emulator.height_m])

    def project(self, points_m: Array) -> Array:
        """Return (column, row) of world points, shape (n, 3), that lie ahead of the camera."""
        image = (points_m - self._lens_m) @ self._world_to_image.T
        return np.asarray(image[:, :2] / image[:, 2:])


class OverheadScene:
    """The floor from above, with the rover's marker at its true position and height.

    Args:
        device: Camera and marker as configured on the host.
        emulator: Pose and image quality of the camera.
        rng: Source of the floor and of the pixel noise.
    """

    def __init__(
        self,
        device: OverheadCameraSettings,
        emulator: OverheadCameraEmulatorSettings,
        rng: np.random.Generator,
    ) -> None:
        self._device = device
        self._emulator = emulator
        self._rng = rng
        self._camera = PinholeCamera(emulator, device.width, device.height)
        self._floor = _make_floor(device.width, device.height, rng)
        shape = (device.height + NOISE_SHIFT, device.width + NOISE_SHIFT)
        self._noise = np.round(rng.normal(0, emulator.noise_grey, shape)).astype(np.int16)
        dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, device.dictionary))
        cells = dictionary.markerSize + 2
        marker = cv2.aruco.generateImageMarker(dictionary, device.marker_id, cells * CELL_TEXELS)
        # A margin of one cell of white paper around the black border.
        self._board = np.pad(np.asarray(marker, np.uint8), CELL_TEXELS, constant_values=255)
        self._board_half_m = 0.5 * device.marker_size_m * (1.0 + 2.0 / cells)
        self._height_m = device.marker_height_m + emulator.marker_height_error_m

    def render(self, truth: Truth) -> Image:
        """Return the image, BGR, with the rover blurred by its motion during the exposure."""
        image = self._floor.copy()
        shares = (np.arange(EXPOSURE_PARTS) - 0.5 * (EXPOSURE_PARTS - 1)) / EXPOSURE_PARTS
        poses = [_pose_after(truth, float(share) * self._emulator.exposure_s) for share in shares]
        decks = [self._camera.project(self._deck(*pose)) for pose in poses]
        boards = [self._camera.project(self._board_corners(*pose)) for pose in poses]
        margin = 2 + math.ceil(4 * self._emulator.blur_px)
        points = np.vstack((*decks, *boards))
        left, top = np.maximum(np.floor(points.min(axis=0)).astype(int) - margin, 0)
        right, bottom = np.maximum(np.ceil(points.max(axis=0)).astype(int) + margin, 0)
        window = image[top:bottom, left:right]
        if window.size:
            corner = np.array([left, top])
            parts = [
                self._draw(window, deck - corner, board - corner)
                for deck, board in zip(decks, boards, strict=True)
            ]
            blurred = np.mean(parts, axis=0)
            if self._emulator.blur_px > 0.0:
                blurred = cv2.GaussianBlur(blurred, (0, 0), self._emulator.blur_px)
            window[:] = np.round(blurred)
        return self._add_noise(image)

    def _draw(self, floor: Image, deck_px: Array, board_px: Array) -> Image:
        """Return a part of the image with the rover in it, each pixel averaged over its area."""
        height, width = floor.shape
        drawn = floor.copy()
        fine_deck = np.round(deck_px * 2**SUBPIXEL_BITS).astype(np.int32)
        cv2.fillConvexPoly(drawn, fine_deck, DECK_GREY, cv2.LINE_AA, SUBPIXEL_BITS)
        side = len(self._board)
        texels = np.array([[0, 0], [side, 0], [side, side], [0, side]], np.float32) - np.float32(0.5)
        fine_px = ((board_px + 0.5) * OVERSAMPLING - 0.5).astype(np.float32)
        to_fine = cv2.getPerspectiveTransform(texels, fine_px)
        fine_size = (width * OVERSAMPLING, height * OVERSAMPLING)
        fine = cv2.resize(drawn, fine_size, interpolation=cv2.INTER_NEAREST)
        cv2.warpPerspective(
            self._board,
            to_fine,
            fine_size,
            dst=fine,
            borderMode=cv2.BORDER_TRANSPARENT,
            flags=cv2.INTER_LINEAR,
        )
        return np.asarray(cv2.resize(fine, (width, height), interpolation=cv2.INTER_AREA), np.uint8)

    def _add_noise(self, image: Image) -> Image:
        height, width = image.shape
        row, column = self._rng.integers(0, NOISE_SHIFT, 2)
        noisy = cv2.add(image, self._noise[row : row + height, column : column + width], dtype=cv2.CV_8U)
        return np.asarray(cv2.cvtColor(noisy, cv2.COLOR_GRAY2BGR), np.uint8)

    def _board_corners(self, x_m: float, y_m: float, yaw_rad: float) -> Array:
        """Return the corners of the marker's board in the world, clockwise from the printed upper left."""
        device = self._device
        mount_rad = math.radians(device.marker_yaw_deg + self._emulator.marker_yaw_error_deg)
        corners = self._board_half_m * np.array([-1 + 1j, 1 + 1j, 1 - 1j, -1 - 1j])
        on_rover = complex(device.marker_x_m, device.marker_y_m) + corners * np.exp(1j * mount_rad)
        return self._in_world(on_rover, x_m, y_m, yaw_rad)

    def _deck(self, x_m: float, y_m: float, yaw_rad: float) -> Array:
        around = DECK_RADIUS_M * np.exp(1j * np.linspace(0.0, math.tau, DECK_POINTS, endpoint=False))
        return self._in_world(around, x_m, y_m, yaw_rad)

    def _in_world(self, on_rover: NDArray[np.complex128], x_m: float, y_m: float, yaw_rad: float) -> Array:
        points = complex(x_m, y_m) + on_rover * np.exp(1j * yaw_rad)
        return np.column_stack((points.real, points.imag, np.full(len(points), self._height_m)))


def _pose_after(truth: Truth, dt_s: float) -> tuple[float, float, float]:
    """Return x, y and yaw `dt_s` later."""
    cosine, sine = math.cos(truth.yaw_rad), math.sin(truth.yaw_rad)
    return (
        truth.x_m + dt_s * (cosine * truth.velocity_x_m_s - sine * truth.velocity_y_m_s),
        truth.y_m + dt_s * (sine * truth.velocity_x_m_s + cosine * truth.velocity_y_m_s),
        truth.yaw_rad + dt_s * truth.yaw_rate_rad_s,
    )


def _make_floor(width: int, height: int, rng: np.random.Generator) -> Image:
    spots = rng.normal(
        FLOOR_GREY, FLOOR_SPOTS_GREY, (height // FLOOR_SPOT_PX + 1, width // FLOOR_SPOT_PX + 1)
    )
    return np.asarray(cv2.resize(spots.astype(np.uint8), (width, height), interpolation=cv2.INTER_LINEAR))
