"""Simulated rovers ("natures") from the literature; README.md has sources, equations and constants."""

from dataclasses import dataclass
from typing import Final, Protocol

from tests.nature.floors import bristle, carpet, falling, tread, tread_differential
from tests.nature.floors.bristle import BristlePlant
from tests.nature.floors.carpet import CarpetPlant
from tests.nature.floors.falling import FallingPlant
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


class _DrawFloor(Protocol):
    def __call__(self, seed: int) -> Floor: ...


class _SteadySlip(Protocol):
    def __call__(self, floor: Floor, speed_m_s: float = ..., direction_rad: float = ...) -> float: ...


@dataclass(frozen=True)
class Nature:
    """One simulated rover with its kind of floors.

    Attributes:
        resistance: Constant of a tile that holds the hub's resistance per load.
    """

    name: str
    plant: type[RoverPlant]
    draw_floor: _DrawFloor
    steady_slip: _SteadySlip
    resistance: int


NATURES: Final = (
    Nature("bristle", BristlePlant, bristle.draw_floor, bristle.steady_slip, bristle.RESISTANCE),
    Nature("tread", TreadPlant, tread.draw_floor, tread.steady_slip, tread.DRAG),
    Nature("carpet", CarpetPlant, carpet.draw_floor, carpet.steady_slip, carpet.RESISTANCE),
    Nature(
        "tread, two wheels",
        DifferentialTreadPlant,
        tread_differential.draw_floor,
        tread_differential.steady_slip,
        tread.DRAG,
    ),
    Nature("falling", FallingPlant, falling.draw_floor, falling.steady_slip, falling.RESISTANCE),
)
