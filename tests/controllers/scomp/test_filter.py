import math

import numpy as np
import pytest

from controllers.estimation.guarded_filter import Innovation
from controllers.slip.scomp.filter import ScompFilter, StartHeading
from controllers.slip.scomp.motion_model import BIAS, GAIN, OFFSET, RESIDUAL, YAW, Motion, X, Y
from controllers.slip.scomp.parameters import (
    CompassModel,
    DriftFromRoll,
    GyroModel,
    RoverGeometry,
    ScompParameters,
    SlipFromPitch,
    TraceModel,
)
from controllers.slip.scomp.slip_laws import PitchLaw, TwoSegmentLaw, slopes

STEP_S = 0.1
RIM_M_S = 0.1
ALONG_X = StartHeading(heading_rad=0.0, standard_deviation_rad=1e-3)
PITCH_RAD = math.radians(8.0)


def estimator(parameters: ScompParameters, start: StartHeading = ALONG_X) -> ScompFilter:
    return ScompFilter(parameters, PitchLaw(parameters), start, follows_roll=True)


def motion(rate_rad_s: float = 0.0, *, drives: bool = True, expected_drift_rad: float = 0.0) -> Motion:
    wheel_rad = RIM_M_S / 0.092 * STEP_S if drives else 0.0
    return Motion(
        duration_s=STEP_S,
        wheel_rad=wheel_rad,
        rate_rad_s=rate_rad_s,
        is_gyro=True,
        pitch_rad=PITCH_RAD,
        expected_drift_rad=expected_drift_rad,
    )


def state_of(pose: ScompFilter) -> np.ndarray:
    return pose.step.estimate[0]


def sigma_of(pose: ScompFilter, index: int) -> float:
    return float(pose.step.estimate[1][index, index] ** 0.5)


def test_moves_by_the_slip_that_the_pitch_asks_for() -> None:
    parameters = ScompParameters()
    pose = estimator(parameters)
    for _ in range(100):
        pose.move(motion())
    slip = parameters.pitch.model.slip_at(math.sin(PITCH_RAD) + parameters.pitch.rolling_resistance, 0.0)
    assert state_of(pose)[X] == pytest.approx(RIM_M_S * 10.0 * (1.0 - slip), rel=1e-6)
    assert state_of(pose)[Y] == 0.0
    assert 0.0 < sigma_of(pose, X) < 0.5


def test_compass_is_read_with_its_lag() -> None:
    parameters = ScompParameters(compass=CompassModel(deviation_rad=1e-6, noise_rad=1e-3))
    pose = estimator(parameters)
    heading = lagged = 0.0
    rate = 0.05
    for _ in range(400):
        heading, lagged = (
            heading + rate * STEP_S,
            lagged + (heading + rate * STEP_S / 2 - lagged) * (1.0 - math.exp(-STEP_S / 0.45)),
        )
        pose.move(motion(rate + 0.01))
        pose.correct_compass(0.3 + lagged)
    # The lag is 0.45 s x 0.05 rad/s = 1.3 deg; taken for a heading error it would stay in the estimate.
    assert heading - lagged > math.radians(1.2)
    assert math.remainder(state_of(pose)[YAW] - heading, math.tau) == pytest.approx(
        0.0, abs=math.radians(0.2)
    )
    assert state_of(pose)[BIAS] == pytest.approx(0.01, abs=5e-4)
    assert state_of(pose)[OFFSET] == pytest.approx(0.3, abs=math.radians(0.3))


def test_a_deviating_compass_does_not_bend_the_heading() -> None:
    pose = estimator(ScompParameters(compass=CompassModel(noise_rad=math.radians(0.3), lag_s=0.0)))
    rng = np.random.default_rng(4)
    heading, errors = 0.0, []
    for index in range(1500):
        rate = 0.03 * math.sin(index / 100.0)
        heading += rate * STEP_S
        pose.move(motion(rate))
        deviation = math.radians(1.5) * math.sin(2.0 * heading + 1.0)
        pose.correct_compass(heading + deviation + math.radians(0.3) * float(rng.standard_normal()))
        errors.append(state_of(pose)[YAW] - heading)
    assert math.degrees(float(np.sqrt(np.mean(np.square(errors[300:]))))) < 0.4


