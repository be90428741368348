"""Compares the pose with the twist of the same messages: both are the motion of one rover."""

import math

import numpy as np

from rover_hil.drives.arrays import Array, in_body_frame, wrap_angles

LEAST_STEPS = 20
LEAST_MOTION = (1.0, 1.0)
"""In m and rad: a drive that moves less shows nothing."""
AGREES = 0.3
"""Residual, as a share of the motion, up to which both agree: a filter smooths one more than the other."""
BETTER = 0.5
"""Another reading of the twist explains the pose if it leaves less than this share of the residual."""
READINGS = ("the twist has the opposite sign", "the twist is in the axes of the map", "the twist is in deg/s")


def twist_fault(t_s: Array, pose: Array, twist: Array) -> str:
    """Return how the twist of messages contradicts their pose; empty where both agree, or show nothing.

    Args:
        t_s: Of n messages, rising.
        pose: x and y in m, yaw in rad, shape (n, 3).
        twist: Forward and left in m/s and yaw rate in rad/s, in the axes of the rover, shape (n, 3).
    """
    if len(t_s) < LEAST_STEPS or not twist.any():  # nobody has filled it in
        return ""
    steps_s = np.diff(t_s)
    by_twist = 0.5 * (twist[1:] + twist[:-1]) * steps_s[:, np.newaxis]
    turned_rad = wrap_angles(np.diff(pose[:, 2]))
    middle_rad = pose[:-1, 2] + 0.5 * turned_rad
    ahead, left = in_body_frame(np.diff(pose[:, 0]), np.diff(pose[:, 1]), middle_rad)
    of_map = np.column_stack(in_body_frame(by_twist[:, 0], by_twist[:, 1], middle_rad))
    travel, by_travel = np.column_stack((ahead, left)), by_twist[:, :2]
    if np.abs(travel).sum() > LEAST_MOTION[0] and _residual(travel, by_travel) > AGREES:
        return _fault(
            "travel",
            _residual(travel, by_travel),
            (_residual(travel, -by_travel), _residual(travel, of_map)),
        )
    turn, by_turn = turned_rad[:, np.newaxis], by_twist[:, 2:]
    if np.abs(turn).sum() > LEAST_MOTION[1] and _residual(turn, by_turn) > AGREES:
        return _fault(
            "rotation",
            _residual(turn, by_turn),
            (_residual(turn, -by_turn), math.inf, _residual(turn, np.radians(by_turn))),
        )
    return ""


def _fault(what: str, residual: float, readings: tuple[float, ...]) -> str:
    best = min(readings)
    cause = f": {READINGS[readings.index(best)]}" if best < BETTER * residual else ""
    return f"pose and twist of the same messages contradict each other in the {what}{cause}; the pose is used"


def _residual(motion: Array, other: Array) -> float:
    """Return the root of the share of the motion that another one leaves."""
    return math.sqrt(float(((motion - other) ** 2).sum() / (motion**2).sum()))
