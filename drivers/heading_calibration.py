"""Calibration of compasses: a deviation table for headings, hard and soft iron for raw magnetic vectors.

Both are TOML data files with their source and date.
"""

import datetime as dt
from bisect import bisect_right
from itertools import pairwise
from pathlib import Path
from typing import Annotated, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, ValidationError, ValidationInfo, field_validator

from drivers.errors import ConfigError, ModelError
from drivers.settings import Settings, direct_mistakes, read_toml

Vector: TypeAlias = tuple[float, float, float]

LARGEST_MEAN_DIRECTION = 0.4
SMALLEST_DIRECTION_SPREAD = 0.1
SMALLEST_CURVATURE = 1e-6


class Calibration(Settings):
    """Keys of every calibration file.

    Attributes:
        source: How the numbers were obtained, e.g. "swung against a GNSS compass on the test field".
        date: Day of the measurement.
    """

    source: Annotated[str, Field(min_length=1)]
    date: dt.date


class DeviationTable(Calibration):
    """Deviation of a compass over its own reading: magnetic heading = reading + deviation, east positive.

    Attributes:
        heading_deg: Readings, clockwise from north, in [0, 360), strictly increasing, at least four.
        deviation_deg: Deviation at each reading, in [-90, 90].
    """

    heading_deg: Annotated[tuple[Annotated[float, Field(ge=0, lt=360)], ...], Field(min_length=4)]
    deviation_deg: tuple[Annotated[float, Field(ge=-90, le=90)], ...]

    @field_validator("heading_deg")
    @classmethod
    def _require_increasing(cls, heading_deg: tuple[float, ...]) -> tuple[float, ...]:
        if any(after <= before for before, after in pairwise(heading_deg)):
            raise ValueError("must be strictly increasing: sort the table and merge repeated headings")
        return heading_deg

    @field_validator("deviation_deg")
    @classmethod
    def _require_same_length(
        cls, deviation_deg: tuple[float, ...], info: ValidationInfo
    ) -> tuple[float, ...]:
        if len(deviation_deg) != len(info.data.get("heading_deg", deviation_deg)):
            raise ValueError("must have as many entries as heading_deg")
        return deviation_deg

    def deviation_at(self, reading_deg: float) -> float:
        """Return the deviation in deg at a reading in deg, linear between entries and across north."""
        right = bisect_right(self.heading_deg, reading_deg % 360.0)
        left = right - 1
        right %= len(self.heading_deg)
        span_deg = (self.heading_deg[right] - self.heading_deg[left]) % 360.0
        fraction = ((reading_deg - self.heading_deg[left]) % 360.0) / span_deg
        step_deg = self.deviation_deg[right] - self.deviation_deg[left]
        return self.deviation_deg[left] + fraction * step_deg


class MagnetometerCalibration(Calibration):
    """Hard and soft iron of a magnetometer: field = soft_iron (raw - hard_iron), in counts.

    Attributes:
        hard_iron_counts: Offset of each axis in the raw unit of the device.
        soft_iron: Rows of the matrix that turns the ellipsoid of readings into a sphere.
    """

    hard_iron_counts: Vector
    soft_iron: tuple[Vector, Vector, Vector]

    @field_validator("soft_iron")
    @classmethod
    def _require_no_mirror(cls, soft_iron: tuple[Vector, Vector, Vector]) -> tuple[Vector, Vector, Vector]:
        if np.linalg.det(np.array(soft_iron)) <= 0.0:
            raise ValueError("must have a positive determinant: fit it again")
        return soft_iron

    def apply(self, raw: Vector) -> Vector:
        """Return the calibrated field in counts."""
        x, y, z = (value - offset for value, offset in zip(raw, self.hard_iron_counts, strict=True))
        first, second, third = self.soft_iron
        return (
            first[0] * x + first[1] * y + first[2] * z,
            second[0] * x + second[1] * y + second[2] * z,
            third[0] * x + third[1] * y + third[2] * z,
        )


CalibrationT = TypeVar("CalibrationT", bound=Calibration)


def load_calibration(path: Path, kind: type[CalibrationT]) -> CalibrationT:
    """Read a calibration file.

    Raises:
        ConfigError: The file is missing, is not TOML, or holds a wrong, unknown or missing key.
    """
    data = read_toml(path, f"calibration file {path}", "correct the path or leave it out")
    try:
        return kind.model_validate(data)
    except ValidationError as error:
        raise ConfigError(_describe(path, kind, error)) from error


