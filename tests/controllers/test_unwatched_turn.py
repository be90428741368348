"""How wrong the yaw may be while nothing watches the gyro, against slip drawn here."""

import math

import numpy as np
import pytest

from controllers.estimation.gyro.unwatched_turn import UnwatchedTurn
from controllers.estimation.parameters import ESTIMATION
from controllers.estimation.wheels.turn_evidence import TurnEvidence, WheelTurn

SLIP_M = 0.5
STEP_M = 0.01
TRACK_M = 0.4
SLIP_SD = 0.3 / math.sqrt(3.0)


def evidence(gyro_rad: float, left_rad: float, right_rad: float) -> TurnEvidence:
    """Return a turn of a hundredth of a second."""
    return TurnEvidence(gyro_rad, WheelTurn(duration_s=0.01, left_rad=left_rad, right_rad=right_rad))


def ahead(unwatched: UnwatchedTurn, distance_m: float) -> bool:
    """Drive straight ahead with a gyro that measures nothing; return whether it has agreed."""
    part_rad = STEP_M / TRACK_M
    agreed = False
    for _ in range(round(distance_m / STEP_M)):
        unwatched.drive(STEP_M)
        agreed |= unwatched.add(evidence(0.0, part_rad, part_rad))
    return agreed


def test_the_error_is_as_large_as_slip_of_that_size_and_distance_makes_it() -> None:
    """The root of the mean square of 4,000 turns by slips of both sides that are drawn separately."""
    rng = np.random.default_rng(5)
    keep = math.exp(-STEP_M / SLIP_M)
    slips = rng.normal(0.0, SLIP_SD, (4000, 2))
    turns_rad = np.zeros(4000)
    unwatched = UnwatchedTurn(SLIP_M)
    for length_m in (0.2, 0.3, 0.5):
        for _ in range(round(length_m / STEP_M)):
            turns_rad += STEP_M / TRACK_M * (slips[:, 1] - slips[:, 0])
            slips = keep * slips + math.sqrt(1.0 - keep**2) * rng.normal(0.0, SLIP_SD, slips.shape)
        ahead(unwatched, length_m)
        assert unwatched.error_rad / math.sqrt(3.0) == pytest.approx(turns_rad.std(), rel=0.05)


@pytest.mark.parametrize(
    ("measured", "agrees"), [(1.0, True), (0.8, True), (0.0, False), (-1.0, False), (0.4, False)]
)
def test_the_gyro_agrees_with_a_turn_that_no_slip_explains(measured: float, agrees: bool) -> None:
    unwatched = UnwatchedTurn(SLIP_M)
    assert not ahead(unwatched, 1.0)
    before_rad = unwatched.error_rad
    assert before_rad > 0.1
    seen = False
    for _ in range(50):
        unwatched.drive(0.0)
        seen |= unwatched.add(evidence(0.01 * measured, 0.01, 0.0))
    assert seen is agrees
    assert (unwatched.error_rad < 0.2 * before_rad) is agrees


def test_a_turn_of_a_gyro_that_the_wheels_did_not_make_may_be_wrong() -> None:
    unwatched = UnwatchedTurn(SLIP_M)
    ahead(unwatched, 0.1)
    before_rad = unwatched.error_rad
    for _ in range(50):
        unwatched.add(evidence(0.01, 0.0, 0.0))
    assert unwatched.error_rad == pytest.approx(math.hypot(before_rad, 0.5))


def test_the_yaw_is_any_at_most() -> None:
    unwatched = UnwatchedTurn(SLIP_M)
    ahead(unwatched, 400.0)
    assert unwatched.error_rad == math.pi


def test_at_rest_nothing_is_added() -> None:
    unwatched = UnwatchedTurn(SLIP_M)
    assert not unwatched.add(evidence(0.0, 0.0, 0.0))
    assert unwatched.error_rad == 0.0


@pytest.mark.parametrize("measured", [-1.0, 0.0, 0.5])
def test_until_a_watched_gyro_has_agreed_the_wheels_may_be_right(measured: float) -> None:
    unwatched = UnwatchedTurn(SLIP_M, is_watched=True)
    for _ in range(50):
        assert not unwatched.add(evidence(0.01 * measured, 0.01, 0.0))
    by_slip_rad = ESTIMATION.pose.gap_turn_error / math.sqrt(3.0) * 0.5
    assert unwatched.error_rad == pytest.approx(math.sqrt((0.5 * (1.0 - measured)) ** 2 - by_slip_rad**2))


def test_uneven_slip_on_a_straight_drive_does_not_doubt_a_watched_gyro() -> None:
    unwatched = UnwatchedTurn(SLIP_M, is_watched=True)
    part_rad = STEP_M / TRACK_M
    for _ in range(round(2.0 / STEP_M)):
        unwatched.drive(STEP_M)
        assert not unwatched.add(evidence(0.0, part_rad, 0.9 * part_rad))
        assert unwatched.error_rad == 0.0


def test_a_watched_gyro_shows_once_that_it_measures_turns() -> None:
    unwatched = UnwatchedTurn(SLIP_M, is_watched=True)
    assert any(unwatched.add(evidence(0.01, 0.01, 0.0)) for _ in range(50))
    for _ in range(50):
        unwatched.add(evidence(-0.01, 0.01, 0.0))
    assert unwatched.error_rad == 0.0


@pytest.mark.parametrize("is_rotation", [False, True])
def test_another_sensor_that_sees_the_rotation_shows_the_same(is_rotation: bool) -> None:
    """The wheels skid, and show twice the rotation; noise of two sensors that stand shows nothing."""
    unwatched = UnwatchedTurn(SLIP_M, is_watched=True)
    unwatched.add(evidence(0.1, 0.2, 0.0))
    unwatched.agree(is_rotation=is_rotation)
    unwatched.add(evidence(0.1, 0.2, 0.0))
    assert (unwatched.error_rad == 0.0) is is_rotation


def test_an_agreement_with_another_sensor_begins_anew() -> None:
    unwatched, other = UnwatchedTurn(SLIP_M), UnwatchedTurn(SLIP_M)
    ahead(unwatched, 1.0)
    unwatched.agree(is_rotation=False)
    assert unwatched.error_rad == 0.0
    ahead(unwatched, 0.3)
    ahead(other, 0.3)
    assert unwatched.error_rad == pytest.approx(other.error_rad)
