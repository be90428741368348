import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from controllers.slip.effort.motor_model import (
    EffortFlag,
    EffortObserver,
    MotorSettings,
    WheelEffort,
    paper_torque,
    wheel_torque,
)
from controllers.slip.effort.parameters import EFFORT

MOTOR = MotorSettings()
LOSSY = MotorSettings(gear_efficiency=0.8, coulomb_torque_nm=0.01, viscous_torque_nm_s_rad=1e-5)
PERIOD_S = 0.02

currents = st.floats(-6.0, 6.0)
speeds = st.floats(-20.0, 20.0)


def settle(
    observer: EffortObserver, current_a: float, speed_rad_s: float, set_speed_rad_s: float | None = None
) -> WheelEffort:
    effort = observer.step(PERIOD_S, current_a, speed_rad_s, set_speed_rad_s)
    for _ in range(60):
        effort = observer.step(PERIOD_S, current_a, speed_rad_s, set_speed_rad_s)
    return effort


def test_paper_torque_is_the_papers_far_from_rest() -> None:
    speed = 150.0  # rad/s at the motor, where the guard at rest changes nothing that matters
    current_a = 0.8
    voltage_v = current_a * MOTOR.resistance_ohm + MOTOR.torque_constant_nm_a * speed
    expected = voltage_v * current_a / speed
    assert paper_torque(MOTOR, current_a, speed / 16, 1.0) == pytest.approx(expected, rel=2e-3)


def test_most_of_m_at_low_speed_is_copper_loss() -> None:
    m_nm = paper_torque(MOTOR, 1.0, 2.5, 1.0)
    assert 0.65 < 1.0 - MOTOR.torque_constant_nm_a / m_nm < 0.75


@given(currents, speeds, st.sampled_from((-1.0, 1.0)))
def test_paper_torque_is_bounded_and_takes_the_direction(
    current_a: float, speed_rad_s: float, direction: float
) -> None:
    m_nm = paper_torque(MOTOR, current_a, speed_rad_s, direction)
    worst = MOTOR.resistance_ohm * current_a**2 / (2 * EFFORT.motor.slowest_rad_s * MOTOR.gear_ratio)
    least = MOTOR.torque_constant_nm_a * abs(current_a)
    assert least - 1e-12 <= m_nm * direction <= least + worst + 1e-12
    assert m_nm == -paper_torque(MOTOR, current_a, -speed_rad_s, -direction)


def test_a_stalled_wheel_reports_its_effort() -> None:
    assert paper_torque(MOTOR, 2.0, 0.0, -1.0) == pytest.approx(-2.0 * MOTOR.torque_constant_nm_a)
    assert wheel_torque(MOTOR, -2.0, 0.0) == pytest.approx(-2.0 * MOTOR.torque_constant_nm_a * 16)


@given(speeds, st.floats(0.0, 5.0), st.floats(0.01, 1.0))
def test_wheel_torque_grows_with_current(speed_rad_s: float, current_a: float, more_a: float) -> None:
    assert wheel_torque(LOSSY, current_a + more_a, speed_rad_s) > wheel_torque(LOSSY, current_a, speed_rad_s)


@given(currents, speeds, st.floats(-50.0, 50.0))
def test_wheel_torque_is_odd(current_a: float, speed_rad_s: float, acceleration: float) -> None:
    forward = wheel_torque(LOSSY, current_a, speed_rad_s, acceleration)
    assert wheel_torque(LOSSY, -current_a, -speed_rad_s, -acceleration) == pytest.approx(-forward, abs=1e-12)


def test_wheel_torque_takes_each_loss_off_once() -> None:
    speed = 5.0 * LOSSY.gear_ratio
    kept = 0.8 * 0.0514 * 1.0 - 0.01 - 1e-5 * speed - 7.1e-6 * 16.0 * 10.0
    assert wheel_torque(LOSSY, 1.0, 5.0, 10.0) == pytest.approx(16.0 * kept)
    # Braking: the gear's loss now helps the brake.
    assert wheel_torque(LOSSY, -1.0, 5.0) == pytest.approx(16.0 * (-0.0514 / 0.8 - 0.01 - 1e-5 * speed))


@given(st.floats(-1e-6, 1e-6))
def test_wheel_torque_does_not_jump_at_rest(speed_rad_s: float) -> None:
    # The gear's efficiency changes sides at rest; without it nothing may jump.
    assert wheel_torque(MOTOR, 0.5, speed_rad_s) == pytest.approx(wheel_torque(MOTOR, 0.5, 0.0), abs=1e-5)


