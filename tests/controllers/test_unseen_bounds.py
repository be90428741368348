"""Bounds of motion that no device measured, and the turn of the rover by its wheels."""

import numpy as np
import pytest

from controllers.estimation.unseen_motion import UnseenMotion
from controllers.motion.kinematics import OmniKinematics, greatest_motion, wheel_effects
from tests.controllers.simulated import OMNI

EFFECTS = wheel_effects(OmniKinematics(OMNI))


def test_the_greatest_motion_is_that_of_the_wheels_that_turn_the_same_way() -> None:
    # Ahead by 0.1 m: wheels 0 and 2 in opposite directions, half of the way each.
    ahead = OmniKinematics(OMNI).wheel_speeds(0.1, 0.0, 0.0)
    x_m, y_m, yaw_rad = greatest_motion(EFFECTS, ahead)
    assert x_m == pytest.approx(0.1)
    assert y_m == pytest.approx(0.1 * np.tan(np.radians(30.0)) / 2.0)
    assert yaw_rad == pytest.approx(0.1 * np.cos(np.radians(30.0)) / (3.0 * 0.125))


def test_while_the_wheels_are_not_measured_the_fastest_speed_counts() -> None:
    unseen = UnseenMotion(EFFECTS)
    unseen.note_speeds((1.0, 0.0, -1.0), (-2.0, 0.0, 0.5), is_measured=True)
    unseen.note_speeds((0.0, 0.0, 0.0), (0.0, 3.0, 0.0), is_measured=False)
    assert unseen.greatest_motion(0.5, 0.0)[:2] == pytest.approx(
        greatest_motion(EFFECTS, (-1.0, 1.5, -0.5))[:2]
    )
    unseen.note_speeds((0.0, 0.0, 0.0), (0.0, 0.1, 0.0), is_measured=True)
    assert unseen.greatest_motion(0.5, 0.5) == pytest.approx(
        greatest_motion(EFFECTS, (0.0, 0.05, 0.0)), abs=1e-4
    )


def test_what_a_measurement_has_removed_is_known_again() -> None:
    unseen = UnseenMotion(EFFECTS)
    unseen.add(0.09, 0.04)
    unseen.limit(0.16, 0.01)
    assert (unseen.position_m, unseen.yaw_rad) == pytest.approx((0.3, 0.1))
