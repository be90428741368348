"""Kinematics of rolling wheels. Plain floats: faster than arrays for so few numbers."""

import math
from collections.abc import Sequence
from typing import Protocol

import numpy as np

from controllers.motion.rover_geometry import OmniRoverSettings, RoverSettings, SkidSteerRoverSettings

BodyMotion = tuple[float, float, float]
"""Forward, to the left, and counter-clockwise: m/s, m/s, rad/s or m, m, rad."""


class Kinematics(Protocol):
    """Geometry of a rover's wheels."""

    wheel_count: int
    moves_sideways: bool

    def wheel_speeds(
        self, velocity_x_m_s: float, velocity_y_m_s: float, yaw_rate_rad_s: float
    ) -> tuple[float, ...]:
        """Return the wheel speeds in rad/s for a body velocity; without the sideways part if impossible."""
        ...

    def body_motion(self, wheel_values: Sequence[float]) -> BodyMotion:
        """Return the body motion of rolling wheels: from rad/s a velocity, from rad an increment.

        With more wheels than degrees of freedom it is the least-squares solution.
        """
        ...


class OmniKinematics:
    """Three omnidirectional wheels: R w = J v, rows of J = [-sin th, cos th, L].

    Source: Robotino paper (003), inverse kinematics; J is inverted numerically, for any angles.
    """

    wheel_count = 3
    moves_sideways = True

    def __init__(self, settings: OmniRoverSettings) -> None:
        angles_rad = [math.radians(angle) for angle in settings.wheel_angles_deg]
        jacobian = np.array([[-math.sin(th), math.cos(th), settings.base_radius_m] for th in angles_rad])
        to_wheels = jacobian / settings.wheel_radius_m
        self._to_wheels: list[list[float]] = to_wheels.tolist()
        self._to_body: list[list[float]] = np.linalg.inv(to_wheels).tolist()

    def wheel_speeds(
        self, velocity_x_m_s: float, velocity_y_m_s: float, yaw_rate_rad_s: float
    ) -> tuple[float, ...]:
        """Return the three wheel speeds in rad/s."""
        return _multiply(self._to_wheels, (velocity_x_m_s, velocity_y_m_s, yaw_rate_rad_s))

    def body_motion(self, wheel_values: Sequence[float]) -> BodyMotion:
        """Return the body motion of rolling wheels."""
        return _multiply(self._to_body, wheel_values)


class SkidSteerKinematics:
    """Four wheels in two fixed rows, left and right; the sideways velocity is always zero."""

    wheel_count = 4
    moves_sideways = False

    def __init__(self, settings: SkidSteerRoverSettings) -> None:
        self._radius_m = settings.wheel_radius_m
        self._half_track_m = 0.5 * settings.track_m

    def wheel_speeds(
        self, velocity_x_m_s: float, velocity_y_m_s: float, yaw_rate_rad_s: float
    ) -> tuple[float, ...]:
        """Return the four wheel speeds in rad/s; `velocity_y_m_s` has no effect."""
        turn_m_s = yaw_rate_rad_s * self._half_track_m
        left = (velocity_x_m_s - turn_m_s) / self._radius_m
        right = (velocity_x_m_s + turn_m_s) / self._radius_m
        return (left, right, left, right)

    def body_motion(self, wheel_values: Sequence[float]) -> BodyMotion:
        """Return the body motion of rolling wheels: least squares of both sides."""
        front_left, front_right, rear_left, rear_right = wheel_values
        left_m = 0.5 * self._radius_m * (front_left + rear_left)
        right_m = 0.5 * self._radius_m * (front_right + rear_right)
        return (0.5 * (left_m + right_m), 0.0, 0.5 * (right_m - left_m) / self._half_track_m)


def make_kinematics(settings: RoverSettings) -> Kinematics:
    """Return the kinematics that the settings describe."""
    if isinstance(settings, OmniRoverSettings):
        return OmniKinematics(settings)
    return SkidSteerKinematics(settings)


def wheel_effects(kinematics: Kinematics) -> tuple[BodyMotion, ...]:
    """Return for each wheel the body motion when it alone turns by one radian."""
    count = kinematics.wheel_count
    return tuple(
        kinematics.body_motion([1.0 if wheel == turning else 0.0 for wheel in range(count)])
        for turning in range(count)
    )


def greatest_motion(effects: Sequence[BodyMotion], wheel_rad: Sequence[float]) -> BodyMotion:
    """Return how far the body moves at most along each axis when each wheel turns by 0 to `wheel_rad`.

    Args:
        effects: Of `wheel_effects`.
        wheel_rad: Signed, one per wheel.
    """
    parts = [[angle * part for part in effect] for angle, effect in zip(wheel_rad, effects, strict=True)]
    x_m, y_m, yaw_rad = (
        max(sum(part for part in axis if part > 0.0), -sum(part for part in axis if part < 0.0))
        for axis in zip(*parts, strict=True)
    )
    return x_m, y_m, yaw_rad


def _multiply(rows: list[list[float]], values: Sequence[float]) -> BodyMotion:
    a, b, c = values
    first, second, third = rows
    return (
        first[0] * a + first[1] * b + first[2] * c,
        second[0] * a + second[1] * b + second[2] * c,
        third[0] * a + third[1] * b + third[2] * c,
    )
