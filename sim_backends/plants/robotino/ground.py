"""The site as a grid: per cell a row of a table of grounds, and a roughness factor."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from sim_backends.arrays import Array
from sim_backends.plants.robotino.site import Site
from sim_backends.plants.robotino.surfaces import soft_ground_resistance

MARGIN_M = 0.1


class Ground(NamedTuple):
    """The ground in cells; outside the grid it is row 0 without roughness.

    Attributes:
        x_min_m, y_min_m: Corner of the first cell.
        cells_per_m: One over the width of a cell.
        row: Row of `rows` for each cell, by x and y.
        roughness: Factor on the resistances for each cell, by x and y.
        rows: Per ground: friction, stiffness, drag along, drag across, soft-ground resistance along, across.
    """

    x_min_m: float
    y_min_m: float
    cells_per_m: float
    row: NDArray[np.int16]
    roughness: NDArray[np.float32]
    rows: Array


def rasterise(site: Site, wheel_radius_m: float, rng: np.random.Generator) -> Ground:
    """Return the patches of a site on a grid, with random roughness.

    Args:
        site: The site.
        wheel_radius_m: Radius of the rover's wheels.
        rng: Source of the roughness; two calls with the same generator state give the same ground.
    """
    (x_min, x_max), (y_min, y_max) = _extent(site)
    column_count = max(1, math.ceil((x_max - x_min) / site.cell_m))
    line_count = max(1, math.ceil((y_max - y_min) / site.cell_m))
    x_m = _cell_centres(x_min, column_count, site.cell_m)[:, None]
    y_m = _cell_centres(y_min, line_count, site.cell_m)[None, :]
    grounds = [(site.floor, 0.0)]
    row = np.zeros((column_count, line_count), dtype=np.int16)
    for patch in site.patches:
        ground = (patch.surface, patch.sinkage_m if patch.inner == "soft" else 0.0)
        if ground not in grounds:
            grounds.append(ground)
        columns = _near(x_m[:, 0], patch.x_range_m, site.cell_m)
        lines = _near(y_m[0], patch.y_range_m, site.cell_m)
        is_covered = patch.covers(x_m[columns], y_m[:, lines])
        row[columns, lines][is_covered] = grounds.index(ground)
    rows = [_row(site, name, sinkage_m, wheel_radius_m) for name, sinkage_m in grounds]
    return Ground(
        x_min,
        y_min,
        1.0 / site.cell_m,
        row,
        _roughness(site, (column_count, line_count), rng),
        np.array(rows),
    )


def _cell_centres(first_edge_m: float, count: int, cell_m: float) -> Array:
    return np.array([first_edge_m + (index + 0.5) * cell_m for index in range(count)])


def _near(centres_m: Array, range_m: tuple[float, float], cell_m: float) -> slice:
    """Return the cells with their centres in a range, and one more at each end."""
    least_m, greatest_m = range_m
    first, last = np.searchsorted(centres_m, (least_m - cell_m, greatest_m + cell_m)).tolist()
    return slice(first, last)


def _extent(site: Site) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the least and largest x and y of all patches, with a margin."""
    xs = [x for patch in site.patches for x in patch.x_range_m]
    ys = [y for patch in site.patches for y in patch.y_range_m]
    if not xs:
        return (0.0, 0.0), (0.0, 0.0)
    return (min(xs) - MARGIN_M, max(xs) + MARGIN_M), (min(ys) - MARGIN_M, max(ys) + MARGIN_M)


def _row(site: Site, name: str, sinkage_m: float, wheel_radius_m: float) -> tuple[float, ...]:
    surface = site.surfaces[name]
    soft_ground = soft_ground_resistance(sinkage_m, wheel_radius_m)
    return (surface.friction, surface.stiffness, surface.drag_along, surface.drag_across, *soft_ground)


def _roughness(site: Site, shape: tuple[int, int], rng: np.random.Generator) -> NDArray[np.float32]:
    """Return a smooth random factor per cell, mean 1, never below 0.1."""
    noise: Array = ndimage.gaussian_filter(rng.standard_normal(shape), site.roughness_length_m / site.cell_m)
    spread = float(noise.std())
    factor = 1.0 + (site.roughness / spread if spread > 0 else 0.0) * noise
    return np.maximum(factor, 0.1).astype(np.float32)
