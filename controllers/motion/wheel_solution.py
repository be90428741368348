"""Least squares of a set of wheels at one set of steering angles. Plain floats: faster than small arrays."""

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from controllers.matrices import WELL_CONDITIONED, product, pseudo_inverse, rank
from controllers.motion.body_motion import BodyMotion
from controllers.motion.wheel_constraints import (
    Matrix,
    is_fixed,
    null_space,
    rolling_row,
    side_row,
    skids_in_turns,
)
from controllers.motion.wheel_settings import WheelSettings

SMALLEST = 1e-9
"""A singular value below this share of the greatest is rounding."""
NUMPY_ADDS_IN_EIGHTHS = 8
"""So many numbers numpy adds in another order; earlier logs of rovers with so many wheels replay as then."""


class WheelEquations:
    """What the equations of a set of wheels have in common at all steering angles.

    Args:
        wheels: The wheels.

    Attributes:
        measured: Wheels with an encoder.
        weak: Wheels whose side slip decides only what the others leave open.
        side_wheels: The others that may not slip sideways.
        radius_m: Of each wheel.
    """

    def __init__(self, wheels: Sequence[WheelSettings]) -> None:
        skids = skids_in_turns(wheels)
        ordinary = [index for index, wheel in enumerate(wheels) if wheel.roller_deg is None]
        self.measured = [index for index, wheel in enumerate(wheels) if wheel.measured]
        self.weak = [index for index in ordinary if skids and is_fixed(wheels[index])]
        self.side_wheels = [index for index in ordinary if index not in self.weak]
        self.radius_m = [wheel.radius_m for wheel in wheels]
        self._wheels = wheels
        self._straight = list(map(rolling_row, wheels))
        self._side_straight = list(map(side_row, wheels))

    def rolling(self, steering_rad: Sequence[float]) -> list[BodyMotion]:
        """Return r omega of each wheel per body motion."""
        return [
            rolling_row(wheel, angle) if angle else straight
            for wheel, angle, straight in zip(self._wheels, steering_rad, self._straight, strict=True)
        ]

    def side(self, steering_rad: Sequence[float], indices: Sequence[int]) -> list[BodyMotion]:
        """Return the side slip of some wheels per body motion."""
        return [
            side_row(self._wheels[index], steering_rad[index])
            if steering_rad[index]
            else self._side_straight[index]
            for index in indices
        ]


class WheelSolution:
    """Least squares for one set of steering angles.

    Args:
        equations: Of the wheels.
        steering_rad: Steering angle of each.

    Attributes:
        effects: Body motion per wheel value, one for each wheel; zero for wheels without an encoder.
        rolling: r omega of each wheel per body motion.
        side: Side slip per body motion of the wheels `side_wheels` of the equations.
    """

    def __init__(self, equations: WheelEquations, steering_rad: Sequence[float]) -> None:
        measured, weak, radius_m = equations.measured, equations.weak, equations.radius_m
        rolling = self.rolling = equations.rolling(steering_rad)
        self.side = equations.side(steering_rad, equations.side_wheels)
        self._firm = [rolling[index] for index in measured] + self.side
        self._inverse = _first_columns(self._firm, len(measured))
        if weak:
            rows = np.array(equations.side(steering_rad, weak))
            inverse = np.array(list(zip(*self._inverse, strict=True)))
            self._inverse = _with_weak(np.array(self._firm), inverse, rows)
        effects: list[BodyMotion] = [(0.0, 0.0, 0.0)] * len(rolling)
        for index, (x, y, turn) in zip(measured, self._inverse, strict=True):
            radius = radius_m[index]
            effects[index] = x * radius + 0.0, y * radius + 0.0, turn * radius + 0.0
        self.effects = tuple(effects)

    @cached_property
    def redundant(self) -> int:
        """Number of constraints beyond those that determine the motion."""
        # Constraints that always agree are not redundant: they cannot contradict each other.
        unexplained = [
            [
                (1.0 if row == column else 0.0) - (0.0 + a * x + b * y + c * turn)
                for column, (x, y, turn) in enumerate(self._inverse)
            ]
            for row, (a, b, c) in enumerate(self._firm)
        ]
        return rank(unexplained, SMALLEST)

    def body_motion(self, wheel_values: Sequence[float]) -> BodyMotion:
        """Return the body motion of rolling wheels: from rad/s a velocity, from rad an increment."""
        if len(self.effects) >= NUMPY_ADDS_IN_EIGHTHS:
            first, second, third = product(
                np.array(list(zip(*self.effects, strict=True))), np.array(wheel_values)
            ).tolist()
            return first, second, third
        x_m = y_m = turn_rad = 0.0
        for (x, y, turn), value in zip(self.effects, wheel_values, strict=True):
            x_m += x * value
            y_m += y * value
            turn_rad += turn * value
        return x_m, y_m, turn_rad