@pytest.mark.parametrize("direction", [-1.0, 1.0])
def test_unsigned_current_takes_the_sign_of_the_speed(direction: float) -> None:
    effort = settle(EffortObserver(MOTOR, current_is_signed=False), 0.7, 3.0 * direction, 3.2 * direction)
    assert effort.flags == ()
    assert effort.current_a == pytest.approx(0.7 * direction)
    assert effort.paper_torque_nm * direction > 0
    assert effort.wheel_torque_nm * direction > 0


def test_signed_current_keeps_its_sign() -> None:
    effort = settle(EffortObserver(MOTOR, current_is_signed=True), -0.7, 3.0, 2.0)
    assert effort.current_a == pytest.approx(-0.7)
    assert effort.flags == ()


def test_stalled_wheel_takes_the_sign_of_the_set_point() -> None:
    effort = settle(EffortObserver(MOTOR, current_is_signed=False), 1.5, 0.0, -3.0)
    assert effort.current_a == pytest.approx(-1.5)
    assert effort.flags == (EffortFlag.SLOW,)


def test_braking_is_flagged() -> None:
    observer = EffortObserver(MOTOR, current_is_signed=False)
    assert EffortFlag.BRAKING in settle(observer, 0.5, 3.0, 2.0).flags
    assert EffortFlag.BRAKING in settle(observer, 0.5, 3.0, -2.0).flags
    assert EffortFlag.BRAKING not in settle(observer, 0.5, 3.0, 3.0).flags
    assert EffortFlag.BRAKING not in settle(observer, 0.5, 3.0, None).flags


def test_change_of_direction_is_flagged_for_a_while() -> None:
    observer = EffortObserver(MOTOR, current_is_signed=False)
    settle(observer, 0.5, 3.0)
    flagged = [EffortFlag.SIGN_CHANGE in observer.step(PERIOD_S, 0.5, -3.0).flags for _ in range(10)]
    assert sum(flagged) == math.ceil(EFFORT.motor.sign_settle_s / PERIOD_S)
    assert flagged == sorted(flagged, reverse=True)


def test_of_a_slow_wheel_the_work_is_known_without_the_sign_of_its_current() -> None:
    observer = EffortObserver(MOTOR, current_is_signed=False)
    settle(observer, 0.5, 0.3)
    trembling = observer.step(PERIOD_S, 0.5, -0.3)
    assert trembling.flags == (EffortFlag.SLOW, EffortFlag.SIGN_CHANGE)
    assert (trembling.unknown_torque, trembling.unknown_work) == (EffortFlag.SIGN_CHANGE, None)
    fast = EffortObserver(MOTOR, current_is_signed=False)
    settle(fast, 0.5, 3.0)
    assert fast.step(PERIOD_S, 0.5, -3.0).unknown_work is EffortFlag.SIGN_CHANGE
    assert observer.step(PERIOD_S, None, 0.3).unknown_work is EffortFlag.NO_CURRENT
    assert settle(observer, 7.0, 0.3).unknown_work is EffortFlag.SATURATED
    assert settle(observer, 0.5, 0.3).unknown_torque is None


def test_saturated_and_missing_currents_are_flagged() -> None:
    observer = EffortObserver(MOTOR, current_is_signed=False)
    assert observer.step(PERIOD_S, MOTOR.current_full_scale_a, 3.0).flags == (EffortFlag.SATURATED,)
    assert observer.step(PERIOD_S, None, 3.0).flags == (EffortFlag.NO_CURRENT,)


@pytest.mark.parametrize("elapsed_s", [0.0, -0.02])
def test_a_clock_that_does_not_go_forward_changes_nothing(elapsed_s: float) -> None:
    observer = EffortObserver(MOTOR, current_is_signed=False)
    before = settle(observer, 0.5, 3.0)
    wrong = observer.step(elapsed_s, 5.0, -9.0)
    assert wrong.flags == (EffortFlag.CLOCK,)
    assert (wrong.current_a, wrong.speed_rad_s) == (before.current_a, before.speed_rad_s)


def test_current_and_speed_pass_the_same_filter() -> None:
    observer = EffortObserver(MOTOR, current_is_signed=True)
    observer.step(PERIOD_S, 0.0, 0.0)
    for _ in range(7):
        effort = observer.step(PERIOD_S, 1.0, 4.0)
        assert effort.speed_rad_s == pytest.approx(4.0 * effort.current_a)


def test_filter_does_not_depend_on_the_period() -> None:
    ends: list[float] = []
    for period_s in (0.001, 0.002):
        observer = EffortObserver(MOTOR, current_is_signed=True)
        observer.step(period_s, 0.0, 3.0)
        for _ in range(round(0.1 / period_s)):
            effort = observer.step(period_s, 1.0, 3.0)
        ends.append(effort.current_a)
    assert ends[0] == pytest.approx(1 - math.exp(-1), abs=0.01)
    assert ends[1] == pytest.approx(ends[0], abs=0.01)
