"""The travel that a map was trained on, and whether another travel is within it. Plain floats."""

import math
from collections.abc import Sequence

DIRECTION_GAP_RAD = math.radians(30.0)
"""A direction of travel further than this from every trained one is outside the training range."""

SPEED_MARGIN = 0.3
"""A speed may leave the trained range by this share of its end."""


def travel_problem(
    directions_rad: Sequence[float],
    speed_range_m_s: tuple[float, float],
    direction_rad: float,
    speed_m_s: float,
) -> str:
    """Say why a map does not hold for this travel in the body frame; empty where it does."""
    problem = direction_problem(directions_rad, direction_rad)
    if problem:
        return problem
    low, high = speed_range_m_s
    if not (1.0 - SPEED_MARGIN) * low <= speed_m_s <= (1.0 + SPEED_MARGIN) * high:
        return f"speed {speed_m_s:.3g} m/s is outside the training range"
    return ""


def direction_problem(directions_rad: Sequence[float], direction_rad: float) -> str:
    """Say that nothing was trained near a direction in the body frame; empty where something was."""
    gaps = (abs(math.remainder(direction_rad - known, math.tau)) for known in directions_rad)
    if min(gaps) > DIRECTION_GAP_RAD:
        return f"direction {math.degrees(direction_rad):.0f} deg is outside the training range"
    return ""
