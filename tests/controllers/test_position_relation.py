"""Positions and dead reckoning: which difference is slip, a conflict, or farther than the wheels rolled."""

import math
from collections.abc import Iterable

import numpy as np
import pytest

from controllers.estimation.positions.relation import APART_SD, PositionRelation
from controllers.estimation.settings import FilterSettings

STD_M = 0.02
STEP_M = 0.05
GATE_SD = 3.9


class Drive:
    """A rover whose wheels roll straight steps, and a device that measures them in its own way."""

    def __init__(self, *, seed: int = 3, std_m: float = STD_M, has_yaw: bool = False) -> None:
        self.relation = PositionRelation(FilterSettings(), GATE_SD)
        self._rng = np.random.default_rng(seed)
        self._std_m, self._has_yaw = std_m, has_yaw
        self._place_m = self._reckoned_m = 0j
        self._path_m = 0.0
        self.is_unexpected = self.is_impossible = False

    def step(self, wheels_m: complex, measured_m: complex) -> None:
        """Roll a way, which the device measures as another one; then take its position."""
        self._reckoned_m += wheels_m
        self._place_m += measured_m
        self._path_m += abs(wheels_m)
        noise_m = complex(*self._rng.normal(0.0, self._std_m, 2))
        self.relation.take(
            self._place_m + noise_m,
            self._reckoned_m,
            self._std_m,
            self._path_m,
            axes=1.0 + 0j,
            yaw_sd_rad=0.02,
            has_yaw=self._has_yaw,
        )
        self.relation.keep()
        self.is_unexpected |= self.relation.is_unexpected
        self.is_impossible |= bool(self.relation.impossible_m)

    def roll(self, length_m: float, factor: complex, direction: complex = 1.0 + 0j) -> "Drive":
        """Roll a length in a direction; the device measures it times a factor."""
        for _ in range(round(length_m / STEP_M)):
            self.step(STEP_M * direction, STEP_M * direction * factor)
        return self

    def rest(self, ways_m: Iterable[complex]) -> "Drive":
        """Stand while the device measures these ways."""
        for way_m in ways_m:
            self.step(0j, way_m)
        return self


@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize("factor", [1.0, 0.8])
def test_slip_that_is_expected_and_noise_are_not_reported(factor: float, seed: int) -> None:
    drive = Drive(seed=seed).roll(8.0, factor)
    assert not drive.is_impossible
    assert not drive.is_unexpected
    assert abs(drive.relation.doubted_m) < 0.35


def test_a_scale_of_the_positions_is_reported_and_the_region_contains_both_places() -> None:
    """The one place is two standard deviations off the other; the 95 % region reaches 2.4."""
    drive = Drive().roll(2.0, 1.0).roll(3.0, 0.1)
    assert drive.is_unexpected
    assert not drive.is_impossible
    assert drive.relation.doubted_m == pytest.approx(-0.9 * 3.0, abs=0.3)
    assert math.sqrt(-2.0 * math.log(0.05)) > APART_SD


@pytest.mark.parametrize("factor", [-1.0, 3.0, 2.0j])
def test_positions_go_farther_than_the_wheels_roll(factor: complex) -> None:
    drive = Drive().roll(2.0, 1.0).roll(0.3, factor)
    assert drive.is_impossible


def test_a_conflict_ends_where_both_move_alike_in_its_direction_again() -> None:
    """A scale of one axis shows on that axis only."""
    drive = Drive().roll(2.0, 1.0).roll(2.0, 0.1)
    assert abs(drive.relation.doubted_m) > 1.0
    assert abs(drive.roll(3.0, 1.0, 1j).relation.doubted_m) > 1.0
    assert abs(drive.roll(2.0, 1.0, -1.0).relation.doubted_m) < 0.1


def test_a_slow_drift_at_standstill_is_doubted_in_full() -> None:
    drive = Drive().roll(2.0, 1.0).rest([0.01 + 0.005j] * 40)
    assert drive.is_impossible
    assert drive.relation.doubted_m == pytest.approx(0.4 + 0.2j, abs=0.1)


def test_each_change_of_a_doubt_is_known() -> None:
    drive = Drive(std_m=1e-6).roll(2.0, 1.0).rest([0.2])
    assert drive.relation.grown_m2 == pytest.approx(0.2**2, rel=0.01)
    assert drive.rest([0.03]).relation.grown_m2 == pytest.approx(0.03**2, rel=0.01)


def test_positions_with_a_yaw_are_believed_while_the_wheels_roll() -> None:
    drive = Drive(has_yaw=True).roll(2.0, 1.0).roll(3.0, 0.1)
    assert drive.relation.doubted_m == 0j


def test_a_rover_with_a_camera_that_is_carried_may_be_at_both_places() -> None:
    drive = Drive(has_yaw=True).roll(2.0, 1.0).rest([0.1j] * 5)
    assert drive.relation.doubted_m == pytest.approx(0.5j, abs=0.1)


def test_the_doubt_of_a_camera_ends_when_the_rover_has_driven_on() -> None:
    drive = Drive(has_yaw=True).roll(2.0, 1.0).rest([0.1j] * 5).roll(0.5, 0.5)
    assert abs(drive.relation.doubted_m) > 0.4
    assert drive.roll(1.5, 0.5).relation.doubted_m == 0j
    assert not drive.is_unexpected


def test_a_jump_does_not_erase_a_doubt() -> None:
    drive = Drive(std_m=1e-6).roll(2.0, 1.0).roll(3.0, 0.1)
    drive.rest([0.5j])
    drive.relation.jump(0.5j, 1.0 + 0j)
    drive.rest([0j])
    assert drive.relation.doubted_m == pytest.approx(-2.7, abs=0.1)


@pytest.mark.parametrize("std_m", [0.02, 0.5])
@pytest.mark.parametrize("seed", range(5))
def test_noise_leaves_doubts_of_its_size_only(std_m: float, seed: int) -> None:
    drive = Drive(seed=seed, std_m=std_m)
    doubts_m = [abs(drive.roll(STEP_M, 1.0).relation.doubted_m) for _ in range(200)]
    assert np.mean(doubts_m) < 1.5 * std_m
    assert max(doubts_m) < 5.0 * std_m
