"""Currents of other wheels: one at rest draws current while one that turns draws hardly any."""

from collections.abc import Sequence

from controllers.slip.effort.motor_model import EffortFlag, MotorSettings, WheelEffort
from controllers.slip.effort.parameters import EFFORT


class CurrentOwners:
    """Measures for how long the currents have fitted other wheels than those that they are said to be of.

    Wheels of equal effort may be exchanged unnoticed: it makes no difference until one of them rests.

    Args:
        motor: Gives the no-load current.
    """

    def __init__(self, motor: MotorSettings) -> None:
        no_load_a = motor.coulomb_torque_nm / motor.torque_constant_nm_a
        self._rest_a = EFFORT.owners.rest_current * no_load_a
        self._turning_a = EFFORT.owners.turning_current * no_load_a
        self._wrong_s = 0.0
        self.reason = ""

    def check(self, efforts: Sequence[WheelEffort], elapsed_s: float) -> None:
        """Take the efforts of one increment of `elapsed_s`; `reason` stays until the currents fit again."""
        numbers, standing_rad_s = EFFORT.owners, EFFORT.stuck.standing_rad_s
        resting = [abs(one.speed_rad_s) < standing_rad_s for one in efforts]
        if True not in resting or any(EffortFlag.NO_CURRENT in effort.flags for effort in efforts):
            return
        turning = [abs(one.speed_rad_s) > numbers.turning_rad_s for one in efforts]
        if True not in turning:
            return
        current_a = [abs(effort.current_a) for effort in efforts]
        drawing = max(range(len(efforts)), key=lambda wheel: current_a[wheel] if resting[wheel] else -1.0)
        idle = min(range(len(efforts)), key=lambda wheel: current_a[wheel] if turning[wheel] else 1e9)
        if current_a[drawing] > self._rest_a and current_a[idle] < self._turning_a:
            self._wrong_s += elapsed_s
        else:
            self._wrong_s, self.reason = 0.0, ""
        if self._wrong_s >= numbers.after_s:
            self.reason = (
                f"currents of other wheels: wheel {drawing} draws {current_a[drawing]:.2f} A at rest, "
                f"wheel {idle} turns with {current_a[idle]:.2f} A"
            )
