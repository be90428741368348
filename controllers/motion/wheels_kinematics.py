"""Kinematics of any set of wheels: fixed, steered, with rollers; equations in `wheel_constraints`."""

import math
from collections.abc import Sequence
from itertools import takewhile

from controllers.motion.body_motion import BodyMotion, Residuals, SetPoints
from controllers.motion.rover_geometry import WheelsRoverSettings
from controllers.motion.wheel_constraints import (
    contact_velocity,
    is_fixed,
    rolling_row,
    size_m,
    skids_in_turns,
)
from controllers.motion.wheel_settings import WheelSettings
from controllers.motion.wheel_solution import WheelEquations, WheelSolution

# Chosen by hand.
WAIT_RAD = 0.35
"""The drives wait while a wheel is still this far from its steering angle; below, they slow down with it."""
SLOWEST_CONTACT_M_S = 1e-4
"""A contact point that is slower has no direction: its wheel keeps its steering angle."""
LARGEST_CRAB_DEG = 45
"""A rover whose wheels are turned further moves sideways rather than forwards."""
CURVATURE_STEP = 1.02
FLATTEST = 50.0
"""Largest turn radius that is tried, over the rover's size."""


class WheelsKinematics:
    """Kinematics of a list of wheels.

    Steering angles are one per wheel, 0 for a wheel that does not steer; an empty tuple means zeros.

    Args:
        settings: The wheels.

    Attributes:
        wheel_count: Number of wheels.
        moves_sideways: Whether the rover can move in any direction at any heading.
        turns_on_spot: Whether it can turn without moving forwards.
        turn_radius_m: Least radius of an arc to either side, 0 where every arc is possible.
        crab_limit_rad: Greatest angle, to either side, by which all wheels can be turned together; 0 where
            not all wheels steer.
        steering_rates_rad_s: Greatest steering speed of each wheel, 0 for one that does not steer; empty
            where none steers.
        unmeasured: Wheels without an encoder.
        undriven: Wheels that no motor turns.
        skids_in_rotations: Whether fixed wheels must slip sideways in every rotation.
    """

    def __init__(self, settings: WheelsRoverSettings) -> None:
        wheels = settings.wheels
        self._wheels = wheels
        self._equations = WheelEquations(wheels)
        fixed = [wheel.x_m for wheel in wheels if is_fixed(wheel)]
        self._axle_x_m = sum(fixed) / len(fixed) if fixed else None
        self.skids_in_rotations = skids_in_turns(wheels)
        self._steers = any(wheel.steering is not None for wheel in wheels)
        self.wheel_count = len(wheels)
        self.unmeasured = frozenset(place for place, wheel in enumerate(wheels) if not wheel.measured)
        self.undriven = frozenset(place for place, wheel in enumerate(wheels) if not wheel.driven)
        self.steering_rates_rad_s = tuple(
            0.0 if wheel.steering is None else math.radians(wheel.steering.rate_deg_s) for wheel in wheels
        )
        if not self._steers:
            self.steering_rates_rad_s = ()
        self.moves_sideways = not fixed and all(map(_reaches_every_direction, wheels))
        self.turns_on_spot = self._reaches((0.0, 0.0, 1.0)) and self._reaches((0.0, 0.0, -1.0))
        self.turn_radius_m = self._least_radius_m()
        self.crab_limit_rad = self._crab_limit_rad()
        self._straight = (0.0,) * self.wheel_count
        self._solved: tuple[tuple[float, ...], WheelSolution] | None = None

    def wheel_speeds(
        self, velocity_x_m_s: float, velocity_y_m_s: float, yaw_rate_rad_s: float
    ) -> tuple[float, ...]:
        """Return the wheel speeds in rad/s with every wheel at the steering angle for this motion."""
        motion = self._possible((velocity_x_m_s, velocity_y_m_s, yaw_rate_rad_s))
        return self._speeds(motion, self._steering_for(motion, self._straight))

    def set_points(
        self,
        velocity_x_m_s: float,
        velocity_y_m_s: float,
        yaw_rate_rad_s: float,
        steering_rad: Sequence[float] = (),
    ) -> SetPoints:
        """Return wheel speeds and steering angles for a body velocity.

        A wheel turns to the nearest of the two steering angles that lie along the motion of its contact
        point; with the farther one its drive would run in the other direction. The speeds are those of the
        contact points along the wheels as they point now, and slow down together while a wheel is far from
        its angle. An angle beyond its limit is set to the limit.

        Args:
            velocity_x_m_s: Forwards.
            velocity_y_m_s: To the left. Where fixed wheels do not allow it, it has no effect: they determine
                the sideways motion of the origin.
            yaw_rate_rad_s: Counter-clockwise.
            steering_rad: Present steering angles.
        """
        present = tuple(steering_rad) or self._straight
        motion = self._possible((velocity_x_m_s, velocity_y_m_s, yaw_rate_rad_s))
        if not self._steers:
            return SetPoints(self._speeds(motion, present), ())
        wanted = self._steering_for(motion, present)
        farthest_rad = max(abs(to - at) for to, at in zip(wanted, present, strict=True))
        share = max(0.0, 1.0 - farthest_rad / WAIT_RAD)
        speeds = self._speeds(motion, present)
        return SetPoints(tuple(share * speed for speed in speeds), wanted)

    def body_motion(self, wheel_values: Sequence[float], steering_rad: Sequence[float] = ()) -> BodyMotion:
        """Return the body motion of rolling wheels: from rad/s a velocity, from rad an increment.

        Least squares: the rolling of all wheels and the absence of side slip have equal weight. The fixed
        wheels of a rover that skids in turns decide only what rolling leaves open.
        """
        return self._solution(steering_rad).body_motion(wheel_values)

    def wheel_effects(self, steering_rad: Sequence[float] = ()) -> tuple[BodyMotion, ...]:
        """Return for each wheel the body motion when it alone turns by one radian."""
        return self._solution(steering_rad).effects

    def with_unmeasured(
        self, wheel_values: Sequence[float], motion: BodyMotion, steering_rad: Sequence[float] = ()
    ) -> Sequence[float]:
        """Return the values of all wheels: those without an encoder as they roll in a body motion."""
        if not self.unmeasured:
            return wheel_values
        rolling = self._solution(steering_rad).rolling
        return [
            _rolled(rolling[wheel], motion) / self._equations.radius_m[wheel]
            if wheel in self.unmeasured
            else value
            for wheel, value in enumerate(wheel_values)
        ]

    def residuals(self, wheel_values: Sequence[float], steering_rad: Sequence[float] = ()) -> Residuals:
        """Return what the least squares of `body_motion` leave; of increments in m, of speeds in m/s."""
        solution = self._solution(steering_rad)
        motion = solution.body_motion(wheel_values)
        rim_m = tuple(
            radius * value for radius, value in zip(self._equations.radius_m, wheel_values, strict=True)
        )
        rolling_m = tuple(
            0.0 if wheel in self.unmeasured else rim - _rolled(row, motion)
            for wheel, (rim, row) in enumerate(zip(rim_m, solution.rolling, strict=True))
        )
        side_m = [0.0] * self.wheel_count
        for wheel, row in zip(self._equations.side_wheels, solution.side, strict=True):
            side_m[wheel] = -_rolled(row, motion)
        return Residuals(rolling_m, tuple(side_m), rim_m, solution.redundant)

    def _solution(self, steering_rad: Sequence[float]) -> WheelSolution:
        key = tuple(steering_rad) or self._straight
        if self._solved is None or self._solved[0] != key:
            self._solved = key, WheelSolution(self._equations, key)
        return self._solved[1]

    def _possible(self, motion: BodyMotion) -> BodyMotion:
        """Return the motion with the sideways velocity that the fixed wheels determine."""
        x, y, turn = motion
        return (x, y, turn) if self._axle_x_m is None else (x, -turn * self._axle_x_m, turn)

    def _speeds(self, motion: BodyMotion, steering_rad: Sequence[float]) -> tuple[float, ...]:
        return tuple(
            _rolled(rolling_row(wheel, angle), motion) / wheel.radius_m
            for wheel, angle in zip(self._wheels, steering_rad, strict=True)
        )

    def _steering_for(self, motion: BodyMotion, present_rad: Sequence[float]) -> tuple[float, ...]:
        return tuple(
            0.0 if wheel.steering is None else self._steer(wheel, motion, present)
            for wheel, present in zip(self._wheels, present_rad, strict=True)
        )

    @staticmethod
    def _steer(wheel: WheelSettings, motion: BodyMotion, present_rad: float) -> float:
        along, aside = contact_velocity(wheel, motion)
        if math.hypot(along, aside) < SLOWEST_CONTACT_M_S:
            return _within_limits(wheel, present_rad)
        angles, beyond = _angles_along(wheel, math.atan2(aside, along))
        if angles:
            return min(angles, key=lambda angle: abs(angle - present_rad))
        return min(beyond, key=lambda pair: pair[1])[0]

    def _reaches(self, motion: BodyMotion) -> bool:
        """Return whether the steering of every wheel reaches its angle for this motion."""
        for wheel in self._wheels:
            along, aside = contact_velocity(wheel, self._possible(motion))
            if wheel.steering is None or math.hypot(along, aside) < SLOWEST_CONTACT_M_S:
                continue
            if not _angles_along(wheel, math.atan2(aside, along))[0]:
                return False
        return True

    def _crab_limit_rad(self) -> float:
        if any(wheel.steering is None for wheel in self._wheels):
            return 0.0
        steps_rad = map(math.radians, range(1, LARGEST_CRAB_DEG + 1))
        reached = takewhile(
            lambda angle: all(
                self._reaches((math.cos(angle), side * math.sin(angle), 0.0)) for side in (1.0, -1.0)
            ),
            steps_rad,
        )
        return max(reached, default=0.0)

    def _least_radius_m(self) -> float:
        if all(map(_reaches_every_direction, self._wheels)) or not self._steers:
            return 0.0
        radius_m = FLATTEST * size_m(self._wheels)
        while self._reaches((radius_m, 0.0, 1.0)) and self._reaches((radius_m, 0.0, -1.0)):
            if radius_m < 0.01 * size_m(self._wheels):
                return 0.0
            radius_m /= CURVATURE_STEP
        return radius_m * CURVATURE_STEP


