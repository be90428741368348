"""Wheels that draw current and do not turn: they move nothing, so their slip is 1."""

from controllers.slip.effort.motor_model import SLOWEST_RAD_S, EffortFlag, MotorSettings, WheelEffort

STUCK_AFTER_S = 0.3
"""A wheel that draws current and does not turn is stuck after this long: until then it may be starting."""

STUCK_CURRENT = 2.0
"""Current of a stuck wheel, over the no-load current."""

STANDING_RAD_S = 0.02
"""A stuck wheel turns no faster. Not the step of the speed field: with the droop of its speed loop, 0.4 rad/s
per ampere, a loaded wheel creeps with 0.1 rad/s and moves the rover, and a slip of 1 would hide that."""


class StuckWheels:
    """Measures for how long each wheel has been stuck.

    Args:
        motor: Tells the no-load current.
        wheel_count: Number of wheels.
    """

    def __init__(self, motor: MotorSettings, wheel_count: int) -> None:
        self._least_current_a = STUCK_CURRENT * (motor.coulomb_torque_nm / motor.torque_constant_nm_a)
        self._stuck_s = [0.0] * wheel_count

    def check(self, wheel: int, effort: WheelEffort, elapsed_s: float, set_speed_rad_s: float) -> bool:
        """Return whether a wheel is stuck; to be called once per increment of `elapsed_s`."""
        is_held = (
            abs(effort.speed_rad_s) < STANDING_RAD_S
            and abs(set_speed_rad_s) > SLOWEST_RAD_S
            and abs(effort.current_a) > self._least_current_a
            and effort.unknown_torque in (None, EffortFlag.SATURATED)
        )
        self._stuck_s[wheel] = self._stuck_s[wheel] + elapsed_s if is_held else 0.0
        return self._stuck_s[wheel] >= STUCK_AFTER_S
