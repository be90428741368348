"""The derivative of a late fix by the present state, against the transition since its exposure."""

import cmath
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from controllers.estimation.filter.state_layout import BIAS, YAW, StateLayout, X, Y, lay_out
from controllers.estimation.filter.transition import MotionTransition, Turn
from controllers.estimation.pose_estimate import YawSource
from controllers.estimation.positions.pose_fix import PoseFix
from controllers.estimation.settings import FilterSettings
from controllers.estimation.wheels.odometry import BodyIncrement
from controllers.motion.planar import wrap_angle
from drivers.clock import nanoseconds
from drivers.samples import PoseFixSample
from tests.controllers.floor_fixes import FIX, NO_SLIP, PositionFilter, PositionQueue

Array = NDArray[np.float64]

PERIOD_S, STEPS, LATE = 0.05, 30, 20
SETTINGS = FilterSettings(slip_sd=0.0)
ARM = PoseFixSample(
    device="overhead",
    t_ns=nanoseconds(STEPS * PERIOD_S),
    t_capture_ns=nanoseconds((STEPS - LATE) * PERIOD_S),
    x_m=0.0,
    y_m=0.0,
    yaw_rad=0.0,
    position_std_m=0.003,
    yaw_std_rad=0.005,
    arm_x_m=0.2,
    arm_y_m=-0.1,
)


def layout() -> StateLayout:
    return lay_out(SETTINGS, (), ("overhead",), has_ground=False, block_variances=())


def moves(seed: int) -> list[tuple[BodyIncrement, Turn]]:
    """Return increments of wheels and turns by a gyro, some of them by the wheels."""
    rng = np.random.default_rng(seed)
    found = []
    for _ in range(STEPS):
        x_m, y_m, turn_rad = (rng.normal(size=3) * (0.03, 0.02, 0.2)).tolist()
        increment = BodyIncrement(x_m=x_m, y_m=y_m, turn_rad=turn_rad, duration_s=PERIOD_S)
        is_gyro = rng.random() < 0.8
        source = YawSource.GYRO if is_gyro else YawSource.WHEELS
        covered_s = PERIOD_S if is_gyro else 0.0
        found.append((increment, Turn(angle_rad=turn_rad, source=source, covered_s=covered_s)))
    return found


def after(state: Array, drive: list[tuple[BodyIncrement, Turn]], queue: PositionQueue | None = None) -> Array:
    """Return a state after a drive."""
    motion, now = MotionTransition(SETTINGS, layout(), None, NO_SLIP, is_compensated=False), state.tolist()
    for number, (increment, turn) in enumerate(drive, 1):
        moved = motion.predict(now, increment, turn)
        now = moved.state
        if queue is not None:
            queue.move(nanoseconds(number * PERIOD_S), moved.step)
    return np.array(now)


def seen(state: Array, origin: int) -> Array:
    """Return the fix of a rover in a state, as of that moment."""
    place = complex(state[X], state[Y]) + complex(ARM.arm_x_m, ARM.arm_y_m) * cmath.rect(1.0, state[YAW])
    floor = complex(state[origin], state[origin + 1]) + place * cmath.rect(1.0, state[origin + 2])
    return np.array([floor.real, floor.imag, state[YAW] + state[origin + 2]])


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 1000), bias_rad_s=st.floats(-0.3, 0.3))
def test_the_row_of_a_late_fix_is_its_derivative_through_the_motion_since(
    seed: int, bias_rad_s: float
) -> None:
    places, drive = layout(), moves(seed)
    origin = places.origins["overhead"]
    start = np.zeros(places.size)
    start[[BIAS, origin, origin + 1, origin + 2]] = bias_rad_s, 2.0, -1.0, 2.5
    queue = PositionQueue()
    now = after(start, drive, queue)
    queue.add(ARM, ARM.t_ns)
    ((fix, way_back),) = queue.take()
    assert way_back is not None
    model = PoseFix(fix=fix, way_back=way_back, origin_index=origin)
    expected = model.predict(now)
    then = after(start, drive[:-LATE])
    since = drive[-LATE:]
    np.testing.assert_allclose(expected.value[:2], seen(then, origin)[:2], atol=1e-9)
    assert wrap_angle(float(expected.value[2] - seen(then, origin)[2])) == pytest.approx(0.0, abs=1e-9)
    for index in (X, Y, YAW, BIAS, origin, origin + 1, origin + 2):
        change = np.zeros(places.size)
        change[index] = 1e-6
        later = after(then + change, since) - after(then - change, since)
        later[YAW] = wrap_angle(later.item(YAW))
        change_seen = seen(then + change, origin) - seen(then - change, origin)
        np.testing.assert_allclose(expected.row @ later / 2e-6, change_seen / 2e-6, atol=1e-5)


def test_a_late_fix_of_the_yaw_teaches_the_bias_as_much_as_the_gyro_has_moved_since() -> None:
    pose_filter, queue = PositionFilter(FilterSettings(), (), ("overhead",)), PositionQueue()
    bias_rad_s, t_ns = 0.05, 0
    for number in range(200):
        t_ns = nanoseconds((number + 1) * PERIOD_S)
        increment = BodyIncrement(x_m=0.01, y_m=0.0, turn_rad=0.0, duration_s=PERIOD_S)
        turn = Turn(angle_rad=bias_rad_s * PERIOD_S, source=YawSource.GYRO, covered_s=PERIOD_S)
        queue.move(t_ns, pose_filter.predict(increment, turn))
        if number % 10 == 9:
            queue.add(late_by(t_ns, 1.5, 0.01 * (number + 1)), t_ns)
        for fix, way_back in queue.take():
            assert way_back is None or all(one.accepted for one in pose_filter.positions.take(fix, way_back))
    assert pose_filter.gyro_bias_rad_s == pytest.approx(bias_rad_s, abs=0.003)
    assert pose_filter.pose.yaw_rad == pytest.approx(0.0, abs=3.0 * math.sqrt(pose_filter.covariance[5]))


def late_by(t_ns: int, late_s: float, driven_m: float) -> PoseFixSample:
    """Return a fix of a rover that drives straight at 0.2 m/s, as it was before."""
    capture_ns = max(0, t_ns - nanoseconds(late_s))
    x_m = driven_m - 0.2 * (t_ns - capture_ns) * 1e-9
    return replace(FIX, t_ns=t_ns, t_capture_ns=capture_ns, x_m=x_m)
