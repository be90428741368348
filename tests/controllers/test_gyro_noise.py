"""Noise of a gyro by its readings, at standstill and against the wheels, and rates that it hides."""

import math
from collections.abc import Callable, Iterable

import numpy as np
import pytest
from numpy.typing import NDArray

from controllers.estimation.gyro.gyro_noise import GyroNoise
from controllers.estimation.gyro.integrator import GyroIntegrator
from controllers.estimation.settings import FilterSettings
from controllers.estimation.wheels.turn_evidence import WheelTurn
from controllers.estimator import Estimator
from controllers.fault import Cause, Severity
from controllers.motion.kinematics import make_kinematics
from controllers.motion.rover_geometry import WheelsRoverSettings
from controllers.roles import DeviceRoles
from drivers.clock import nanoseconds
from drivers.samples import RateSample, WheelSample
from tests.nature.gyro_drives import RADIUS_M, TRACK_M, GyroDrive, TrueGyro, record

Array = NDArray[np.float64]

CONFIGURED = 0.002
INTERVAL_S = 0.01
READING = CONFIGURED / math.sqrt(INTERVAL_S)
SETTINGS = FilterSettings(gyro_noise_rad_sqrt_s=CONFIGURED, gyro_rate_noise_rad_s=READING)
DEAD_BAND = math.radians(0.2)
QUIET = 1e-4


def rng(seed: int = 1) -> np.random.Generator:
    return np.random.default_rng(seed)


def stand(noise: GyroNoise, rates_rad_s: Iterable[float], *, start_s: float = 0.0) -> float:
    """Feed readings at standstill; return the time of the last one."""
    t_s = start_s
    for number, rate in enumerate(rates_rad_s):
        t_s = start_s + number * INTERVAL_S
        noise.take(nanoseconds(t_s), float(rate))
        noise.follow(nanoseconds(start_s))
    return t_s


def at_standstill(rates_rad_s: Iterable[float]) -> GyroNoise:
    noise = GyroNoise(SETTINGS)
    stand(noise, rates_rad_s)
    return noise


@pytest.mark.parametrize("factor", [2.0, 4.0])
def test_noise_at_standstill_is_measured_within_two_seconds_and_reported_beyond_twice(factor: float) -> None:
    noise = at_standstill(1.2 * factor * READING * rng().standard_normal(200))
    assert noise.noise_rad_sqrt_s / CONFIGURED == pytest.approx(1.2 * factor, rel=0.15)
    assert noise.reading_rad_s / READING == pytest.approx(1.2 * factor, rel=0.15)
    assert noise.fault is not None
    assert (noise.fault.cause, noise.fault.severity) == (Cause.GYRO_NOISE, Severity.WARNING)
    assert f"{noise.noise_rad_sqrt_s / CONFIGURED:.0f} times" in noise.fault.text


@pytest.mark.parametrize("factor", [0.0, 0.5, 1.0])
def test_noise_is_never_less_than_configured_and_chance_adds_nothing(factor: float) -> None:
    for seed in range(20):
        noise = at_standstill(factor * READING * rng(seed).standard_normal(1000))
        assert noise.noise_rad_sqrt_s == CONFIGURED
        assert noise.reading_rad_s == READING
        assert noise.fault is None


def test_noise_that_readings_share_is_found_by_their_means() -> None:
    white = 4.0 * READING * rng().standard_normal(3000)
    kernel = np.exp(-np.arange(40) / 8.0)
    noise = at_standstill(np.convolve(white, kernel / kernel.sum())[:3000])
    assert noise.noise_rad_sqrt_s / CONFIGURED == pytest.approx(4.0, rel=0.3)


def test_readings_that_only_vibrate_are_hardly_noise_of_the_angle() -> None:
    times_s = INTERVAL_S * np.arange(3000)
    noise = at_standstill(0.1 * np.sin(math.tau * 41.0 * times_s) + READING * rng().standard_normal(3000))
    assert noise.noise_rad_sqrt_s < 1.5 * CONFIGURED


