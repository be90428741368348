"""Bounds of motion that no device measured, and the turn of the rover by its wheels."""

import numpy as np
import pytest

from controllers.estimation.wheels.turn_evidence import WheelTurn
from controllers.estimation.wheels.unobserved_motion import UnobservedMotion
from controllers.motion.kinematics import OmniKinematics, greatest_motion
from tests.controllers.simulated import OMNI

EFFECTS = OmniKinematics(OMNI).wheel_effects()


def test_the_greatest_motion_is_that_of_the_wheels_that_turn_the_same_way() -> None:
    # Ahead by 0.1 m: wheels 0 and 2 in opposite directions, half of the way each.
    ahead = OmniKinematics(OMNI).wheel_speeds(0.1, 0.0, 0.0)
    x_m, y_m, yaw_rad = greatest_motion(EFFECTS, ahead)
    assert x_m == pytest.approx(0.1)
    assert y_m == pytest.approx(0.1 * np.tan(np.radians(30.0)) / 2.0)
    assert yaw_rad == pytest.approx(0.1 * np.cos(np.radians(30.0)) / (3.0 * 0.125))


def test_while_the_wheels_are_not_measured_the_fastest_speed_counts() -> None:
    unseen = UnobservedMotion(EFFECTS)
    unseen.note_speeds((1.0, 0.0, -1.0), (-2.0, 0.0, 0.5), is_measured=True)
    unseen.note_speeds((0.0, 0.0, 0.0), (0.0, 3.0, 0.0), is_measured=False)
    assert unseen.greatest_motion(0.5, 0.0)[:2] == pytest.approx(
        greatest_motion(EFFECTS, (-1.0, 1.5, -0.5))[:2]
    )
    unseen.note_speeds((0.0, 0.0, 0.0), (0.0, 0.1, 0.0), is_measured=True)
    assert unseen.greatest_motion(0.5, 0.5) == pytest.approx(
        greatest_motion(EFFECTS, (0.0, 0.05, 0.0)), abs=1e-4
    )


@pytest.mark.parametrize("turn_unknown_s", [0.25, 6.0])
def test_an_unknown_turn_leads_to_the_side(turn_unknown_s: float) -> None:
    unseen = UnobservedMotion(EFFECTS)
    unseen.note_speeds(OmniKinematics(OMNI).wheel_speeds(0.1, 0.0, 0.0), is_measured=True)
    ahead_m, aside_m, _ = unseen.greatest_motion(6.0, 0.0)
    x_m, y_m, yaw_rad = unseen.greatest_motion(6.0, turn_unknown_s)
    assert yaw_rad == pytest.approx(turn_unknown_s * 0.1 * np.cos(np.radians(30.0)) / (3.0 * 0.125))
    assert x_m == ahead_m
    # Half of the product of distance and turn; one radian at most.
    assert y_m == pytest.approx(aside_m + 0.5 * ahead_m * min(yaw_rad, 1.0))
    # A turn that the gyro has measured leads there, too, whichever its sign.
    for turned_rad in (0.1, -0.1):
        _, y_m, _ = unseen.greatest_motion(6.0, turn_unknown_s, turned_rad)
        assert y_m == pytest.approx(aside_m + 0.5 * ahead_m * min(yaw_rad + 0.1, 1.0))


def test_wheels_that_have_steered_move_the_rover_another_way() -> None:
    unseen = UnobservedMotion(EFFECTS)
    unseen.note_speeds((0.0, 1.0, 0.0), is_measured=True)
    turned = tuple((2.0 * y, 2.0 * x, yaw) for x, y, yaw in EFFECTS)
    unseen.turn_wheels(turned)
    assert unseen.greatest_motion(0.5, 0.0)[:2] == pytest.approx(greatest_motion(turned, (0.0, 0.5, 0.0))[:2])


def test_before_the_first_speeds_nothing_is_unknown() -> None:
    unseen = UnobservedMotion(EFFECTS)
    assert unseen.greatest_motion(1.0, 1.0) == (0.0, 0.0, 0.0)


def test_speeds_of_a_wheel_must_not_be_missing() -> None:
    unseen = UnobservedMotion(EFFECTS)
    unseen.note_speeds((1.0, 1.0, 1.0), (1.0, 1.0), is_measured=True)
    with pytest.raises(ValueError, match="shorter"):
        unseen.greatest_motion(1.0, 1.0)


def test_the_wheels_turn_the_rover_to_both_sides_at_once() -> None:
    effects = ((1.0, 0.0, 0.5), (0.0, 1.0, -0.25))
    turn = WheelTurn().with_increment(effects, (0.25, 0.5), 0.125)
    assert turn == WheelTurn(duration_s=0.125, left_rad=0.125, right_rad=0.125)
    assert turn.turn_rad == 0.0
    turn = turn.with_increment(effects, (-0.5, -1.0), 0.25)
    assert turn == WheelTurn(duration_s=0.375, left_rad=0.375, right_rad=0.375)
    turn = turn.with_increment(((0.0, 0.0, 1.0),) * 2, (1.0, 0.5), 0.5)
    assert turn == WheelTurn(duration_s=0.875, left_rad=1.875, right_rad=0.375)
    assert turn.turn_rad == 1.5
    turn = turn.with_increment(((0.0, 0.0, 1.0),) * 2, (-1.0, -0.5), 0.125)
    assert turn == WheelTurn(duration_s=1.0, left_rad=1.875, right_rad=1.875)


def test_every_wheel_must_have_turned_by_a_known_angle() -> None:
    with pytest.raises(ValueError, match="shorter"):
        WheelTurn().with_increment(EFFECTS, (0.1, 0.1), 0.1)
