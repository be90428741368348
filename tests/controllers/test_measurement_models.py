"""Every measurement model: its derivatives, and its update compared with filterpy's."""

import math

import numpy as np
import pytest
from filterpy.kalman import ExtendedKalmanFilter
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from controllers.estimation.filter.guarded_filter import GuardedFilter
from controllers.estimation.filter.measurement_model import Measured, MeasurementModel
from controllers.estimation.filter.motion_history import WayBack
from controllers.estimation.ground.model import GroundTravel
from controllers.estimation.gyro.standstill_reading import GyroAtStandstill
from controllers.estimation.headings.heading import HeadingModel
from controllers.estimation.positions.pose_fix import PoseFix
from controllers.ground_motion.motion import GroundMotion
from controllers.motion.planar import wrap_angle
from controllers.slip.scomp.motion_model import MotionModel, Tilt
from controllers.slip.scomp.parameters import ScompParameters
from controllers.slip.scomp.slip_laws import PitchLaw
from controllers.slip.scomp.trace_model import TraceAngle
from drivers.samples import UNKNOWN_YAW_STD_RAD, PoseFixSample

Array = NDArray[np.float64]

SIZE = 16
WAY_BACK = WayBack(
    x_m=-0.02,
    y_m=0.01,
    turned_rad=0.1,
    position_m2=1e-5,
    yaw_rad2=1e-6,
    covered_s=0.3,
    place_s_m=0.02 - 0.01j,
)
MOTION = GroundMotion(
    from_ns=1,
    to_ns=2,
    forward_m=0.05,
    left_m=0.01,
    turn_rad=0.02,
    forward_sd_m=1e-3,
    left_sd_m=2e-3,
    turn_sd_rad=1e-2,
    scale_sd=0.01,
    direction_sd_rad=0.0,
    point_m=(-0.3, 0.1),
    foot_m=(-0.1, 0.05),
)


def fix(yaw_sd_rad: float) -> PoseFixSample:
    return PoseFixSample(
        device="floor",
        t_ns=2,
        t_capture_ns=1,
        x_m=1.0,
        y_m=2.0,
        yaw_rad=0.3,
        position_std_m=0.01,
        yaw_std_rad=yaw_sd_rad,
        arm_x_m=0.2,
        arm_y_m=-0.1,
    )


def trace() -> TraceAngle:
    parameters = ScompParameters()
    return TraceAngle(
        model=MotionModel(parameters, PitchLaw(parameters), follows_roll=True),
        tilt=Tilt(pitch_rad=0.1, expected_drift_rad=0.05),
        block=slice(9, SIZE),
        steering_rad=0.0,
        arm_s=0.0,
        yaw_rate_rad_s=0.0,
        bias_slope_s=0.0,
        variance_rad2=1e-4,
    )


MODELS: dict[str, MeasurementModel] = {
    "heading": HeadingModel(
        source=Measured("compass"), offset_index=4, deviation_index=None, turned_since_rad=0.1, sd_rad=0.05
    ),
    "heading with deviation": HeadingModel(
        source=Measured("compass"), offset_index=4, deviation_index=5, turned_since_rad=0.1, sd_rad=0.05
    ),
    "gyro at rest": GyroAtStandstill(device="imu", sd_rad_s=0.01),
    "fix": PoseFix(fix=fix(0.02), way_back=WAY_BACK, origin_index=5),
    "fix without yaw": PoseFix(fix=fix(UNKNOWN_YAW_STD_RAD), way_back=WAY_BACK, origin_index=5),
    "ground": GroundTravel(device="camera", motion=MOTION, way_back=WAY_BACK, frame_index=5, has_turn=True),
    "ground without turn": GroundTravel(
        device="camera", motion=MOTION, way_back=WAY_BACK, frame_index=5, has_turn=False
    ),
    "trace": trace(),
}

states = st.lists(st.floats(-0.8, 0.8), min_size=SIZE, max_size=SIZE).map(np.array)


@pytest.mark.parametrize("name", MODELS)
@settings(max_examples=25, deadline=None)
@given(state=states)
def test_the_row_is_the_derivative_of_the_value(name: str, state: Array) -> None:
    model = MODELS[name]
    expected = model.predict(state)
    assert expected.row.shape == (len(model.names), SIZE)
    for index in range(SIZE):
        ends = []
        for change in (-1e-6, 1e-6):
            moved = state.copy()
            moved[index] += change
            ends.append(model.predict(moved).value)
        assert expected.row[:, index] == pytest.approx((ends[1] - ends[0]) / 2e-6, abs=1e-6), index


@pytest.mark.parametrize("name", MODELS)
@settings(max_examples=25, deadline=None)
@given(state=states, errors=st.lists(st.floats(-1.0, 1.0), min_size=3, max_size=3), seed=st.integers(0, 99))
def test_the_update_is_filterpys(name: str, state: Array, errors: list[float], seed: int) -> None:
    model = MODELS[name]
    root = np.random.default_rng(seed).normal(size=(SIZE, SIZE))
    covariance = 0.01 * (root @ root.T) + 0.001 * np.eye(SIZE)
    ours = GuardedFilter(state.tolist(), [1.0] * SIZE, (), 1.0 - 1e-12)
    ours.add_covariance(covariance - np.eye(SIZE))
    expected = model.predict(state)
    measured = expected.value + 0.1 * np.array(errors[: len(expected.value)])
    theirs = ExtendedKalmanFilter(SIZE, len(measured))
    theirs.x, theirs.P = state.copy(), covariance.copy()

    def difference(reading: Array, value: Array) -> Array:
        turns = [wrap_angle(float(each)) for each in reading - value]
        return np.where([i in model.angles for i in range(len(reading))], turns, reading - value)

    theirs.update(
        measured,
        HJacobian=lambda at: model.predict(at).row,
        Hx=lambda at: model.predict(at).value,
        R=np.diag(expected.variance),
        residual=difference,
    )
    innovations = ours.correct(model, measured.tolist())
    assert all(innovation.accepted for innovation in innovations)
    assert np.array(ours.state) == pytest.approx(theirs.x, abs=1e-9)
    assert np.array(ours.covariance) == pytest.approx(theirs.P, abs=1e-9)
    total = expected.row @ covariance @ expected.row.T + np.diag(expected.variance)
    for innovation, variance in zip(innovations, np.diag(total), strict=True):
        assert innovation.variance is not None
        assert math.isclose(innovation.variance, float(variance), rel_tol=1e-9)
