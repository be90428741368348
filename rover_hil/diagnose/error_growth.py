"""How the error of the odometry grows: variances of its causes, by maximum likelihood over parts of drives.

The causes are those of the pose filter: yaw that walks at random over rotations and over the way, place that
does so, and slip along and across that lasts. Each makes a covariance of the error at the end of a part that
follows from the path; the ground truth adds its own noise. H. Zhou, L. Hu, J. Zhou, K. Lange: MM algorithms
for variance components models. Journal of Computational and Graphical Statistics 28 (2019) 350-361.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.stats import norm

from controllers.estimation.slip_prior import UNKNOWN
from rover_hil.diagnose.drive_errors import ODOMETRY, Compared
from rover_hil.diagnose.trajectory_errors import Places
from rover_hil.drives.arrays import Array, Times

PARTS = (1, 2, 4, 8)
"""Numbers of parts that a drive is cut into; each way counts as much."""
MOST_STEPS = 200
"""Of a drive."""
ROUNDS = 500
SETTLED = 1e-4
"""Greatest relative change of a standard deviation."""
FIRST_SD = 0.01
LEAST_VARIANCE = 1e-14
LEAST_DRIVES = 4
"""Fewer do not show how much the error varies from drive to drive."""
LEAST = 1.0
"""Metre or radian that a drive counts for at least, there."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ErrorGrowth:
    """Standard deviations.

    Attributes:
        parts: Number of parts they are from.
        yaw_rad_sqrt_rad: Of the yaw after rotating by one radian.
        yaw_rad_sqrt_m: Of the yaw after one metre.
        place_m_sqrt_m: Of the place after one metre.
        place_m_sqrt_rad: Of the place after rotating by one radian.
        slip: Of the share of the travel that is lost over some metres.
        cross_slip: The same across.
        true_m: Of a known place.
        true_rad: Of a known yaw.
    """

    parts: int
    yaw_rad_sqrt_rad: float
    yaw_rad_sqrt_m: float
    place_m_sqrt_m: float
    place_m_sqrt_rad: float
    slip: float
    cross_slip: float
    true_m: float
    true_rad: float


@dataclass(frozen=True, slots=True)
class _Steps:
    """Steps of the odometry of a drive, and its error.

    Attributes:
        place_m, yaw_rad: Of the odometry at the edges, (n + 1,).
        true_m, true_rad: Known ones.
        way_m, angle_rad: Of each step, back and forth added, (n,).
    """

    place_m: Places
    yaw_rad: Array
    true_m: Places
    true_rad: Array
    way_m: Array
    angle_rad: Array


def error_growth(compared: Sequence[Compared], slip_mean: float) -> ErrorGrowth | None:
    """Return how the error grows; None for less than four drives with a true yaw, or where a cause is absent.

    On straight lines rotations add nothing.

    Args:
        compared: Drives.
        slip_mean: Share of the travel of the wheels that is always lost.
    """
    drives = [steps for each in compared if (steps := _steps(each, slip_mean)) is not None]
    if len(drives) < LEAST_DRIVES:
        return None
    errors, causes, weights = [], [], []
    for steps in drives:
        for count in PARTS:
            edges = np.linspace(0, len(steps.way_m), count + 1).astype(int).tolist()
            for first, end in pairwise(edges):
                if end > first:
                    errors.append(_error(steps, first, end))
                    causes.append(_causes(steps, first, end))
                    weights.append(1.0 / count)
    table = np.array(causes)
    if not table.any(axis=(0, 2, 3)).all():
        return None
    sd = _standard_deviations(np.array(errors), table, np.array(weights)).tolist()
    *_, true_m, true_rad = sd
    # What is smaller than the noise of the ground truth over the longest drive is not known to be so small.
    way_m = math.sqrt(max(float(each.way_m.sum()) for each in drives))
    angle_rad = math.sqrt(max(float(each.angle_rad.sum()) for each in drives))
    yaw_rad_sqrt_rad, yaw_rad_sqrt_m, place_m_sqrt_m, place_m_sqrt_rad, slip, cross_slip = sd[:6]
    return ErrorGrowth(
        parts=len(errors),
        yaw_rad_sqrt_rad=max(yaw_rad_sqrt_rad, true_rad / max(angle_rad, LEAST)),
        yaw_rad_sqrt_m=max(yaw_rad_sqrt_m, true_rad / max(way_m, LEAST)),
        place_m_sqrt_m=max(place_m_sqrt_m, true_m / max(way_m, LEAST)),
        place_m_sqrt_rad=max(place_m_sqrt_rad, true_m / max(angle_rad, LEAST)),
        slip=slip,
        cross_slip=cross_slip,
        true_m=true_m,
        true_rad=true_rad,
    )


