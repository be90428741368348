"""What the numbers of a Robotino board mean: its counts in SI units, for its driver and for recorded data.

Source: SensorState.h and the EA09 corrections of controld2.conf (0.15, 3.0, 0.89).
"""

import math
from typing import NamedTuple

from drivers.robotino_board.parameters import RobotinoBoardParameters

MAX_SPEED_STEPS = 255
STEP_TICKS_PER_S = 900
"""One speed step is one encoder tick per 1/900 s: 27 rpm at the motor with 2000 ticks per turn."""
MAX_RAW = 1023
"""Largest reading of the 10-bit converters."""


class Scales(NamedTuple):
    """What one count means, in SI units at the wheel, and how a motor's current is counted.

    Attributes:
        current_step_a: Step of the currents sent: an EA05 sends the upper 8 of 10 bits only.
        current_limit_a: Largest current that can be sent.
    """

    position_rad: float
    speed_rad_s: float
    current_a: float
    system_current_a: float
    battery_v: float
    current_step_a: float
    current_limit_a: float


def scales(settings: RobotinoBoardParameters) -> Scales:
    """Return what one count means on this board with this gear and encoder."""
    position_rad = math.tau / (settings.ticks_per_motor_turn * settings.gear_ratio)
    is_ea05 = settings.board == "EA05"
    current, system, battery = (1.0, 1.0, 1.0) if is_ea05 else (0.15, 3.0, 0.89)
    cut_counts = 4 if is_ea05 else 1
    return Scales(
        position_rad=position_rad,
        speed_rad_s=STEP_TICKS_PER_S * position_rad,
        current_a=current / 156.0,
        system_current_a=system / 61.44,
        battery_v=battery / 36.10,
        current_step_a=cut_counts * (current / 156.0),
        current_limit_a=MAX_RAW // cut_counts * cut_counts * (current / 156.0),
    )
