"""From pixels to the floor: the calibration of an overhead camera, and how it is fitted.

The floor frame is that of the calibration points: x and y on the floor, z up.
"""

import datetime as dt
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Self, TypeAlias

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from drivers.camera.parameters import Pixels
from drivers.errors import ModelError
from drivers.heading_calibration import Calibration

Array: TypeAlias = NDArray[np.float64]
Vector: TypeAlias = tuple[float, float, float]
Matrix: TypeAlias = tuple[Vector, Vector, Vector]

FEWEST_POINTS = 4
SMALLEST_SPREAD = 0.01


class FloorCalibration(Calibration):
    """Geometry of an overhead camera above the floor, in one of three forms.

    Smallest: `scale_mm_per_px`, for a camera that points straight down; the image's middle is the floor's
    origin, x to the right and y up in the image. Usual: `homography`, from at least four floor points
    (`fit_floor`). Fullest: `camera_matrix`, `distortion`, `rotation_vector` and `translation_m`, as from
    OpenCV's `calibrateCamera` and `solvePnP`. The first two contain the position of the camera only with
    `camera_m`, and only then a marker above the floor can be located.

    Attributes:
        width: Width of the images in pixels.
        height: Height of the images in pixels.
        scale_mm_per_px: Length on the floor that one pixel shows.
        homography: Rows of the matrix that takes (column, row, 1) in pixels to floor points in m.
        camera_m: Position of the camera's lens in the floor frame.
        camera_matrix: Rows of the camera matrix in pixels.
        distortion: 4, 5 or 8 coefficients in OpenCV's order.
        rotation_vector: Turns the floor frame into the camera frame (x right, y down, z ahead), in rad.
        translation_m: Floor's origin in the camera frame.
    """

    width: Pixels
    height: Pixels
    scale_mm_per_px: Annotated[float, Field(gt=0.01, lt=100)] | None = None
    homography: Matrix | None = None
    camera_m: Vector | None = None
    camera_matrix: Matrix | None = None
    distortion: tuple[float, ...] = ()
    rotation_vector: Vector | None = None
    translation_m: Vector | None = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        pose = (self.camera_matrix, self.rotation_vector, self.translation_m)
        forms = (self.scale_mm_per_px, self.homography, self.camera_matrix)
        if sum(form is not None for form in forms) != 1 or any(
            (part is None) != (self.camera_matrix is None) for part in pose
        ):
            raise ValueError(
                "give either scale_mm_per_px, or homography, "
                "or camera_matrix with rotation_vector and translation_m"
            )
        if self.camera_matrix is None and self.distortion:
            raise ValueError("distortion needs the camera_matrix it was found with: add it")
        if self.camera_matrix is not None and self.camera_m is not None:
            raise ValueError("camera_m follows from rotation_vector and translation_m: remove it")
        if len(self.distortion) not in (0, 4, 5, 8):
            raise ValueError("distortion must have 4, 5 or 8 coefficients")
        floor = Floor(self)
        if not _sees_from_above(floor.homography, 0.5 * (self.width - 1), 0.5 * (self.height - 1)):
            raise ValueError(
                "the floor would be seen from below or on edge: its x, y and z axes must be right-handed"
            )
        if floor.camera_m is not None and floor.camera_m[2] <= 0.0:
            raise ValueError("the camera must hang above the floor: correct its position")
        return self


