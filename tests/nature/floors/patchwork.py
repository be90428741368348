"""Floors of square tiles, each with its own constants; what they mean is each nature's affair."""

import dataclasses
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from tests.nature.floors.machine import Floats, Machine

__all__ = [
    "Ends",
    "Floor",
    "Grid",
    "between",
    "draw_kinds",
    "draw_softness",
    "graded",
    "lay_floor",
    "scatter",
    "table_of_kinds",
    "tile_constants",
]

Ends = tuple[float, float]
"""A constant of hard and of soft ground."""

_GOLDEN: Final = (math.sqrt(5.0) - 1.0) / 2.0
_HALF_WIDTH_M: Final = 3.0
"""A floor covers 6 m x 6 m around the start; its outermost tiles go on for ever."""
_KIND_SPREAD: Final = 0.12
"""Grades of a floor's kinds differ by this to either side."""


class Grid(NamedTuple):
    """A floor as compiled code sees it: constants by row, column and meaning."""

    constants: Floats
    corner_x_m: float
    corner_y_m: float
    tile_m: float


@dataclass(frozen=True)
class Floor:
    """A patchwork of tiles and the rover that drives on it.

    Attributes:
        softness: Grade of the floor as drawn, 0 hard to 1 soft; a label, no constant of any law.
        kind: Kind of ground of each tile, by row (y) and column (x), an index of `kind_names`.
    """

    seed: int
    machine: Machine
    softness: float
    kind_names: tuple[str, ...]
    kind: NDArray[np.int64]
    grid: Grid

    def tile_at(self, x_m: float, y_m: float) -> tuple[int, int]:
        """Return row and column of the tile under a place."""
        rows, columns = self.kind.shape
        row = math.floor((y_m - self.grid.corner_y_m) / self.grid.tile_m)
        column = math.floor((x_m - self.grid.corner_x_m) / self.grid.tile_m)
        return min(max(row, 0), rows - 1), min(max(column, 0), columns - 1)

    def uniform(self, row: int, column: int) -> "Floor":
        """Return an endless floor of one of this floor's tiles."""
        grid = self.grid._replace(constants=self.grid.constants[row : row + 1, column : column + 1].copy())
        return dataclasses.replace(self, kind=self.kind[row : row + 1, column : column + 1].copy(), grid=grid)

    def changed(self, meaning: int, value: float) -> "Floor":
        """Return this floor with one constant set to the same value on all tiles."""
        constants = self.grid.constants.copy()
        constants[:, :, meaning] = value
        return dataclasses.replace(self, grid=self.grid._replace(constants=constants))


def draw_softness(seed: int, lean: float) -> float:
    """Draw a floor's grade, uniform for a lean of 1 and towards the soft end above.

    Floors of consecutive seeds cover the grades evenly (Kronecker sequence of the golden ratio, Niederreiter
    1992, section 3.1): so a dozen floors in a row are already a fair sample of soft and hard ones.
    """
    return float(1.0 - (seed * _GOLDEN % 1.0) ** lean)


def draw_kinds(
    rng: np.random.Generator, softness: float, names: Iterable[str]
) -> tuple[tuple[str, float], ...]:
    """Draw the order of a floor's kinds of ground, and their grades around the floor's own grade.

    The grades are spread evenly, not drawn one by one: so no floor has kinds that are all alike.
    """
    kinds = [str(name) for name in rng.permutation(list(names))]
    places = np.linspace(-1.0, 1.0, len(kinds)) + rng.uniform(-0.2, 0.2, len(kinds))
    grades = (softness + _KIND_SPREAD * float(place) for place in rng.permutation(places))
    return tuple((name, min(1.0, max(0.0, grade))) for name, grade in zip(kinds, grades, strict=True))


def table_of_kinds(names: Sequence[str], rows: Mapping[int, Sequence[Ends]]) -> dict[str, dict[int, Ends]]:
    """Return the ends of each kind's constants by their meaning, from a row per meaning."""
    return {name: {meaning: row[place] for meaning, row in rows.items()} for place, name in enumerate(names)}


def between(hard: float, soft: float, grade: float) -> float:
    """Return a constant of a grade of ground, between those of the hard and the soft end, in proportion."""
    return float(hard * (soft / hard) ** grade)


def graded(ends: Mapping[int, Ends], grade: float) -> dict[int, float]:
    """Return the constants of a grade of ground, by their meaning."""
    return {meaning: between(hard, soft, grade) for meaning, (hard, soft) in ends.items()}


def scatter(rng: np.random.Generator, value: dict[int, float], meanings: Iterable[int]) -> None:
    """Let some of a tile's constants scatter."""
    for meaning in meanings:
        value[meaning] *= float(rng.uniform(0.93, 1.07))


def lay_floor(
    rng: np.random.Generator,
    seed: int,
    machine: Machine,
    softness: float,
    kinds: Sequence[tuple[str, float]],
    draw_tile: Callable[[int], list[float]],
) -> Floor:
    """Lay tiles of random kinds over the floor.

    Args:
        rng: Source of the tile size, the place of the tile corners and the kinds.
        seed: Of the floor.
        machine: The rover that drives on it.
        softness: Grade of the floor.
        kinds: Kinds of ground with their grades.
        draw_tile: Returns the constants of a tile of a kind.
    """
    tile_m = float(rng.uniform(0.3, 0.6))
    count = math.ceil(2.0 * _HALF_WIDTH_M / tile_m) + 1
    corner_x_m, corner_y_m = (float(-_HALF_WIDTH_M - tile_m * part) for part in rng.uniform(0.0, 1.0, 2))
    kind = rng.integers(0, len(kinds), (count, count))
    constants = np.array([[draw_tile(int(entry)) for entry in row] for row in kind], dtype=np.float64)
    grid = Grid(constants, corner_x_m, corner_y_m, tile_m)
    return Floor(seed, machine, softness, tuple(name for name, _ in kinds), kind, grid)


@njit(cache=True)
def tile_constants(grid: Grid, x_m: float, y_m: float) -> Floats:
    """Return the constants of the tile under a place."""
    rows, columns = grid.constants.shape[0], grid.constants.shape[1]
    row = math.floor((y_m - grid.corner_y_m) / grid.tile_m)
    column = math.floor((x_m - grid.corner_x_m) / grid.tile_m)
    row = min(max(row, 0), rows - 1)
    column = min(max(column, 0), columns - 1)
    constants: Floats = grid.constants[row, column]
    return constants
