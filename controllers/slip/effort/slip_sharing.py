"""One slip of the rover, and a turn that it does not explain: which wheel slips how much?"""

from collections.abc import Sequence

from controllers.motion.kinematics import Kinematics

SLIP_SCATTER = 0.1
"""Scatter of the wheels' slips about that of the rover, as on patchy ground."""

TURN_NOISE_RAD = 0.005
"""Of the missing turn: wheels and gyro are not read at quite the same time."""


def share_slip(
    kinematics: Kinematics, turned_rad: Sequence[float], slip: float, missing_turn_rad: float
) -> tuple[float, ...]:
    """Return the likeliest slip of each wheel, -1 to 1.

    The wheels' slips scatter alike about the rover's, and together they explain the turn that is missing. A
    wheel that hardly turns can lose hardly anything: it goes on rolling, and tells of drift along its rim. So
    the gyro of an omnidirectional rover tells how it drifts.

    Args:
        kinematics: Of the wheels.
        turned_rad: What each wheel turned.
        slip: Slip ratio of the rover.
        missing_turn_rad: What the body turned less than wheels would have made it that all had this slip.
    """
    count = kinematics.wheel_count
    turns_rad = [
        kinematics.body_motion([angle_rad if other == wheel else 0.0 for other in range(count)])[2]
        for wheel, angle_rad in enumerate(turned_rad)
    ]
    noise = (TURN_NOISE_RAD / SLIP_SCATTER) ** 2
    gain = missing_turn_rad / (sum(turn_rad**2 for turn_rad in turns_rad) + noise)
    return tuple(min(max(slip + gain * turn_rad, -1.0), 1.0) for turn_rad in turns_rad)
