"""Gain, delay and first-order lag of a gyro, by least squares over the turns of the wheels.

In place on firm ground the body turns as its wheels do. The yaw rate of the wheels, passed through a
low-pass and delayed, is fitted to the readings of the gyro, with a constant and a trend in each block. The
standard deviations are those of a jackknife over groups of blocks: errors within a block are not independent.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares
from scipy.signal import lfilter

from rover_hil.datasets.arrays import Array
from rover_hil.ready.imu.parameters import GYRO_FIT
from rover_hil.ready.imu.turns import Turns

TURNS, RESPONSE = GYRO_FIT.turns, GYRO_FIT.response


@dataclass(frozen=True, slots=True, kw_only=True)
class ResponseFit:
    """What came out.

    Attributes:
        gain: Of the gyro over the wheels.
        delay_s: Of the gyro, the age of the wheels' positions taken out.
        lag_s: Time constant of the low-pass.
        gain_sd, delay_sd_s, lag_sd_s: Standard deviations.
        residual: Standard deviation of what the fit leaves, over that of the readings.
        seconds: Of turns that were used.
    """

    gain: float
    delay_s: float
    lag_s: float
    gain_sd: float
    delay_sd_s: float
    lag_sd_s: float
    residual: float
    seconds: float

    @property
    def bandwidth_hz(self) -> float:
        """Where the low-pass has lost 3 dB, at most `greatest_bandwidth_hz`."""
        return min(RESPONSE.greatest_bandwidth_hz, 1.0 / (math.tau * max(self.lag_s, 1e-6)))

    @property
    def bandwidth_sd_hz(self) -> float:
        """Standard deviation of the bandwidth, at most the bandwidth itself."""
        return min(self.bandwidth_hz, self.bandwidth_hz * self.lag_sd_s / max(self.lag_s, 1e-6))

    @property
    def problem(self) -> str:
        """Why the result must not be used; empty where it may."""
        if self.residual > RESPONSE.greatest_residual:
            return (
                f"{100 * self.residual:.0f} % of the readings are not explained by the wheels' turns: firm "
                "ground, a free rover and the right axis of the gyro are needed"
            )
        if not RESPONSE.least_gain <= self.gain <= RESPONSE.greatest_gain:
            return (
                f"the gyro reads {self.gain:.2f} of the wheels' turns: the ground is not firm, the wheels' "
                "geometry in [rover] is wrong, or the sensor is mounted another way"
            )
        return ""


def fit_response(turns: Turns) -> ResponseFit:
    """Return the constants of the gyro that fit the turns best."""
    groups = [
        turns.blocks[first :: RESPONSE.groups] for first in range(min(RESPONSE.groups, len(turns.blocks)))
    ]
    best = min(
        (_fit(turns, turns.blocks, start) for start in RESPONSE.starts_s),
        key=lambda response: response.residual,
    )
    others = [_fit(turns, np.setdiff1d(turns.blocks, group), (best.delay_s, best.lag_s)) for group in groups]

    least_sd_s = RESPONSE.same_rate_sd_s if turns.rates_ratio < RESPONSE.same_rate else RESPONSE.least_sd_s

    def deviation(name: str) -> float:
        values = np.array([getattr(each, name) for each in others])
        return float(np.sqrt((len(values) - 1) * np.mean((values - values.mean()) ** 2)))

    return replace(
        best,
        delay_s=best.delay_s + turns.wheel_age_s,
        gain_sd=math.hypot(deviation("gain"), RESPONSE.least_gain_sd),
        delay_sd_s=math.hypot(deviation("delay_s"), least_sd_s),
        lag_sd_s=math.hypot(deviation("lag_s"), least_sd_s),
    )


def _fit(turns: Turns, blocks: Array, start: tuple[float, float]) -> ResponseFit:
    parts = [
        np.flatnonzero((turns.gyro_s >= block) & (turns.gyro_s < block + TURNS.block_s))
        for block in blocks.tolist()
    ]
    measured = np.concatenate([_without_trend(turns.gyro_s[part], turns.gyro_rad_s[part]) for part in parts])

    def predict(numbers: Array) -> Array:
        delay_s, lag_s = numbers.tolist()
        keep = math.exp(-TURNS.grid_s / lag_s)
        slow = lfilter([1.0 - keep], [1.0, -keep], turns.wheel_rate_rad_s)
        # The discrete low-pass is half a step earlier than the continuous one.
        predicted = np.interp(turns.gyro_s - delay_s - 0.5 * TURNS.grid_s, turns.grid_s, slow)
        return np.concatenate([_without_trend(turns.gyro_s[part], predicted[part]) for part in parts])

    def rest(numbers: Array) -> Array:
        predicted = predict(numbers)
        return measured - float(predicted @ measured) / float(predicted @ predicted) * predicted

    solution = least_squares(
        rest,
        start,
        bounds=(
            (RESPONSE.earliest_delay_s, RESPONSE.shortest_lag_s),
            (RESPONSE.longest_delay_s, RESPONSE.longest_lag_s),
        ),
        x_scale=(0.01, 0.01),
        diff_step=1e-3,
    )
    predicted = predict(solution.x)
    return ResponseFit(
        gain=float(predicted @ measured) / float(predicted @ predicted),
        delay_s=float(solution.x[0]),
        lag_s=float(solution.x[1]),
        gain_sd=0.0,
        delay_sd_s=0.0,
        lag_sd_s=0.0,
        residual=float(np.std(solution.fun) / np.std(measured)),
        seconds=len(blocks) * TURNS.block_s,
    )


def _without_trend(t_s: Array, values: Array) -> Array:
    columns = np.column_stack((np.ones(len(t_s)), t_s - t_s.mean()))
    trend, *_ = np.linalg.lstsq(columns, values, rcond=None)
    residuals: Array = values - columns @ trend
    return residuals
