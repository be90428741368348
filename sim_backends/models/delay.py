"""Mean rates in windows, delayed by a time that need not be a whole number of windows."""

import math
from functools import cache

import numpy as np
from scipy.interpolate import CubicSpline

from sim_backends.models.interface import Array


def earlier(t_s: Array, rate: Array, latency_s: float) -> Array:
    """Return the mean rates of windows that end earlier; nothing moved before the first.

    Args:
        t_s: Middles of windows of equal length.
        rate: Mean rates in them.
        latency_s: 0 or more.
    """
    if latency_s == 0.0 or t_s.size < 2:
        return rate
    width = float(t_s[1] - t_s[0])
    total = np.concatenate(([0.0], np.cumsum(rate) * width))
    late = latency_s / width
    whole = math.ceil(late)
    count = total.size - whole
    reached = np.zeros(total.size)
    if count > 0:
        # Smooth, so that a small change of the latency changes the rates in proportion.
        slope = _spline_slopes(total.size) @ total
        here, after = slice(0, count), slice(1, count + 1)
        near, far = whole - late, 1.0 - (whole - late)
        reached[whole:] = (
            (1.0 + 2.0 * near) * far**2 * total[here]
            + (1.0 + 2.0 * far) * near**2 * total[after]
            + near * far * (far * slope[here] - near * slope[after])
        )
    shifted: Array = np.diff(reached) / width
    return shifted


def later(t_s: Array, rate: Array, time_s: float) -> Array:
    """Return the mean rates as they are `time_s` later, 0 or more; after the last window they stay."""
    last = float(rate[-1])
    shifted: Array = last + earlier(t_s, rate[::-1] - last, time_s)[::-1]
    return shifted


@cache
def _spline_slopes(count: int) -> Array:
    """Return what turns `count` values at equal steps into the slopes per step of their cubic spline."""
    steps = np.arange(count, dtype=np.float64)
    slopes: Array = CubicSpline(steps, np.eye(count))(steps, 1)
    return slopes
