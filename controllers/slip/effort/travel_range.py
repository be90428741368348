"""The training range of a map: directions and speeds of travel. Plain floats."""

import math
from collections.abc import Sequence

DIRECTION_GAP_RAD = math.radians(30.0)
"""A direction of travel further than this from every trained one is outside the training range."""

SPEED_MARGIN = 0.3
"""A speed may exceed the trained range by this share of its end."""


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
    if not (1.0 - SPEED_MARGIN) * low <= speed_m_s <= (1.0 + SPEED_MARGIN) * high:
        return f"speed {speed_m_s:.3g} m/s is outside the training range"
    return ""


def direction_problem(directions_rad: Sequence[float], direction_rad: float) -> str:
    """Return why a map does not hold for a direction in the body frame; empty where it does."""
    gaps = (abs(math.remainder(direction_rad - known, math.tau)) for known in directions_rad)
    if all(gap > DIRECTION_GAP_RAD for gap in gaps):
        return f"direction {math.degrees(direction_rad):.0f} deg is outside the training range"
    return ""
