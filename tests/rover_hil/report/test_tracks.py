"""Numbers and poses over time."""

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from rover_hil.report.thinning import THIN_BINS, thin, with_gaps
from rover_hil.report.tracks import (
    Series,
    Track,
    integrate_rate,
    local_headings,
    slip_over_time,
    spans,
    speed_from_positions,
)

COORDINATE = st.floats(-100.0, 100.0)


def arc() -> Track:
    """A quarter circle of 1 m radius to the left, driven in 10 s."""
    angle = np.linspace(0.0, math.pi / 2, 501)
    return Track(np.linspace(0.0, 10.0, 501), np.sin(angle), 1.0 - np.cos(angle), angle)


@given(x_m=COORDINATE, y_m=COORDINATE, yaw_rad=st.floats(-10.0, 10.0))
def test_the_frame_of_the_truth_does_not_matter(x_m: float, y_m: float, yaw_rad: float) -> None:
    track = arc()
    cosine, sine = math.cos(yaw_rad), math.sin(yaw_rad)
    moved = Track(
        track.t_s,
        x_m + cosine * track.x_m - sine * track.y_m,
        y_m + sine * track.x_m + cosine * track.y_m,
        track.yaw_rad + yaw_rad,
    )
    aligned = moved.from_first_pose()
    np.testing.assert_allclose(aligned.x_m, track.x_m, atol=1e-9)
    np.testing.assert_allclose(aligned.y_m, track.y_m, atol=1e-9)
    np.testing.assert_allclose(aligned.yaw_rad, track.yaw_rad, atol=1e-9)


def test_length_of_the_way_ignores_noise_at_standstill() -> None:
    track = arc()
    noise_m = np.random.default_rng(1).normal(0.0, 0.001, 5000)
    standing = Track(np.arange(5000) / 50.0, noise_m, noise_m[::-1], np.zeros(5000))
    assert abs(track.distance_m()[-1] - math.pi / 2) < 0.001
    assert abs(track.distance_m()[250] - math.pi / 4) < 0.021
    assert standing.distance_m()[-1] < 0.01


def test_poses_outside_the_known_time_are_unknown() -> None:
    track = arc().at(np.array([-1.0, 0.01, 11.0]))
    assert np.isnan(track.x_m[[0, 2]]).all()
    assert 0.0 < track.x_m[1] < 0.002


def test_yaw_is_unwrapped() -> None:
    rows = np.array([[0.0, 0.0, 0.0, 3.1], [1.0, 0.0, 0.0, -3.1]])
    assert abs(Track.of(rows).yaw_rad[1] - (2 * math.pi - 3.1)) < 1e-12


def test_rows_that_are_not_newer_or_not_finite_are_left_out() -> None:
    series = Series.of([(0.0, 1.0), (1.0, math.nan), (2.0, 3.0), (2.0, 4.0), (1.5, 5.0), (3.0, 6.0)])
    assert series.t_s.tolist() == [0.0, 2.0, 3.0]
    assert series.value.tolist() == [1.0, 3.0, 6.0]
    assert len(Series.of([]).t_s) == 0


def test_slip_over_time_sees_where_the_slip_was() -> None:
    t_s = np.arange(0.0, 20.0, 0.02)
    encoder_m_s = np.where(t_s < 15.0, 0.1, 0.0)
    true_m_s = encoder_m_s * np.where(t_s < 8.0, 1.0, 0.7)
    zeros = np.zeros_like(t_s)
    encoders = Track(t_s, np.cumsum(encoder_m_s) * 0.02, zeros, zeros)
    truth = Track(t_s, np.cumsum(true_m_s) * 0.02, zeros, zeros)
    slip = slip_over_time(encoders, truth)
    assert abs(np.interp(5.0, slip.t_s, slip.value)) < 0.03
    assert abs(np.interp(12.0, slip.t_s, slip.value) - 0.3) < 0.03
    assert np.isnan(slip.value[-1])


@given(offset_rad=st.floats(-20.0, 20.0))
def test_headings_start_at_zero_whatever_the_compass_reads(offset_rad: float) -> None:
    t_s = np.arange(0.0, 10.0, 0.1)
    yaw_rad = np.where(t_s < 2.0, 0.0, 0.5 * (t_s - 2.0))
    wrapped = (yaw_rad + offset_rad + math.pi) % (2 * math.pi) - math.pi
    local = local_headings(Series(t_s, wrapped), first_motion_s=1.95)
    np.testing.assert_allclose(local.value, yaw_rad, atol=1e-9)


def test_gyro_loses_the_bias_it_had_at_rest() -> None:
    t_s = np.arange(0.0, 10.0, 0.01)
    rate = np.where(t_s < 2.0, 0.0, 0.1) + 0.03
    yaw = integrate_rate(Series(t_s, rate), first_motion_s=1.9)
    assert abs(yaw.value[-1] - 0.1 * (t_s[-1] - 2.0)) < 0.001


def test_first_motion() -> None:
    t_s = np.arange(0.0, 4.0, 0.1)
    x_m = np.where(t_s < 2.0, 0.0, 0.1 * (t_s - 2.0))
    zeros = np.zeros_like(t_s)
    assert abs(Track(t_s, x_m, zeros, zeros).first_motion_s() - 2.1) < 1e-9
    assert Track(t_s, zeros, zeros, 10.0 * x_m).first_motion_s() < 2.2
    assert Track(t_s, zeros, zeros, zeros).first_motion_s() == t_s[-1]


def test_speed_from_positions_survives_gaps_and_restarts() -> None:
    t_s = np.concatenate((np.arange(0.0, 5.0, 0.02), np.arange(7.0, 10.0, 0.02)))
    position_rad = 3.0 * t_s
    position_rad[t_s > 9.0] -= 20.0
    speed = speed_from_positions(Series(t_s, position_rad), limit_rad_s=10.0)
    known = np.isfinite(speed.value)
    np.testing.assert_allclose(speed.value[known], 3.0, atol=1e-9)
    assert known[speed.t_s < 4.9].all()
    assert not known[(speed.t_s > 5.1) & (speed.t_s < 6.9)].any()
    assert not known[np.abs(speed.t_s - 9.0) < 0.03].any()
    assert len(speed_from_positions(Series(t_s[:1], position_rad[:1]), 10.0).t_s) == 0


def test_spans_last_until_the_next_one() -> None:
    t_s = np.array([0.0, 1.0, 2.0, 3.0, 4.0])
    assert spans(t_s, ["a", "a", "b", "b", "a"]) == [(0.0, 2.0, "a"), (2.0, 4.0, "b"), (4.0, 4.0, "a")]


def test_thinning_keeps_every_peak() -> None:
    value = np.zeros(100_000)
    value[12_345], value[77_777], value[50_000:50_500] = 1.0, -1.0, np.nan
    thinned = thin(Series(np.arange(100_000.0), value))
    assert len(thinned.t_s) < 3 * THIN_BINS
    assert np.nanmax(thinned.value) == 1.0
    assert np.nanmin(thinned.value) == -1.0
    assert np.isnan(thinned.value).any()
    assert (np.diff(thinned.t_s) > 0).all()


def test_no_line_is_drawn_across_a_gap() -> None:
    t_s = np.array([0.0, 0.1, 0.2, 0.3, 5.0, 5.1])
    gapped = with_gaps(Series(t_s, np.ones(6)))
    assert np.isnan(gapped.value).tolist() == [False, False, False, False, True, False, False]


def test_times_that_repeat_are_no_gaps() -> None:
    assert np.isfinite(with_gaps(Series(np.repeat(np.arange(5.0), 4), np.ones(20))).value).all()
