"""The torque correction against the matrices as they are written down, not as they are computed."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from controllers.slip.effort.settings import TorqueCorrectionSettings
from controllers.slip.effort.torque_correction import TorqueCorrection
from tests.controllers.simulated import OMNI

RADIUS_M, BASE_M = 0.04, 0.125
ANGLES_RAD = np.radians([60.0, 180.0, 300.0])
FORWARD = np.column_stack((-np.sin(ANGLES_RAD), np.cos(ANGLES_RAD), np.full(3, BASE_M)))
DUAL = RADIUS_M * np.column_stack(
    (-2.0 / 3.0 * np.sin(ANGLES_RAD), 2.0 / 3.0 * np.cos(ANGLES_RAD), np.full(3, 1.0 / (3.0 * BASE_M)))
)

AHEAD, ASIDE, TURN = (0.1, 0.0, 0.0), (0.0, 0.1, 0.0), (0.0, 0.0, 0.5)
torques = st.tuples(*[st.floats(-3.0, 3.0)] * 3)
twists = st.tuples(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5), st.floats(-2.0, 2.0))


def correction(gain: float = 2.0, bound: float = 5.0) -> TorqueCorrection:
    return TorqueCorrection(OMNI, TorqueCorrectionSettings(gain_rad_s_nm=gain, bound_rad_s=bound))


@pytest.mark.parametrize(
    ("twist", "across"),
    [(AHEAD, (0.0, 4.0, 0.3)), (ASIDE, (4.0, 0.0, -0.3)), (TURN, (3.0, -2.0, 0.0))],
)
def test_a_force_across_the_motion_is_turned_into_set_points(
    twist: tuple[float, ...], across: tuple[float, ...]
) -> None:
    wheel_torques = DUAL @ np.array(across)
    changes = correction().set_point_changes(wheel_torques.tolist(), twist)
    assert changes == pytest.approx(2.0 * DUAL @ np.array(across), abs=1e-9)


@pytest.mark.parametrize(
    ("twist", "along"), [(AHEAD, (9.0, 0.0, 0.0)), (ASIDE, (0.0, -9.0, 0.0)), (TURN, (0.0, 0.0, 1.0))]
)
def test_a_force_along_the_motion_changes_nothing(twist: tuple[float, ...], along: tuple[float, ...]) -> None:
    wheel_torques = DUAL @ np.array(along)
    assert FORWARD.T @ wheel_torques / RADIUS_M == pytest.approx(along)  # the dual undoes the statics
    changes = correction().set_point_changes(wheel_torques.tolist(), twist)
    assert changes == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)


@given(torques, twists)
def test_with_the_dual_matrix_the_changes_do_no_work_along_the_motion(
    wheel_torques: tuple[float, ...], twist: tuple[float, float, float]
) -> None:
    changes = correction(gain=0.5).set_point_changes(wheel_torques, twist)
    force = FORWARD.T @ np.array(changes) / RADIUS_M
    assert abs(float(force @ np.array(twist))) < 1e-9


@given(torques, twists, st.floats(0.0, 5.0))
def test_changes_are_bounded(
    wheel_torques: tuple[float, ...], twist: tuple[float, ...], bound: float
) -> None:
    changes = correction(gain=50.0, bound=bound).set_point_changes(wheel_torques, twist)
    assert all(abs(change) <= bound for change in changes)
    if not any(twist):
        assert changes == (0.0, 0.0, 0.0)


@given(torques)
def test_at_rest_nothing_is_changed(wheel_torques: tuple[float, ...]) -> None:
    assert correction(gain=50.0).set_point_changes(wheel_torques, (0.0, 0.0, 0.0)) == (0.0, 0.0, 0.0)


def test_the_more_loaded_wheel_is_raised() -> None:
    # Ahead, wheels 0 and 2 share the work; wheel 0 has the harder ground.
    speeds = FORWARD @ np.array(AHEAD) / RADIUS_M
    even = DUAL @ np.array((9.0, 0.0, 0.0))
    uneven = even * np.array((1.5, 1.0, 0.5))
    changes = correction().set_point_changes(uneven.tolist(), AHEAD)
    assert math.copysign(1.0, speeds[0]) * changes[0] > 0.05
    assert math.copysign(1.0, speeds[2]) * changes[2] < -0.05


@pytest.mark.parametrize(
    ("key", "value"), [("matrix", "inverse"), ("gain_rad_s_nm", -1.0), ("bound_rad_s", 9.0)]
)
def test_settings_out_of_range_are_refused(key: str, value: object) -> None:
    with pytest.raises(ValidationError, match=key):
        TorqueCorrectionSettings.model_validate({key: value})
