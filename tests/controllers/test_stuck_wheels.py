"""Wheels that draw current and do not turn."""

import pytest

from controllers.slip.effort.motor_model import EffortFlag, MotorSettings, WheelEffort
from controllers.slip.effort.parameters import EFFORT
from controllers.slip.effort.stuck_wheels import StuckWheels

MOTOR = MotorSettings(coulomb_torque_nm=0.25, torque_constant_nm_a=0.5)
LEAST_CURRENT_A = EFFORT.stuck.current * 0.5


def effort(current_a: float = 3.0, speed_rad_s: float = 0.0, *flags: EffortFlag) -> WheelEffort:
    return WheelEffort(current_a, speed_rad_s, 0.0, 0.0, flags)


def is_stuck_after(elapsed_s: float, held: WheelEffort, set_speed_rad_s: float = 3.0) -> bool:
    return StuckWheels(MOTOR, 1).check(0, held, elapsed_s, set_speed_rad_s)


def test_a_wheel_is_stuck_when_it_has_been_held_for_long_enough() -> None:
    assert (EFFORT.stuck.after_s, EFFORT.stuck.current, EFFORT.stuck.standing_rad_s) == (0.3, 2.0, 0.02)
    assert not is_stuck_after(0.29, effort())
    assert is_stuck_after(0.3, effort())


def test_each_wheel_has_its_own_account_and_one_turn_clears_it() -> None:
    wheels = StuckWheels(MOTOR, 2)
    assert not wheels.check(0, effort(), 0.2, 3.0)
    assert not wheels.check(1, effort(), 0.2, 3.0)
    assert wheels.check(0, effort(), 0.2, 3.0)
    assert not wheels.check(1, effort(speed_rad_s=1.0), 0.2, 3.0)
    assert not wheels.check(1, effort(), 0.2, 3.0)
    assert wheels.check(1, effort(), 0.2, 3.0)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_edges_of_being_held(sign: float) -> None:
    below, above = 1.0 - 1e-9, 1.0 + 1e-9
    assert is_stuck_after(1.0, effort(speed_rad_s=sign * EFFORT.stuck.standing_rad_s * below))
    assert not is_stuck_after(1.0, effort(speed_rad_s=sign * EFFORT.stuck.standing_rad_s))
    assert is_stuck_after(1.0, effort(), sign * EFFORT.motor.slowest_rad_s * above)
    assert not is_stuck_after(1.0, effort(), sign * EFFORT.motor.slowest_rad_s)
    assert is_stuck_after(1.0, effort(sign * LEAST_CURRENT_A * above))
    assert not is_stuck_after(1.0, effort(sign * LEAST_CURRENT_A))


@pytest.mark.parametrize("flag", EffortFlag)
def test_only_a_torque_that_is_known_or_too_large_to_be_known_makes_a_wheel_stuck(flag: EffortFlag) -> None:
    assert is_stuck_after(1.0, effort(3.0, 0.0, flag)) == (flag in (EffortFlag.SATURATED, EffortFlag.SLOW))
