"""The slip that remains, as a state of the pose filter that changes slowly."""

import math

import numpy as np
import pytest

from controllers.estimation.filter.motion_history import WayBack
from controllers.estimation.filter.transition import Turn
from controllers.estimation.pose_estimate import YawSource
from controllers.estimation.settings import FilterSettings
from controllers.estimation.slip_prior import SlipPrior
from controllers.estimation.wheels.odometry import BodyIncrement
from drivers.samples import PoseFixSample
from tests.controllers.floor_fixes import NO_SLIP, PositionFilter

STEP_M = 0.01
SETTINGS = FilterSettings(
    position_noise_m_sqrt_m=1e-4,
    unsure_position_noise_m_sqrt_m=1e-4,
    slip_sd=0.1,
    cross_slip_ratio=0.5,
    slip_distance_m=0.5,
)
UNSURE = SlipPrior("unknown", 0.0, 0.4, 0.2, 0.5, 0.0)


def driven(
    settings: FilterSettings,
    distance_m: float,
    *,
    is_compensated: bool,
    is_sure: bool = True,
    prior: SlipPrior = UNSURE,
) -> PositionFilter:
    """Return a filter that has rolled straight ahead."""
    pose_filter = PositionFilter(settings, (), ("camera",), is_compensated=is_compensated, prior=prior)
    roll(pose_filter, distance_m, is_sure=is_sure)
    return pose_filter


def roll(pose_filter: PositionFilter, distance_m: float, *, is_sure: bool = True) -> None:
    for _ in range(round(distance_m / STEP_M)):
        increment = BodyIncrement(x_m=STEP_M, y_m=0.0, turn_rad=0.0, duration_s=0.1, is_sure=is_sure)
        pose_filter.predict(increment, Turn(angle_rad=0.0, source=YawSource.GYRO))


def integrated_sd_m(slip_sd: float, distance_m: float, correlation_m: float) -> float:
    """Return the standard deviation of an integrated first-order Gauss-Markov process."""
    share = distance_m / correlation_m
    return slip_sd * correlation_m * math.sqrt(2.0 * (share - 1.0 + math.exp(-share)))


@pytest.mark.parametrize("distance_m", [0.1, 0.5, 3.0])
@pytest.mark.parametrize(("is_compensated", "is_sure", "slip_sd"), [(True, True, 0.1), (False, True, 0.4)])
def test_the_position_spreads_as_an_integrated_gauss_markov_process(
    distance_m: float, is_compensated: bool, is_sure: bool, slip_sd: float
) -> None:
    pose_filter = driven(SETTINGS, distance_m, is_compensated=is_compensated, is_sure=is_sure)
    xx, _, _, yy, _, _ = pose_filter.covariance
    expected_m = integrated_sd_m(slip_sd, distance_m, 0.5)
    assert math.sqrt(xx) == pytest.approx(expected_m, rel=0.03)
    assert math.sqrt(yy) == pytest.approx(0.5 * expected_m, rel=0.03)


def test_slip_that_becomes_unsure_spreads_as_that_of_wheels_without_compensation() -> None:
    """The parts before and after are independent."""
    pose_filter = driven(SETTINGS, 0.5, is_compensated=True)
    roll(pose_filter, 0.2, is_sure=False)
    expected_m2 = integrated_sd_m(0.1, 0.5, 0.5) ** 2 + integrated_sd_m(0.4, 0.2, 0.5) ** 2
    assert pose_filter.covariance[0] == pytest.approx(expected_m2, rel=0.05)


@pytest.mark.parametrize(("slip", "reported_sd"), [(0.0, 0.1), (0.5, 0.2), (0.9, 0.3)])
def test_the_reported_uncertainty_of_the_slip_acts_on_the_way_of_the_wheels(
    slip: float, reported_sd: float
) -> None:
    """And it changes with the place, not with the turning of the wheels."""
    settings = SETTINGS.model_copy(update={"slip_sd": 0.03, "slip_sd_share": 0.4})
    pose_filter = PositionFilter(settings, (), is_compensated=True)
    for _ in range(100):
        increment = BodyIncrement(
            x_m=(1.0 - slip) * STEP_M,
            y_m=0.0,
            turn_rad=0.0,
            duration_s=0.1,
            rolled_m=STEP_M + 0j,
            slip_sd=reported_sd,
        )
        pose_filter.predict(increment, Turn(angle_rad=0.0, source=YawSource.GYRO))
    sd = math.hypot(0.03, 0.4 * reported_sd)
    expected_m = integrated_sd_m(sd, 1.0 - slip, 0.5) / (1.0 - slip)
    assert math.sqrt(pose_filter.covariance[0]) == pytest.approx(expected_m, rel=0.03)


@pytest.mark.parametrize("is_compensated", [True, False])
def test_a_flag_that_flaps_does_not_make_a_lasting_slip_noise(is_compensated: bool) -> None:
    """Half of the way is unsure: half of the steady spread is left, or all of it without compensation."""
    pose_filter = driven(SETTINGS, STEP_M, is_compensated=is_compensated)
    for number in range(100):
        roll(pose_filter, STEP_M, is_sure=number % 2 == 0)
    expected_m = integrated_sd_m(0.4, 1.0, 0.5) * (0.5 if is_compensated else 1.0)
    assert math.sqrt(pose_filter.covariance[0]) == pytest.approx(expected_m, rel=0.06)


def test_a_drive_that_begins_unsure_spreads_so_from_the_start() -> None:
    pose_filter = driven(SETTINGS, 0.2, is_compensated=True, is_sure=False)
    assert math.sqrt(pose_filter.covariance[0]) == pytest.approx(integrated_sd_m(0.4, 0.2, 0.5), rel=0.05)


def test_fixes_of_a_rover_that_slips_correct_the_way_after_them() -> None:
    """Wheels roll 1 m for 0.8 m on the ground; after that fix the next 0.1 m are shortened, too."""
    pose_filter = PositionFilter(SETTINGS, (), ("camera",), is_compensated=False)
    here = WayBack(x_m=0.0, y_m=0.0, turned_rad=0.0, position_m2=0.0, yaw_rad2=0.0)

    def fix(x_m: float) -> None:
        sample = PoseFixSample(
            device="camera",
            t_ns=1,
            t_capture_ns=1,
            x_m=x_m,
            y_m=0.0,
            yaw_rad=0.0,
            position_std_m=0.002,
            yaw_std_rad=0.01,
        )
        assert all(innovation.accepted for innovation in pose_filter.positions.take(sample, here))

    fix(0.0)
    for number in range(1, 11):
        roll(pose_filter, 0.1)
        fix(0.08 * number)
    before_m = pose_filter.pose.x_m
    roll(pose_filter, 0.1)
    assert pose_filter.pose.x_m - before_m == pytest.approx(0.08, abs=0.01)


def test_without_slip_nothing_changes() -> None:
    pose_filter = driven(SETTINGS, 1.0, is_compensated=False, prior=NO_SLIP)
    assert np.sqrt(pose_filter.covariance[0]) < 1e-3
    assert pose_filter.pose.x_m == pytest.approx(1.0)
