"""Calibration of a camera: lens from pictures of a board, pose from a picture of it on the ground."""

import json
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from controllers.ground_motion.rig import SCHEMA, RigFile
from drivers.camera.images import read_image
from drivers.errors import ConfigError
from drivers.files import parse_json, read_text
from drivers.samples import Image
from rover_hil.config import validated
from rover_hil.ftrace.frames import FrameSource
from rover_hil.ftrace.log_frames import LogFrames

Floats = NDArray[np.float64]

LEAST_PICTURES = 5
MOST_PICTURES = 60
"""Of a video or a log, evenly spaced: more cost time and show nothing new."""
LOG_SUFFIX = ".mcap"
LEAST_CORNERS = 8
MARKER_SHARE = 0.75
"""Side of a ChArUco marker as a share of a square's, as board generators print it by default."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Board:
    """A calibration board.

    Attributes:
        kind: `chessboard` or `charuco` (dictionary DICT_4X4_50, markers of 3/4 of a square).
        columns: Squares along the board's x axis.
        rows: Squares along its y axis.
        square_m: Side of a square.
    """

    kind: Literal["chessboard", "charuco"]
    columns: int
    rows: int
    square_m: float


@dataclass(frozen=True, slots=True, kw_only=True)
class GroundTarget:
    """Place of the board on the ground: its first inner corner, and the direction of its columns.

    Attributes:
        x_m: Corner in the vehicle frame.
        y_m: Corner in the vehicle frame.
        yaw_rad: Direction of increasing columns, counter-clockwise from x; rows increase to its right.
    """

    x_m: float
    y_m: float
    yaw_rad: float


@dataclass(frozen=True, slots=True)
class View:
    """Corners of the board in one picture.

    Attributes:
        pixels: Where they are, (n, 2).
        error: Where the calibrated camera would see them, less where they are, pixels, (n, 2).
    """

    pixels: Floats
    error: Floats

    @property
    def rms_px(self) -> float:
        """Root mean square of the distance of a corner from where it should be."""
        return float(np.sqrt((self.error**2).sum(axis=1).mean()))


@dataclass(frozen=True, slots=True, kw_only=True)
class Calibration:
    """Lens and pose of a camera.

    Attributes:
        camera_matrix: Of OpenCV, (3, 3).
        distortion: k1, k2, p1, p2, k3 of OpenCV.
        rotation: Camera to vehicle, (3, 3).
        position_m: Of the camera in the vehicle frame, (3,).
        lens_rms_px: Reprojection error of the lens, over all pictures.
        views: The pictures that showed the board.
        ground: The picture of the board on the ground.
        size: Width and height of the pictures.
    """

    camera_matrix: Floats
    distortion: Floats
    rotation: Floats
    position_m: Floats
    lens_rms_px: float
    views: tuple[View, ...]
    ground: View
    size: tuple[int, int]


def fit_camera(pictures: Path, ground: Path, board: Board, target: GroundTarget) -> Calibration:
    """Return the calibration of a camera.

    Args:
        pictures: Folder, video or log with the board in many poses; pictures without the board are skipped.
        ground: Picture of the board on the ground, or a log, whose last frame is taken.
        board: The board.
        target: Its place on the ground.

    Raises:
        ConfigError: Fewer than 5 pictures show the board, they differ in size, or `ground` does not.
        LogError: A log cannot be read, or holds no frames.
    """
    views = list(_pictures(pictures))
    sizes = {view.shape[:2] for view in views}
    if len(sizes) != 1:
        raise ConfigError(f"{pictures} holds pictures of {len(sizes)} sizes: all must come from one camera")
    boards = [pair for pair in (find_corners(view, board) for view in views) if pair is not None]
    if len(boards) < LEAST_PICTURES:
        raise ConfigError(
            f"{len(boards)} of {len(views)} pictures in {pictures} show the board, {LEAST_PICTURES} needed: "
            "check --columns, --rows (squares) and --board"
        )
    height, width = sizes.pop()
    points = [flat.astype(np.float32) for flat, _ in boards]
    corners = [pixels.astype(np.float32) for _, pixels in boards]
    rms, matrix, distortion, turns, shifts = cv2.calibrateCamera(
        points, corners, (width, height), np.eye(3), np.zeros(5)
    )
    camera_matrix = np.asarray(matrix, np.float64)
    coefficients = np.asarray(distortion, np.float64).ravel()[:5]
    rotation, position, on_ground = _pose(ground, board, target, camera_matrix, coefficients)
    seen = [
        _view(*pair, np.asarray(turn), np.asarray(shift), camera_matrix, coefficients)
        for pair, turn, shift in zip(boards, turns, shifts, strict=True)
    ]
    return Calibration(
        camera_matrix=camera_matrix,
        distortion=coefficients,
        rotation=rotation,
        position_m=position,
        lens_rms_px=float(rms),
        views=tuple(seen),
        ground=on_ground,
        size=(width, height),
    )


def _pictures(path: Path) -> Iterator[Image]:
    """Yield the pictures that can be decoded; of many frames some, evenly spaced."""
    source = LogFrames(path) if path.suffix == LOG_SUFFIX else FrameSource(path)
    step = 1 if path.is_dir() else -(-source.count // MOST_PICTURES)
    for number, frame in enumerate(source):
        if number % step == 0 and frame.image.size:
            yield frame.image


def _ground_picture(path: Path) -> Image:
    if path.suffix != LOG_SUFFIX:
        return read_image(path)
    (last,) = deque(LogFrames(path), maxlen=1)  # a list would hold all frames
    return last.image


def _view(
    points: Floats, pixels: Floats, turn: Floats, shift: Floats, matrix: Floats, distortion: Floats
) -> View:
    projected, _ = cv2.projectPoints(points, turn, shift, matrix, distortion)
    return View(pixels, np.asarray(projected, np.float64).reshape(-1, 2) - pixels)


def find_corners(image: Image, board: Board) -> tuple[Floats, Floats] | None:
    """Return inner corners on the board (n x 3, m) and in the image (n x 2, pixels), or None."""
    grey = image if image.ndim == 2 else np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), np.uint8)
    columns, rows = board.columns - 1, board.rows - 1
    if board.kind == "chessboard":
        ok, corners = cv2.findChessboardCornersSB(grey, (columns, rows))
        if not ok:
            return None
        numbers = np.arange(columns * rows)
    else:
        dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
        size = (board.columns, board.rows)
        pattern = cv2.aruco.CharucoBoard(size, board.square_m, MARKER_SHARE * board.square_m, dictionary)
        corners, identities, _, _ = cv2.aruco.CharucoDetector(pattern).detectBoard(grey)
        # OpenCV returns None without a corner.
        seen = np.asarray(np.atleast_1d(identities), np.float64).ravel()
        numbers = seen[np.isfinite(seen)].astype(np.intp)
        if len(numbers) < LEAST_CORNERS:
            return None
    flat = np.stack([numbers % columns, numbers // columns, np.zeros(len(numbers))], axis=1) * board.square_m
    return flat.astype(np.float64), np.asarray(corners, np.float64).reshape(-1, 2)


def _pose(
    ground: Path, board: Board, target: GroundTarget, matrix: Floats, distortion: Floats
) -> tuple[Floats, Floats, View]:
    """Return rotation camera to vehicle, position in the vehicle frame, and the corners on the ground."""
    image = _ground_picture(ground)
    corners = find_corners(image, board) if image.size else None
    if corners is None:
        raise ConfigError(f"{ground} does not show the board on the ground: all of it must be in view")
    flat, pixels = corners
    best: tuple[Floats, Floats, View] | None = None
    # A chessboard is symmetric to half a turn; the camera looks back, away from the vehicle's nose.
    for turned in (False, True) if board.kind == "chessboard" else (False,):
        points = _on_ground(flat[::-1] if turned else flat, target)
        ok, turn, shift = cv2.solvePnP(points, pixels, matrix, distortion)
        if not ok:
            continue
        to_camera = np.asarray(cv2.Rodrigues(turn)[0], np.float64)
        view = _view(points, pixels, np.asarray(turn), np.asarray(shift), matrix, distortion)
        rotation, position = to_camera.T, -to_camera.T @ np.asarray(shift, np.float64).ravel()
        if position[2] > 0 and (best is None or rotation[0, 2] < best[0][0, 2]):
            best = rotation, position, view
    if best is None:
        raise ConfigError(
            f"{ground}: the camera would be below the ground: check --ground-yaw and the board's direction"
        )
    return best


def _on_ground(flat: Floats, target: GroundTarget) -> Floats:
    cos, sin = np.cos(target.yaw_rad), np.sin(target.yaw_rad)
    # Seen from above, as on paper, rows are counted clockwise of columns.
    x = target.x_m + cos * flat[:, 0] + sin * flat[:, 1]
    y = target.y_m + sin * flat[:, 0] - cos * flat[:, 1]
    return np.stack([x, y, np.zeros(len(flat))], axis=1)


def rig_text(rover: Path, calibration: Calibration, fps: float) -> str:
    """Return a rig file's text: the rover's own keys from a JSON file, the camera's from a calibration.

    Args:
        rover: JSON with vehicle_frame, wheel, other_wheels, b_m, nominal_speed_mps, ground_view_m and
            max_slip_angle_deg; camera keys in it, as in an older rig file, are replaced.
        calibration: The camera.
        fps: Frames per second.

    Raises:
        ConfigError: The rover's file cannot be read, or a key is missing or wrong.
    """
    try:
        table = parse_json(read_text(rover))
    except OSError as error:
        raise ConfigError(f"cannot read {rover}: {error.strerror}") from error
    except ValueError as error:
        raise ConfigError(f"{rover} is not valid JSON: {error}") from error
    if not isinstance(table, dict):
        raise ConfigError(f"{rover} must hold an object with the keys of the rover")
    table |= {
        "schema": SCHEMA,
        "image": {"width": calibration.size[0], "height": calibration.size[1], "fps": fps, "format": "bgr8"},
        "camera_matrix": calibration.camera_matrix.tolist(),
        "dist_coeffs": {"model": "opencv", "values": calibration.distortion.tolist()},
        "R_vehicle_camera": calibration.rotation.tolist(),
        "t_vehicle_camera": calibration.position_m.tolist(),
    }
    validated(RigFile, table, str(rover))
    return json.dumps(table, indent=2) + "\n"
