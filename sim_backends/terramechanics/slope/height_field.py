"""A surface given by heights on a grid, and the plane on which a rover stands."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.errors import ModelError

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class HeightField:
    """Heights on a rectangular grid, linear in between.

    Attributes:
        x_m: Grid lines, rising, (N,) with N >= 2.
        y_m: Grid lines, rising, (M,) with M >= 2.
        height_m: (N, M).

    Raises:
        ModelError: Shapes do not fit, lines do not rise, or a height is not a number.
    """

    x_m: Floats
    y_m: Floats
    height_m: Floats

    def __post_init__(self) -> None:
        for name, lines in (("x_m", self.x_m), ("y_m", self.y_m)):
            if lines.ndim != 1 or lines.size < 2 or not (np.diff(lines) > 0.0).all():
                raise ModelError(f"{name} must be two or more rising numbers in m.")
        expected = (self.x_m.size, self.y_m.size)
        if self.height_m.shape != expected or not np.isfinite(self.height_m).all():
            raise ModelError(
                f"height_m has shape {self.height_m.shape}; give {expected} finite heights in m."
            )

    def height(self, x_m: Floats, y_m: Floats) -> Floats:
        """Return heights at points within the grid, m.

        Args:
            x_m: Any shape.
            y_m: The same shape.

        Raises:
            ModelError: A point lies outside the grid.
        """
        column, along = _cell("x_m", self.x_m, x_m)
        row, across = _cell("y_m", self.y_m, y_m)
        low = self.height_m[column, row] * (1.0 - across) + self.height_m[column, row + 1] * across
        high = self.height_m[column + 1, row] * (1.0 - across) + self.height_m[column + 1, row + 1] * across
        return np.asarray(low * (1.0 - along) + high * along)


@dataclass(frozen=True, slots=True)
class Plane:
    """A plane that leans.

    Attributes:
        slope_rad: Its steepness, at least 0.
        uphill_rad: Azimuth of the direction that rises most, counter-clockwise from x.
    """

    slope_rad: float
    uphill_rad: float

    def heading_in_plane(self, azimuth_rad: float) -> float:
        """Return an azimuth as angle in the plane from the traverse that has uphill to its left, rad."""
        angle = azimuth_rad - self.uphill_rad + 0.5 * math.pi
        return math.atan2(math.sin(angle) / math.cos(self.slope_rad), math.cos(angle))

    def azimuth(self, heading_rad: float) -> float:
        """Return the azimuth of a direction in the plane; the inverse of `heading_in_plane`, rad."""
        angle = math.atan2(math.sin(heading_rad) * math.cos(self.slope_rad), math.cos(heading_rad))
        return angle + self.uphill_rad - 0.5 * math.pi


def plane_under(field: HeightField, x_m: Floats, y_m: Floats) -> Plane:
    """Return the plane nearest to the surface under a rover's wheels (least squares of the heights).

    Args:
        field: Surface.
        x_m: Of the wheels, (N,) with three or more that are not in line.
        y_m: Of the wheels, (N,).

    Raises:
        ModelError: A wheel stands outside the grid.
    """
    points = np.stack([np.ones(x_m.size), x_m - x_m.mean(), y_m - y_m.mean()], axis=1)
    _, rise_x, rise_y = np.linalg.lstsq(points, field.height(x_m, y_m), rcond=None)[0]
    return Plane(math.atan(math.hypot(rise_x, rise_y)), math.atan2(rise_y, rise_x))


def _cell(name: str, lines: Floats, values: Floats) -> tuple[NDArray[np.intp], Floats]:
    """Return the number of the grid line before each value, and the share of the way to the next."""
    inside = (values >= lines[0]) & (values <= lines[-1])
    if not inside.all():
        wrong = float(np.atleast_1d(values)[~np.atleast_1d(inside)][0])
        raise ModelError(f"{name} is {wrong:g} m, outside {lines[0]:g} .. {lines[-1]:g} m, the height field.")
    index = np.clip(np.searchsorted(lines, values, side="right") - 1, 0, lines.size - 2)
    return index, (values - lines[index]) / (lines[index + 1] - lines[index])
