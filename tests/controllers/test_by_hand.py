"""Driving by hand: limits, and commands that expire."""

import math

import pytest

from controllers.motion.missions.by_hand import EXPIRY_S, ByHandMission
from controllers.motion.planar import Pose
from drivers.clock import nanoseconds
from tests.controllers.mobility import OMNI, Wheels

MISSION = ByHandMission(type="by_hand", speed_m_s=0.2, yaw_rate_limit_rad_s=0.5)


def test_a_command_holds_for_its_time_and_no_longer() -> None:
    hand = MISSION.follower(OMNI)
    assert hand.guide(Pose(), 5) is None
    hand.command(1000, (0.1, -0.05, 0.2))
    guidance = hand.guide(Pose(), 1000 + nanoseconds(EXPIRY_S) - 1)
    assert guidance is not None
    assert (guidance.velocity_x_m_s, guidance.velocity_y_m_s, guidance.yaw_rate_rad_s) == (0.1, -0.05, 0.2)
    assert hand.guide(Pose(), 1000 + nanoseconds(EXPIRY_S)) is None


def test_rest_needs_no_set_points() -> None:
    hand = MISSION.follower(OMNI)
    hand.command(0, (0.1, 0.0, 0.0))
    hand.command(1, (0.0, 0.0, 0.0))
    assert hand.guide(Pose(), 2) is None


@pytest.mark.parametrize("wrong", [math.nan, math.inf, -math.inf])
def test_a_command_that_is_not_finite_is_rest(wrong: float) -> None:
    hand = MISSION.follower(OMNI)
    hand.command(0, (0.1, wrong, 0.0))
    assert hand.guide(Pose(), 1) is None


@pytest.mark.parametrize("motion", [(3.0, 4.0, -0.9), (0.15, -0.2, 5.0), (3.0, 4.0, -20.0), (0.0, 0.0, 2.0)])
def test_a_command_beyond_a_limit_is_scaled_as_a_whole(motion: tuple[float, float, float]) -> None:
    hand = MISSION.follower(OMNI)
    hand.command(0, motion)
    guidance = hand.guide(Pose(), 1)
    assert guidance is not None
    limited = (guidance.velocity_x_m_s, guidance.velocity_y_m_s, guidance.yaw_rate_rad_s)
    share = max(map(abs, limited)) / max(map(abs, motion))
    assert share < 1.0
    assert limited == pytest.approx(tuple(share * value for value in motion))
    assert math.hypot(*limited[:2]) <= 0.2 * (1 + 1e-12)
    assert abs(limited[2]) <= 0.5 * (1 + 1e-12)
    assert math.hypot(*limited[:2]) == pytest.approx(0.2) or abs(limited[2]) == pytest.approx(0.5)


def test_what_the_wheels_cannot_do_is_left_out() -> None:
    hand = MISSION.follower(Wheels(moves_sideways=False, turns_on_spot=False, turn_radius_m=1.0))
    hand.command(0, (0.1, 0.1, 0.5))
    guidance = hand.guide(Pose(), 1)
    assert guidance is not None
    assert guidance.velocity_y_m_s == 0.0
    assert guidance.yaw_rate_rad_s == pytest.approx(0.1)
    hand.command(1, (0.0, 0.0, 0.5))
    turn = hand.guide(Pose(), 2)
    assert turn is not None
    assert turn.yaw_rate_rad_s == 0.0
