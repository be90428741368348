"""Angles and poses in the plane."""

import math

from drivers.record import record


def wrap_angle(angle_rad: float) -> float:
    """Return the same direction within [-pi, pi)."""
    wrapped_rad = (angle_rad + math.pi) % math.tau - math.pi
    return -math.pi if wrapped_rad >= math.pi else wrapped_rad  # slightly below -pi is rounded up to pi


@record(frozen=True, slots=True, kw_only=True)
class Pose:
    """Position in m and yaw in rad within [-pi, pi), in the local frame: the pose at start is zero."""

    x_m: float = 0.0
    y_m: float = 0.0
    yaw_rad: float = 0.0


def move(pose: Pose, x_m: float, y_m: float, turn_rad: float) -> Pose:
    """Return `pose` moved by an increment of its body frame, rotated by the heading half-way through.

    Rotating by the mid heading is exact to second order in the turn (a chord for an arc); integrals kept in
    the body frame would not be positions once the heading turns.
    """
    middle_rad = pose.yaw_rad + 0.5 * turn_rad
    cosine, sine = math.cos(middle_rad), math.sin(middle_rad)
    return Pose(
        x_m=pose.x_m + cosine * x_m - sine * y_m,
        y_m=pose.y_m + sine * x_m + cosine * y_m,
        yaw_rad=wrap_angle(pose.yaw_rad + turn_rad),
    )