class Floor:
    """Maps pixels to points on the floor or on a plane above it.

    Args:
        calibration: Geometry of the camera.

    Attributes:
        homography: From undistorted pixels to floor points in m.
        camera_m: Position of the camera's lens in the floor frame; None when the calibration lacks it.
    """

    def __init__(self, calibration: FloorCalibration) -> None:
        self._camera_matrix: Array | None = None
        self._distortion = np.array(calibration.distortion)
        self.camera_m = None if calibration.camera_m is None else np.array(calibration.camera_m)
        if calibration.camera_matrix is not None:
            self._place_camera(calibration)
        elif calibration.scale_mm_per_px is not None:
            metres = 1e-3 * calibration.scale_mm_per_px
            middle_x, middle_y = 0.5 * (calibration.width - 1), 0.5 * (calibration.height - 1)
            self.homography = np.array(
                [[metres, 0, -metres * middle_x], [0, -metres, metres * middle_y], [0, 0, 1]]
            )
        else:
            self.homography = np.array(calibration.homography)

    def locate(self, points_px: Array, height_m: float) -> Array:
        """Return the points on the plane at `height_m`, in m, for points of the image, shape (n, 2).

        The line of sight from the camera C through the floor point p is C + s (p - C); it is `height_m` above
        the floor at s = 1 - height / C_z, hence p + (C - p) height / C_z in x and y.
        """
        if self._camera_matrix is not None and self._distortion.size:
            import cv2

            straight = cv2.undistortPoints(
                points_px.reshape(-1, 1, 2), self._camera_matrix, self._distortion, P=self._camera_matrix
            )
            points_px = np.asarray(straight, np.float64).reshape(-1, 2)
        on_floor = _project(self.homography, points_px)
        if height_m == 0.0:
            return on_floor
        if self.camera_m is None:
            raise ModelError("a point above the floor cannot be located: the calibration lacks camera_m")
        share = height_m / self.camera_m[2]
        return np.asarray(on_floor + share * (self.camera_m[:2] - on_floor))

    def _place_camera(self, calibration: FloorCalibration) -> None:
        import cv2

        rotation = np.asarray(cv2.Rodrigues(np.array(calibration.rotation_vector))[0], np.float64)
        translation = np.array(calibration.translation_m)
        self._camera_matrix = np.array(calibration.camera_matrix)
        # On the floor z is zero, which leaves the rotation's first two columns.
        to_image = self._camera_matrix @ np.column_stack((rotation[:, 0], rotation[:, 1], translation))
        self.homography = np.linalg.pinv(to_image)
        self.camera_m = -rotation.T @ translation


@dataclass(frozen=True, slots=True, kw_only=True)
class FloorFit:
    """A homography and the quality of its fit.

    Attributes:
        homography: Rows of the matrix from pixels to floor points in m.
        residuals_px: For each point, observed minus fitted.
        rms_px: Root mean square of the residuals' lengths.
        rms_m: The same on the floor.
        scale_mm_per_px: In the middle of the points.
        scale_std_mm_per_px: Standard error of the scale, from the residuals; None with four points, which
            leave no residuals.
    """

    homography: Matrix
    residuals_px: tuple[tuple[float, float], ...]
    rms_px: float
    rms_m: float
    scale_mm_per_px: float
    scale_std_mm_per_px: float | None

    def to_toml(self, *, source: str, date: dt.date, size_px: tuple[int, int], camera_m: Vector) -> str:
        """Return the text of a calibration file; `camera_m`: the lens in the floor frame."""
        rows = ",\n".join(f"  {list(row)}" for row in self.homography)
        return (
            f'source = "{source}"\ndate = {date.isoformat()}\nwidth = {size_px[0]}\nheight = {size_px[1]}\n'
            f"camera_m = {list(camera_m)}\nhomography = [\n{rows},\n]\n"
        )


def fit_floor(points_px: Sequence[tuple[float, float]], points_m: Sequence[tuple[float, float]]) -> FloorFit:
    """Fit the homography from pixels to the floor to points known in both.

    By the normalised direct linear transformation (Hartley and Zisserman, Multiple View Geometry, algorithm
    4.2); all error is assumed to be in the pixels.

    Args:
        points_px: (column, row) in the image, free of lens distortion; clicked, or `centre_of` markers.
        points_m: The same points on the floor in m, at least four, spread over the floor.

    Raises:
        ModelError: Fewer than four points, not finite, (almost) on a line, or mirrored.
    """
    image, floor = np.array(points_px, dtype=np.float64), np.array(points_m, dtype=np.float64)
    if image.shape != floor.shape or image.ndim != 2 or image.shape[1:] != (2,) or len(image) < FEWEST_POINTS:
        raise ModelError(f"fit_floor needs at least {FEWEST_POINTS} points (x, y) in pixels and as many in m")
    if not (np.isfinite(image).all() and np.isfinite(floor).all()):
        raise ModelError("fit_floor: a point is not finite; correct it")
    to_unit_image, to_unit_floor = _normalisation(image), _normalisation(floor)
    unit_image, unit_floor = _project(to_unit_image, image), _project(to_unit_floor, floor)
    parameters = _transform(unit_image, unit_floor)
    seen = _project(_matrix(parameters), unit_floor)
    residuals = (unit_image - seen) / to_unit_image[0, 0]
    to_floor = np.linalg.inv(to_unit_floor) @ np.linalg.inv(_matrix(parameters)) @ to_unit_image
    to_floor /= to_floor[2, 2]
    if not _sees_from_above(to_floor, *image.mean(axis=0)):
        raise ModelError(
            "fit_floor: the points are mirrored; x, y and up must be a right-handed frame on the floor"
        )
    unit_scale_mm = 1e3 * to_unit_image[0, 0] / to_unit_floor[0, 0]
    return FloorFit(
        homography=_rows(to_floor),
        residuals_px=tuple((float(x), float(y)) for x, y in residuals),
        rms_px=float(np.sqrt((residuals**2).sum(axis=1).mean())),
        rms_m=float(np.sqrt(((_project(to_floor, image) - floor) ** 2).sum(axis=1).mean())),
        scale_mm_per_px=unit_scale_mm * _unit_scale(parameters),
        scale_std_mm_per_px=_unit_scale_std(parameters, unit_image, unit_floor, unit_scale_mm),
    )


