"""Thrust over slip, with everything else balanced: slow, but finds every state."""

import numpy as np

from sim_backends.arrays import Array
from sim_backends.terramechanics.slope.balance import Balance
from sim_backends.terramechanics.soil.quadrature import rule_for
from sim_backends.terramechanics.soil.wheel_set import MOST_SLIP

SLIPS = 25
BISECTIONS = 18
SECANTS = 20
SUNK = 1e-5
HELD = 1e-3
WIDEST = 8.0
"""Greatest sideways speed over forward speed: a slip angle of 83 deg."""
COARSE = 1e-3
NO_BEARING = "the soil cannot bear the rover: its wheels sink to the axles"
NO_SIDE_GRIP = "the soil cannot hold the rover across the slope"
NO_THRUST = "the soil cannot give the thrust that the slope asks for"


def scan(balance: Balance, lowest: float) -> tuple[Array | None, str]:
    """Return a point near the balanced state with the least slip, by trying all slips.

    Args:
        balance: What is to be balanced.
        lowest: Least slip ratio.

    Returns:
        The point, or None and the reason why there is no balanced state.
    """
    start, end = lowest, MOST_SLIP
    point: Array | None = None
    for _ in range(3):
        # Closer together at small slip, where forces change fastest.
        share = np.linspace(0.0, 1.0, SLIPS) ** 2 if start >= 0.0 else np.linspace(0.0, 1.0, SLIPS)
        slips = start + (end - start) * share
        points, thrust = profile(balance, slips)
        held = np.isfinite(thrust)
        enough = held & (np.where(held, thrust, -1.0) >= 0.0)
        if not enough.any():
            bears = np.isfinite(points).all(axis=1).any()
            return point, NO_THRUST if held.any() else NO_SIDE_GRIP if bears else NO_BEARING
        index = int(np.argmax(enough))
        point = points[index]
        if index == 0 or not held[index - 1]:
            break
        start, end = float(slips[index - 1]), float(slips[index])
    return point, ""


def profile(balance: Balance, slips: Array) -> tuple[Array, Array]:
    """Return points of the search, and the residual of F_x there, for a row of slip ratios.

    For each slip ratio sinkages and side speed are found that balance F_z and F_y, by bisection.

    Args:
        balance: What is to be balanced.
        slips: Slip ratios, (M,).

    Returns:
        Points (M, 2 + K) with F_y and F_z balanced; the residual of F_x (M,), NaN where that is impossible.
    """
    speed = np.where(slips >= 0.0, 1.0 - slips, 1.0 / (1.0 + np.minimum(slips, 0.0)))
    # Side speeds are bisected on a scale that is even for small ones, where forces change fastest.
    low = np.full(slips.shape, 0.0 if balance.straight else -np.sqrt(WIDEST))
    high = -low
    for _ in range(0 if balance.straight else BISECTIONS):
        middle = 0.5 * (low + high)
        _, missing = _sunk(balance, _points(balance, slips, speed * middle * np.abs(middle)))
        # Too little force to the left asks for more motion to the right.
        right = missing[:, 1] < 0.0
        high = np.where(right, middle, high)
        low = np.where(right, low, middle)
    middle = 0.5 * (low + high)
    points, missing = _sunk(balance, _points(balance, slips, speed * middle * np.abs(middle)))
    good = np.isfinite(points).all(axis=1) & (np.abs(missing[:, 1]) < HELD)
    return points, np.where(good, missing[:, 0], np.nan)


def _points(balance: Balance, slips: Array, side: Array) -> Array:
    """Return points with the deepest sinkages."""
    root = np.sqrt(slips + 1j * (side - balance.side_origin))
    points = np.full((slips.size, 2 + balance.load_n.size), balance.depth_range[1])
    points[:, 0] = np.where(side == 0.0, np.sign(slips) * np.sqrt(np.abs(slips)), root.real)
    points[:, 1] = np.where(side == 0.0, 0.0, root.imag)
    return points


def _sunk(balance: Balance, points: Array) -> tuple[Array, Array]:
    """Return the points with sinkages that balance the loads (NaN where none does), and the residual.

    F_z grows with sinkage, so a secant step within a shrinking bracket (Illinois) finds the only root.
    """
    rule = rule_for(COARSE)
    points = points.copy()
    high = points[:, 2:].copy()
    low = np.full(high.shape, balance.depth_range[0])
    missing = balance.residual(balance.forces(rule, points))
    bears = missing[:, 2:] >= 0.0
    # Where not even the deepest sinkage bears the load, any gap will do that keeps the trial in the bracket.
    low_gap, high_gap = np.full(high.shape, -1.0), np.where(bears, missing[:, 2:], 1.0)
    for _ in range(SECANTS):
        points[:, 2:] = low - (high - low) * low_gap / np.maximum(high_gap - low_gap, 1e-300)
        missing = balance.residual(balance.forces(rule, points))
        gap = missing[:, 2:]
        if (np.abs(gap) < SUNK)[bears].all():
            break
        below = gap < 0.0
        high_gap, low_gap = np.where(below, 0.5 * high_gap, gap), np.where(below, gap, 0.5 * low_gap)
        low = np.where(below, points[:, 2:], low)
        high = np.where(below, high, points[:, 2:])
    points[:, 2:] = np.where(bears, points[:, 2:], np.nan)
    return points, missing
