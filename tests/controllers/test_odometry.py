"""Wheel odometry: complete sets, rebasing, standstill, and dead reckoning against the geometry."""

import cmath
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from controllers.estimation.wheels.odometry import WheelOdometry
from controllers.motion.kinematics import make_kinematics
from controllers.motion.planar import wrap_angle
from controllers.motion.rover_geometry import OmniRoverSettings, SkidSteerRoverSettings
from drivers.samples import WheelSample
from tests.controllers.simulated import (
    OMNI,
    SECOND_NS,
    SKID,
    Geometry,
    SimulatedRover,
    omni_geometry,
    skid_geometry,
)

MS = 1_000_000
LIMIT_RAD_S = 12.0


def make(rover: OmniRoverSettings | SkidSteerRoverSettings = OMNI) -> WheelOdometry:
    return WheelOdometry(make_kinematics(rover), LIMIT_RAD_S)


def feed(odometry: WheelOdometry, t_ns: int, *positions: float) -> None:
    for wheel, position in enumerate(positions):
        assert odometry.feed(wheel, t_ns, position)


@pytest.mark.parametrize(("rover", "geometry"), [(OMNI, omni_geometry()), (SKID, skid_geometry())])
@settings(max_examples=30)
@given(set_points=st.lists(st.lists(st.floats(-8.0, 8.0), min_size=4, max_size=4), min_size=1, max_size=4))
def test_without_slip_the_wheels_tell_the_true_pose(
    rover: OmniRoverSettings | SkidSteerRoverSettings, geometry: Geometry, set_points: list[list[float]]
) -> None:
    simulated, odometry = SimulatedRover(geometry), make(rover)
    feed(odometry, simulated.t_ns, *simulated.position_rad)
    odometry.take()
    travelled_m = 0.0
    for set_point in set_points:
        simulated.set_point_rad_s = np.array(set_point[: len(geometry.drive)])
        for _ in range(25):
            simulated.advance(simulated.t_ns + 10 * MS)
            feed(odometry, simulated.t_ns, *simulated.position_rad)
            increment = odometry.take()
            assert increment is not None
            travelled_m += math.hypot(increment.x_m, increment.y_m)
    assert odometry.rebases == 0
    pose = odometry.pose
    # A wheel changing speed within the 10 ms is all that chord and arc differ by.
    assert abs(complex(pose.x_m, pose.y_m) - simulated.place) <= 1e-6 + 0.002 * travelled_m
    assert wrap_angle(pose.yaw_rad - simulated.yaw_rad) == pytest.approx(0.0, abs=1e-9)


def test_an_increment_waits_for_all_wheels() -> None:
    odometry = make(SKID)
    feed(odometry, 0, 0.0, 0.0, 0.0, 0.0)
    assert odometry.take() is None
    for wheel in range(3):
        odometry.feed(wheel, 10 * MS, 0.1)
        assert odometry.take() is None
    odometry.feed(3, 10 * MS, 0.1)
    increment = odometry.take()
    assert increment is not None
    assert (increment.x_m, increment.y_m, increment.turn_rad) == pytest.approx((0.01, 0.0, 0.0))
    assert increment.duration_s == 0.01
    assert odometry.take() is None


def test_wheels_that_report_at_different_times_do_not_look_like_a_turn() -> None:
    odometry = make(SKID)
    turns: list[float] = []
    for i in range(100):
        for wheel in range(4):
            t_ns = (i * 10 + wheel * 2) * MS
            odometry.feed(wheel, t_ns, 0.5 * 5.0 * (t_ns / SECOND_NS) ** 2)
            odometry.take()
        turns.append(odometry.pose.yaw_rad)
    assert odometry.t_ns == 990 * MS
    assert odometry.pose.x_m == pytest.approx(0.1 * 0.5 * 5.0 * 0.99**2, abs=2e-4)
    # Interpolating a parabola linearly over 10 ms is wrong by 6e-5 rad at most.
    assert max(map(abs, turns[2:])) < 0.1 * 6.3e-5 / 0.2


