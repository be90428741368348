"""Small turns in place, and the age of wheel positions that they are compared with."""

import math

import pytest

from controllers.motion.planar import Pose
from controllers.motion.settings import SmallTurnsMission
from drivers.clock import nanoseconds
from drivers.robotino_board.settings import RobotinoBoardSettings
from tests.controllers.mobility import OMNI, SKID


def test_each_frequency_is_turned_for_its_time_and_then_the_mission_ends() -> None:
    mission = SmallTurnsMission(
        type="small_turns", frequencies_hz=(1.0, 4.0), each_s=2.0, turn_rate_rad_s=0.3
    )
    turns = mission.follower(OMNI)
    start_s = 100.0
    rates = [turns.guide(Pose(), nanoseconds(start_s + 0.001 * step)).yaw_rate_rad_s for step in range(4000)]
    expected = [
        0.3 * math.sin(math.tau * (1.0 if step < 2000 else 4.0) * 0.001 * step) for step in range(4000)
    ]
    assert rates == pytest.approx(expected, abs=1e-3)
    assert not turns.guide(Pose(), nanoseconds(start_s + 3.999)).finished
    end = turns.guide(Pose(), nanoseconds(start_s + 4.0))
    assert (end.finished, end.yaw_rate_rad_s) == (True, 0.0)


def test_a_rover_that_cannot_move_sideways_may_turn_in_place_whatever_the_heading() -> None:
    assert not list(SmallTurnsMission(type="small_turns", heading="hold").conflicts(SKID))


def test_the_heading_is_held_on_average() -> None:
    turns = SmallTurnsMission(type="small_turns").follower(OMNI)
    guidance = turns.guide(Pose(yaw_rad=0.2), nanoseconds(5.0))
    assert guidance.yaw_rate_rad_s == pytest.approx(-0.06)
    assert (guidance.velocity_x_m_s, guidance.velocity_y_m_s) == (0.0, 0.0)


def test_a_board_that_answers_with_the_request_before_is_older_by_a_period() -> None:
    old = RobotinoBoardSettings(type="robotino_board", port="p", board="EA05").wheel_age_s(0.02)
    new = RobotinoBoardSettings(type="robotino_board", port="p", board="EA09").wheel_age_s(0.02)
    assert old - new == pytest.approx(0.02)
    assert new == pytest.approx(0.005 + 1010 / 115_200)