def _rolled(row: BodyMotion, motion: BodyMotion) -> float:
    """Return what a row of constraints gives for a body motion."""
    (a, b, c), (x, y, turn) = row, motion
    return 0.0 + a * x + b * y + c * turn


def _reaches_every_direction(wheel: WheelSettings) -> bool:
    steering = wheel.steering
    return not is_fixed(wheel) and (steering is None or steering.high_deg - steering.low_deg >= 180.0)


def _within_limits(wheel: WheelSettings, angle_rad: float) -> float:
    if wheel.steering is None:
        return 0.0
    return min(max(angle_rad, math.radians(wheel.steering.low_deg)), math.radians(wheel.steering.high_deg))


def _angles_along(
    wheel: WheelSettings, direction_rad: float
) -> tuple[list[float], list[tuple[float, float]]]:
    """Return the steering angles of a wheel along a direction, driving forwards or backwards.

    Returns:
        The angles within the limits, and both limits with their distances from the direction.
    """
    if wheel.steering is None:
        return [0.0], []
    low_rad, high_rad = math.radians(wheel.steering.low_deg), math.radians(wheel.steering.high_deg)
    base_rad = direction_rad - math.radians(wheel.angle_deg)
    slack_rad = 1e-9
    first = math.ceil((low_rad - slack_rad - base_rad) / math.pi)
    last = math.floor((high_rad + slack_rad - base_rad) / math.pi)
    angles = [min(max(base_rad + turns * math.pi, low_rad), high_rad) for turns in range(first, last + 1)]
    beyond = [
        (limit_rad, abs(math.remainder(limit_rad - base_rad, math.pi))) for limit_rad in (low_rad, high_rad)
    ]
    return angles, beyond
