"""Torque and drawbar pull of a skidding wheel from its measurements in slip (paper 002, eqs 26-29).

Good for wheels with lugs, poor for the smooth one. Compared with the paper's own skid lines at 85 N over slip
ratios from -1 to 0 the rms difference is 0.83, 0.33 and 1.44 N m in torque and 3.1, 2.3 and 9.1 N in drawbar
pull for Wh31 (15 mm lugs), Wh32 (10 mm) and Wh34 (smooth).
"""

import numpy as np
from numpy.typing import ArrayLike

from drivers.errors import ModelError
from sim_backends.arrays import Array
from sim_backends.terramechanics.soil.slip_skid_model import (
    TESTED_LOAD_N,
    SlipSkidWheel,
    checked_load,
    checked_slip_ratio,
)


def tractive_coefficient_in_skid(wheel: SlipSkidWheel, slip_ratio: ArrayLike) -> Array:
    """Return lambda_TC at slip ratios from -1 to 0, mirrored about its value at 0 (eq 26).

    Raises:
        ModelError: A slip ratio is outside [-1, 0].
    """
    skid = _skid_ratio(slip_ratio)
    return 2 * wheel.moment.at(0.0) - wheel.moment.at(skid)


def resistance_moment_in_skid_nm(
    wheel: SlipSkidWheel, slip_ratio: ArrayLike, normal_force_n: float = TESTED_LOAD_N
) -> Array:
    """Return the moment M_DR in N m at slip ratios from -1 to 0 (eq 27).

    Raises:
        ModelError: A slip ratio is outside [-1, 0], or the load is not positive.
    """
    coefficient = tractive_coefficient_in_skid(wheel, slip_ratio)
    return coefficient * checked_load(normal_force_n) * wheel.shearing_radius_m


def resistance_coefficient_in_skid(wheel: SlipSkidWheel, slip_ratio: ArrayLike) -> Array:
    """Return lambda_RC at slip ratios from -1 to 0: that of the same slip (eq 28 with a plus sign).

    The printed minus sign contradicts both eq 29 and Table II, where resistance is positive either way.

    Raises:
        ModelError: A slip ratio is outside [-1, 0].
    """
    return wheel.resistance.at(_skid_ratio(slip_ratio))


def drawbar_pull_in_skid_n(
    wheel: SlipSkidWheel, slip_ratio: ArrayLike, normal_force_n: float = TESTED_LOAD_N
) -> Array:
    """Return the drawbar pull F_DP in N at slip ratios from -1 to 0; negative (eq 29).

    Raises:
        ModelError: A slip ratio is outside [-1, 0], or the load is not positive.
    """
    traction = tractive_coefficient_in_skid(wheel, slip_ratio)
    return (traction - resistance_coefficient_in_skid(wheel, slip_ratio)) * checked_load(normal_force_n)


def _skid_ratio(slip_ratio: ArrayLike) -> Array:
    slip = checked_slip_ratio(slip_ratio)
    if np.any(slip > 0):
        raise ModelError(f"slip_ratio = {slip.max()} must lie between -1 and 0: this law is for skid")
    return -slip
