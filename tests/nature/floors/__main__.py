"""Prints the quantiles of the steady slip at 0.15 m/s that each nature's floors have."""

import math
import sys
from typing import Final

import numpy as np

from tests.nature.floors import NATURES, Nature
from tests.nature.floors.patchwork import Floor

_FLOORS: Final = 40
_DIRECTIONS_DEG: Final = (0.0, 75.0, 160.0, 250.0)
"""They cover driving towards, between and beside the wheels."""
_LOOKED_THROUGH: Final = 200
_SOFTEST: Final = 5
_QUANTILES: Final = (0.1, 0.5, 0.9)


def drive_slips(nature: Nature, floors: int = _FLOORS) -> list[float]:
    """Return the slip of drives across the patchworks of floors 0, 1, ... in all directions."""
    return [
        nature.steady_slip(floor, 0.15, math.radians(degrees))
        for floor in map(nature.draw_floor, range(floors))
        for degrees in _DIRECTIONS_DEG
    ]


def tile_slips(nature: Nature, floors: int = _FLOORS) -> list[float]:
    """Return the slip on some single tiles, each made endless."""
    places = ((0.2, 0.1), (-0.7, 0.4), (0.3, -0.8))
    return [
        nature.steady_slip(floor.uniform(*floor.tile_at(*place)), 0.15, math.radians(degrees))
        for floor in map(nature.draw_floor, range(floors))
        for place, degrees in zip(places, _DIRECTIONS_DEG[1:], strict=True)
    ]


def worst_tile_slip(nature: Nature) -> float:
    """Return the greatest slip on a single tile, of the softest of many floors."""
    softest = sorted(
        map(nature.draw_floor, range(_LOOKED_THROUGH)), key=lambda floor: floor.softness, reverse=True
    )[:_SOFTEST]
    return max(
        nature.steady_slip(tile, 0.15, math.radians(degrees))
        for floor in softest
        for tile in _one_of_each_kind(floor)
        for degrees in _DIRECTIONS_DEG
    )


def _one_of_each_kind(floor: Floor) -> list[Floor]:
    """Return a tile of each kind of ground, endless."""
    places = [tuple(np.argwhere(floor.kind == kind)[0].tolist()) for kind in range(len(floor.kind_names))]
    return [floor.uniform(row, column) for row, column in places]


def main() -> None:
    """Print a line per nature."""
    for nature in NATURES:
        drives, tiles = (
            " ".join(f"{value:.3f}" for value in np.quantile(slips, _QUANTILES))
            for slips in (drive_slips(nature), tile_slips(nature))
        )
        sys.stdout.write(
            f"{nature.name:17s} 10, 50, 90 % of steady slip: drives {drives}   single tiles {tiles}"
            f"   softest tile {worst_tile_slip(nature):.3f}\n"
        )
        sys.stdout.flush()


if __name__ == "__main__":
    main()
