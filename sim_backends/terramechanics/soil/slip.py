"""Slip and skid ratio, shearing radius."""

import numpy as np
from numpy.typing import ArrayLike

from sim_backends.arrays import Array
from sim_backends.terramechanics.soil.quantity import check_range

LARGEST = 1e6


def shearing_radius(radius_m: float, lug_height_m: float, shearing_share: float) -> float:
    """Return the radius r_s = r + lambda_s h at which a wheel with lugs shears the soil, m.

    Paper 002, eq 8.

    Args:
        radius_m: r, 0.001 to 5.
        lug_height_m: h, 0 to 1.
        shearing_share: lambda_s, 0 to 1.

    Raises:
        ModelError: A number is outside its range.
    """
    check_range("radius_m", radius_m, "m", 0.001, 5.0)
    check_range("lug_height_m", lug_height_m, "m", 0.0, 1.0)
    check_range("shearing_share", shearing_share, "1", 0.0, 1.0)
    return radius_m + shearing_share * lug_height_m


def slip_ratio(speed_m_s: ArrayLike, rim_speed_m_s: ArrayLike) -> Array:
    """Return the slip ratio: 1 - v / (r omega) in slip, r omega / v - 1 (negative) in skid.

    Paper 001, eq 1; paper 002, eqs 5 to 7, with the rim speed at the shearing radius.

    Args:
        speed_m_s: v, along the wheel's plane, at least 0; any shape.
        rim_speed_m_s: r_s omega, at least 0, not 0 where v is; broadcast with it.

    Returns:
        -1 (locked) to 1 (spinning on the spot); 0 where both are equal.

    Raises:
        ModelError: A speed is negative or not a number, or both are 0.
    """
    check_range("speed_m_s", speed_m_s, "m/s", 0.0, LARGEST)
    check_range("rim_speed_m_s", rim_speed_m_s, "m/s", 0.0, LARGEST)
    speed, rim = np.broadcast_arrays(np.asarray(speed_m_s, float), np.asarray(rim_speed_m_s, float))
    faster = np.maximum(speed, rim)
    check_range("the greater of speed_m_s and rim_speed_m_s", faster, "m/s", np.finfo(float).tiny, LARGEST)
    return np.asarray((rim - speed) / faster)


def speed_ratio(slip: ArrayLike) -> Array:
    """Return v / (r_s omega) of a slip ratio: 1 - s in slip, 1 / (1 + s) in skid.

    Args:
        slip: More than -1, at most 1; any shape.

    Raises:
        ModelError: Outside that range.
    """
    check_range("slip", slip, "1", -0.999, 1.0)
    ratio = np.asarray(slip, float)
    return np.where(ratio >= 0.0, 1.0 - ratio, 1.0 / (1.0 + np.minimum(ratio, 0.0)))
