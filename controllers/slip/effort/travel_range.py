"""The training range of a map: directions and speeds of travel. Plain floats."""

import math
from collections.abc import Sequence

from controllers.slip.effort.parameters import EFFORT


def travel_problem(
    directions_rad: Sequence[float],
    speed_range_m_s: tuple[float, float],
    direction_rad: float,
    speed_m_s: float,
) -> str:
    """Return why a map does not hold for this travel in the body frame; empty where it does."""
    problem = direction_problem(directions_rad, direction_rad)
    if problem:
        return problem
    low, high = speed_range_m_s
    if not (1.0 - EFFORT.range.speed_margin) * low <= speed_m_s <= (1.0 + EFFORT.range.speed_margin) * high:
        return f"speed {speed_m_s:.3g} m/s is outside the training range"
    return ""


def direction_problem(directions_rad: Sequence[float], direction_rad: float) -> str:
    """Return why a map does not hold for a direction in the body frame; empty where it does."""
    gaps = (abs(math.remainder(direction_rad - known, math.tau)) for known in directions_rad)
    if all(gap > EFFORT.range.direction_gap_rad for gap in gaps):
        return f"direction {math.degrees(direction_rad):.0f} deg is outside the training range"
    return ""
