"""The geometry of a rover in the words of the controllers of ros2_controllers that publish odometry."""

import math
from typing import NamedTuple

from controllers.motion.rover_geometry import OmniRoverSettings, RoverSettings, SkidSteerRoverSettings
from controllers.motion.wheel_settings import WheelSettings

ROUND = 1e-9
"""Angles that differ by less are the same."""
LISTED = "odometry_publisher"
"""Stands for a publisher of the user's own, where no controller has the geometry."""
UNKNOWN_GEOMETRY = "No controller of ros2_controllers has this geometry: names for a publisher of your own."


class Parameter(NamedTuple):
    """A parameter, its value and where that comes from."""

    name: str
    value: float | list[float]
    source: str


class WheelController(NamedTuple):
    """A controller that publishes odometry.

    Attributes:
        name: Of the controller, or `LISTED`.
        parameters: Geometry, in m and rad.
        note: What else must be known; "" for nothing.
        covariances: Names of the parameters of the diagonals of pose and twist, outer names first.
    """

    name: str
    parameters: tuple[Parameter, ...]
    note: str = ""
    covariances: tuple[tuple[str, ...], tuple[str, ...]] = (
        ("pose_covariance_diagonal",),
        ("twist_covariance_diagonal",),
    )


def wheel_controller(rover: RoverSettings) -> WheelController:
    """Return the controller of ros2_controllers that fits a rover, else `LISTED`."""
    if isinstance(rover, SkidSteerRoverSettings):
        return WheelController(
            "diff_drive_controller",
            (
                Parameter("wheel_radius", rover.wheel_radius_m, "m; setting rover.wheel_radius_m"),
                Parameter("wheel_separation", rover.track_m, "m; setting rover.track_m, the effective track"),
            ),
        )
    if isinstance(rover, OmniRoverSettings):
        return _of_circle(rover)
    # The controller takes the middle of the wheels for the origin.
    is_centred = abs(sum(wheel.x_m for wheel in rover.wheels)) < ROUND
    is_two_sided = is_centred and all(map(_rolls_ahead, rover.wheels))
    left = [wheel for wheel in rover.wheels if wheel.y_m > 0.0]
    right = [wheel for wheel in rover.wheels if wheel.y_m < 0.0]
    return _of_sides(left, right) if is_two_sided and left and right else _listed(rover.wheels)


def _of_circle(rover: OmniRoverSettings) -> WheelController:
    radius = Parameter("wheel_radius", rover.wheel_radius_m, "m; setting rover.wheel_radius_m")
    base = Parameter("robot_radius", rover.base_radius_m, "m; setting rover.base_radius_m")
    angles = rover.wheel_angles_deg
    steps = [math.remainder(angle - angles[0] - 120.0 * place, 360.0) for place, angle in enumerate(angles)]
    if max(map(abs, steps)) > ROUND:
        degrees = Parameter("wheel_angles_deg", list(angles), "deg; setting rover.wheel_angles_deg")
        return WheelController(LISTED, (radius, base, degrees), UNKNOWN_GEOMETRY)
    offset = Parameter("wheel_offset", math.radians(angles[0]), "rad; setting rover.wheel_angles_deg")
    return WheelController(
        "omni_wheel_drive_controller",
        (radius, base, offset),
        "Its wheels turn forwards clockwise around the rover, here counter-clockwise: negate their speeds.",
        (("diagonal_covariance", "pose"), ("diagonal_covariance", "twist")),
    )


def _rolls_ahead(wheel: WheelSettings) -> bool:
    is_ahead = abs(math.remainder(wheel.angle_deg, 360.0)) < ROUND
    return is_ahead and wheel.y_m != 0.0 and wheel.roller_deg is None and wheel.steering is None


def _of_sides(left: list[WheelSettings], right: list[WheelSettings]) -> WheelController:
    sides_m = [sum(wheel.radius_m for wheel in side) / len(side) for side in (left, right)]
    places_m = [sum(wheel.y_m for wheel in side) / len(side) for side in (left, right)]
    mean_m = 0.5 * sum(sides_m)
    of_wheels = "settings rover.wheels, radius_m"
    return WheelController(
        "diff_drive_controller",
        (
            Parameter("wheel_radius", mean_m, f"m; {of_wheels}, mean of both sides"),
            Parameter("left_wheel_radius_multiplier", sides_m[0] / mean_m, of_wheels),
            Parameter("right_wheel_radius_multiplier", sides_m[1] / mean_m, of_wheels),
            Parameter("wheel_separation", places_m[0] - places_m[1], "m; settings rover.wheels, y_m"),
        ),
    )


def _listed(wheels: tuple[WheelSettings, ...]) -> WheelController:
    return WheelController(
        LISTED,
        (
            Parameter("wheel_radii", [wheel.radius_m for wheel in wheels], "m; settings rover.wheels"),
            Parameter("wheels_x", [wheel.x_m for wheel in wheels], "m; settings rover.wheels, x_m"),
            Parameter("wheels_y", [wheel.y_m for wheel in wheels], "m; settings rover.wheels, y_m"),
        ),
        UNKNOWN_GEOMETRY,
    )
