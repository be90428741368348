"""What is assumed about the ground: what it makes of the estimate, and what contradicts it."""

import math

import numpy as np
import pytest
from pydantic import ValidationError

from controllers.control_loop import ControlLoop, StepOutput
from controllers.estimation.filter.pose_filter import PoseFilter
from controllers.estimation.filter.transition import Turn
from controllers.estimation.ground_settings import GroundSettings
from controllers.estimation.pose_estimate import YawSource
from controllers.estimation.settings import FilterSettings
from controllers.estimation.slip_prior import FIRM, UNKNOWN, SlipPrior
from controllers.estimation.wheels.odometry import BodyIncrement
from tests.controllers.simulated import LONG_WAY, ROLES, make_settings, omni_rover, run

LEARNED = GroundSettings(slip="learned", slip_mean=0.2, slip_sd=0.03, source="commissioning")
QUIET = FilterSettings(position_noise_m_sqrt_m=1e-4, unsure_position_noise_m_sqrt_m=1e-4)


def rolled(pose_filter: PoseFilter, length_m: float) -> PoseFilter:
    """Let the wheels roll straight ahead."""
    for _ in range(round(length_m / 0.01)):
        increment = BodyIncrement(x_m=0.01, y_m=0.0, turn_rad=0.0, duration_s=0.05)
        pose_filter.predict(increment, Turn(angle_rad=0.0, source=YawSource.GYRO))
    return pose_filter


def driven(ground: GroundSettings, slip: float | tuple[float, ...]) -> StepOutput:
    """Return the last cycle of ten seconds straight ahead, with a slip of all wheels or of each."""
    rover = omni_rover()
    rover.slip = np.array(slip)
    loop = ControlLoop(make_settings(mission=LONG_WAY, ground=ground), ROLES)
    return run(loop, rover, 10.0)[-1]


@pytest.mark.parametrize(("prior", "low", "high"), [(UNKNOWN, 0.29, 0.45), (FIRM, 0.009, 0.012)])
def test_the_position_is_as_uncertain_as_the_ground_is(prior: SlipPrior, low: float, high: float) -> None:
    xx, _, _, yy, _, _ = rolled(PoseFilter(QUIET, (), prior=prior), 3.0).covariance
    assert low < math.sqrt(xx) / 3.0 < high
    assert yy < xx


def test_another_assumption_also_acts_on_the_path_before() -> None:
    """And its slip is the same there: what measures it later corrects the position."""
    pose_filter = rolled(PoseFilter(QUIET, (), prior=FIRM), 3.0)
    before = pose_filter.covariance[0]
    pose_filter.assume(UNKNOWN, 3.0 + 0j)
    assert math.sqrt(pose_filter.covariance[0] - before) == pytest.approx(0.3 * 3.0)
    covariance, index = np.array(pose_filter.kalman.covariance), pose_filter.layout.assumed_slip
    assert covariance[index, index] == pytest.approx(1.0)
    assert covariance[0, index] == pytest.approx(0.3 * 3.0)
    assert np.linalg.eigvalsh(covariance).min() > -1e-9


def test_a_learned_slip_is_removed_from_the_travel_and_the_velocity() -> None:
    last = driven(LEARNED, 0.2)
    assert last.estimate.x_m == pytest.approx(0.8 * last.odometry.x_m, rel=0.01)
    assert last.estimate.velocity_x_m_s == pytest.approx(0.16, rel=0.05)
    assert not last.suspicion


def test_nothing_contradicts_equal_slip_of_all_wheels_on_a_straight_path() -> None:
    """Wheels and gyro agree; `check` states it."""
    assert driven(GroundSettings(slip="firm"), 0.3).suspicion == ""


def test_wheels_that_turn_the_rover_otherwise_than_the_gyro_are_not_on_firm_ground() -> None:
    last, believed = driven(GroundSettings(slip="firm"), (0.3, 0.0, 0.0)), GroundSettings(slip="firm")
    assert 'slip = "firm" does not hold here' in last.suspicion
    assert last.estimate.covariance[0] > 50.0 * driven(believed, 0.0).estimate.covariance[0]


@pytest.mark.parametrize(
    "wrong",
    [
        {"slip": "firm", "slip_sd": 0.1},
        {"slip": "unknown", "slip_mean": 0.1},
        {"slip": "learned", "slip_sd": 0.1},
        {"slip": "learned", "source": "runs"},
    ],
)
def test_numbers_that_do_not_belong_to_an_assumption_are_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(ValidationError, match="slip"):
        GroundSettings.model_validate(wrong)