def _describe(path: Path, kind: type[Calibration], error: ValidationError) -> str:
    lines = []
    for detail in direct_mistakes(error.errors()):
        key = ".".join(str(part) for part in detail["loc"])
        place = f", key '{key}'" if key else ""
        problem = detail["msg"].removeprefix("Value error, ")
        known = ", ".join(kind.model_fields)
        lines.append(f"calibration file {path}{place}: {problem}; the file has the keys {known}")
    return "\n".join(lines)


def fit_magnetometer(
    raw: NDArray[np.float64], *, source: str, date: dt.date, planar: bool = False
) -> MagnetometerCalibration:
    """Fit hard and soft iron to magnetometer readings taken while turning in a uniform field.

    Least squares of the quadric x'Ax + 2b'x = 1 in centred, scaled readings; its centre is the hard iron, the
    symmetric root of A the soft iron, scaled to determinant 1, which keeps the mean strength of the field. A
    rotation of the sensor against the body does not show in such readings and is not corrected.

    Args:
        raw: Readings in counts, shape (n, 3), spread evenly over all directions.
        source: How they were taken.
        date: When they were taken.
        planar: The sensor turned about z only, on level ground: fit x and y and leave z as it is. The heading
            is then good on level ground only.

    Raises:
        ModelError: Too few readings, not spread over all directions, or not on an ellipsoid.
    """
    axes = 2 if planar else 3
    points = np.asarray(raw, dtype=np.float64)[:, :axes]
    if len(points) < 4 * axes or not np.isfinite(points).all():
        raise ModelError(f"fit_magnetometer needs at least {4 * axes} finite readings, got {len(points)}")
    centre, shape = _fit_ellipsoid(points)
    values, vectors = np.linalg.eigh(shape)
    root = (vectors * np.sqrt(values)) @ vectors.T
    root /= np.linalg.det(root) ** (1.0 / axes)
    _require_all_directions((points - centre) @ root)
    hard_iron, soft_iron = np.zeros(3), np.eye(3)
    hard_iron[:axes] = centre
    soft_iron[:axes, :axes] = root
    return MagnetometerCalibration.model_validate(
        {
            "source": source,
            "date": date,
            "hard_iron_counts": hard_iron.tolist(),
            "soft_iron": soft_iron.tolist(),
        }
    )


def _fit_ellipsoid(points: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the centre of the nearest ellipsoid, and its shape matrix up to a factor."""
    axes = points.shape[1]
    middle = points.mean(axis=0)
    scale = float(np.abs(points - middle).max()) or 1.0
    scaled = (points - middle) / scale
    rows, columns = np.triu_indices(axes)
    design = np.hstack([scaled[:, rows] * scaled[:, columns], 2.0 * scaled])
    solution, *_ = np.linalg.lstsq(design, np.ones(len(scaled)), rcond=None)
    quadratic = np.zeros((axes, axes))
    quadratic[rows, columns] = solution[: len(rows)]
    quadratic = (quadratic + quadratic.T) / 2.0
    linear = solution[len(rows) :]
    if np.linalg.eigvalsh(quadratic)[0] < SMALLEST_CURVATURE:
        raise ModelError(
            "fit_magnetometer: the readings do not fit an ellipsoid; turn the sensor through all directions"
        )
    centre = -np.linalg.solve(quadratic, linear)
    return middle + scale * centre, quadratic


def _require_all_directions(field: NDArray[np.float64]) -> None:
    directions = field / np.linalg.norm(field, axis=1, keepdims=True)
    mean = float(np.linalg.norm(directions.mean(axis=0)))
    spread = float(np.linalg.eigvalsh(directions.T @ directions / len(directions))[0])
    if mean > LARGEST_MEAN_DIRECTION or spread < SMALLEST_DIRECTION_SPREAD:
        raise ModelError(
            f"fit_magnetometer: the readings do not cover all directions evenly (mean direction {mean:.2f}, "
            f"at most {LARGEST_MEAN_DIRECTION}; spread {spread:.2f}, at least {SMALLEST_DIRECTION_SPREAD}); "
            "turn the sensor through all directions"
        )
