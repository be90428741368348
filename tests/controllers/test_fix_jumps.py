"""Places without a yaw that jump: neither place is believed, and the region holds both."""

import math
from dataclasses import replace

import pytest

from controllers.estimation.filter.motion_history import WayBack
from controllers.estimation.filter.transition import Turn
from controllers.estimation.pose_estimate import YawSource
from controllers.estimation.positions.jumps import PositionJumps
from controllers.estimation.settings import FilterSettings
from controllers.estimation.wheels.odometry import BodyIncrement
from drivers.samples import UNKNOWN_YAW_STD_RAD, PoseFixSample
from tests.controllers.floor_fixes import FIX, PositionFilter

HERE = WayBack(x_m=0.0, y_m=0.0, turned_rad=0.0, position_m2=0.0, yaw_rad2=0.0)
AHEAD = BodyIncrement(x_m=0.1, y_m=0.0, turn_rad=0.0, duration_s=0.2)
NO_TURN = Turn(angle_rad=0.0, source=YawSource.GYRO)
DEVICE = FIX.device


def fix(place_m: complex) -> PoseFixSample:
    return replace(
        FIX, x_m=place_m.real, y_m=place_m.imag, position_std_m=0.02, yaw_std_rad=UNKNOWN_YAW_STD_RAD
    )


def driven(steps: int = 20) -> tuple[PositionFilter, complex]:
    """Return a filter that has found the axes of the places, and where it is."""
    pose_filter = PositionFilter(FilterSettings(), (), (DEVICE,))
    place_m = 0j
    for _ in range(steps):
        pose_filter.positions.take(fix(place_m), HERE)
        pose_filter.predict(AHEAD, NO_TURN)
        place_m += 0.1
    assert pose_filter.positions.take(fix(place_m), HERE)[0].accepted
    return pose_filter, place_m


@pytest.mark.parametrize("jump_m", [1.0 + 0j, -0.6 + 0.8j, 20.0 + 0j])
def test_a_jump_moves_no_pose_and_holds_it_from_then_on(jump_m: complex) -> None:
    pose_filter, place_m = driven()
    before, variances = pose_filter.pose, pose_filter.covariance
    accepted = [pose_filter.positions.take(fix(place_m + jump_m), HERE)[0].accepted for _ in range(4)]
    assert accepted == [False, False, True, True]
    assert pose_filter.positions.jumped_m[DEVICE] == pytest.approx(jump_m, abs=0.02)
    assert pose_filter.pose.x_m == pytest.approx(before.x_m, abs=1e-3)
    assert pose_filter.covariance == pytest.approx(variances, rel=0.15)  # the noise of one position
    for _ in range(50):  # wheels that turn 10 % too far are still corrected
        pose_filter.predict(replace(AHEAD, x_m=0.11), NO_TURN)
        place_m += 0.1
        assert pose_filter.positions.take(fix(place_m + jump_m), HERE)[0].accepted
    assert pose_filter.pose.x_m == pytest.approx(place_m.real, abs=0.1)


def test_places_that_return_end_the_jump() -> None:
    pose_filter, place_m = driven()
    for _ in range(3):
        pose_filter.positions.take(fix(place_m + 1.0), HERE)
    names = [
        innovation.name for _ in range(3) for innovation in pose_filter.positions.take(fix(place_m), HERE)
    ]
    assert names.count(f"{DEVICE} jumped") == 1
    assert pose_filter.positions.jumped_m == {}
    assert pose_filter.pose.x_m == pytest.approx(place_m.real, abs=0.02)


def test_wheels_that_slip_wholly_are_no_jump() -> None:
    """The rover has stayed behind: its places are believed, as of any device."""
    pose_filter, place_m = driven()
    for _ in range(40):
        pose_filter.predict(AHEAD, NO_TURN)
        pose_filter.positions.take(fix(place_m), HERE)
    assert pose_filter.positions.jumped_m == {}
    assert pose_filter.pose.x_m == pytest.approx(place_m.real, abs=0.3)


def test_motion_that_was_not_measured_is_no_jump() -> None:
    """Silent wheels, while the rover rolled on."""
    pose_filter, place_m = driven()
    pose_filter.inflate(1.5, 0.0, 0.0)
    for _ in range(4):
        pose_filter.positions.take(fix(place_m + 1.2), HERE)
    assert pose_filter.positions.jumped_m == {}
    assert pose_filter.pose.x_m == pytest.approx(place_m.real + 1.2, abs=0.1)


def test_the_first_contradiction_in_a_row_decides() -> None:
    """After it the rover may have driven as far as the jump."""
    jumps = PositionJumps(3.9)
    jumps.agree(0j, 0.02, 0.0)
    assert jumps.is_off(1.0 + 0j, 0.02, 0.1)
    assert jumps.is_off(0.9 + 0j, 0.02, 5.0)
    assert not jumps.is_off(0.2 + 0j, 0.02, 5.0)
    jumps.agree(0j, 0.02, 5.0)
    assert not jumps.is_off(0.2 + 0j, 0.02, 5.1)
    assert jumps.is_off(0.3 + 0j, 0.02, 5.1)


@pytest.mark.parametrize("outliers", [1, 2])
def test_single_wild_places_are_no_jump(outliers: int) -> None:
    pose_filter, place_m = driven()
    for index in range(30):
        pose_filter.predict(AHEAD, NO_TURN)
        place_m += 0.1
        pose_filter.positions.take(fix(place_m + (5.0 if 4 <= index < 4 + outliers else 0.0)), HERE)
    assert pose_filter.positions.jumped_m == {}
    assert pose_filter.pose.x_m == pytest.approx(place_m.real, abs=0.05)


@pytest.mark.parametrize("wrong", [math.nan, math.inf])
def test_a_place_that_is_no_number_leaves_a_conflict_as_it_was(wrong: float) -> None:
    pose_filter, place_m = driven()
    for _ in range(20):
        pose_filter.predict(AHEAD, NO_TURN)
        place_m += 0.03
        pose_filter.positions.take(fix(place_m), HERE)
    before_m = pose_filter.positions.doubted_m[DEVICE]
    assert abs(before_m) > 0.5
    pose_filter.positions.take(replace(fix(place_m), x_m=wrong), HERE)
    assert pose_filter.positions.doubted_m == {DEVICE: before_m}
    assert pose_filter.positions.jumped_m == {}
