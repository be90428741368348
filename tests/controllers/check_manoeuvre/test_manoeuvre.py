"""The manoeuvre alone: its limits of time."""

from dataclasses import replace

import pytest

from controllers.check_manoeuvre.manoeuvre import LONGEST_STOP_S, CheckManoeuvre
from controllers.check_manoeuvre.path import Compared, Pace, legs_of
from controllers.estimation.settings import FilterSettings
from controllers.motion.kinematics import make_kinematics
from controllers.motion.planar import Pose
from tests.controllers.check_manoeuvre.test_comparison import ground_pair
from tests.controllers.simulated import OMNI, PERIOD_NS, ROLES

LEGS = legs_of(make_kinematics(OMNI), Pace(0.1, 0.2), Compared.NOTHING)


def make() -> CheckManoeuvre:
    return CheckManoeuvre(LEGS, ROLES, FilterSettings())


def guided(manoeuvre: CheckManoeuvre, from_s: float, to_s: float) -> bool:
    """Guide a rover whose wheels do not turn; return whether the manoeuvre is over."""
    for t_ns in range(round(from_s * 1e9), round(to_s * 1e9), PERIOD_NS):
        if not manoeuvre.is_over:
            manoeuvre.guide(t_ns, Pose(), t_ns, ())
    return manoeuvre.is_over


def test_a_leg_that_takes_too_long_ends_the_run() -> None:
    manoeuvre = make()
    assert not guided(manoeuvre, 0.0, 10.0)
    assert guided(manoeuvre, 10.0, 12.0)
    assert manoeuvre.failure.startswith("check manoeuvre: its leg 1 took longer than 10 s")


def test_pauses_count_for_no_leg() -> None:
    manoeuvre = make()
    for number in range(8):
        guided(manoeuvre, 20.0 * number, 20.0 * number + 1.0)
    assert not manoeuvre.is_over


@pytest.mark.parametrize("is_begun", [True, False])
def test_a_stop_that_lasts_ends_it_once_it_has_begun(is_begun: bool) -> None:
    manoeuvre = make()
    if is_begun:
        guided(manoeuvre, 0.0, 1.0)
    manoeuvre.wait(10**9)
    manoeuvre.wait(round((0.9 + LONGEST_STOP_S) * 1e9))
    assert not manoeuvre.is_over
    manoeuvre.wait(round((1.0 + LONGEST_STOP_S) * 1e9))
    assert manoeuvre.is_over is is_begun
    assert bool(manoeuvre.failure) is is_begun


def test_without_legs_it_is_over() -> None:
    manoeuvre = CheckManoeuvre((), ROLES, FilterSettings())
    assert manoeuvre.is_over
    assert manoeuvre.take_result() is None


def test_what_a_rotation_leaves_of_the_swing_of_the_camera_is_no_travel() -> None:
    legs = legs_of(make_kinematics(OMNI), Pace(0.1, 0.2), Compared.TRAVEL)
    manoeuvre = CheckManoeuvre(legs, replace(ROLES, camera="camera"), FilterSettings())
    x_m = yaw_rad = 0.0
    for t_ns in range(0, 60 * 10**9, PERIOD_NS):
        guidance = manoeuvre.guide(t_ns, Pose(x_m=x_m, yaw_rad=yaw_rad), t_ns, ())
        step_m = guidance.velocity_x_m_s * PERIOD_NS / 1e9
        turn_rad = guidance.yaw_rate_rad_s * PERIOD_NS / 1e9
        x_m, yaw_rad = x_m + step_m, yaw_rad + turn_rad
        if turn_rad:
            pair = ground_pair(0.01 * turn_rad, -0.03 * turn_rad)
            manoeuvre.guide(t_ns, Pose(x_m=x_m, yaw_rad=yaw_rad), t_ns, (pair,))
    assert manoeuvre.is_over
    assert all(check.quantity != "travel" for check in manoeuvre.result)
