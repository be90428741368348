"""The sample of a calibration board: pictures by the rear camera of the shipped El-Dorado."""

import json
import math
from importlib import resources
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from controllers.ground_motion.rig import RigFile
from drivers.samples import Image
from rover_hil.config import read_rig
from rover_hil.config.shipped import rigs
from rover_hil.ready.camera.fit import MARKER_SHARE

Floats = NDArray[np.float64]

SEED = 4
PICTURES = 10
COLUMNS, ROWS, SQUARE_M, SQUARE_PX = 8, 6, 0.04, 60
GROUND_X_M, GROUND_Y_M = -0.72, 0.10
"""First inner corner of the board on the ground; its columns point to the left, rows ahead."""
CAMERA_KEYS = {"schema", "image", "camera_matrix", "dist_coeffs", "R_vehicle_camera", "t_vehicle_camera"}
EDGE_PX = 60
PAPER_GREY, BACKGROUND_GREY, NOISE_GREY = 255.0, 150.0, 1.5


def write_board(folder: Path) -> None:
    """Write pictures of a ChArUco board in many poses, one on the ground, and the rover's part of the rig."""
    with resources.as_file(resources.files(rigs) / "el-dorado.json") as path:
        rig = read_rig(path)
    rng = np.random.default_rng(SEED)
    paper = _printed()
    (folder / "pictures").mkdir()
    for number in range(PICTURES):
        picture = _photograph(rig, paper, *_in_hand(rng), rng)
        cv2.imwrite(str(folder / "pictures" / f"{number}.png"), picture)
    cv2.imwrite(str(folder / "ground.png"), _photograph(rig, paper, *_on_ground(rig), rng))
    keys = rig.model_dump(mode="json", by_alias=True)
    rover = {key: value for key, value in keys.items() if key not in CAMERA_KEYS}
    (folder / "rover.json").write_text(json.dumps(rover, indent=2) + "\n", "utf-8")


def _printed() -> Image:
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    pattern = cv2.aruco.CharucoBoard((COLUMNS, ROWS), SQUARE_M, MARKER_SHARE * SQUARE_M, dictionary)
    return np.asarray(pattern.generateImage((COLUMNS * SQUARE_PX, ROWS * SQUARE_PX)), np.uint8)


def _photograph(
    rig: RigFile, paper: Image, axes: Floats, corner_m: Floats, rng: np.random.Generator
) -> Image:
    """Return the picture of a board with these axes and this upper left corner in the camera's frame."""
    matrix, lens = np.array(rig.camera_matrix), np.array(rig.dist_coeffs.values)
    height, width = rig.image.height, rig.image.width
    rows, columns = np.indices((height, width)).astype(np.float64)
    pixels = np.stack([columns, rows], axis=-1).reshape(-1, 1, 2)
    flat = cv2.undistortPoints(pixels, matrix, lens).reshape(height, width, 2)
    rays = np.concatenate([flat, np.ones((height, width, 1))], axis=2)
    normal = axes[:, 2]
    along = (normal @ corner_m) / (rays @ normal)
    place = (rays * along[..., None] - corner_m) @ axes[:, :2] / SQUARE_M * SQUARE_PX - 0.5
    # Shrunk in the picture the board must be smoothed first, as a lens does.
    soft = cv2.GaussianBlur(paper, (0, 0), 1.5)
    framed = cv2.copyMakeBorder(soft, *(EDGE_PX,) * 4, cv2.BORDER_CONSTANT, value=(PAPER_GREY,))
    column, row = (place[..., axis].astype(np.float32) + EDGE_PX for axis in (0, 1))
    shown = cv2.remap(
        framed, column, row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=(BACKGROUND_GREY,)
    )
    noisy = 30.0 + 0.7 * shown + rng.normal(0.0, NOISE_GREY, shown.shape)
    return np.asarray(np.clip(noisy, 0, 255), np.uint8)


def _in_hand(rng: np.random.Generator) -> tuple[Floats, Floats]:
    turned, _ = cv2.Rodrigues(rng.uniform(-0.45, 0.45, 3))
    axes = np.asarray(turned, np.float64)
    middle = np.array([rng.uniform(-0.1, 0.1), rng.uniform(-0.08, 0.08), rng.uniform(0.35, 0.5)])
    return axes, middle - axes @ (np.array([COLUMNS, ROWS, 0.0]) * SQUARE_M / 2.0)


def _on_ground(rig: RigFile) -> tuple[Floats, Floats]:
    yaw_rad = math.radians(90.0)
    cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
    # Printed side up: columns, rows clockwise of them seen from above, and into the ground.
    axes = np.array([[cos, sin, 0.0], [sin, -cos, 0.0], [0.0, 0.0, -1.0]])
    corner_m = np.array([GROUND_X_M, GROUND_Y_M, 0.0]) - axes @ np.array([SQUARE_M, SQUARE_M, 0.0])
    to_camera = np.array(rig.R_vehicle_camera).T
    return to_camera @ axes, to_camera @ (corner_m - np.array(rig.t_vehicle_camera))
