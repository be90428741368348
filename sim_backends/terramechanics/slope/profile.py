"""Thrust over slip with all other forces balanced: slow, but finds every state."""

import numpy as np

from sim_backends.arrays import Array
from sim_backends.terramechanics.slope.balance import Balance
from sim_backends.terramechanics.soil.quadrature import rule_for
from sim_backends.terramechanics.soil.wheel_set import MOST_SLIP

SLIPS = 25
BISECTIONS = 18
SECANTS = 20
LOAD_TOLERANCE = 1e-5
SIDE_TOLERANCE = 1e-3
LARGEST_SIDE_SPEED = 8.0
"""Greatest sideways speed over forward speed: a slip angle of 83 deg."""
COARSE = 1e-3
NO_BEARING = "the soil cannot bear the rover: its wheels sink to the axles"
NO_SIDE_GRIP = "the soil cannot hold the rover across the slope"
NO_THRUST = "the soil cannot give the thrust that the slope requires"


def scan(balance: Balance, lowest: float) -> tuple[Array | None, str]:
    """Return a point near the balanced state with the least slip, by a scan over all slips.

    Args:
        balance: The force balance.
        lowest: Least slip ratio.

    Returns:
        The point and an empty reason, or None and the reason why there is no balanced state.
    """
    start, end = lowest, MOST_SLIP
    point: Array | None = None
    for _ in range(3):
        # Denser at small slip, where forces change fastest.
        share = np.linspace(0.0, 1.0, SLIPS) ** 2 if start >= 0.0 else np.linspace(0.0, 1.0, SLIPS)
        slips = start + (end - start) * share
        points, thrust = profile(balance, slips)
        is_held = np.isfinite(thrust)
        enough = is_held & (np.where(is_held, thrust, -1.0) >= 0.0)
        if not enough.any():
            is_borne = np.isfinite(points).all(axis=1).any()
            return point, NO_THRUST if is_held.any() else NO_SIDE_GRIP if is_borne else NO_BEARING
        index = int(np.argmax(enough))
        point = points[index]
        if index == 0 or not is_held[index - 1]:
            break
        start, end = float(slips[index - 1]), float(slips[index])
    return point, ""


def profile(balance: Balance, slips: Array) -> tuple[Array, Array]:
    """Return points and the residual of F_x there for a series of slip ratios.

    For each slip ratio sinkages and side speed are found that balance F_z and F_y, by bisection.

    Args:
        balance: The force balance.
        slips: Slip ratios, (M,).

    Returns:
        Points (M, 2 + K) with F_y and F_z balanced; the residual of F_x (M,), NaN where that is impossible.
    """
    speed = np.where(slips >= 0.0, 1.0 - slips, 1.0 / (1.0 + np.minimum(slips, 0.0)))
    # Bisect on the square root of the side speed: forces change fastest at small ones.
    low = np.full(slips.shape, 0.0 if balance.straight else -np.sqrt(LARGEST_SIDE_SPEED))
    high = -low
    for _ in range(0 if balance.straight else BISECTIONS):
        middle = 0.5 * (low + high)
        _, missing = _at_load(balance, _points(balance, slips, speed * middle * np.abs(middle)))
        # Too little force to the left requires more motion to the right.
        right = missing[:, 1] < 0.0
        high = np.where(right, middle, high)
        low = np.where(right, low, middle)
    middle = 0.5 * (low + high)
    points, missing = _at_load(balance, _points(balance, slips, speed * middle * np.abs(middle)))
    is_balanced = np.isfinite(points).all(axis=1) & (np.abs(missing[:, 1]) < SIDE_TOLERANCE)
    return points, np.where(is_balanced, missing[:, 0], np.nan)


def _points(balance: Balance, slips: Array, side: Array) -> Array:
    """Return points with the deepest sinkages."""
    root = np.sqrt(slips + 1j * (side - balance.side_origin))
    points = np.full((slips.size, 2 + balance.load_n.size), balance.depth_range[1])
    points[:, 0] = np.where(side == 0.0, np.sign(slips) * np.sqrt(np.abs(slips)), root.real)
    points[:, 1] = np.where(side == 0.0, 0.0, root.imag)
    return points


def _at_load(balance: Balance, points: Array) -> tuple[Array, Array]:
    """Return the points with sinkages that balance the loads, NaN where there are none, and the residuals.

    F_z grows with sinkage, so a secant step within a shrinking bracket (Illinois) finds the only root.
    """
    rule = rule_for(COARSE)
    points = points.copy()
    high = points[:, 2:].copy()
    low = np.full(high.shape, balance.depth_range[0])
    missing = balance.residual(balance.forces(rule, points))
    is_borne = missing[:, 2:] >= 0.0
    # Where even the deepest sinkage does not bear the load, any gap that keeps the bracket works.
    low_gap, high_gap = np.full(high.shape, -1.0), np.where(is_borne, missing[:, 2:], 1.0)
    for _ in range(SECANTS):
        points[:, 2:] = low - (high - low) * low_gap / np.maximum(high_gap - low_gap, 1e-300)
        missing = balance.residual(balance.forces(rule, points))
        gap = missing[:, 2:]
        if (np.abs(gap) < LOAD_TOLERANCE)[is_borne].all():
            break
        below = gap < 0.0
        high_gap, low_gap = np.where(below, 0.5 * high_gap, gap), np.where(below, gap, 0.5 * low_gap)
        low = np.where(below, points[:, 2:], low)
        high = np.where(below, high, points[:, 2:])
    points[:, 2:] = np.where(is_borne, points[:, 2:], np.nan)
    return points, missing
