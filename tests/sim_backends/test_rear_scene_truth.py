"""Truth of the rear scene, against geometry done a second time by other means."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from sim_backends.rear_scene.ground_map import Terrain
from tests.rear_scene.motion import RATE_HZ, Motion, drive
from tests.rear_scene.sets import make_sequence
from tests.rear_scene.truth import SensorErrors, centre_line, frame_truth, telemetry
from tests.sim_backends.rear_drives import B_M, HALF_TRACK_M, SPEED_M_S, plan, rig

LEVEL = Terrain()
NO_ERRORS = SensorErrors(
    gyro_noise_dps=0.0, compass_noise_deg=0.0, wheel_speed_noise_mps=0.0, compass_lag_s=0.0
)


def contact_in_world(motion: Motion, step: int) -> tuple[np.ndarray, Rotation]:
    """Return the contact and the vehicle's attitude, from position and angles alone."""
    angles = [motion.yaw_rad[step], motion.pitch_rad[step], motion.roll_rad[step]]
    attitude = Rotation.from_euler("ZYX", angles)
    return motion.position_m[step] + attitude.apply([-B_M, HALF_TRACK_M, 0.0]), attitude


@pytest.mark.parametrize("name", ["easy", "curved", "field_test_2"])
def test_the_angle_is_the_direction_in_which_the_contact_moves_over_the_world(name: str) -> None:
    sequence = make_sequence(name, 3, duration_s=30)  # type: ignore[arg-type]
    motion, wheel = sequence.motion, sequence.rig.wheel
    assert (wheel.x_m, wheel.y_m) == (-B_M, HALF_TRACK_M)
    for frame in range(5, len(sequence) - 1, 7):
        step = 20 * frame
        before, _ = contact_in_world(motion, step - 1)
        after, _ = contact_in_world(motion, step + 1)
        _, attitude = contact_in_world(motion, step)
        velocity = attitude.inv().apply(after - before)
        expected = math.degrees(math.atan2(velocity[1], velocity[0]))
        assert sequence.truth[frame].theta_t_deg == pytest.approx(expected, abs=1e-3)


@settings(max_examples=20, deadline=None)
@given(st.floats(-25, 25), st.floats(-4, 4), st.floats(0, 0.6))
def test_on_level_ground_the_angle_follows_from_drift_and_turn(
    drift: float, turn: float, slip: float
) -> None:
    motion = drive(rig(), LEVEL, plan(2.0, drift_deg=drift, yaw_rate_dps=turn, slip=slip), 0.012)
    truth = frame_truth(rig(), motion, 100, 5, usable=True)
    forward, rate = SPEED_M_S * (1 - slip), math.radians(turn)
    along = forward - rate * HALF_TRACK_M
    across = forward * math.tan(math.radians(drift)) - rate * B_M
    assert truth.theta_t_deg == pytest.approx(math.degrees(math.atan2(across, along)), abs=1e-3)
    assert truth.slip_angle_deg == pytest.approx(drift, abs=1e-3)
    # The line through the contact, seen from the origin.
    theta = math.radians(truth.theta_t_deg)
    assert truth.d_t_m == pytest.approx(HALF_TRACK_M * math.cos(theta) + B_M * math.sin(theta), abs=1e-6)


def test_drift_to_the_left_is_positive_and_the_trace_then_lies_to_the_right_behind() -> None:
    motion = drive(rig(), LEVEL, plan(10.0, drift_deg=8.0), 0.012)
    points, _ = centre_line(rig(), motion, 990)
    assert frame_truth(rig(), motion, 990, 0, usable=True).theta_t_deg == pytest.approx(8.0, abs=1e-3)
    assert points[0, :2] == pytest.approx([-B_M, HALF_TRACK_M], abs=0.005)
    assert points[-1, 1] < points[0, 1]
    assert points[-1, 0] < points[0, 0]


@pytest.mark.parametrize("drift", [-12.0, 0.0, 7.0])
def test_a_straight_trace_has_one_angle(drift: float) -> None:
    motion = drive(rig(), LEVEL, plan(12.0, drift_deg=drift), 0.012)
    truth = frame_truth(rig(), motion, 1190, 0, usable=True)
    assert (truth.theta_t_deg, truth.chord_deg, truth.line_deg) == pytest.approx((drift,) * 3, abs=1e-3)
    assert truth.chord_d_m == pytest.approx(truth.d_t_m, abs=1e-6)


@pytest.mark.parametrize("turn", [2.5, -2.5])
def test_the_chord_of_a_circle_is_off_its_tangent_by_half_the_arc(turn: float) -> None:
    motion = drive(rig(), LEVEL, plan(20.0, yaw_rate_dps=turn), 0.012)
    truth = frame_truth(rig(), motion, 1990, 0, usable=True)
    points, pixels = centre_line(rig(), motion, 1990)
    seen = points[rig().sees(pixels)]
    rate = math.radians(turn)
    radius_m = math.hypot(SPEED_M_S - rate * HALF_TRACK_M, rate * B_M) / abs(rate)
    # From the contact to the middle of the visible arc the direction turns by way / radius.
    hidden_m = np.linalg.norm(seen[0] - points[0])
    arc = (hidden_m + 0.5 * truth.visible_m) / radius_m
    assert truth.visible_m > 0.4
    expected = truth.theta_t_deg - math.copysign(math.degrees(arc), turn)
    assert truth.chord_deg == pytest.approx(expected, abs=0.3)
    assert truth.line_deg == pytest.approx(expected, abs=0.5)