def test_interpolation_never_leaves_the_two_positions() -> None:
    odometry = make(SKID)
    feed(odometry, 0, 0.0, 0.0, 0.0, 0.0)
    odometry.take()
    # Wheel 0 is heard of twice in a burst, later than the others.
    for wheel in (1, 2, 3):
        odometry.feed(wheel, 10 * MS, 0.1)
    odometry.feed(0, 15 * MS, 0.1)
    odometry.feed(0, 15 * MS + 1, 0.2)
    increment = odometry.take()
    assert increment is not None
    assert increment.x_m == pytest.approx(0.01)
    assert increment.turn_rad == pytest.approx(0.0)


@pytest.mark.parametrize(
    ("wheel", "t_ns", "position"),
    [(0, 10, 1.0), (0, 9, 1.0), (3, 20, 1.0), (-1, 20, 1.0), (0, 20, math.nan), (0, 20, math.inf)],
    ids=["repeated", "out of order", "no such wheel", "negative wheel", "nan", "infinite"],
)
def test_unusable_positions_are_refused(wheel: int, t_ns: int, position: float) -> None:
    odometry = make()
    feed(odometry, 10, 0.0, 0.0, 0.0)
    assert odometry.take() is None
    assert not odometry.feed(wheel, t_ns, position)
    feed(odometry, 20, 0.0, 0.0, 0.0)
    increment = odometry.take()
    assert increment is not None
    assert increment.x_m == 0.0


def test_a_counter_reset_rebases_instead_of_moving() -> None:
    odometry = make()
    feed(odometry, 0, 100.0, 50.0, -100.0)
    odometry.take()
    feed(odometry, 10 * MS, 100.1, 0.0, -100.1)
    assert odometry.take() is None
    assert odometry.rebases == 1
    feed(odometry, 20 * MS, 100.2, 0.0, -100.2)
    assert odometry.take() is None
    feed(odometry, 30 * MS, 100.3, 0.0, -100.3)
    increment = odometry.take()
    assert increment is not None
    assert odometry.rebases == 1
    assert odometry.pose.x_m == pytest.approx(increment.x_m)
    assert increment.x_m == pytest.approx(-0.1 * 0.04 * 2.0 / math.sqrt(3.0))


def test_the_fastest_honest_increment_moves_and_the_next_one_does_not() -> None:
    for factor, rebases in ((0.999, 0), (1.001, 1)):
        odometry = make()
        feed(odometry, 0, 0.0, 0.0, 0.0)
        odometry.take()
        feed(odometry, 100 * MS, factor * 1.5 * LIMIT_RAD_S * 0.15, 0.0, 0.0)
        odometry.take()
        assert odometry.rebases == rebases


def test_a_broken_link_forgets_the_base() -> None:
    odometry = make()
    odometry.rebase()
    assert odometry.rebases == 0
    feed(odometry, 0, 1.0, 1.0, 1.0)
    odometry.take()
    odometry.rebase()
    odometry.rebase()
    assert odometry.rebases == 1
    feed(odometry, 10 * MS, 0.9, 0.9, 0.9)
    assert odometry.take() is None
    assert odometry.pose.yaw_rad == 0.0


def test_half_a_set_from_before_a_broken_link_is_forgotten() -> None:
    odometry = make()
    feed(odometry, 0, 1.0, 1.0, 1.0)
    odometry.take()
    odometry.feed(0, 5 * MS, 1.1)
    odometry.rebase()
    odometry.feed(1, 10 * MS, 0.0)
    odometry.feed(2, 10 * MS, 0.0)
    assert odometry.take() is None
    assert odometry.t_ns is None


def test_two_sets_in_one_burst_do_not_give_an_endless_velocity() -> None:
    odometry = make(SKID)
    for i in range(100):
        feed(odometry, i * 20 * MS, *([0.05 * i] * 4))
        odometry.take()
    feed(odometry, 99 * 20 * MS + 1, *([5.0] * 4))
    odometry.take()
    steady_m_s = 0.1 * 0.05 / 0.02
    assert odometry.velocity[0] == pytest.approx(steady_m_s * 1.4, rel=0.01)
    assert odometry.wheel_speed_rad_s[0] == pytest.approx(2.5 * 1.4, rel=0.01)


