"""Kinematics of rolling wheels. Plain floats: faster than arrays for so few numbers."""

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Protocol

import numpy as np

from controllers.matrices import inverse
from controllers.motion.body_motion import BodyMotion, Residuals, SetPoints
from controllers.motion.missions.mission import Mobility
from controllers.motion.rover_geometry import OmniRoverSettings, RoverSettings, SkidSteerRoverSettings
from controllers.motion.wheels_kinematics import WheelsKinematics


class Kinematics(Mobility, Protocol):
    """Geometry of a rover's wheels.

    Attributes:
        wheel_count: Number of wheels.
        steering_rates_rad_s: Greatest steering speed of each wheel, 0 for one that does not steer; empty
            where none steers.
        unmeasured: Wheels without an encoder; their values have no effect on `body_motion`.
        undriven: Wheels that no motor turns.
        skids_in_rotations: Whether fixed wheels must slip sideways in every rotation.
    """

    wheel_count: int
    unmeasured: frozenset[int]
    undriven: frozenset[int]
    skids_in_rotations: bool
    steering_rates_rad_s: tuple[float, ...]

    def wheel_speeds(
        self, velocity_x_m_s: float, velocity_y_m_s: float, yaw_rate_rad_s: float
    ) -> tuple[float, ...]:
        """Return the wheel speeds in rad/s for a body velocity; without the sideways part if impossible."""
        ...

    def set_points(
        self,
        velocity_x_m_s: float,
        velocity_y_m_s: float,
        yaw_rate_rad_s: float,
        steering_rad: Sequence[float] = (),
    ) -> SetPoints:
        """Return wheel speeds and steering angles for a body velocity, given the present steering angles."""
        ...

    def body_motion(self, wheel_values: Sequence[float], steering_rad: Sequence[float] = ()) -> BodyMotion:
        """Return the body motion of rolling wheels: from rad/s a velocity, from rad an increment.

        With more wheels than degrees of freedom it is the least-squares solution.

        Args:
            wheel_values: One per wheel.
            steering_rad: Steering angles, one per wheel; empty for zeros.
        """
        ...

    def wheel_effects(self, steering_rad: Sequence[float] = ()) -> tuple[BodyMotion, ...]:
        """Return for each wheel the body motion when it alone turns by one radian.

        Args:
            steering_rad: Steering angles, one per wheel; empty for zeros.
        """
        ...

    def with_unmeasured(
        self, wheel_values: Sequence[float], motion: BodyMotion, steering_rad: Sequence[float] = ()
    ) -> Sequence[float]:
        """Return the values of all wheels: those without an encoder as they roll in a body motion."""
        ...

    def residuals(
        self, wheel_values: Sequence[float], steering_rad: Sequence[float] = ()
    ) -> Residuals | None:
        """Return what the least squares over all wheels leave; None where the wheels are not compared."""
        ...


class _FixedWheels(ABC):
    """What kinematics without steering and without a limit of the turn radius have in common."""

    turns_on_spot = True
    turn_radius_m = 0.0
    crab_limit_rad = 0.0
    steering_rates_rad_s: tuple[float, ...] = ()
    unmeasured: frozenset[int] = frozenset()
    undriven: frozenset[int] = frozenset()
    wheel_count: int

    @abstractmethod
    def body_motion(self, wheel_values: Sequence[float], steering_rad: Sequence[float] = ()) -> BodyMotion:
        """Return the body motion of rolling wheels."""

    @abstractmethod
    def wheel_speeds(
        self, velocity_x_m_s: float, velocity_y_m_s: float, yaw_rate_rad_s: float
    ) -> tuple[float, ...]:
        """Return the wheel speeds in rad/s."""

    def set_points(
        self,
        velocity_x_m_s: float,
        velocity_y_m_s: float,
        yaw_rate_rad_s: float,
        steering_rad: Sequence[float] = (),
    ) -> SetPoints:
        """Return the wheel speeds; there are no steering angles."""
        return SetPoints(self.wheel_speeds(velocity_x_m_s, velocity_y_m_s, yaw_rate_rad_s), ())

    def wheel_effects(self, steering_rad: Sequence[float] = ()) -> tuple[BodyMotion, ...]:
        """Return for each wheel the body motion when it alone turns by one radian."""
        wheels = range(self.wheel_count)
        return tuple(
            self.body_motion([1.0 if wheel == turning else 0.0 for wheel in wheels]) for turning in wheels
        )

    def with_unmeasured(
        self, wheel_values: Sequence[float], motion: BodyMotion, steering_rad: Sequence[float] = ()
    ) -> Sequence[float]:
        """Return the values: every wheel has an encoder."""
        return wheel_values

    def residuals(
        self,
        wheel_values: Sequence[float],
        steering_rad: Sequence[float] = (),
    ) -> Residuals | None:
        """Return None: the wheels are not compared."""
        return None


class OmniKinematics(_FixedWheels):
    """Three omnidirectional wheels: R w = J v, rows of J = [-sin th, cos th, L].

    Source: Robotino paper (003), inverse kinematics; J is inverted numerically, for any angles.
    """

    wheel_count = 3
    moves_sideways = True
    skids_in_rotations = False

    def __init__(self, settings: OmniRoverSettings) -> None:
        angles_rad = [math.radians(angle) for angle in settings.wheel_angles_deg]
        jacobian = np.array([[-math.sin(th), math.cos(th), settings.base_radius_m] for th in angles_rad])
        to_wheels = jacobian / settings.wheel_radius_m
        self._to_wheels: list[list[float]] = to_wheels.tolist()
        self._to_body: list[list[float]] = inverse(to_wheels).tolist()

    def wheel_speeds(
        self, velocity_x_m_s: float, velocity_y_m_s: float, yaw_rate_rad_s: float
    ) -> tuple[float, ...]:
        """Return the three wheel speeds in rad/s."""
        return _multiply(self._to_wheels, (velocity_x_m_s, velocity_y_m_s, yaw_rate_rad_s))

    def body_motion(
        self,
        wheel_values: Sequence[float],
        steering_rad: Sequence[float] = (),
    ) -> BodyMotion:
        """Return the body motion of rolling wheels."""
        return _multiply(self._to_body, wheel_values)


class SkidSteerKinematics(_FixedWheels):
    """Four wheels in two fixed rows, left and right; the sideways velocity is always zero."""

    wheel_count = 4
    moves_sideways = False
    skids_in_rotations = True

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

    def body_motion(
        self,
        wheel_values: Sequence[float],
        steering_rad: Sequence[float] = (),
    ) -> BodyMotion:
        """Return the body motion of rolling wheels: least squares of both sides."""
        front_left, front_right, rear_left, rear_right = wheel_values
        left_m = 0.5 * self._radius_m * (front_left + rear_left)
        right_m = 0.5 * self._radius_m * (front_right + rear_right)
        return (0.5 * (left_m + right_m), 0.0, 0.5 * (right_m - left_m) / self._half_track_m)


def make_kinematics(settings: RoverSettings) -> Kinematics:
    """Return the kinematics that the settings describe."""
    if isinstance(settings, OmniRoverSettings):
        return OmniKinematics(settings)
    if isinstance(settings, SkidSteerRoverSettings):
        return SkidSteerKinematics(settings)
    return WheelsKinematics(settings)


def greatest_motion(effects: Sequence[BodyMotion], wheel_rad: Sequence[float]) -> BodyMotion:
    """Return how far the body moves at most along each axis when each wheel turns by 0 to `wheel_rad`.

    Args:
        effects: Of `Kinematics.wheel_effects`.
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
