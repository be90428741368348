"""Monotone tables: check and linear interpolation. Plain floats."""

from bisect import bisect_right
from collections.abc import Sequence
from itertools import pairwise


def check_rising(
    points_name: str, points: Sequence[float], values_name: str, values: Sequence[float]
) -> None:
    """Check that `points` increase and `values`, one for each, do not decrease.

    Raises:
        ValueError: They do not; the message is written for a user.
    """
    if len(points) != len(values):
        raise ValueError(f"{points_name} and {values_name} must have the same length")
    if any(right <= left for left, right in pairwise(points)):
        raise ValueError(f"{points_name} must increase")
    if any(right < left for left, right in pairwise(values)):
        raise ValueError(f"{values_name} must not decrease")


def interpolate(points: Sequence[float], values: Sequence[float], at: float) -> float:
    """Return a value between two points, linearly; before the first and after the last the end value."""
    right = bisect_right(points, at)
    if right == 0:
        return values[0]
    if right == len(points):
        return values[-1]
    left = right - 1
    share = (at - points[left]) / (points[right] - points[left])
    return values[left] + share * (values[right] - values[left])
