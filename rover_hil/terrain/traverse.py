"""Steady states of a rover that traverses a side slope, as a table."""

import itertools
import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from rover_hil.terrain.table import Table, number
from sim_backends.terramechanics.slope.rover import Conditions, SlopeRover
from sim_backends.terramechanics.slope.steady_state import SteadyState, solve_steady_state
from sim_backends.terramechanics.soil.library import SoilSettings
from sim_backends.terramechanics.soil.wheel_contact import Kernel

COLUMNS = (
    "slope_deg",
    "roll_deg",
    "mass_kg",
    "slip",
    "slip_angle_deg",
    "sinkage_uphill_m",
    "sinkage_downhill_m",
    "boundary",
    "reason",
)


class Traverse(NamedTuple):
    """One steady state of a traverse (paper 001, IV.B).

    Attributes:
        slope_deg: alpha.
        roll_deg: psi_h, of the rover towards uphill.
        mass_kg: Of the rover.
        slip: Slip ratio; None where there is no equilibrium, as for the numbers below.
        slip_angle_deg: beta, negative downhill.
        sinkage_uphill_m: Mean of the uphill wheels at their middle planes.
        sinkage_downhill_m: Mean of the downhill wheels.
        boundary: True where the model has thrust to spare at slip 0: the edge of its domain and not a root;
            None where unknown.
        reason: Why there is no equilibrium, or no sinkage on one side; else empty.
    """

    slope_deg: float
    roll_deg: float
    mass_kg: float
    slip: float | None
    slip_angle_deg: float | None
    sinkage_uphill_m: float | None
    sinkage_downhill_m: float | None
    boundary: bool | None
    reason: str


def solve_traverses(
    rover: SlopeRover,
    soil: SoilSettings,
    slopes_deg: Sequence[float],
    rolls_deg: Sequence[float],
    masses_kg: Sequence[float],
    kernel: Kernel,
) -> Iterator[Traverse]:
    """Yield the steady states for all combinations, the last list running fastest.

    Args:
        rover: Rover; its mass is replaced.
        soil: Soil.
        slopes_deg: 0 to 45.
        rolls_deg: -45 to 45.
        masses_kg: More than 0.
        kernel: What computes the forces.

    Raises:
        ModelError: A number is outside its range.
    """
    for slope_deg, roll_deg, mass_kg in itertools.product(slopes_deg, rolls_deg, masses_kg):
        state = solve_steady_state(
            rover.model_copy(update={"mass_kg": mass_kg}),
            soil,
            Conditions(slope_rad=math.radians(slope_deg), roll_rad=math.radians(roll_deg)),
            kernel=kernel,
        )
        yield Traverse(
            slope_deg,
            roll_deg,
            mass_kg,
            number(state.slip),
            number(math.degrees(state.slip_angle_rad)),
            number(state.sinkage_uphill_m),
            number(state.sinkage_downhill_m),
            bool(state.boundary),
            state.reason or _missing_side(state),
        )


def traverse_table(states: Sequence[Traverse]) -> Table:
    """Return the states as a table."""
    return Table("traverse", "Steady traverses of a side slope", COLUMNS, list(states), keys=3)


def _missing_side(state: SteadyState) -> str:
    both = (("uphill", state.sinkage_uphill_m), ("downhill", state.sinkage_downhill_m))
    sides = [side for side, sinkage_m in both if math.isnan(sinkage_m)]
    return f"no wheel is {' or '.join(sides)} of the centre of gravity" if sides else ""


def no_equilibrium(states: Sequence[Traverse]) -> str:
    """Return one sentence about the states without equilibrium; empty where there are none."""
    failed = [state for state in states if state.slip is None]
    if not failed:
        return ""
    first = failed[0]
    more = f" (and in {len(failed) - 1} more cases)" if len(failed) > 1 else ""
    return (
        f"no equilibrium at slope {first.slope_deg:g} deg, roll {first.roll_deg:g} deg, "
        f"mass {first.mass_kg:g} kg{more}: {first.reason}."
    )