def test_the_first_readings_of_a_motion_are_none_of_the_standstill() -> None:
    noise = at_standstill([*(READING * rng().standard_normal(200)), *np.linspace(0.0, 1.0, 25)])
    noise.follow(None)
    stand(noise, READING * rng(2).standard_normal(200), start_s=10.0)
    assert noise.noise_rad_sqrt_s == CONFIGURED


def drive(
    noise: GyroNoise, rates_rad_s: Array, body_rad_s: Array, wheels: Callable[[int], tuple[float, float]]
) -> float:
    """Feed a drive at 50 Hz by readings and by the sides of the wheels; return the variance added."""
    gyro, variance = GyroIntegrator(0.1), 0.0
    for number, rate in enumerate(rates_rad_s + body_rad_s):
        gyro.feed(nanoseconds(1.0 + number * INTERVAL_S), float(rate))
        if number % 2 == 0 and number:
            turn = gyro.take()
            left, right = wheels(number)
            sides = WheelTurn(2.0 * INTERVAL_S, 2.0 * INTERVAL_S * left, 2.0 * INTERVAL_S * right)
            variance += noise.add(turn.angle_rad, turn.covered_s, turn.variance_rad2, sides)
    return variance


def straight(_: int) -> tuple[float, float]:
    return 1.0, 1.0


def test_noise_that_only_driving_shows_is_found_and_added_for_the_whole_drive() -> None:
    noise = GyroNoise(SETTINGS)
    stand(noise, READING * rng(2).standard_normal(300))
    count = 6000
    variance = drive(noise, 4.0 * READING * rng().standard_normal(count), np.zeros(count), straight)
    assert noise.noise_rad_sqrt_s / CONFIGURED == pytest.approx(4.0, rel=0.25)
    assert variance == pytest.approx(15.0 * CONFIGURED**2 * count * INTERVAL_S, rel=0.5)


def wander(seed: int, count: int, sd_rad_s: float, each_s: float) -> Array:
    knots = np.arange(0.0, count * INTERVAL_S + 2.0 * each_s, each_s)
    values = sd_rad_s * rng(seed).standard_normal(len(knots))
    return np.asarray(np.interp(INTERVAL_S * np.arange(count), knots, values), np.float64)


@pytest.mark.parametrize("each_s", [1.0, 3.0, 8.0])
def test_a_rotation_that_slipping_wheels_do_not_show_is_no_noise(each_s: float) -> None:
    count = 12000
    for seed in range(10):
        noise = GyroNoise(SETTINGS)
        body = wander(seed, count, 0.05, each_s)
        drive(noise, READING * rng(seed + 100).standard_normal(count), body, straight)
        assert noise.noise_rad_sqrt_s == CONFIGURED


def test_a_ground_that_shakes_the_rover_counts_no_more_than_the_readings_scatter() -> None:
    count = 6000
    body = np.convolve(0.3 * rng(3).standard_normal(count), np.hanning(40) / 20.0)[:count]
    noise = GyroNoise(SETTINGS)
    drive(noise, READING * rng().standard_normal(count), body, straight)
    assert noise.noise_rad_sqrt_s < 1.5 * CONFIGURED


def test_wheels_that_lose_a_share_of_changing_rotations_show_no_noise() -> None:
    count = 12000

    def turning(number: int) -> tuple[float, float]:
        rate = math.sin(0.7 * number * INTERVAL_S)
        return max(0.0, rate), max(0.0, -rate)

    body = np.array([0.6 * (turning(number)[0] - turning(number)[1]) for number in range(count)])
    noise = GyroNoise(SETTINGS)
    drive(noise, READING * rng().standard_normal(count), body, turning)
    assert noise.noise_rad_sqrt_s == CONFIGURED


def test_a_dead_band_hides_a_rate_that_readings_beside_it_bound() -> None:
    noise = at_standstill(np.zeros(300))
    assert noise.hidden_rad_s == 0.0
    for number, rate in enumerate(0.02 * rng().standard_normal(2000)):
        noise.take(nanoseconds(10.0 + number * INTERVAL_S), float(np.where(abs(rate) < DEAD_BAND, 0.0, rate)))
    assert noise.hidden_rad_s * math.sqrt(3.0) == pytest.approx(DEAD_BAND, rel=0.1)
    assert noise.noise_rad_sqrt_s == CONFIGURED


