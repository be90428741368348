"""Integration of the gyro."""

import math
from dataclasses import replace

import numpy as np
import pytest

from controllers.estimation.gyro.integrator import GyroIntegrator
from controllers.estimation.parameters import ESTIMATION

MS = 1_000_000


def test_the_trapezoid_rule_integrates_a_ramp_exactly() -> None:
    gyro = GyroIntegrator(0.15)
    for i in range(11):
        gyro.feed(i * 10 * MS, 0.1 * i)
    angle_rad, covered_s, variance_rad2 = gyro.take()
    assert covered_s == pytest.approx(0.1)
    assert angle_rad == pytest.approx(0.5 * 1.0 * 0.1)
    assert variance_rad2 == pytest.approx(0.0, abs=1e-20)
    assert gyro.take() == (0.0, 0.0, 0.0)


def test_a_gap_is_not_integrated() -> None:
    gyro = GyroIntegrator(0.15)
    gyro.feed(0, 1.0)
    gyro.feed(151 * MS, 1.0)
    assert gyro.take() == (0.0, 0.0, 0.0)
    gyro.feed(161 * MS, 1.0)
    assert gyro.take() == pytest.approx((0.01, 0.01, 0.0))


def angle_error(lost_share: float, rng: np.random.Generator) -> tuple[float, float]:
    """Return error and standard deviation of the angle of an oscillation of 5 Hz, read at 50 Hz for 2 s."""
    gyro = GyroIntegrator(0.15)
    turning, phase = math.tau * 5.0, math.tau * rng.random()
    ends_s: list[float] = []
    variance_rad2 = angle_rad = 0.0
    for i in range(150):
        t_s = 0.02 * i
        has_all = t_s < 1.0 or rng.random() >= lost_share
        if has_all and gyro.feed(i * 20 * MS, 0.3 * math.cos(turning * t_s + phase)):
            turn = gyro.take()
            if t_s > 1.0:
                angle_rad, variance_rad2 = angle_rad + turn.angle_rad, variance_rad2 + turn.variance_rad2
            if t_s >= 1.0:
                ends_s.append(t_s)
    begin, end = (0.3 / turning * math.sin(turning * t_s + phase) for t_s in (ends_s[0], ends_s[-1]))
    return angle_rad - (end - begin), math.sqrt(variance_rad2)


def test_readings_that_are_lost_while_the_rate_oscillates_leave_the_uncertainty_of_their_error() -> None:
    rng = np.random.default_rng(1)
    lossy = np.array([angle_error(0.5, rng) for _ in range(200)])
    nees = float(np.mean((lossy[:, 0] / lossy[:, 1]) ** 2))
    assert 0.3 < nees < 1.5
    assert np.mean(lossy[:, 1]) > 0.005
    whole = np.array([angle_error(0.0, rng) for _ in range(20)])
    assert np.max(whole[:, 1]) < 0.002


def test_the_uncertainty_is_the_error_of_the_trapezoid_by_the_mean_square_of_the_second_derivative(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    memory_s = 0.5
    pose = replace(ESTIMATION.pose, curvature_memory_s=memory_s)
    monkeypatch.setattr("controllers.estimation.gyro.integrator.ESTIMATION", replace(ESTIMATION, pose=pose))
    gyro = GyroIntegrator(0.15)
    for i in range(6):
        gyro.feed(i * 10 * MS, 40.0 * (0.01 * i) ** 2)
    # The second derivative is 80 rad/s^3, known from the third reading on.
    squares = [80.0**2 * (1.0 - math.exp(-known * 0.01 / memory_s)) for known in range(5)]
    assert gyro.turn.variance_rad2 == pytest.approx(sum((0.01**3 / 12.0) ** 2 * square for square in squares))


def test_readings_in_a_burst_do_not_pass_for_an_oscillation() -> None:
    gyro = GyroIntegrator(0.15)
    rng = np.random.default_rng(2)
    for i in range(100):
        for j in range(4):
            gyro.feed(i * 20 * MS + j * MS // 10, 0.002 * float(rng.standard_normal()))
    assert math.sqrt(gyro.take().variance_rad2) < 5e-4


@pytest.mark.parametrize("rate", [math.nan, math.inf, -math.inf, 100.1])
def test_impossible_rates_are_refused(rate: float) -> None:
    gyro = GyroIntegrator(0.15)
    assert not gyro.feed(0, rate)
    assert gyro.t_ns is None
    assert not gyro.is_fresh(0)


def test_old_and_repeated_readings_are_refused() -> None:
    gyro = GyroIntegrator(0.15)
    assert gyro.feed(10 * MS, 1.0)
    assert not gyro.feed(10 * MS, 5.0)
    assert not gyro.feed(9 * MS, 5.0)
    assert gyro.rate_rad_s == 1.0


def test_freshness_ends_after_150_ms() -> None:
    gyro = GyroIntegrator(0.15)
    gyro.feed(0, 1.0)
    assert gyro.is_fresh(150 * MS)
    assert not gyro.is_fresh(150 * MS + 1)


def test_readings_at_the_limits_count() -> None:
    gyro = GyroIntegrator(0.15, 2.0)
    assert gyro.rate_rad_s == 0.0
    assert gyro.feed(100 * MS, 2.0)
    assert gyro.is_fresh(250 * MS)
    assert gyro.feed(250 * MS, -2.0)
    assert gyro.take() == (0.0, 0.15, 0.0)
    assert not gyro.has_gap


def test_a_reading_that_is_too_great_is_remembered_until_the_next_one() -> None:
    gyro = GyroIntegrator(0.15, 2.0)
    rejected: list[float | None] = [gyro.rejected_rad_s]
    for t_ns, rate_rad_s in ((0, -2.1), (MS, 1.0)):
        assert gyro.feed(t_ns, rate_rad_s) == (rate_rad_s == 1.0)
        rejected.append(gyro.rejected_rad_s)
    assert rejected == [None, -2.1, None]


def test_a_gap_is_remembered_until_it_is_cleared() -> None:
    gyro = GyroIntegrator(0.15)
    has_gap = [gyro.has_gap]
    for t_ns in (0, 151 * MS, 152 * MS):
        gyro.feed(t_ns, 1.0)
        has_gap.append(gyro.has_gap)
    gyro.clear_gap()
    has_gap.append(gyro.has_gap)
    assert list(map(repr, has_gap)) == ["False", "False", "True", "True", "False"]
