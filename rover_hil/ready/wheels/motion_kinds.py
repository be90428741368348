"""Kinds of motion of recorded drives, by their wheels."""

import math

import numpy as np

from rover_hil.drives.arrays import Array, Flags
from rover_hil.ready.wheels.trajectory import STEP_S

STRAIGHT, CIRCLE, ON_THE_SPOT, SQUARE, BY_HAND = "straight", "circle", "on the spot", "square", "by hand"
KINDS = (STRAIGHT, CIRCLE, ON_THE_SPOT, SQUARE, BY_HAND)
# Chosen by hand.
WINDOW = round(1.0 / STEP_S)
"""Steps of a window of a second."""
LEAST_MOTION = 0.1
"""Windows with a smaller share of the usual motion are standstill."""
SPOT = 0.5
"""A window in which the origin goes less than this share of what the outermost wheel goes is on the spot."""
MOSTLY = 0.8
"""Share of the windows of a drive, or of its corners, that is of one kind."""
STRAIGHT_RAD = 0.6
"""Over a straight the course changes by less."""
ALIKE = 2.0
"""Curvatures of a circle differ by at most this factor, between their quartiles; it is at least half one."""
CORNER = 0.25
"""A window belongs to a corner where the course changes by more than this share of the sharpest windows."""
CORNER_RAD = (1.0, 2.1)
"""Change of the course in a corner of a square."""
LEAST_CORNERS = 3


def kind_of(moves: Array, size_m: float) -> str:
    """Return the kind of motion of a drive, one of `KINDS`.

    Args:
        moves: Ahead and left in m, yaw in rad, in steps of `STEP_S`, (n, 3).
        size_m: Distance of the outermost wheel from the origin.
    """
    ahead, left, turn_rad = np.add.reduceat(moves, np.arange(0, len(moves), WINDOW), axis=0).T
    way_m, rim_m = np.hypot(ahead, left), size_m * np.abs(turn_rad)
    moving = way_m + rim_m > LEAST_MOTION * np.quantile(way_m + rim_m, 0.9)
    ahead, left, turn_rad, way_m, rim_m = (each[moving] for each in (ahead, left, turn_rad, way_m, rim_m))
    is_spot = way_m < SPOT * rim_m
    if not moving.any() or is_spot.mean() >= MOSTLY:
        return ON_THE_SPOT if moving.any() else BY_HAND
    # Driving backwards is no change of the course, and on the spot there is none but the rotation.
    swing_rad = np.diff(np.arctan2(left, ahead), prepend=math.atan2(left[0], ahead[0]))
    swing_rad = (swing_rad + 0.5 * math.pi) % math.pi - 0.5 * math.pi
    course_rad = turn_rad + np.where(is_spot | np.roll(is_spot, 1), 0.0, swing_rad)
    if np.ptp(np.cumsum(course_rad)) <= STRAIGHT_RAD:
        return STRAIGHT
    low, high = np.quantile(np.abs(course_rad) / np.maximum(way_m, 1e-9), (0.25, 0.75))
    if high <= ALIKE * low and np.abs(course_rad).sum() >= math.pi:
        return CIRCLE
    is_corner = is_spot | (np.abs(course_rad) > CORNER * np.quantile(np.abs(course_rad), 0.95))
    corners_rad = _corners(course_rad, is_corner)
    is_square = (np.abs(corners_rad) >= CORNER_RAD[0]) & (np.abs(corners_rad) <= CORNER_RAD[1])
    return SQUARE if is_square.sum() >= max(LEAST_CORNERS, MOSTLY * len(corners_rad)) else BY_HAND


def _corners(course_rad: Array, is_corner: Flags) -> Array:
    """Return the change of the course of each corner between two straights."""
    changes = np.flatnonzero(np.diff(is_corner)) + 1
    parts = zip(np.split(course_rad, changes), np.split(is_corner, changes), strict=True)
    return np.array([float(part.sum()) for part, corner in parts if corner[0]])
