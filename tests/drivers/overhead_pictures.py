"""Pictures of a marker by OpenCV's own projection of points, so that no error of the codec can cancel out."""

import math
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.samples import Image

WIDTH, HEIGHT = 640, 480
CAMERA_MATRIX = np.array([[900.0, 0, 310], [0, 905.0, 250], [0, 0, 1]])
LENS_M = (0.5, 0.3, 2.2)
SIZE_M = 0.12
OVERSAMPLING = 6

# Looks down with the image's x axis along the floor's x, then leans and turns a little.
ROTATION = cv2.Rodrigues(np.array([0.06, -0.04, 0.3]))[0] @ np.diag([1.0, -1.0, -1.0])
ROTATION_VECTOR = np.asarray(cv2.Rodrigues(ROTATION)[0], np.float64).ravel()
TRANSLATION_M = np.asarray(-ROTATION @ np.array(LENS_M), np.float64)


def project(points_m: NDArray[np.float64], distortion: tuple[float, ...] = ()) -> NDArray[np.float64]:
    """Pixels of world points, shape (n, 3)."""
    pixels, _ = cv2.projectPoints(
        points_m, ROTATION_VECTOR, TRANSLATION_M, CAMERA_MATRIX, np.array(distortion or (0.0,) * 4)
    )
    return np.asarray(pixels, np.float64).reshape(-1, 2)


def marker_corners(
    x_m: float, y_m: float, yaw_rad: float, height_m: float, size_m: float = SIZE_M
) -> NDArray[np.float64]:
    """Corners in the world, clockwise from the printed upper left; x runs along the upper edge."""
    half = size_m / 2
    corners = []
    for right, up in ((-half, half), (half, half), (half, -half), (-half, -half)):
        x = x_m + math.cos(yaw_rad) * right - math.sin(yaw_rad) * up
        y = y_m + math.sin(yaw_rad) * right + math.cos(yaw_rad) * up
        corners.append((x, y, height_m))
    return np.array(corners)


def put_marker(
    image: Image, corners_px: NDArray[np.float64], marker_id: int = 7, dictionary: int = cv2.aruco.DICT_4X4_50
) -> None:
    """Draw a marker on white paper into a grey picture, each pixel the mean of what it covers."""
    cell = 20
    drawn = cv2.aruco.generateImageMarker(cv2.aruco.getPredefinedDictionary(dictionary), marker_id, 6 * cell)
    paper = np.pad(np.asarray(drawn, np.uint8), cell, constant_values=255)
    inner = np.array([[1, 1], [7, 1], [7, 7], [1, 7]]) * cell - 0.5
    fine_px = (corners_px + 0.5) * OVERSAMPLING - 0.5
    to_fine = cv2.getPerspectiveTransform(inner.astype(np.float32), fine_px.astype(np.float32))
    height, width = image.shape
    fine = cv2.resize(image, (width * OVERSAMPLING, height * OVERSAMPLING), interpolation=cv2.INTER_NEAREST)
    cv2.warpPerspective(paper, to_fine, fine.shape[::-1], dst=fine, borderMode=cv2.BORDER_TRANSPARENT)
    image[:] = cv2.GaussianBlur(cv2.resize(fine, (width, height), interpolation=cv2.INTER_AREA), (0, 0), 0.6)


def empty_floor() -> Image:
    return np.full((HEIGHT, WIDTH), 150, np.uint8)


def camera_calibration() -> dict[str, object]:
    return {
        "source": "drawing",
        "date": "2026-01-02",
        "width": WIDTH,
        "height": HEIGHT,
        "camera_matrix": CAMERA_MATRIX.tolist(),
        "rotation_vector": ROTATION_VECTOR.tolist(),
        "translation_m": TRANSLATION_M.tolist(),
    }


def write_toml(path: Path, table: dict[str, object]) -> Path:
    path.write_text(
        "\n".join(
            f"{key} = {value!r}" if key != "date" else f"date = {value}" for key, value in table.items()
        )
    )
    return path
