"""Geometry of a rover's wheels, the section [rover]."""

import cmath
import math
from itertools import combinations
from typing import Annotated, Literal, Self, TypeAlias, TypeGuard

from pydantic import Field, model_validator

from controllers.motion.wheel_constraints import find_wheel_conflicts
from controllers.motion.wheel_settings import WheelRadius, WheelSettings
from drivers.settings import Settings

CLOSEST_WHEELS_DEG = 15.0
FOUR_WHEEL_SIGNS = ((1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0))
"""Signs of x and y of front left, front right, rear left, rear right."""


class OmniRoverSettings(Settings):
    """Three omnidirectional wheels on a circle around the origin of the body frame.

    Attributes:
        wheel_radius_m: Radius of the wheels.
        base_radius_m: Distance of each wheel from the origin.
        wheel_angles_deg: Where each wheel sits, counter-clockwise from x; it drives counter-clockwise.
    """

    kinematics: Literal["omni3"]
    wheel_radius_m: WheelRadius
    base_radius_m: Annotated[float, Field(ge=0.02, le=2.0)]
    wheel_angles_deg: tuple[float, float, float] = (60.0, 180.0, 300.0)

    @model_validator(mode="after")
    def _check_angles(self) -> Self:
        for first, second in combinations(self.wheel_angles_deg, 2):
            if abs(math.remainder(first - second, 360.0)) < CLOSEST_WHEELS_DEG:
                raise ValueError(
                    f"wheel_angles_deg: wheels at {first:g} and {second:g} deg are closer than "
                    f"{CLOSEST_WHEELS_DEG:g} deg; give the three angles in degrees"
                )
        return self


class SkidSteerRoverSettings(Settings):
    """Four wheels that do not steer, in the order front left, front right, rear left, rear right.

    Attributes:
        wheel_radius_m: Radius of the wheels.
        track_m: Distance between the contact patches of the left and the right wheels. Skidding makes the
            effective track wider than the drawing shows: identify it by turning on the spot.
    """

    kinematics: Literal["skid_steer_4"]
    wheel_radius_m: WheelRadius
    track_m: Annotated[float, Field(ge=0.05, le=5.0)]


class WheelsRoverSettings(Settings):
    """Any set of wheels, in the order of the wheel device.

    The number of motions that the wheels allow must equal the number that motors and steering control. A
    rover that moves sideways has only wheels with rollers, or only wheels that steer by half a turn.

    Attributes:
        wheels: The wheels.
    """

    kinematics: Literal["wheels"]
    wheels: Annotated[tuple[WheelSettings, ...], Field(min_length=2, max_length=32)]

    @property
    def wheel_radius_m(self) -> float:
        """Greatest radius of the wheels."""
        return max(wheel.radius_m for wheel in self.wheels)

    @model_validator(mode="after")
    def _check_wheels(self) -> Self:
        for conflict in find_wheel_conflicts(self.wheels):
            raise ValueError(conflict)
        return self


def wheels_reach_m(rover: "RoverSettings") -> float:
    """Return the distance in m of the outermost known point of the wheels from the origin of the body frame.

    A wheel that steers counts in every direction. Of four wheels that do not steer only the track is known.
    """
    if isinstance(rover, OmniRoverSettings):
        return math.hypot(rover.base_radius_m, rover.wheel_radius_m)
    if isinstance(rover, SkidSteerRoverSettings):
        return math.hypot(0.5 * rover.track_m, rover.wheel_radius_m)
    return max(map(_wheel_reach_m, rover.wheels))


def _wheel_reach_m(wheel: WheelSettings) -> float:
    contact = complex(wheel.x_m, wheel.y_m)
    if wheel.steering is not None:
        return abs(contact) + wheel.radius_m
    rim = cmath.rect(wheel.radius_m, math.radians(wheel.angle_deg))
    return max(abs(contact + rim), abs(contact - rim))


def has_four_wheels(rover: "RoverSettings") -> "TypeGuard[SkidSteerRoverSettings | WheelsRoverSettings]":
    """Return whether a rover has four driven wheels, front left, front right, rear left, rear right.

    All of them point forwards at steering angle 0, and none has rollers.
    """
    if isinstance(rover, SkidSteerRoverSettings):
        return True
    if not isinstance(rover, WheelsRoverSettings) or len(rover.wheels) != len(FOUR_WHEEL_SIGNS):
        return False
    return all(
        x_sign * wheel.x_m > 0.0
        and y_sign * wheel.y_m > 0.0
        and wheel.driven
        and wheel.roller_deg is None
        and wheel.angle_deg == 0.0
        for wheel, (x_sign, y_sign) in zip(rover.wheels, FOUR_WHEEL_SIGNS, strict=True)
    )


def track_of(rover: "SkidSteerRoverSettings | WheelsRoverSettings") -> float:
    """Return the mean distance in m between the left and the right wheels."""
    if isinstance(rover, SkidSteerRoverSettings):
        return rover.track_m
    return 2.0 * sum(abs(wheel.y_m) for wheel in rover.wheels) / len(rover.wheels)


RoverSettings: TypeAlias = Annotated[
    OmniRoverSettings | SkidSteerRoverSettings | WheelsRoverSettings, Field(discriminator="kinematics")
]
