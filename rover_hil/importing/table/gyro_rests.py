"""The bias of a gyro by the rests of a drive, with its deviation: whether it may be used."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from controllers.estimation.settings import FilterSettings
from rover_hil.datasets.arrays import Array

LEAST_RESTS = 5
"""Fewer rests do not tell noise and drift apart: those of the settings are used."""
GRID = 41
"""Values of each of the two that are compared, evenly on a logarithmic scale over their ranges."""
DEVIATIONS = 3.0
"""A bias that differs from zero by fewer of its deviations may be none."""


@dataclass(frozen=True, slots=True)
class GyroRest:
    """A rest.

    Attributes:
        t_s: Its middle.
        mean_rad_s: Mean reading.
        readings: Their number.
    """

    t_s: float
    mean_rad_s: float
    readings: int


@dataclass(frozen=True, slots=True)
class LearnedBias:
    """What the rests of a drive tell of its gyro.

    Attributes:
        filter: Settings with the noise of a reading and the drift of the bias.
        bias_rad_s: At the last rest.
        sd_rad_s: Its standard deviation.
    """

    filter: FilterSettings
    bias_rad_s: float
    sd_rad_s: float

    @property
    def is_significant(self) -> bool:
        """Whether the bias differs from zero by more than `DEVIATIONS`."""
        return abs(self.bias_rad_s) > DEVIATIONS * self.sd_rad_s


def learn_bias(rests: Sequence[GyroRest], resolution_rad_s: float, settings: FilterSettings) -> LearnedBias:
    """Return the bias by the rests, with the noise and the drift that make them most likely.

    The mean of n readings at rest scatters by noise / sqrt(n) about a bias that drifts as a random walk. So a
    short rest counts for little, and a steady gyro keeps what a long one has taught. Motion that the wheels
    do not show, as of a body that swings, is part of that scatter. The likelihood is that of the innovations
    of a Kalman filter with one state (Harvey, Forecasting, structural time series models and the Kalman
    filter, 1989, section 3.4). The noise is at least what rounding to the resolution leaves in a usual rest.

    Args:
        rests: At least one, in the order of their times.
        resolution_rad_s: Least difference of two readings.
        settings: Noise and drift where the rests do not tell them, and deviation of the bias at the start.
    """
    usual = float(np.median([rest.readings for rest in rests]))
    least = max(1e-5, resolution_rad_s * math.sqrt(usual / 12.0))
    noises = np.array([[max(least, settings.gyro_rate_noise_rad_s)]])
    walks = np.array([[settings.gyro_bias_walk_rad_s_sqrt_s]])
    if len(rests) >= LEAST_RESTS:
        noises = np.geomspace(least, max(0.5, 2.0 * least), GRID)[:, np.newaxis]
        walks = np.geomspace(1e-7, 0.01, GRID)[np.newaxis, :]
    likelihood, bias, variance = _filtered(rests, noises, walks, settings.gyro_bias_rad_s)
    best = np.unravel_index(int(np.argmax(likelihood)), likelihood.shape)
    fitted = {
        "gyro_rate_noise_rad_s": min(0.5, float(noises[best[0], 0])),
        "gyro_bias_walk_rad_s_sqrt_s": float(walks[0, best[1]]),
    }
    return LearnedBias(
        settings.model_copy(update=fitted), float(bias[best]), math.sqrt(float(variance[best]))
    )


def _filtered(
    rests: Sequence[GyroRest], noises: Array, walks: Array, start_sd: float
) -> tuple[Array, Array, Array]:
    """Return log-likelihood, bias and its variance after the last rest, for each noise and walk."""
    bias = np.zeros(np.broadcast_shapes(noises.shape, walks.shape))
    variance = np.full_like(bias, start_sd**2)
    likelihood = np.zeros_like(bias)
    before_s = rests[0].t_s
    for rest in rests:
        variance = variance + walks**2 * (rest.t_s - before_s)
        before_s = rest.t_s
        innovation = rest.mean_rad_s - bias
        total = variance + noises**2 / rest.readings
        likelihood -= 0.5 * (np.log(total) + innovation**2 / total)
        gain = variance / total
        bias, variance = bias + gain * innovation, (1.0 - gain) * variance
    return likelihood, bias, variance
