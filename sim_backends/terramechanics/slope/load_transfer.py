"""Loads of the wheels of a rover on a slope, and the forces required by its weight."""

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from sim_backends.arrays import Array
from sim_backends.terramechanics.slope.rover import Conditions, SlopeRover

BALANCE_M = 1e-9


class Demand(NamedTuple):
    """Forces that hold a rover, in the wheels' frame (x forward, y left, z along the wheels), N.

    Attributes:
        weight_n: W.
        forward_n: Sum of F_x; W sin(alpha) in a climb, 0 in a traverse.
        left_n: Sum of F_y; W sin(alpha - psi_h) in a traverse.
        vertical_n: F_z of each wheel, (N,); not positive where a wheel lifts off.
        balanced: False where these wheels cannot hold the rover against tipping.
    """

    weight_n: float
    forward_n: float
    left_n: float
    vertical_n: Array
    balanced: bool


def demand(rover: SlopeRover, conditions: Conditions) -> Demand:
    """Return the forces that the soil must supply to hold the rover.

    The loads are those of a rigid rover on equal springs: the least-squares solution of all loads that
    balance weight and moments. For four wheels in a traverse they are eqs 3 and 4 of paper 001; F_z follows
    eq 7, the sums eq 8, for any heading. A rover with one wheel is a test rig: its frame takes the moments,
    so that it cannot tip, and the wheel bears the whole load.

    Args:
        rover: Rover.
        conditions: Slope, roll and heading of the rover.
    """
    weight = rover.mass_kg * conditions.gravity_m_s2
    steep, flat = math.sin(conditions.slope_rad), math.cos(conditions.slope_rad)
    along, across = steep * math.sin(conditions.heading_rad), steep * math.cos(conditions.heading_rad)
    leaning, upright = math.sin(conditions.roll_rad), math.cos(conditions.roll_rad)
    share, balanced = _shares(rover, flat, along, across)
    # W_i of the paper is the load over cos(alpha); the load along the wheel's plane is W_i times this.
    plane = across * leaning + flat * upright
    return Demand(
        weight_n=weight,
        forward_n=weight * along,
        left_n=weight * (across * upright - flat * leaning),
        vertical_n=weight * plane * share / flat,
        balanced=balanced,
    )


def _shares(rover: SlopeRover, flat: float, along: float, across: float) -> tuple[Array, bool]:
    """Return the share of each wheel in the weight across the surface, and whether they hold the rover."""
    if len(rover.wheel_positions_m) == 1:
        return np.array([flat]), True
    levers, inverse = _levers(rover.wheel_positions_m, rover.cog_forward_m, rover.cog_lateral_m)
    moments = np.array([flat, -rover.cog_height_m * along, -rover.cog_height_m * across])
    share = inverse @ moments
    return share, bool(np.abs(levers @ share - moments).max() < BALANCE_M)


@lru_cache(maxsize=256)
def _levers(
    positions: tuple[tuple[float, float], ...], forward_m: float, lateral_m: float
) -> tuple[Array, Array]:
    """Return the matrix from loads to their sum and moments, and its pseudo-inverse."""
    position = np.array(positions)
    levers = np.stack([np.ones(len(position)), position[:, 0] - forward_m, position[:, 1] - lateral_m])
    return levers, np.linalg.pinv(levers)
