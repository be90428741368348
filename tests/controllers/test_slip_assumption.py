"""What is assumed about the ground: what it makes of the estimate, and what contradicts it."""

import math

import numpy as np
import pytest
from pydantic import ValidationError

from controllers.control_loop import ControlLoop, StepOutput
from controllers.estimation.filter.pose_filter import PoseFilter
from controllers.estimation.filter.transition import Turn
from controllers.estimation.ground.travel import GroundPair
from controllers.estimation.ground_assumption.assumption import SlipAssumption
from controllers.estimation.ground_settings import GroundSettings
from controllers.estimation.pose_estimate import YawSource
from controllers.estimation.positions.relation import PositionRelation
from controllers.estimation.settings import FilterSettings
from controllers.estimation.slip_compensator import SlipEvidence
from controllers.estimation.slip_prior import FIRM, UNKNOWN, SlipPrior
from controllers.estimation.wheels.contradiction import ContradictionReport
from controllers.estimation.wheels.odometry import BodyIncrement
from controllers.ground_motion.motion import GroundMotion
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


def test_another_assumption_begins_the_slip_of_places_anew() -> None:
    """Its state counts in standard deviations: 2 of firm ground would be a slip of 0.6 on unknown ground."""
    pose_filter = rolled(PoseFilter(QUIET, (), prior=FIRM), 1.0)
    pose_filter.kalman.assign(pose_filter.layout.first_slip, 2.0)
    pose_filter.assume(UNKNOWN, 0j)
    before_m = pose_filter.pose.x_m
    assert rolled(pose_filter, 0.1).pose.x_m == pytest.approx(before_m + 0.1)


def evidence(slip: float) -> SlipEvidence:
    """Return what a slip estimator reads."""
    return SlipEvidence(slip=slip, slip_sd=0.06)


def firm_ground(**options: object) -> SlipAssumption:
    """Return the assumption of firm ground."""
    return SlipAssumption(FIRM, UNKNOWN, **options)  # type: ignore[arg-type]


def pair(slip: float, scale_sd: float = 0.01) -> GroundPair:
    """Return the motion of two frames, 2 cm by the wheels."""
    motion = GroundMotion(
        from_ns=0,
        to_ns=1,
        point_m=(0.0, 0.0),
        foot_m=(0.0, 0.0),
        forward_m=0.0,
        left_m=0.0,
        turn_rad=0.0,
        forward_sd_m=5e-4,
        left_sd_m=5e-4,
        turn_sd_rad=1e-3,
        scale_sd=scale_sd,
        direction_sd_rad=0.01,
    )
    return GroundPair(rolled_m=0.02 + 0j, ground_m=0.02 * (1.0 - slip) + 0j, turn_rad=0.0, motion=motion)


@pytest.mark.parametrize(
    ("slip", "scale_sd", "is_reported"), [(0.02, 0.01, False), (0.15, 0.01, True), (0.15, 0.1, False)]
)
def test_a_camera_contradicts_by_more_than_its_own_scale(
    slip: float, scale_sd: float, is_reported: bool
) -> None:
    assumption = firm_ground()
    assumption.compare_ground([pair(slip, scale_sd)] * 40)
    assert (assumption.fault is not None) is is_reported
    assert assumption.prior is (UNKNOWN if is_reported else FIRM)


@pytest.mark.parametrize(("slip", "is_reported"), [(0.05, False), (0.4, True)])
def test_readings_of_the_yaw_excitation_contradict(slip: float, is_reported: bool) -> None:
    assumption = firm_ground(share_sd=0.35)
    for number in range(10):
        assumption.compare_slip(evidence(slip + 1e-6 * number), 0.05)
    assert (assumption.fault is not None) is is_reported


def test_a_body_that_does_not_answer_and_an_unusual_force_contradict() -> None:
    reading = evidence(0.0)
    for symptom in (reading._replace(lost_response="no answer"), reading._replace(unusual_force="3 N")):
        assumption = firm_ground()
        assumption.compare_slip(symptom, 0.05)
        assert assumption.fault is not None


@pytest.mark.parametrize("compares_turns", [True, False])
def test_wheels_that_skid_in_rotations_do_not_contradict_by_each_other(compares_turns: bool) -> None:
    assumption = firm_ground(compares_turns=compares_turns)
    report = ContradictionReport(scaled=2.0, wheel=1, rolling_m=(0.0,) * 4, side_m=(0.0,) * 4)
    assumption.compare_wheels(report)
    assert (assumption.fault is not None) is compares_turns


@pytest.mark.parametrize("slip", [0.0, 0.3])
def test_positions_contradict_slip_that_is_not_assumed(slip: float) -> None:
    relation, rng, contradicted = PositionRelation(FilterSettings(), 3.9), np.random.default_rng(4), False
    assumption = firm_ground()
    for step in range(60):
        noise_m = complex(*rng.normal(0.0, 0.02, 2))
        place_m, path_m = 0.05 * step * (1.0 - slip), 0.05 * step
        relation.take(
            place_m + noise_m, path_m + 0j, 0.02, path_m, axes=1.0 + 0j, yaw_sd_rad=0.01, has_yaw=True
        )
        assumption.compare_positions("gnss", *relation.compare(assumption.prior))
        contradicted |= assumption.fault is not None
    assert contradicted is (slip > 0.0)


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
