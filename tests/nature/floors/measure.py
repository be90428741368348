"""Measures the slip of a plant by its own truth."""

import math
from typing import Final

import numpy as np

from tests.nature.floors.machine import NANOSECONDS, Floats
from tests.nature.floors.rover import RoverPlant

__all__ = ["translation_slip", "wheel_speeds"]

_SETTLE_S: Final = 1.5
"""The setpoints' delay, the loops' rise and a few relaxation lengths are over by then."""
_SAMPLE_NS: Final = 50_000_000


def wheel_speeds(
    plant: RoverPlant, velocity_x_m_s: float, velocity_y_m_s: float, yaw_rate_rad_s: float
) -> list[float]:
    """Return the wheel speeds (rad/s) of a body velocity if all wheels roll rigidly."""
    body = np.array([velocity_x_m_s, velocity_y_m_s, yaw_rate_rad_s])
    speeds: list[float] = (plant.kinematics @ body / plant.machine.radius_m).tolist()
    return speeds


def translation_slip(
    plant: RoverPlant, speed_m_s: float, direction_rad: float, drive_s: float = 6.0
) -> float:
    """Return 1 - true path / path by the wheels' turns, of a drive straight ahead in the body frame.

    Paths and not velocities: so the mean is over the ground covered, and it holds, too, when the rover turns
    because its wheels slip by different amounts.

    Args:
        plant: A rover at rest; it is driven.
        speed_m_s: Body speed by rigid rolling.
        direction_rad: Of the velocity, in the body frame.
        drive_s: Length of the drive; the first 1.5 s do not count.
    """
    start_ns = plant.truth().t_ns
    plant.set_wheel_speeds(
        wheel_speeds(plant, speed_m_s * math.cos(direction_rad), speed_m_s * math.sin(direction_rad), 0.0)
    )
    inverse = np.linalg.pinv(plant.kinematics) * plant.machine.radius_m
    first_ns = start_ns + round(_SETTLE_S * NANOSECONDS)
    true_m, wheels_m = 0.0, 0.0
    before: tuple[Floats, Floats] | None = None
    for t_ns in range(first_ns, start_ns + round(drive_s * NANOSECONDS), _SAMPLE_NS):
        plant.advance(t_ns)
        truth = plant.truth()
        place, turns = np.array([truth.x_m, truth.y_m]), np.array(truth.wheel_position_rad)
        if before is not None:
            true_m += float(np.hypot(*(place - before[0])))
            wheels_m += float(np.hypot(*(inverse @ (turns - before[1]))[:2]))
        before = place, turns
    return 1.0 - true_m / wheels_m
