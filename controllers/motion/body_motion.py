"""Motion of the body and what the wheels need for it, as all kinematics exchange them."""

from typing import NamedTuple

BodyMotion = tuple[float, float, float]
"""Forward, to the left, and counter-clockwise: m/s, m/s, rad/s or m, m, rad."""


class SetPoints(NamedTuple):
    """Setpoints of all wheels.

    Attributes:
        speed_rad_s: Speed of each wheel.
        steering_rad: Steering angle of each wheel, 0 for one that does not steer; empty where none steers.
    """

    speed_rad_s: tuple[float, ...]
    steering_rad: tuple[float, ...]


class Residuals(NamedTuple):
    """What the least squares over all wheels leave, one number per wheel, in m (or m/s).

    Attributes:
        rolling_m: Residual of the rolling.
        side_m: Residual of the side slip, 0 for a wheel without this constraint.
        rim_m: Distance of the rim.
        redundant: Number of redundant constraints: 0 for wheels that cannot contradict each other.
    """

    rolling_m: tuple[float, ...]
    side_m: tuple[float, ...]
    rim_m: tuple[float, ...]
    redundant: int