def _first_columns(rows: Sequence[BodyMotion], count: int) -> list[BodyMotion]:
    """Return the first columns of the Moore-Penrose inverse of rows that each have three numbers.

    The same operations in the same order as in `pseudo_inverse`, without its arrays.
    """
    xx = xy = xt = yy = yt = tt = 0.0
    for x, y, turn in rows:
        xx += x * x
        xy += x * y
        xt += x * turn
        yy += y * y
        yt += y * turn
        tt += turn * turn
    gram = (xx, xy, xt), (xy, yy, yt), (xt, yt, tt)
    if _is_well_conditioned(*gram):
        return _solve_three(*gram, rows[:count])
    inverse = pseudo_inverse(np.array(rows), SMALLEST)[:, :count]
    return [(x, y, turn) for x, y, turn in inverse.T.tolist()]


def _is_well_conditioned(first: BodyMotion, second: BodyMotion, third: BodyMotion) -> bool:
    """Return whether the pivots of a symmetric matrix, less the least eigenvalue, are greater than zero."""
    (xx, xy, xt), (_, yy, yt), (_, _, tt) = first, second, third
    least = WELL_CONDITIONED * (xx + yy + tt)
    xx, yy, tt = xx - least, yy - least, tt - least
    if not xx > 0.0:
        return False
    below = yt - xt / xx * xy
    yy, yt, tt = yy - xy / xx * xy, yt - xy / xx * xt, tt - xt / xx * xt
    return yy > 0.0 and tt - below / yy * yt > 0.0


def _solve_three(
    first: BodyMotion, second: BodyMotion, third: BodyMotion, right: Sequence[BodyMotion]
) -> list[BodyMotion]:
    """Return x of a system of three equations for each right-hand side, by elimination with pivoting."""
    equations = [(first, 0), (second, 1), (third, 2)]
    sizes = [abs(row[0]) for row, _ in equations]
    pivot = sizes.index(max(sizes))
    equations[0], equations[pivot] = equations[pivot], equations[0]
    ((a, b, c), i), ((s1, d1, e1), j), ((s2, d2, e2), k) = equations
    b, c = b / a, c / a
    d1, e1, d2, e2 = d1 - s1 * b, e1 - s1 * c, d2 - s2 * b, e2 - s2 * c
    if abs(d2) > abs(d1):
        s1, d1, e1, j, s2, d2, e2, k = s2, d2, e2, k, s1, d1, e1, j
    e1 /= d1
    c -= b * e1
    e2 -= d2 * e1
    solved = []
    for row in right:
        x = row[i] / a
        y = (row[j] - s1 * x) / d1
        turn = (row[k] - s2 * x - d2 * y) / e2
        solved.append((x - b * y - c * turn, y - e1 * turn, turn))
    return solved


def _with_weak(firm: Matrix, inverse: Matrix, weak: Matrix) -> list[BodyMotion]:
    """Return the inverse with what the side slip of fixed wheels decides: what the firm rows leave open."""
    free = null_space(firm)
    kept_free = product(free, pseudo_inverse(product(weak, free), SMALLEST))
    whole = inverse - product(kept_free, product(weak, inverse))
    return [(x, y, turn) for x, y, turn in whole.T.tolist()]
