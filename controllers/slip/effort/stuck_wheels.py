"""Wheels that draw current and do not turn: they move nothing, so their slip is 1."""

from controllers.slip.effort.motor_model import EffortFlag, MotorSettings, WheelEffort
from controllers.slip.effort.parameters import EFFORT
from drivers.safety_event import Outcome, SafetyEvent

EVENTS = (
    SafetyEvent(
        Outcome.CONTINUES,
        "A wheel is stuck, and its current is measured.",
        "Its slip is 1 after 0.3 s, so that the odometry stays right until the stall stops the rover.",
        ("tests/controllers/test_effort_compensator.py::test_a_stuck_wheel_slips_by_one",),
    ),
)
"""Rows of the reference page of safety."""


class StuckWheels:
    """Measures for how long each wheel has been stuck.

    Args:
        motor: Gives the no-load current.
        wheel_count: Number of wheels.
    """

    def __init__(self, motor: MotorSettings, wheel_count: int) -> None:
        self._least_current_a = EFFORT.stuck.current * (motor.coulomb_torque_nm / motor.torque_constant_nm_a)
        self._stuck_s = [0.0] * wheel_count

    def check(self, wheel: int, effort: WheelEffort, elapsed_s: float, set_speed_rad_s: float) -> bool:
        """Return whether a wheel is stuck; to be called once per increment of `elapsed_s`."""
        is_held = (
            abs(effort.speed_rad_s) < EFFORT.stuck.standing_rad_s
            and abs(set_speed_rad_s) > EFFORT.motor.slowest_rad_s
            and abs(effort.current_a) > self._least_current_a
            and effort.unknown_torque in (None, EffortFlag.SATURATED)
        )
        self._stuck_s[wheel] = self._stuck_s[wheel] + elapsed_s if is_held else 0.0
        return self._stuck_s[wheel] >= EFFORT.stuck.after_s
