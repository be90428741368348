"""Angle conventions in one place: yaw counts counter-clockwise from east, a compass clockwise from north."""

import math


def wrap_rad(angle_rad: float) -> float:
    """Return the same direction in rad in [-pi, pi)."""
    wrapped_rad = math.remainder(angle_rad, math.tau)
    return -math.pi if wrapped_rad >= math.pi else wrapped_rad


def yaw_from_compass_deg(heading_deg: float) -> float:
    """Convert a compass heading in deg, clockwise from north, to yaw in rad in [-pi, pi)."""
    yaw_deg = math.remainder(90.0 - heading_deg, 360.0)
    return math.radians(-180.0 if yaw_deg == 180.0 else yaw_deg)


def compass_deg_from_yaw(yaw_rad: float) -> float:
    """Convert yaw in rad to a compass heading in deg, clockwise from north, in [0, 360)."""
    heading_deg = (90.0 - math.degrees(yaw_rad)) % 360.0
    return 0.0 if heading_deg == 360.0 else heading_deg