@pytest.mark.parametrize(("scatter", "hidden"), [(0.0, 0.005), (0.002, 0.005), (0.01, 0.0)])
def test_rounded_readings_hide_half_a_step_unless_noise_changes_them(scatter: float, hidden: float) -> None:
    def rounded(values: Array) -> Array:
        return np.round(values / 0.01) * 0.01

    noise = at_standstill(rounded(scatter * rng().standard_normal(300)))
    for number, rate in enumerate(rounded(0.1 * rng().standard_normal(500))):
        noise.take(nanoseconds(10.0 + number * INTERVAL_S), float(rate))
    assert noise.hidden_rad_s * math.sqrt(3.0) == pytest.approx(hidden, rel=1e-6)


ROVER = WheelsRoverSettings.model_validate(
    {
        "kinematics": "wheels",
        "wheels": [{"x_m": 0.0, "y_m": side * TRACK_M, "radius_m": RADIUS_M} for side in (0.5, -0.5)],
    }
)
ROLES = DeviceRoles(wheels="wheels", gyro="gyro", required={"wheels": 0.15, "gyro": 0.15})


def follow(drive: GyroDrive) -> tuple[float, float, Estimator]:
    """Return error and standard deviation of the yaw at the end of a drive."""
    estimator = Estimator(make_kinematics(ROVER), SETTINGS, 20.0, ROLES)
    readings = list(zip(drive.gyro_t_s.tolist(), drive.gyro_rad_s.tolist(), strict=True))
    first, now_ns = 0, 0
    for t_s, wheels_rad in zip(drive.wheel_t_s.tolist(), drive.wheels_rad.tolist(), strict=True):
        now_ns = nanoseconds(1.0 + t_s)
        while first < len(readings) and readings[first][0] <= t_s:
            at_s, rate = readings[first]
            sample = RateSample(device="gyro", t_ns=nanoseconds(1.0 + at_s), rate_z_rad_s=rate)
            estimator.take(sample, sample.t_ns)
            first += 1
        for wheel, angle_rad in enumerate(wheels_rad):
            position = WheelSample(device="wheels", t_ns=now_ns, wheel=wheel, position_rad=angle_rad)
            estimator.take(position, now_ns)
        estimator.advance(now_ns)
    estimate = estimator.estimate(now_ns)
    error_rad = math.remainder(estimate.yaw_rad - float(drive.yaw_rad[-1]), math.tau)
    return error_rad, math.sqrt(estimate.covariance[5]), estimator


GYROS = {
    "as configured": TrueGyro(noise_rad_sqrt_s=CONFIGURED),
    "four times": TrueGyro(noise_rad_sqrt_s=4.0 * CONFIGURED),
    "dead band": TrueGyro(noise_rad_sqrt_s=QUIET, bias_rad_s=0.001, dead_band_rad_s=DEAD_BAND),
    "coarse": TrueGyro(noise_rad_sqrt_s=QUIET, step_rad_s=0.01),
}


@pytest.mark.parametrize("name", GYROS)
def test_the_yaw_is_within_its_interval_whatever_the_noise_of_the_gyro(name: str) -> None:
    ends = [follow(record(GYROS[name], rng(seed)))[:2] for seed in range(4)]
    assert sum(abs(error_rad) < 1.96 * sd_rad for error_rad, sd_rad in ends) >= 3


def test_the_bias_is_never_known_better_than_what_a_dead_band_hides() -> None:
    estimator = follow(record(GYROS["dead band"], rng()))[2]
    bias_sd_rad_s = math.sqrt(estimator.pose_filter.gyro_bias_rad2_s2)
    assert bias_sd_rad_s == pytest.approx(DEAD_BAND / math.sqrt(3.0), rel=0.1)
