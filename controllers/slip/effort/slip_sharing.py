"""Slip of each wheel from the slip of the rover and the turn that it leaves unexplained."""

from collections.abc import Sequence

from controllers.motion.kinematics import Kinematics
from controllers.slip.effort.parameters import EFFORT


def share_slip(
    kinematics: Kinematics, turned_rad: Sequence[float], slip: float, missing_turn_rad: float
) -> tuple[float, ...]:
    """Return the likeliest slip of each wheel, -1 to 1.

    The slips of the wheels scatter equally about that of the rover, and together they explain the missing
    turn. A wheel that hardly turns loses hardly anything: it rolls on and measures drift along its rim. So
    the gyro of an omnidirectional rover measures its drift.

    Args:
        kinematics: Of the wheels.
        turned_rad: Angle turned by each wheel.
        slip: Slip ratio of the rover.
        missing_turn_rad: Turn that this slip at every wheel would give, less the measured turn.
    """
    count = kinematics.wheel_count
    turns_rad = [
        kinematics.body_motion([angle_rad if other == wheel else 0.0 for other in range(count)])[2]
        for wheel, angle_rad in enumerate(turned_rad)
    ]
    noise = (EFFORT.sharing.turn_noise_rad / EFFORT.sharing.slip_scatter) ** 2
    gain = missing_turn_rad / (sum(turn_rad**2 for turn_rad in turns_rad) + noise)
    return tuple(min(max(slip + gain * turn_rad, -1.0), 1.0) for turn_rad in turns_rad)
