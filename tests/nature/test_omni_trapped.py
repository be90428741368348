"""The rover that is trapped: what holds it, holds."""

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.cases import first_often
from tests.nature.omni_contact import Floor
from tests.nature.omni_trapped import ONE_WHEEL, TrappedOmni


def driven(trap: str, wheel: int = 0) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Drive straight ahead into a trap at 0.1 m; return pose and wheel angles at 2 and 4 s."""
    floor = Floor.uniform("exponential", 0.005, (0.3, 6.0, 0.01, 0.05))
    rover = TrappedOmni(floor, 0, trap=trap, at_m=0.1, wheel=wheel)
    speed_rad_s = 0.15 * math.sin(math.radians(60.0)) / rover.body.radius_m
    rover.set_wheel_speeds((-speed_rad_s, 0.0, speed_rad_s))
    poses, angles = [], []
    for end_ns in (2_000_000_000, 4_000_000_000):
        rover.advance(end_ns)
        truth = rover.truth()
        poses.append((truth.x_m, truth.y_m, truth.yaw_rad))
        angles.append(truth.wheel_position_rad)
    assert rover.is_trapped
    return np.array(poses), np.array(angles)


@pytest.mark.parametrize("wheel", first_often([0, 2]))
def test_a_wheel_that_sticks_turns_no_more_while_the_others_drive_the_rover(wheel: int) -> None:
    poses, angles = driven(ONE_WHEEL, wheel)
    turned_rad = np.abs(angles[1] - angles[0])
    assert turned_rad[wheel] == 0.0
    assert turned_rad[2 - wheel] > 5.0
    assert np.abs(poses[1] - poses[0]).max() > 0.1


@pytest.mark.parametrize("trap", ["lifted", "dug in"])
def test_a_body_that_is_held_stays_while_its_wheels_turn(trap: str) -> None:
    poses, angles = driven(trap)
    assert poses[1] == pytest.approx(poses[0], abs=1e-4)
    assert np.abs(angles[1] - angles[0])[[0, 2]].min() > 3.0
