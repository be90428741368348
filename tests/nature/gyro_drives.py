"""Drives of a rover on two wheels whose gyro is noisier than its data sheet, rounds, or hides slow rates.

It knows nothing of the program: the rates of the rims are given, the ground takes a little off each, and the
yaw is the integral.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

STEP_S = 0.002
WHEEL_STEPS, GYRO_STEPS = 10, 5
RADIUS_M, TRACK_M = 0.06, 0.3
TICK_RAD = math.tau / 4096.0


@dataclass(frozen=True, kw_only=True)
class TrueGyro:
    """What the gyro does to the yaw rate.

    Attributes:
        noise_rad_sqrt_s: White noise of the rate.
        correlation_s: Low-pass before the readings are taken; 0 for none.
        bias_rad_s: Standard deviation of its bias over the drives.
        dead_band_rad_s: Slower rates are read as zero.
        step_rad_s: Rates are rounded to multiples; 0 for none.
    """

    noise_rad_sqrt_s: float = 0.002
    correlation_s: float = 0.0
    bias_rad_s: float = 0.005
    dead_band_rad_s: float = 0.0
    step_rad_s: float = 0.0

    def read(self, rate_rad_s: Array, rng: np.random.Generator) -> Array:
        """Return readings of the true rates, one each `GYRO_STEPS`."""
        interval_s = STEP_S * GYRO_STEPS
        noise = rng.standard_normal(len(rate_rad_s)) * self.noise_rad_sqrt_s / math.sqrt(interval_s)
        if self.correlation_s:
            keep = math.exp(-interval_s / self.correlation_s)
            past = 0.0
            for index, value in enumerate(noise.tolist()):
                past = noise[index] = keep * past + (1.0 - keep) * value
        readings = rate_rad_s + noise + self.bias_rad_s * rng.standard_normal()
        if self.step_rad_s:
            readings = np.round(readings / self.step_rad_s) * self.step_rad_s
        return np.where(np.abs(readings) < self.dead_band_rad_s, 0.0, readings)


@dataclass(frozen=True)
class GyroDrive:
    """A drive.

    Attributes:
        wheel_t_s: Times of the wheels' angles and of the true yaw, shape (n,).
        wheels_rad: Angles of both wheels in whole ticks, left first, shape (n, 2).
        yaw_rad: True yaw.
        gyro_t_s: Times of the readings, shape (m,).
        gyro_rad_s: Readings.
    """

    wheel_t_s: Array
    wheels_rad: Array
    yaw_rad: Array
    gyro_t_s: Array
    gyro_rad_s: Array


def record(
    gyro: TrueGyro,
    rng: np.random.Generator,
    *,
    rest_s: float = 3.0,
    slip: float = 0.01,
    slip_change_s: float = 1.0,
) -> GyroDrive:
    """Return a drive of 60 to 120 s: straight lines that are not quite straight, rotations and rests.

    Args:
        gyro: Of the rover.
        rng: Source of chance.
        rest_s: Rest before it.
        slip: Greatest slip of a rim, which changes along the drive.
        slip_change_s: Time between two independent values of it.
    """
    duration_s = rng.uniform(60.0, 120.0)
    times_s = np.arange(0.0, duration_s, STEP_S)
    speed, rate = np.zeros_like(times_s), np.zeros_like(times_s)
    at_s = rest_s
    while at_s < duration_s - 1.0:
        kind = rng.choice(("straight", "straight", "turn", "arc", "rest"), p=(0.35, 0.2, 0.2, 0.15, 0.1))
        for_s = rng.uniform(2.0, 15.0) if kind == "straight" else rng.uniform(1.0, 4.0)
        during = (times_s >= at_s) & (times_s < at_s + for_s)
        if kind in ("straight", "arc"):
            speed[during] = rng.uniform(0.1, 0.4)
            rate[during] = rng.normal(0.0, 0.002)
        if kind in ("turn", "arc"):
            rate[during] = rng.choice((-1.0, 1.0)) * rng.uniform(0.2, 0.9)
        at_s += for_s
    speed, rate = _lagged(speed), _lagged(rate)
    sides = np.column_stack([speed - 0.5 * TRACK_M * rate, speed + 0.5 * TRACK_M * rate])
    knots_s = np.arange(0.0, duration_s + 2.0 * slip_change_s, slip_change_s)
    lost = np.column_stack(
        [np.interp(times_s, knots_s, rng.uniform(0.0, slip, len(knots_s))) for _ in range(2)]
    )
    over_ground = sides * (1.0 - lost)
    true_rate = (over_ground[:, 1] - over_ground[:, 0]) / TRACK_M
    yaw_rad = np.cumsum(true_rate) * STEP_S
    angles_rad = np.floor(np.cumsum(sides, axis=0) * STEP_S / RADIUS_M / TICK_RAD) * TICK_RAD
    read = slice(GYRO_STEPS - 1, None, GYRO_STEPS)
    seen = slice(WHEEL_STEPS - 1, None, WHEEL_STEPS)
    return GyroDrive(
        times_s[seen] + STEP_S,
        angles_rad[seen],
        yaw_rad[seen],
        times_s[read] + STEP_S,
        gyro.read(true_rate[read], rng),
    )


def _lagged(values: Array) -> Array:
    kernel = np.exp(-np.arange(0.0, 1.0, STEP_S) / 0.12)
    return np.asarray(np.convolve(values, kernel / kernel.sum())[: len(values)], np.float64)
