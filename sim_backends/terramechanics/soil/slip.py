"""Speed of a wheel from its slip or skid ratio; shearing radius."""

import numpy as np
from numpy.typing import ArrayLike

from sim_backends.arrays import Array
from sim_backends.terramechanics.soil.quantity import check_range


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


def speed_ratio(slip: ArrayLike) -> Array:
    """Return v / (r_s omega) of a slip ratio s: 1 - s in slip, 1 / (1 + s) in skid (paper 001, eq 1).

    Args:
        slip: More than -1, at most 1; any shape.

    Raises:
        ModelError: Outside that range.
    """
    check_range("slip", slip, "1", -0.999, 1.0)
    ratio = np.asarray(slip, float)
    return np.where(ratio >= 0.0, 1.0 - ratio, 1.0 / (1.0 + np.minimum(ratio, 0.0)))
