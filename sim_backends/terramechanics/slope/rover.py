"""A rover on a slope: its geometry, its conditions, and effects beyond the paper's model."""

import math
from dataclasses import dataclass
from typing import Annotated, Protocol

from pydantic import Field

from drivers.settings import Settings
from drivers.units import STANDARD_GRAVITY_M_S2
from sim_backends.arrays import Array
from sim_backends.terramechanics.soil.library import WheelSettings, load_wheel
from sim_backends.terramechanics.soil.quantity import check_range, quantity
from sim_backends.terramechanics.soil.wheel_contact import STEEPEST_RAD

Length = Annotated[float, quantity("m", -100.0, 100.0)]
FOUR_WHEELS = ((0.3, 0.275), (0.3, -0.275), (-0.3, 0.275), (-0.3, -0.275))


class SlopeRover(Settings):
    """A rover with rigid wheels of one kind, all driven at one speed and parallel.

    Attributes:
        mass_kg: Mass of the whole rover.
        wheel: Wheel.
        wheel_positions_m: (x, y) of each contact in the surface, x forward, y left (uphill in a traverse);
            paper 001, Table I: wheel base 0.6 m, L_u = L_d = 0.275 m.
        cog_height_m: L_h, of the centre of gravity over the surface.
        cog_lateral_m: Position of the centre of gravity to the left of the origin of the positions.
        cog_forward_m: Position of the centre of gravity ahead of that origin.
    """

    mass_kg: Annotated[float, quantity("kg", 0.01, 1e6)]
    wheel: WheelSettings
    wheel_positions_m: Annotated[tuple[tuple[Length, Length], ...], Field(min_length=1)] = FOUR_WHEELS
    cog_height_m: Annotated[float, quantity("m", 0.0, 100.0)] = 0.187
    cog_lateral_m: Length = 0.0
    cog_forward_m: Length = 0.0


def paper_rover(mass_kg: float = 23.8) -> SlopeRover:
    """Return the four-wheeled test bed of paper 001, Table I."""
    return SlopeRover(mass_kg=mass_kg, wheel=load_wheel("paper_001"))


@dataclass(frozen=True, slots=True)
class Conditions:
    """Slope, roll and heading of a rover.

    Attributes:
        slope_rad: alpha, steepness of the surface, 0 to 45 deg.
        roll_rad: psi_h, of the rover about its forward axis, to its left (uphill in a traverse);
            within 45 deg.
        heading_rad: In the surface, counter-clockwise from the traverse that has uphill to the left:
            pi/2 climbs, -pi/2 descends; within +-2 pi.
        gravity_m_s2: 0.1 to 100.

    Raises:
        ModelError: A number is outside its range; names parameter, value, unit and range.
    """

    slope_rad: float
    roll_rad: float = 0.0
    heading_rad: float = 0.0
    gravity_m_s2: float = STANDARD_GRAVITY_M_S2

    def __post_init__(self) -> None:
        check_range("slope_rad", self.slope_rad, "rad", 0.0, STEEPEST_RAD)
        check_range("roll_rad", self.roll_rad, "rad", -STEEPEST_RAD, STEEPEST_RAD)
        check_range("heading_rad", self.heading_rad, "rad", -2.0 * math.pi, 2.0 * math.pi)
        check_range("gravity_m_s2", self.gravity_m_s2, "m/s^2", 0.1, 100.0)

    @property
    def cross_slope_rad(self) -> float:
        """Slope of the surface across the wheels, rising to the left."""
        return math.atan(math.tan(self.slope_rad) * math.cos(self.heading_rad))


class SoilFlow(Protocol):
    """Soil that moves under the wheels, e.g. when a slope fails."""

    def __call__(self, conditions: Conditions, slip: float, sinkage_m: Array) -> tuple[Array, Array]:
        """Return the soil's velocity forward and to the left, over the rim speed r_s omega; one per wheel.

        Args:
            conditions: Slope, roll and heading of the rover.
            slip: Slip ratio of the rover.
            sinkage_m: Of the wheels' middle planes, (N,).
        """
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class Effects:
    """Effects beyond the paper's model; none by default.

    Attributes:
        soil_flow: Motion of the soil under the wheels.
        slip_sinkage_m: Sinkage per slip ratio that carries no load, 0 to 0.2.
        sidewall: False omits the forces on the side walls.
    """

    soil_flow: SoilFlow | None = None
    slip_sinkage_m: float = 0.0
    sidewall: bool = True