def test_a_trace_is_present_from_20_cm_on() -> None:
    motion = drive(rig(), LEVEL, plan(8.0), 0.012)
    truths = [frame_truth(rig(), motion, 20 * frame, frame, usable=True) for frame in range(40)]
    lengths = [truth.visible_m for truth in truths]
    assert lengths == sorted(lengths)
    assert lengths[0] == 0
    assert math.isnan(truths[0].chord_deg)
    assert [truth.trace_present for truth in truths] == [length >= 0.20 for length in lengths]
    assert 0 < sum(truth.trace_present for truth in truths) < 40
    assert not frame_truth(rig(), motion, 780, 39, usable=False).trace_present


def test_hard_ground_takes_no_trace() -> None:
    soft = plan(16.0)
    hard = drive(rig(), LEVEL, replace(soft, hard_m=((0.7, 1.0),)), 0.012)
    full = frame_truth(rig(), drive(rig(), LEVEL, soft, 0.012), 1590, 0, usable=True)
    broken = frame_truth(rig(), hard, 1590, 0, usable=True)
    assert full.visible_m - broken.visible_m == pytest.approx(0.30, abs=0.04)
    assert hard.position_m[:, 2].max() == pytest.approx(0.0, abs=1e-9)
    assert hard.position_m[0, 2] == pytest.approx(-0.012)
    # The front wheels get there a wheel base earlier: 0.6 m, 7.5 s.
    reached_s = [hard.t_s[np.flatnonzero(hard.softness[:, wheel] < 0.5)[0]] for wheel in (0, 3)]
    assert reached_s == pytest.approx([0.1 / SPEED_M_S, 0.7 / SPEED_M_S], abs=0.05)


def test_the_vehicle_stands_on_the_slope_it_is_on() -> None:
    grade = math.tan(math.radians(6))
    uphill = drive(rig(), Terrain(slope=(grade, 0.0)), plan(1.0, start_yaw_rad=0.0), 0.0)
    assert math.degrees(uphill.pitch_rad[0]) == pytest.approx(-6.0)
    assert uphill.roll_rad[0] == pytest.approx(0.0)
    across = drive(rig(), Terrain(slope=(grade, 0.0)), plan(1.0, start_yaw_rad=-math.pi / 2), 0.0)
    assert math.degrees(across.roll_rad[0]) == pytest.approx(6.0)
    assert across.pitch_rad[0] == pytest.approx(0.0, abs=1e-12)


def test_the_gyro_feels_turn_and_rocking_and_the_compass_counts_counter_clockwise() -> None:
    turning = drive(rig(), LEVEL, plan(4.0, yaw_rate_dps=3.0, start_yaw_rad=0.0), 0.012)
    row = telemetry(turning, [300], NO_ERRORS, np.random.default_rng(0))[0]
    assert row.gyro_yaw_dps == pytest.approx(3.0, abs=1e-3)
    assert (row.gyro_roll_dps, row.gyro_pitch_dps) == pytest.approx((0.0, 0.0), abs=1e-6)
    assert row.compass_deg == pytest.approx(9.0, abs=0.05)
    assert row.wheel_speed_mps == pytest.approx(SPEED_M_S)
    steady = plan(4.0)
    ramp = np.radians(np.arange(400) / RATE_HZ)
    rocking = replace(steady, rock_rad=np.stack([2 * ramp, -1 * ramp], axis=1))
    felt = telemetry(drive(rig(), LEVEL, rocking, 0.0), [50], NO_ERRORS, np.random.default_rng(0))[0]
    assert (felt.gyro_roll_dps, felt.gyro_pitch_dps) == pytest.approx((2.0, -1.0), abs=0.02)


def test_the_other_sensors_err_as_drawn() -> None:
    errors = SensorErrors(
        gyro_bias_dps=(0.3, -0.2, 0.1), gyro_noise_dps=0.2, compass_bias_deg=2.0, wheel_speed_scale=0.02
    )
    motion = drive(rig(), LEVEL, plan(120.0, yaw_rate_dps=1.0, start_yaw_rad=0.0), 0.012)
    rows = telemetry(motion, list(range(0, 12000, 20)), errors, np.random.default_rng(5))
    rates = np.array([row.gyro_yaw_dps for row in rows])
    assert rates.mean() == pytest.approx(1.1, abs=0.03)
    assert rates.std() == pytest.approx(0.2, rel=0.1)
    late = np.array([row.compass_deg - row.t for row in rows])[20:]
    assert late.mean() == pytest.approx(2.0 - 0.45, abs=0.1)
    assert np.mean([row.wheel_speed_mps for row in rows]) == pytest.approx(1.02 * SPEED_M_S, rel=0.01)