def test_heading_by_the_compass_alone() -> None:
    compass = CompassModel(sign=-1, offset_rad=0.5, noise_rad=1e-3, deviation_rad=1e-3, reference_rad=1.0)
    pose = estimator(
        ScompParameters(compass=compass), StartHeading(heading_rad=0.0, standard_deviation_rad=None)
    )
    pose.correct_compass(-1.5)
    assert state_of(pose)[YAW] == pytest.approx(1.0, abs=1e-6)
    assert sigma_of(pose, YAW) == pytest.approx(compass.offset_sd_rad, rel=0.05)


def drive_with_trace(pose: ScompFilter, angle_rad: float, steps: int) -> list[Innovation | None]:
    found: list[Innovation | None] = []
    for index in range(steps):
        pose.move(motion())
        if index % 2 == 0:
            found.append(pose.correct_trace(angle_rad))
    return found


def test_trace_turns_into_slip_angle_by_the_rear_term() -> None:
    parameters = ScompParameters(rover=RoverGeometry(rear_axle_m=0.3), gyro=GyroModel(bias_rad_s=1e-5))
    pose = estimator(parameters)
    rate, beta = 0.02, 0.1
    for _ in range(200):
        pose.move(motion(rate))
        pose.correct_standstill()
        slip = pose.model.slip(state_of(pose), pose.motion)
        velocity = RIM_M_S * (1.0 - slip)
        pose.correct_trace(math.atan(math.tan(beta) - 0.3 * rate / velocity))
        pose.correct_compass(float(state_of(pose)[YAW]))
    assert pose.model.drift(state_of(pose), pose.motion) == pytest.approx(beta, abs=math.radians(1.0))
    assert 0.3 * rate / velocity > math.radians(3.0)


def test_one_wrong_trace_is_refused_and_a_new_direction_is_not() -> None:
    parameters = ScompParameters(
        roll=DriftFromRoll(rest=math.radians(2.0), rest_time_s=4.0), gyro=GyroModel(bias_rad_s=1e-5)
    )
    pose = estimator(parameters)
    drive_with_trace(pose, 0.05, 100)
    before = pose.model.drift(state_of(pose), pose.motion)
    wrong = pose.correct_trace(math.radians(35.0))
    assert wrong is not None
    assert not wrong.accepted
    assert pose.model.drift(state_of(pose), pose.motion) == before
    found = drive_with_trace(pose, math.radians(25.0), 100)
    assert [item.accepted for item in found if item is not None][-5:] == [True] * 5
    # Twelve standard deviations: the rest is put down to the trace's own errors.
    assert pose.model.drift(state_of(pose), pose.motion) > math.radians(17.0)


def test_no_trace_is_read_at_a_standstill() -> None:
    pose = estimator(ScompParameters())
    pose.move(motion(drives=False))
    assert pose.correct_trace(0.2) is None


def test_the_gyros_bias_is_learnt_at_a_standstill_only() -> None:
    pose = estimator(ScompParameters())
    for _ in range(50):
        pose.move(motion(0.02, drives=False))
        pose.correct_standstill()
    assert state_of(pose)[BIAS] == pytest.approx(0.02, abs=1e-3)
    assert state_of(pose)[YAW] == pytest.approx(0.0, abs=2e-3)
    pose.move(motion(0.02))
    assert pose.correct_standstill() is None