def test_velocity_settles_at_the_true_one() -> None:
    rover, odometry = SimulatedRover(omni_geometry()), make()
    rover.set_point_rad_s = rover.geometry.wheel_speeds(0.2 - 0.1j, 0.3)
    for sample in rover.advance(rover.t_ns + SECOND_NS):
        if isinstance(sample, WheelSample):
            odometry.feed(sample.wheel, sample.t_ns, sample.position_rad or 0.0)
            odometry.take()
    assert odometry.velocity == pytest.approx((0.2, -0.1, 0.3), abs=1e-4)
    assert odometry.wheel_speed_rad_s == pytest.approx(rover.speed_rad_s.tolist(), abs=1e-3)


def test_standstill_begins_after_the_wheels_rest_and_ends_with_the_first_motion() -> None:
    odometry = make()
    position = 0.0
    still_at_ms = []
    for i in range(120):
        position += 0.02 if 20 <= i < 40 else 0.0
        dither = 0.001 * (i % 2)
        feed(odometry, i * 10 * MS, position + dither, 0.0, 0.0)
        odometry.take()
        if odometry.is_still(i * 10 * MS, 0.1):
            still_at_ms.append(i * 10)
    assert still_at_ms == [*range(100, 200, 10), *range(490, 1200, 10)]


def test_silent_wheels_are_not_standing_still() -> None:
    odometry = make()
    for i in range(31):
        feed(odometry, i * 10 * MS, 0.0, 0.0, 0.0)
        odometry.take()
    assert odometry.is_still(300 * MS, 0.3)
    assert odometry.is_still(600 * MS, 0.3)
    assert not odometry.is_still(601 * MS, 0.3)


def test_a_quarter_circle_lands_where_it_should() -> None:
    odometry = make(SKID)
    steps = 200
    left, right = (0.5 * math.pi * (1.0 + side * 0.2) / 0.1 / steps for side in (-1.0, 1.0))
    for i in range(steps + 1):
        feed(odometry, i * 100 * MS, left * i, right * i, left * i, right * i)
        odometry.take()
    assert abs(complex(odometry.pose.x_m, odometry.pose.y_m) - (1.0 + 1.0j)) < 1e-4
    assert cmath.rect(1.0, odometry.pose.yaw_rad) == pytest.approx(1j)


def test_a_rover_just_switched_on_has_not_stood_still_yet() -> None:
    odometry = make()
    for i in range(40):
        feed(odometry, 10 * SECOND_NS + i * 10 * MS, 0.0, 0.0, 0.0)
        odometry.take()
        assert odometry.is_still(10 * SECOND_NS + i * 10 * MS, 0.3) == (i >= 30)


def test_positions_of_before_and_after_a_broken_link_are_not_interpolated() -> None:
    odometry = make(SKID)
    feed(odometry, 0, 3.0, 3.0, 3.0, 3.0)
    odometry.take()
    odometry.rebase()
    for wheel in (1, 2, 3):
        odometry.feed(wheel, 10 * MS, 0.0)
    odometry.feed(0, 15 * MS, 0.0)
    assert odometry.take() is None
    feed(odometry, 20 * MS, 0.0, 0.0, 0.0, 0.0)
    odometry.take()
    assert (odometry.pose.x_m, odometry.pose.yaw_rad) == (0.0, 0.0)


def test_after_a_broken_link_no_speed_of_before_is_told() -> None:
    odometry = make(SKID)
    for i in range(50):
        feed(odometry, i * 20 * MS, *([0.1 * i] * 4))
        odometry.take()
    assert odometry.velocity[0] == pytest.approx(0.5)
    odometry.rebase()
    assert odometry.velocity == (0.0, 0.0, 0.0)
    assert odometry.wheel_speed_rad_s == (0.0,) * 4
