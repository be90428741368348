"""Least squares of a set of wheels at one set of steering angles. Plain floats: faster than small arrays."""

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from controllers.matrices import Rows, by_normal_equations, product, pseudo_inverse, rank
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
            self._inverse = _with_weak(np.array(self._firm), np.array(self._inverse), rows)
        effects: list[BodyMotion] = [(0.0, 0.0, 0.0)] * len(rolling)
        for index, x, y, turn in zip(measured, *self._inverse, strict=True):
            radius = radius_m[index]
            effects[index] = x * radius + 0.0, y * radius + 0.0, turn * radius + 0.0
        self.effects = tuple(effects)

    @cached_property
    def redundant(self) -> int:
        """Number of constraints beyond those that determine the motion."""
        # Constraints that always agree are not redundant: they cannot contradict each other.
        first, second, third = self._inverse
        unexplained = [
            [
                (1.0 if row == column else 0.0) - (0.0 + a * x + b * y + c * turn)
                for column, (x, y, turn) in enumerate(zip(first, second, third, strict=True))
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


def _first_columns(rows: Sequence[BodyMotion], count: int) -> Rows:
    """Return the first columns of the Moore-Penrose inverse of rows that each have three numbers."""
    xx = xy = xt = yy = yt = tt = 0.0
    for x, y, turn in rows:
        xx += x * x
        xy += x * y
        xt += x * turn
        yy += y * y
        yt += y * turn
        tt += turn * turn
    gram = [[xx, xy, xt], [xy, yy, yt], [xt, yt, tt]]
    columns = list(map(list, zip(*rows[:count], strict=True)))
    inverse = by_normal_equations(gram, columns)
    if inverse is None:
        all_columns: Rows = pseudo_inverse(np.array(rows), SMALLEST)[:, :count].tolist()
        return all_columns
    return inverse


def _with_weak(firm: Matrix, inverse: Matrix, weak: Matrix) -> Rows:
    """Return the inverse with what the side slip of fixed wheels decides: what the firm rows leave open."""
    free = null_space(firm)
    kept_free = product(free, pseudo_inverse(product(weak, free), SMALLEST))
    whole: Rows = (inverse - product(kept_free, product(weak, inverse))).tolist()
    return whole
