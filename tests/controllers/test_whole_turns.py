"""Whole turns on the spot in both senses, by the estimated yaw."""

import math
from itertools import pairwise

import pytest

from controllers.motion.planar import Pose, wrap_angle
from controllers.motion.settings import WholeTurnsMission
from drivers.clock import nanoseconds
from drivers.errors import ConfigError
from tests.controllers.mobility import OMNI, Wheels

STEP_S = 0.02


def test_the_rover_turns_there_and_back_and_rests_in_between() -> None:
    mission = WholeTurnsMission(type="whole_turns", turns=2, turn_rate_rad_s=0.8, rest_s=1.0)
    turns, yaw, t_s, yaws = mission.follower(OMNI), 0.0, 50.0, []
    while not (guidance := turns.guide(Pose(yaw_rad=wrap_angle(yaw)), nanoseconds(t_s))).finished:
        assert abs(guidance.yaw_rate_rad_s) <= 0.8
        yaw += 0.9 * guidance.yaw_rate_rad_s * STEP_S  # wheels that skid
        yaws.append(yaw)
        t_s += STEP_S
        assert t_s < 150.0
    assert max(yaws) == pytest.approx(2 * math.tau, abs=0.03)
    assert yaws[-1] == pytest.approx(0.0, abs=0.03)
    rests = [later - earlier == 0.0 for earlier, later in pairwise(yaws)]
    assert sum(rests) * STEP_S == pytest.approx(3.0, abs=0.2)


@pytest.mark.parametrize(("senses", "expected"), [("left", math.tau), ("right", -math.tau)])
def test_one_sense_only(senses: str, expected: float) -> None:
    mission = WholeTurnsMission.model_validate(
        {"type": "whole_turns", "turns": 1, "turn_rate_rad_s": 0.8, "rest_s": 0.5, "senses": senses}
    )
    turns, yaw, t_s = mission.follower(OMNI), 0.0, 0.0
    while not (guidance := turns.guide(Pose(yaw_rad=wrap_angle(yaw)), nanoseconds(t_s))).finished:
        yaw += guidance.yaw_rate_rad_s * STEP_S
        t_s += STEP_S
        assert t_s < 60.0
    assert yaw == pytest.approx(expected, abs=0.03)


def test_a_rover_that_cannot_turn_on_the_spot_is_refused() -> None:
    with pytest.raises(ConfigError, match="turns on the spot"):
        WholeTurnsMission(type="whole_turns").follower(Wheels(turns_on_spot=False))
