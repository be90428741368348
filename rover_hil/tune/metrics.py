"""Errors of a driven path against the commanded one, and how much the setpoints vary."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from controllers.motion.missions.mission import Point
from rover_hil.drives.arrays import Array
from rover_hil.report.tracks import Track

PATH_STEP_M = 0.01
LEAST_LENGTH_M2 = 1e-18
REVERSAL_WINDOW_S = 4.0


@dataclass(frozen=True, slots=True)
class TruePath:
    """True poses at equal steps of the driven distance, in the local frame: m, m, rad."""

    x_m: Array
    y_m: Array
    yaw_rad: Array

    @classmethod
    def of(cls, truth: Track) -> "TruePath":
        """Return the path of a track, relative to its first pose."""
        steps_m = np.hypot(np.diff(truth.x_m), np.diff(truth.y_m))
        moved = np.concatenate(([True], steps_m > 0.0))
        driven_m = np.concatenate(([0.0], np.cumsum(steps_m)))[moved]
        at_m = np.linspace(0.0, driven_m[-1], 1 + math.ceil(driven_m[-1] / PATH_STEP_M))
        x_m, y_m, yaw_rad = (
            np.interp(at_m, driven_m, values[moved]) for values in (truth.x_m, truth.y_m, truth.yaw_rad)
        )
        return cls(x_m, y_m, yaw_rad)


def path_rms_m(true_path: TruePath, corners: Sequence[Point]) -> float:
    """Return the root mean square distance in m between the true and the commanded path.

    The mean of both directions, true to commanded and commanded to true: a rover that stops half-way is near
    the commanded path everywhere, but the commanded path is not near its own.
    """
    driven, commanded = np.column_stack((true_path.x_m, true_path.y_m)), _along(np.array(corners))
    there_m, _ = _nearest(driven, commanded)
    back_m, _ = _nearest(commanded, driven)
    return math.sqrt(0.5 * (float(np.mean(there_m**2)) + float(np.mean(back_m**2))))


def closure_m(true_path: TruePath, corners: Sequence[Point]) -> float:
    """Return the distance in m between the true and the commanded end."""
    end_x, end_y = corners[-1]
    return math.hypot(float(true_path.x_m[-1]) - end_x, float(true_path.y_m[-1]) - end_y)


def heading_rms_rad(true_path: TruePath, corners: Sequence[Point], *, along_path: bool) -> float:
    """Return the root mean square heading error in rad over the distance; turns on the spot do not count.

    Args:
        true_path: Poses of the rover.
        corners: The commanded path.
        along_path: The commanded heading is that of the nearest line, else that at the start.
    """
    commanded_rad: Array | float = 0.0
    if along_path:
        points = np.array(corners)
        lines = np.diff(points, axis=0)
        _, nearest = _nearest(np.column_stack((true_path.x_m, true_path.y_m)), points)
        commanded_rad = np.arctan2(lines[:, 1], lines[:, 0])[nearest]
    error_rad = np.angle(np.exp(1j * (true_path.yaw_rad - commanded_rad)))
    return math.sqrt(float(np.mean(error_rad**2)))


def effort_rad_s2(set_points_rad_s: Array, period_s: float) -> float:
    """Return the root mean square of the commanded wheel acceleration; rows are cycles, columns wheels."""
    if len(set_points_rad_s) < 2:
        return 0.0
    return math.sqrt(float(np.mean((np.diff(set_points_rad_s, axis=0) / period_s) ** 2)))


def reversals_per_s(set_points_rad_s: Array, period_s: float, amplitude_rad_s: float) -> float:
    """Return the reversals per second of the wheel and the four seconds that have most of them.

    A limit cycle reverses twice per period for as long as it lasts; a corner two or three times.

    Args:
        set_points_rad_s: Rows are cycles, columns wheels.
        period_s: Time between rows.
        amplitude_rad_s: A change of direction by this much is a reversal; less is noise.
    """
    window = round(REVERSAL_WINDOW_S / period_s)
    most = 0
    for speeds in set_points_rad_s.T.tolist():
        turns = np.array(_reversals(speeds, amplitude_rad_s))
        within = np.searchsorted(turns, turns + window) - np.arange(len(turns))
        most = max(most, int(within.max(initial=0)))
    return most / REVERSAL_WINDOW_S


def _reversals(values: Sequence[float], amplitude: float) -> list[int]:
    """Return the indices at which the values have gone back by `amplitude` from their last extreme."""
    indices: list[int] = []
    direction, lowest, highest = 0, math.inf, -math.inf
    for index, value in enumerate(values):
        lowest, highest = min(lowest, value), max(highest, value)
        falls, rises = highest - value >= amplitude, value - lowest >= amplitude
        if (falls and direction >= 0) or (rises and direction <= 0):
            if direction:
                indices.append(index)
            direction = 1 if rises and direction <= 0 else -1
            lowest = highest = value
    return indices


def _along(corners: Array) -> Array:
    """Return points along straight lines, the corners included, at most `PATH_STEP_M` apart."""
    parts = [corners[:1]]
    for start, end in pairwise(corners):
        count = max(1, math.ceil(float(np.hypot(*(end - start))) / PATH_STEP_M))
        parts.append(start + np.linspace(0.0, 1.0, count + 1)[1:, np.newaxis] * (end - start))
    return np.concatenate(parts)


def _nearest(points: Array, corners: Array) -> tuple[Array, NDArray[np.intp]]:
    """Return for each point its distance from the lines between corners, and which one is nearest."""
    starts = corners[:1] if len(corners) == 1 else corners[:-1]
    lines = np.diff(corners, axis=0) if len(corners) > 1 else np.zeros((1, 2))
    from_start = points[:, np.newaxis] - starts
    length_2 = np.maximum(np.sum(lines**2, axis=1), LEAST_LENGTH_M2)
    share = np.clip(np.sum(from_start * lines, axis=2) / length_2, 0.0, 1.0)
    apart_m = np.linalg.norm(from_start - share[:, :, np.newaxis] * lines, axis=2)
    nearest = np.argmin(apart_m, axis=1)
    return apart_m[np.arange(len(points)), nearest], nearest