def _steps(compared: Compared, slip_mean: float) -> _Steps | None:
    wheels, true = compared.tracks[ODOMETRY], compared.true
    if wheels.yaw_rad is None or true.yaw_rad is None:
        return None
    edges: Times = np.unique(np.linspace(0, len(compared.t_s) - 1, MOST_STEPS + 1).astype(np.int64))
    way_m = np.concatenate(([0.0], np.cumsum(np.abs(np.diff(wheels.place_m)))))
    angle_rad = np.concatenate(([0.0], np.cumsum(np.abs(np.diff(wheels.yaw_rad)))))
    return _Steps(
        (1.0 - slip_mean) * wheels.place_m[edges],
        wheels.yaw_rad[edges],
        true.place_m[edges],
        true.yaw_rad[edges],
        np.diff(way_m[edges]),
        np.diff(angle_rad[edges]),
    )


def _error(steps: _Steps, first: int, end: int) -> Array:
    """Return the error of x, y and yaw at the end of a part, from the true pose at its start."""
    apart_rad = steps.yaw_rad - steps.true_rad
    true_m = (steps.true_m[end] - steps.true_m[first]) * np.exp(1j * apart_rad[first])
    error_m = steps.place_m[end] - steps.place_m[first] - true_m
    return np.array((error_m.real, error_m.imag, apart_rad[end] - apart_rad[first]))


def _causes(steps: _Steps, first: int, end: int) -> Array:
    """Return the covariance that each cause makes with a standard deviation of 1, (causes, 3, 3)."""
    part = slice(first, end)
    way_m, angle_rad = steps.way_m[part], steps.angle_rad[part]
    middle_m = 0.5 * (steps.place_m[first:end] + steps.place_m[first + 1 : end + 1])
    ahead_m = np.append(steps.place_m[end] - middle_m, steps.place_m[end] - steps.place_m[first])
    swings = np.column_stack((-ahead_m.imag, ahead_m.real, np.ones(end - first + 1)))
    swings, whole = swings[:-1], swings[-1]
    moves_m = np.diff(steps.place_m[first : end + 1])
    travelled_m = np.cumsum(way_m)
    alike = np.exp(-np.abs(travelled_m[:, np.newaxis] - travelled_m) / UNKNOWN.distance_m)
    place, yaw = np.diag((1.0, 1.0, 0.0)), np.diag((0.0, 0.0, 1.0))
    return np.array(
        (
            (swings.T * angle_rad) @ swings,
            (swings.T * way_m) @ swings,
            way_m.sum() * place,
            angle_rad.sum() * place,
            _lasting(moves_m, alike),
            _lasting(1j * moves_m, alike),
            2.0 * place,
            np.outer(whole, whole) + yaw,
        )
    )


def _lasting(moves_m: Places, alike: Array) -> Array:
    """Return the covariance of the sum of moves times a random share."""
    moves = np.column_stack((moves_m.real, moves_m.imag, np.zeros(len(moves_m))))
    covariance: Array = moves.T @ alike @ moves
    return covariance


def _standard_deviations(errors: Array, causes: Array, weights: Array) -> Array:
    """Return the standard deviation of each cause, by maximum likelihood, with what is not known of it.

    A variance cannot be negative: the mean of what is possible, by the standard error, is larger than what is
    likeliest. A cause that is not shown is not taken to be none.

    Args:
        errors: (n, 3).
        causes: (n, causes, 3, 3).
        weights: Of the parts, (n,).
    """
    variances = np.full(causes.shape[1], FIRST_SD**2)
    for _ in range(ROUNDS):
        inverse = np.linalg.inv(np.einsum("k,nkij->nij", variances, causes))
        pull = np.einsum("nij,nj->ni", inverse, errors)
        found = np.einsum("n,ni,nkij,nj->k", weights, pull, causes, pull)
        expected = np.einsum("n,nij,nkji->k", weights, inverse, causes)
        factor = np.sqrt(found / expected)
        is_there = variances > LEAST_VARIANCE
        variances = np.maximum(variances * factor, LEAST_VARIANCE)
        if np.abs(np.log(factor[is_there])).max(initial=0.0) < SETTLED:
            break
    inverse = np.linalg.inv(np.einsum("k,nkij->nij", variances, causes))
    effects = np.einsum("nij,nkjl->nkil", inverse, causes)
    information = 0.5 * np.einsum("n,nkij,nlji->kl", weights, effects, effects)
    # In units of the curvatures, which differ by orders of magnitude.
    scale = 1.0 / np.sqrt(np.diag(information))
    shared = np.linalg.pinv(scale[:, np.newaxis] * information * scale)
    sd = scale * np.sqrt(np.diag(shared))
    sure = variances / sd
    return np.asarray(np.sqrt(variances + sd * norm.pdf(sure) / norm.cdf(sure)), np.float64)