def _sees_from_above(to_floor: Array, x_px: float, y_px: float) -> bool:
    """Return whether the map turns the image's sense of rotation (y down) into the floor's (y up)."""
    with np.errstate(all="ignore"):
        depth = to_floor[2] @ (x_px, y_px, 1.0)
        return bool(np.linalg.det(to_floor) / depth**3 < 0.0)


def _project(homography: Array, points: Array) -> Array:
    mapped = np.column_stack((points, np.ones(len(points)))) @ homography.T
    return np.asarray(mapped[:, :2] / mapped[:, 2:])


def _normalisation(points: Array) -> Array:
    """Return the map that gives points the mean zero and the mean distance sqrt(2)."""
    middle = points.mean(axis=0)
    spread = float(np.linalg.norm(points - middle, axis=1).mean())
    if spread == 0.0:
        raise ModelError("fit_floor: all points are the same; spread them over the floor")
    scale = np.sqrt(2.0) / spread
    return np.array([[scale, 0, -scale * middle[0]], [0, scale, -scale * middle[1]], [0, 0, 1]])


def _matrix(parameters: Array) -> Array:
    return np.append(parameters, 1.0).reshape(3, 3)


def _rows(matrix: Array) -> Matrix:
    first, second, third = ((float(row[0]), float(row[1]), float(row[2])) for row in matrix)
    return (first, second, third)


def _transform(image: Array, floor: Array) -> Array:
    """Return the first eight elements of the floor-to-image matrix by the direct linear transformation."""
    x, y = floor.T
    u, v = image.T
    one, zero = np.ones(len(x)), np.zeros(len(x))
    first = np.column_stack((x, y, one, zero, zero, zero, -u * x, -u * y, -u))
    second = np.column_stack((zero, zero, zero, x, y, one, -v * x, -v * y, -v))
    _, strengths, directions = np.linalg.svd(np.vstack((first, second)))
    if strengths[7] < SMALLEST_SPREAD * strengths[0]:
        raise ModelError("fit_floor: too many points are (almost) on one line; spread them over the floor")
    solution = directions[-1]
    return np.asarray(solution[:8] / solution[8])


def _jacobian(parameters: Array, floor: Array) -> Array:
    x, y = floor.T
    u, v = _project(_matrix(parameters), floor).T
    depth = parameters[6] * x + parameters[7] * y + 1.0
    one, zero = np.ones(len(x)), np.zeros(len(x))
    first = np.column_stack((x, y, one, zero, zero, zero, -u * x, -u * y))
    second = np.column_stack((zero, zero, zero, x, y, one, -v * x, -v * y))
    return np.vstack((first / depth[:, None], second / depth[:, None]))


def _unit_scale(parameters: Array) -> float:
    """Return the length on the floor per length in the image at the middle of the points, normalised."""
    return float(abs(np.linalg.det(_matrix(parameters))) ** -0.5)


def _unit_scale_std(parameters: Array, image: Array, floor: Array, unit_mm: float) -> float | None:
    excess = 2 * len(image) - len(parameters)
    if excess == 0:
        return None
    variance = float(((image - _project(_matrix(parameters), floor)) ** 2).sum()) / excess
    jacobian = _jacobian(parameters, floor)
    step = 1e-6
    slope = [
        (_unit_scale(parameters + step * unit) - _unit_scale(parameters - step * unit)) / (2.0 * step)
        for unit in np.eye(len(parameters))
    ]
    spread = np.linalg.solve(jacobian.T @ jacobian, np.array(slope))
    return unit_mm * float(np.sqrt(variance * np.dot(slope, spread)))
