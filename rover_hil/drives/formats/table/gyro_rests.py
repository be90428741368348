"""The bias of a gyro by the rests of a drive, with its deviation: whether it may be used."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from controllers.estimation.settings import FilterSettings
from rover_hil.drives.arrays import Array

LEAST_RESTS = 5
"""Fewer rests do not distinguish noise and drift: those of the settings are used."""
GRID = 41
"""Values of each of the two that are compared, evenly on a logarithmic scale over their ranges."""
SWINGS_RAD = (1e-6, 1.0)
"""Range of the angle by which a body turns although its wheels rest."""
DEVIATIONS = 3.0
"""A bias that differs from zero by fewer of its deviations may be none."""


@dataclass(frozen=True, slots=True)
class GyroRest:
    """A rest.

    Attributes:
        t_s: Its middle.
        mean_rad_s: Mean reading.
        readings: Their number.
        duration_s: Over which they were taken.
        squares_rad2_s2: Sum of the squares of their differences from the mean.
    """

    t_s: float
    mean_rad_s: float
    readings: int
    duration_s: float
    squares_rad2_s2: float


@dataclass(frozen=True, slots=True)
class LearnedBias:
    """What the rests of a drive show of its gyro.

    Attributes:
        filter: Settings for readings that are corrected by these biases: noise, drift of what is left of the
            bias, and its deviation at the start.
        biases_rad_s: In each rest, by all of them.
        sds_rad_s: Their standard deviations.
    """

    filter: FilterSettings
    biases_rad_s: Array
    sds_rad_s: Array

    @property
    def bias_rad_s(self) -> float:
        """Bias at the last rest."""
        return float(self.biases_rad_s[-1])

    @property
    def sd_rad_s(self) -> float:
        """Its standard deviation."""
        return float(self.sds_rad_s[-1])

    @property
    def is_significant(self) -> bool:
        """Whether the bias differs from zero by more than `DEVIATIONS`."""
        return abs(self.bias_rad_s) > DEVIATIONS * self.sd_rad_s


def learn_bias(rests: Sequence[GyroRest], resolution_rad_s: float, settings: FilterSettings) -> LearnedBias:
    """Return the bias in each rest, with the swing and the drift that make the rests most likely.

    The mean over a rest is the angle turned in it over its duration T. Beside a bias that drifts as a random
    walk it holds the noise of its n readings and the angle by which the body turns although its wheels rest:
    its variance is noise^2 / n + swing^2 / T^2. So a short rest counts for little, and a steady gyro keeps
    what a long one has taught. The noise is the scatter of the readings within all rests, and at least what
    rounding to the resolution leaves in a usual one. The likelihood of swing and drift is that of the
    innovations of a Kalman filter with one state (Harvey, Forecasting, structural time series models and the
    Kalman filter, 1989, section 3.4); the bias is smoothed backwards (Rauch, Tung, Striebel 1965).

    Args:
        rests: At least one, in the order of their times.
        resolution_rad_s: Least difference of two readings.
        settings: Noise and drift where the rests do not show them, and deviation of the bias at the start.

    Returns:
        Biases in rad/s. A reading of the returned filter is as noisy as makes the shortest rest as uncertain
        as it is; longer ones then count for less than they could, since their bias is known already.
    """
    readings = np.array([rest.readings for rest in rests], float)
    durations_s = np.array([rest.duration_s for rest in rests])
    least = max(1e-5, resolution_rad_s * math.sqrt(float(np.median(readings)) / 12.0))
    noise = max(least, settings.gyro_rate_noise_rad_s)
    swings, walks = np.array([[0.0]]), np.array([[settings.gyro_bias_walk_rad_s_sqrt_s]])
    freedom = float((readings - 1.0).sum())
    if len(rests) >= LEAST_RESTS and freedom >= LEAST_RESTS:
        noise = max(least, math.sqrt(sum(rest.squares_rad2_s2 for rest in rests) / freedom))
        swings = np.geomspace(*SWINGS_RAD, GRID)[:, np.newaxis]
        walks = np.geomspace(1e-7, 0.01, GRID)[np.newaxis, :]
    start_sd = settings.gyro_bias_rad_s
    variances = [
        noise**2 / count + (swings / duration_s) ** 2
        for count, duration_s in zip(readings, durations_s, strict=True)
    ]
    likelihood, _ = _filtered(rests, variances, walks, start_sd)
    place = np.unravel_index(int(np.argmax(likelihood)), likelihood.shape)
    swing, walk = float(swings[place[0], 0]), float(walks[0, place[1]])
    best = [variance[place[0], :1] for variance in variances]
    biases, sds = _smoothed(rests, _filtered(rests, best, np.array([walk]), start_sd)[1], walk)
    swung = swing * float((np.sqrt(readings) / durations_s).max())
    learned = {
        "gyro_rate_noise_rad_s": min(0.5, math.hypot(noise, swung)),
        "gyro_bias_walk_rad_s_sqrt_s": walk,
        "gyro_bias_rad_s": min(max(float(sds[0]), 1e-6), 0.5),
    }
    return LearnedBias(settings.model_copy(update=learned), biases, sds)


def _filtered(
    rests: Sequence[GyroRest], variances: Sequence[Array], walks: Array, start_sd: float
) -> tuple[Array, list[tuple[Array, Array]]]:
    """Return the log-likelihood, and bias and its variance after each rest, for each swing and walk."""
    bias = np.zeros(np.broadcast_shapes(variances[0].shape, walks.shape))
    variance = np.full_like(bias, start_sd**2)
    likelihood = np.zeros_like(bias)
    before_s = rests[0].t_s
    steps = []
    for rest, own in zip(rests, variances, strict=True):
        variance = variance + walks**2 * (rest.t_s - before_s)
        before_s = rest.t_s
        innovation = rest.mean_rad_s - bias
        total = variance + own
        likelihood -= 0.5 * (np.log(total) + innovation**2 / total)
        gain = variance / total
        bias, variance = bias + gain * innovation, (1.0 - gain) * variance
        steps.append((bias, variance))
    return likelihood, steps


def _smoothed(
    rests: Sequence[GyroRest], steps: Sequence[tuple[Array, Array]], walk: float
) -> tuple[Array, Array]:
    """Return bias and its standard deviation in each rest, by all of them."""
    biases = np.array([float(bias[0]) for bias, _ in steps])
    variances = np.array([float(variance[0]) for _, variance in steps])
    for index in range(len(rests) - 2, -1, -1):
        drifted = variances[index] + walk**2 * (rests[index + 1].t_s - rests[index].t_s)
        gain = variances[index] / drifted
        biases[index] += gain * (biases[index + 1] - biases[index])
        variances[index] += gain**2 * (variances[index + 1] - drifted)
    return biases, np.sqrt(variances)
