"""Simulated rovers ("natures") from the literature; README.md has sources, equations and constants."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from tests.nature.floors import bristle, carpet, falling, tread, tread_differential
from tests.nature.floors.bristle import BristlePlant
from tests.nature.floors.carpet import CarpetPlant
from tests.nature.floors.falling import FallingPlant
from tests.nature.floors.measure import translation_slip
from tests.nature.floors.patchwork import Floor
from tests.nature.floors.rover import RoverPlant
from tests.nature.floors.tread import TreadPlant
from tests.nature.floors.tread_differential import DifferentialTreadPlant

__all__ = [
    "NATURES",
    "BristlePlant",
    "CarpetPlant",
    "DifferentialTreadPlant",
    "FallingPlant",
    "Floor",
    "Nature",
    "RoverPlant",
    "TreadPlant",
]


@dataclass(frozen=True)
class Nature:
    """One simulated rover with its kind of floors.

    Attributes:
        resistance: Constant of a tile that holds the hub's resistance per load.
    """

    name: str
    plant: type[RoverPlant]
    draw_floor: Callable[[int], Floor]
    resistance: int

    def steady_slip(self, floor: Floor, speed_m_s: float = 0.15, direction_rad: float = 0.0) -> float:
        """Return the steady slip of a straight drive across the floor, 1 - true path / path by the wheels.

        A rover that cannot drive sideways starts with its nose in the direction.
        """
        rng, nose_ahead = np.random.default_rng(floor.seed), self.plant.wheel_count == 2
        plant = self.plant(floor, rng, 0, start_yaw_rad=direction_rad if nose_ahead else 0.0)
        return translation_slip(plant, speed_m_s, 0.0 if nose_ahead else direction_rad)


NATURES: Final = (
    Nature("bristle", BristlePlant, bristle.draw_floor, bristle.RESISTANCE),
    Nature("tread", TreadPlant, tread.draw_floor, tread.DRAG),
    Nature("carpet", CarpetPlant, carpet.draw_floor, carpet.RESISTANCE),
    Nature("tread, two wheels", DifferentialTreadPlant, tread_differential.draw_floor, tread.DRAG),
    Nature("falling", FallingPlant, falling.draw_floor, falling.RESISTANCE),
)