def test_the_share_of_the_roll_is_learnt_from_the_trace() -> None:
    rng = np.random.default_rng(5)
    pose = estimator(ScompParameters(roll=DriftFromRoll(gain=1.0, gain_sd=0.7, rest=math.radians(1.0))))
    for index in range(600):
        expected = 0.1 * math.sin(index / 30.0)
        pose.move(motion(expected_drift_rad=expected))
        if index % 2 == 0:
            pose.correct_trace(2.0 * expected + math.radians(0.5) * float(rng.standard_normal()))
    assert state_of(pose)[GAIN] == pytest.approx(2.0, abs=0.25)
    assert sigma_of(pose, GAIN) < 0.3
    assert abs(state_of(pose)[RESIDUAL]) < math.radians(2.0)


def test_fixes_teach_the_slip() -> None:
    true = ScompParameters(pitch=SlipFromPitch(rolling_resistance=0.12))
    truth = estimator(true)
    pose = estimator(ScompParameters())
    blind = estimator(ScompParameters())
    for index in range(600):
        for item in (truth, pose, blind):
            item.move(motion())
        if index % 100 == 99 and index < 400:
            pose.correct_position(float(state_of(truth)[X]), float(state_of(truth)[Y]), 0.02)
    slips = [item.model.slip(state_of(item), item.motion) for item in (truth, pose, blind)]
    assert abs(slips[0] - slips[2]) > 0.05
    assert slips[1] == pytest.approx(slips[0], abs=0.01)
    # Two hundred steps after the last fix.
    assert abs(state_of(pose)[X] - state_of(truth)[X]) < 0.2 * abs(state_of(blind)[X] - state_of(truth)[X])


def test_nonsense_is_refused() -> None:
    pose = estimator(ScompParameters(trace=TraceModel()))
    drive_with_trace(pose, 0.05, 20)
    before = state_of(pose)
    for innovation in (
        pose.correct_compass(math.nan),
        pose.correct_trace(math.inf),
        *pose.correct_position(math.nan, 0.0, 0.1),
    ):
        assert innovation is not None
        assert not innovation.accepted
    assert state_of(pose) == pytest.approx(before)


@pytest.mark.parametrize("law_of", [PitchLaw, TwoSegmentLaw])
def test_jacobian_of_the_motion(law_of: type[PitchLaw] | type[TwoSegmentLaw]) -> None:
    parameters = ScompParameters()
    law = law_of(parameters)
    pose = ScompFilter(parameters, law, ALONG_X, follows_roll=True)
    state = state_of(pose)
    state[[YAW, BIAS, RESIDUAL, GAIN]] = 0.4, 0.01, 0.2, 1.3
    step = motion(0.3, expected_drift_rad=0.1)
    transition = pose.model.predict(state.tolist(), step).transition
    for index in range(len(state)):
        ends = []
        for change in (-1e-4, 1e-4):
            shifted = state.copy()
            shifted[index] += change
            ends.append(np.array(pose.model.predict(shifted.tolist(), step).state))
        slope = (ends[1] - ends[0]) / 2e-4
        assert transition[:, index] == pytest.approx(slope, abs=1e-6), index


def test_slopes_of_the_law() -> None:
    law = PitchLaw(ScompParameters())
    slip, over_angle, over_first, over_second = slopes(law, 0.2, PITCH_RAD, law.first, law.second)
    assert slip == law.slip_at(0.2, PITCH_RAD, law.first, law.second)
    assert over_angle > 0.0
    assert over_first > 1.0
    assert over_second < 0.0


def test_the_fit_is_kept_along_the_direction_it_does_not_determine() -> None:
    pitch = SlipFromPitch(stiffness_follows=8.0)
    law = PitchLaw(ScompParameters(pitch=pitch))
    free = PitchLaw(ScompParameters(pitch=replace_follows(pitch)))
    steps = [item.slip_at(0.0, PITCH_RAD, item.first + 0.02, item.second) for item in (law, free)]
    level = law.slip_at(0.0, PITCH_RAD, law.first, law.second)
    assert abs(steps[0] - level) < 0.5 * abs(steps[1] - level)


def replace_follows(pitch: SlipFromPitch) -> SlipFromPitch:
    return pitch.model_copy(update={"stiffness_follows": 0.0})
