"""Least squares over whole trajectories, intervals by jackknife over recordings, end errors.

The clocks of a recording are taken as the authors have aligned them: a delay of each recording that is
fitted, too, makes the errors of the validation larger for all three robots.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.stats import t as student

from benchmarks.datasets.reference_fit.models import MARKER, Robot, Values, marker_path
from benchmarks.datasets.reference_fit.recordings import Recording

Array = NDArray[np.float64]

EVERY_ROWS = 5
POSITION_SD_M = 0.01
YAW_SD_RAD = 0.01
START_S = 1.0
FEW, PIECES = 6, 4
LEVEL = 0.95


@dataclass(frozen=True, kw_only=True)
class Fitted:
    """A number with its interval."""

    value: float
    low: float
    high: float


@dataclass(frozen=True, kw_only=True)
class EndError:
    """Error at the end of a recording whose first second is aligned."""

    distance_m: float
    yaw_rad: float


def solve(robot: Robot, recordings: Sequence[Recording], fixed: Values, start: Values) -> dict[str, float]:
    """Return the numbers of least squares; those in `fixed` stay. Each trajectory has a free start."""
    names = [name for name in start if name not in fixed]

    def residuals(vector: Array) -> Array:
        values = {**fixed, **dict(zip(names, vector.tolist(), strict=True))}
        return np.concatenate([_residuals(robot, recording, values) for recording in recordings])

    found = least_squares(
        residuals, [start[name] for name in names], x_scale=[_scale(name) for name in names]
    )
    return {**fixed, **dict(zip(names, found.x.tolist(), strict=True))}


def _scale(name: str) -> float:
    return 0.001 if name.startswith("radius") else 0.01


def _residuals(robot: Robot, recording: Recording, values: Values) -> Array:
    """Return errors of x, y and yaw over their standard deviations, after the best rigid motion."""
    path = marker_path(robot, recording.counts, values)[::EVERY_ROWS]
    truth = recording.marker[::EVERY_ROWS]
    error = _moved(path, _start(path, truth)) - truth
    error[:, 2] -= math.tau * np.round(error[:, 2].mean() / math.tau)
    return np.concatenate(((error[:, :2] / POSITION_SD_M).ravel(), error[:, 2] / YAW_SD_RAD))


def _start(path: Array, truth: Array) -> Array:
    """Return the rigid motion of least squares from a path to the ground truth: x, y, yaw."""
    centre, true_centre = path[:, :2].mean(axis=0), truth[:, :2].mean(axis=0)
    ours, theirs = path[:, :2] - centre, truth[:, :2] - true_centre
    # By positions and yaws together, each with its weight; the yaws are near the solution already.
    weights = np.array((POSITION_SD_M, YAW_SD_RAD)) ** -2.0
    by_yaw = np.angle(np.exp(1j * (truth[:, 2] - path[:, 2])).mean())
    cross = float(np.sum(ours[:, 0] * theirs[:, 1] - ours[:, 1] * theirs[:, 0]))
    dot = float(np.sum(ours * theirs))
    sine = weights[0] * cross + weights[1] * len(path) * math.sin(by_yaw)
    cosine = weights[0] * dot + weights[1] * len(path) * math.cos(by_yaw)
    angle = math.atan2(sine, cosine)
    cos, sin = math.cos(angle), math.sin(angle)
    x, y = true_centre - np.array(((cos, -sin), (sin, cos))) @ centre
    return np.array((x, y, angle))


def _moved(path: Array, motion: Array) -> Array:
    """Return a path after a rigid motion."""
    cos, sin = math.cos(motion[2]), math.sin(motion[2])
    x, y = path[:, 0], path[:, 1]
    return np.column_stack(
        (motion[0] + cos * x - sin * y, motion[1] + sin * x + cos * y, path[:, 2] + motion[2])
    )


def start_values(robot: Robot, recordings: Sequence[Recording]) -> dict[str, float]:
    """Return nominal numbers with the marker whose residuals are least; its yaw is tried all around."""
    best: tuple[float, dict[str, float]] = (math.inf, {})
    for yaw in np.arange(-math.pi, math.pi, math.pi / 6.0).tolist():
        start = {**robot.nominal, **MARKER, "marker_yaw_rad": yaw}
        found = solve(robot, recordings, robot.nominal, start)
        best = min(best, (cost(robot, recordings, found), found), key=lambda each: each[0])
    return best[1]


def cost(robot: Robot, recordings: Sequence[Recording], values: Values) -> float:
    """Return the sum of squares of all residuals."""
    return sum(float(np.sum(_residuals(robot, recording, values) ** 2)) for recording in recordings)


def jackknife(robot: Robot, recordings: Sequence[Recording], values: Values) -> dict[str, Fitted]:
    """Return numbers with intervals from fits without one recording each.

    Few recordings are divided into pieces: without one of three, one direction of the circles would be
    missing.
    """
    parts = list(recordings)
    if len(parts) < FEW:
        parts = [piece for recording in recordings for piece in recording.pieces(PIECES)]
    without = [solve(robot, [other for other in parts if other is not part], {}, values) for part in parts]
    count = len(parts)
    factor = float(student.ppf(0.5 + 0.5 * LEVEL, count - 1))
    fitted = {}
    for name, value in values.items():
        left_out = np.array([each[name] for each in without])
        margin = factor * math.sqrt((count - 1) / count * float(np.sum((left_out - left_out.mean()) ** 2)))
        fitted[name] = Fitted(value=value, low=value - margin, high=value + margin)
    return fitted


def end_error(robot: Robot, recording: Recording, values: Values) -> EndError:
    """Return the error at the last row; the path is aligned in the first second: the robot hardly moves."""
    path, truth = marker_path(robot, recording.counts, values), recording.marker
    begin = round(START_S / (recording.t_s[1] - recording.t_s[0]))
    first, true_first = path[:begin].mean(axis=0), truth[:begin].mean(axis=0)
    angle = true_first[2] - first[2]
    cos, sin = math.cos(angle), math.sin(angle)
    x, y = true_first[:2] - np.array(((cos, -sin), (sin, cos))) @ first[:2]
    error = _moved(path[-1:], np.array((x, y, angle)))[0] - truth[-1]
    return EndError(distance_m=math.hypot(error[0], error[1]), yaw_rad=math.remainder(error[2], math.tau))
