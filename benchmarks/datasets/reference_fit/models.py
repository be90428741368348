"""Motion of the three robots by their wheels, as a function of what is fitted."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

Values = Mapping[str, float]


@dataclass(frozen=True, kw_only=True)
class Robot:
    """What is fitted of a robot.

    Attributes:
        nominal: Published numbers; 0 for those of the marker, which are not published.
        steps: From readings and numbers to motion forward, to the left and yaw of each row, shape (n, 3).
    """

    nominal: dict[str, float]
    steps: Callable[[Array, Values], Array]


MARKER = {"marker_x_m": 0.0, "marker_y_m": 0.0, "marker_yaw_rad": 0.0}


def _differential(counts: Array, values: Values) -> Array:
    turned = counts * math.tau / (64 * 43.7)
    right, left = turned[:, 0] * values["radius_right_m"], turned[:, 1] * values["radius_left_m"]
    return np.column_stack((0.5 * (right + left), np.zeros(len(counts)), (right - left) / values["track_m"]))


def _omni(counts: Array, values: Values) -> Array:
    # The order of the wheels that fits: the other one leaves 500 times the sum of squares. Another direction
    # of the first wheel is another yaw of the marker.
    angles = np.radians((-60.0, 60.0, 180.0))
    rims = -counts * math.tau / (1024 * 12) * [values[f"radius_{wheel}_m"] for wheel in range(3)]
    matrix = np.column_stack((-np.sin(angles), np.cos(angles), np.full(3, values["base_m"])))
    steps: Array = np.linalg.solve(matrix, rims.T).T
    return steps


def _tricycle(counts: Array, values: Values) -> Array:
    rolled = counts[:, 0] * math.tau / 1600 * values["radius_m"]
    read = counts[:, 1]
    # Its circles show the wheelbase only over the ratio of the steering, which is taken as 1.
    steering = 0.5 * (read + np.concatenate((read[:1], read[:-1]))) + values["steering_zero_rad"]
    return np.column_stack(
        (
            rolled * np.cos(steering),
            np.zeros(len(counts)),
            rolled * np.sin(steering) / values["wheelbase_m"],
        )
    )


ROBOTS = {
    "diff": Robot(
        nominal={"radius_right_m": 0.042, "radius_left_m": 0.042, "track_m": 0.2}, steps=_differential
    ),
    "omni3": Robot(
        nominal={"radius_0_m": 0.051, "radius_1_m": 0.051, "radius_2_m": 0.051, "base_m": 0.195}, steps=_omni
    ),
    "tricyc": Robot(
        nominal={"radius_m": 0.0325, "wheelbase_m": 0.15, "steering_zero_rad": 0.0}, steps=_tricycle
    ),
}


def marker_path(robot: Robot, counts: Array, values: Values) -> Array:
    """Return x, y and yaw of the marker in the frame of the robot at the first row, shape (n, 3).

    Each row is the exact arc of its motion.
    """
    forward, left, rotation = robot.steps(counts, values).T
    yaw = np.cumsum(rotation)
    before = yaw - rotation
    # Chord of an arc: sin(a / 2) / (a / 2) of its length, in the direction of the middle of the rotation.
    shorter = np.sinc(0.5 * rotation / math.pi)
    cos, sin = np.cos(before + 0.5 * rotation), np.sin(before + 0.5 * rotation)
    x = np.cumsum(shorter * (cos * forward - sin * left))
    y = np.cumsum(shorter * (sin * forward + cos * left))
    marker_x, marker_y = values["marker_x_m"], values["marker_y_m"]
    return np.column_stack(
        (
            x + np.cos(yaw) * marker_x - np.sin(yaw) * marker_y,
            y + np.sin(yaw) * marker_x + np.cos(yaw) * marker_y,
            yaw + values["marker_yaw_rad"],
        )
    )
