"""What other sensors report about the motion between two frames, before the pictures are compared."""

from dataclasses import dataclass

from controllers.ground_motion.flow import Angles
from controllers.ground_motion.parameters import TurnParameters


@dataclass(frozen=True, slots=True, kw_only=True)
class MotionPrior:
    """Motion since the frame before, by wheels and gyro.

    Attributes:
        forward_m: Travel of the measured point by the wheels, along the vehicle's x axis; None without.
        left_m: To its left.
        turn_rad: Angles turned about x, y, z.
        turn_sd_rad: Standard deviation of each.
        has_gyro: Whether a gyro of three axes has measured them.
    """

    forward_m: float | None
    left_m: float
    turn_rad: Angles
    turn_sd_rad: Angles
    has_gyro: bool = False


def turned(
    now: Angles | None, before: Angles | None, dt_s: float, noise: TurnParameters
) -> tuple[Angles, Angles]:
    """Return the angles turned about x, y, z in an interval, and their standard deviations, rad.

    Args:
        now: Turn rates of the body at the end of the interval, rad/s; None without a gyro.
        before: At its beginning.
        dt_s: Length of the interval.
        noise: Uncertainty of the angles.
    """
    if now is None or before is None:
        tilt, yaw = noise.free_tilt_sd_rad, noise.free_turn_rate_sd_rad_s * dt_s
        return (0.0, 0.0, 0.0), (tilt, tilt, yaw)
    pairs = tuple(zip(now, before, strict=True))
    # The rate is known at both ends only: the more the two differ, the less certain is the rate between.
    x, y, z = ((end + start) / 2 * dt_s for end, start in pairs)
    sd = noise.gyro_sd_rad + noise.gyro_rate_sd_rad_s * dt_s
    sd_x, sd_y, sd_z = (sd + abs(end - start) * dt_s / 4 for end, start in pairs)
    return (x, y, z), (sd_x, sd_y, sd_z)
