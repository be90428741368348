"""Noise models: transformations that make errors independent and of unit size."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from rover_hil.gap.data.problem import Indices, Observations, cells
from rover_hil.gap.statistics.parameters import STATISTICS
from rover_hil.gap.statistics.replicates import Scatter
from rover_hil.gap.statistics.run_scatter import RunScatter, likeliest, run_scatter, series_starts
from sim_backends.models.interface import Array, Channel

ROUNDING = 1e-9
"""Least size of errors, as a share of the values: below it is rounding of the arithmetic."""


class Noise(Protocol):
    """Whitens errors of observations."""

    @property
    def freedom(self) -> float:
        """Degrees of freedom behind the size of the errors."""
        ...

    @property
    def row_sd(self) -> Array:
        """Standard deviation of each row before whitening."""
        ...

    @property
    def site(self) -> Indices:
        """Group of each whitened row."""
        ...

    @property
    def channel(self) -> Indices:
        """Channel of each whitened row."""
        ...

    @property
    def block(self) -> Indices:
        """Stretch of data of each whitened row; errors of different stretches are independent."""
        ...

    def whiten(self, rows: Array) -> Array:
        """Return rows, or columns of rows, in units of independent standard errors."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class SteadyNoise:
    """Errors of group means: scatter over the number of runs, and the common errors of replicates."""

    matrix: Array
    freedom: float
    row_sd: Array
    site: Indices
    channel: Indices
    block: Indices

    def whiten(self, rows: Array) -> Array:
        """Return independent standard errors; the whitened rows stay in their order."""
        whitened: Array = self.matrix @ rows
        return whitened


def steady_noise(observations: Observations, scatter: Scatter) -> SteadyNoise:
    """Return the errors of the means of `observations`."""
    size = observations.values.size
    matrix = np.zeros((size, size))
    row_sd = np.zeros(size)
    for index in range(len(observations.groups)):
        rows = np.flatnonzero(observations.site == index)
        channels = observations.channel[rows]
        single = scatter.covariance[index][np.ix_(channels, channels)]
        counts = observations.counts[rows]
        covariance = single / np.sqrt(counts[:, None] * counts[None, :])
        shared = [
            _shared_variance(observations.channels[c], float(single[i, i])) for i, c in enumerate(channels)
        ]
        covariance = covariance + np.diag(shared)
        values, vectors = np.linalg.eigh(covariance)
        root = vectors @ np.diag(1.0 / np.sqrt(np.maximum(values, 1e-300))) @ vectors.T
        matrix[np.ix_(rows, rows)] = root
        row_sd[rows] = np.sqrt(np.diag(covariance))
    freedom = float(scatter.freedom.min())
    return SteadyNoise(
        matrix=matrix,
        freedom=freedom,
        row_sd=row_sd,
        site=observations.site,
        channel=observations.channel,
        block=observations.site,
    )


def _shared_variance(channel: Channel, variance: float) -> float:
    """Return the variance that replicates have in common: the model's own error, and rounding.

    Where the scatter is small against the step, all replicates are rounded alike; the correlation of
    two rounding errors is exp(-(2 pi sd / step)^2) (characteristic function of the scatter).
    """
    if channel.quantum <= 0.0:
        return channel.tolerance**2
    alike = math.exp(-((2.0 * math.pi / channel.quantum) ** 2) * variance)
    return channel.tolerance**2 + channel.quantum**2 / 12.0 * alike


@dataclass(frozen=True, slots=True, kw_only=True)
class SeriesNoise:
    """Errors of series: autoregressive per channel, heavy tails weighted down, and constants of runs.

    Attributes:
        lags: Coefficients of past errors, per channel.
        taps: The same for each row.
        innovation_sd: Standard deviation of the innovations, per channel.
        constant_sd: Standard deviation of the constants of the runs, per channel.
        keep: Rows with complete past.
        scale: Factor of each kept row.
    """

    lags: tuple[Array, ...]
    taps: Array
    innovation_sd: Array
    constant_sd: Array
    keep: Indices
    scale: Array
    constants: RunScatter
    row_sd: Array
    freedom: float
    site: Indices
    channel: Indices
    block: Indices

    def whiten(self, rows: Array) -> Array:
        """Return independent standard errors of the rows with complete past."""
        filtered = _filter(self.taps, rows)[self.keep]
        return self.constants.whiten(filtered * (self.scale if rows.ndim == 1 else self.scale[:, None]))


def series_noise(observations: Observations, residual: Array, *, is_final: bool = True) -> SeriesNoise:
    """Estimate the errors from the residual.

    Args:
        observations: The observations.
        residual: Measured minus predicted; NaN where either is missing.
        is_final: Reduce the weight of outliers. Only after effects are removed from the residual: an effect
            that acts at times, like a delay, resembles heavy tails.
    """
    constant_sd = np.zeros(len(observations.channels))
    centred = residual.copy()
    lags = []
    for index in range(len(observations.channels)):
        learned, constant_sd[index] = _learn(observations, residual, index)
        lags.append(learned)
        if constant_sd[index] > 0.0:
            _centre(observations, centred, index)
    filled = np.where(np.isfinite(residual), residual, 0.0)
    taps = _taps(observations, lags)
    innovations = _filter(taps, np.where(np.isfinite(centred), centred, 0.0))
    keep = _with_past(observations, np.isfinite(residual), lags)
    weight = np.ones(innovations.size)
    sigma = np.zeros(len(observations.channels))
    row_sd = np.zeros(innovations.size)
    for index, channel in enumerate(observations.channels):
        in_channel = keep[observations.channel[keep] == index]
        here = (observations.channel == index) & np.isfinite(residual)
        least = max(ROUNDING * _rms(observations.values[here]), 1e-12)
        weight[in_channel], sigma[index] = _weigh(innovations[in_channel], channel, least, is_final=is_final)
        row_sd[observations.channel == index] = max(_rms(filled[here]), least)
    scale = np.sqrt(weight[keep]) / sigma[observations.channel[keep]]
    return SeriesNoise(
        lags=tuple(lags),
        taps=taps,
        innovation_sd=sigma,
        constant_sd=constant_sd,
        keep=keep,
        scale=scale,
        constants=_constants(observations, taps, keep, scale, constant_sd),
        row_sd=row_sd,
        freedom=math.inf,
        site=observations.site[keep],
        channel=observations.channel[keep],
        block=_blocks(observations, keep),
    )


def _learn(observations: Observations, residual: Array, channel: int) -> tuple[Array, float]:
    """Return the autoregression of one channel's errors, and the deviation of the constants of its runs.

    A constant per run resembles errors that never decay, which would hide all slow effects. Both models are
    fitted, and the likelier one is kept.
    """
    cost = {}
    found = {}
    centred = residual.copy()
    _centre(observations, centred, channel)
    for name, errors in (("slow", residual), ("constant", centred)):
        lags = _fit_lags(observations, errors, channel)
        every = [lags if index == channel else np.zeros(0) for index in range(len(observations.channels))]
        keep = _with_past(observations, np.isfinite(residual), every)
        keep = keep[observations.channel[keep] == channel]
        if keep.size < STATISTICS.noise.least_blocks:
            return lags, 0.0
        taps = _taps(observations, every)
        new = _filter(taps, np.where(np.isfinite(residual), residual, 0.0))[keep]
        square = max(float(np.mean(new**2)), 1e-300)
        variance, total = 0.0, keep.size * (math.log(square) + 1.0)
        if name == "constant":
            level = _filter(taps, np.ones(residual.size))[keep]
            starts = series_starts(observations.site[keep], observations.channel[keep])
            variance, total = likeliest(starts, level, new)
        cost[name], found[name] = total / keep.size, (lags, math.sqrt(variance))
    gain = (cost["slow"] - cost["constant"]) * float(np.sum(observations.channel == channel))
    return found["constant"] if gain > STATISTICS.noise.clearly else found["slow"]


def _centre(observations: Observations, values: Array, channel: int) -> None:
    """Subtract the mean of each series of a channel."""
    for cell in cells(observations):
        good = cell[np.isfinite(values[cell])]
        if observations.channel[cell[0]] == channel and good.size:
            values[good] -= float(np.mean(values[good]))


def _constants(
    observations: Observations, taps: Array, keep: Indices, scale: Array, constant_sd: Array
) -> RunScatter:
    level = _filter(taps, np.ones(observations.values.size))[keep] * scale
    starts = series_starts(observations.site[keep], observations.channel[keep])
    return run_scatter(starts, level, constant_sd[observations.channel[keep][starts]] ** 2)


def _weigh(innovations: Array, channel: Channel, least: float, *, is_final: bool) -> tuple[Array, float]:
    """Return Huber's weights and the deviation, above `least`, that makes weighted scores of unit size."""
    floor = max(1e-3 * channel.quantum / math.sqrt(12.0), 1e-3 * (channel.sigma or 0.0), least)
    median = 1.4826 * float(np.median(np.abs(innovations))) if innovations.size else 0.0
    spread = max(median, 1e-3 * _rms(innovations), floor)
    weight = np.ones(innovations.size)
    if is_final:
        weight = np.minimum(1.0, STATISTICS.noise.huber_sd * spread / np.maximum(np.abs(innovations), 1e-300))
    # With weights w the squares of a score are w^2 e^2 where its information counts w: this ratio.
    variance = float(np.sum((weight * innovations) ** 2) / max(float(np.sum(weight)), 1e-300))
    return weight, max(math.sqrt(variance), floor)


def for_other_runs(noise: Noise, scatter: Scatter | None, observations: Observations) -> Noise:
    """Return the same noise model for other observations."""
    if isinstance(noise, SeriesNoise):
        present = np.isfinite(observations.values)
        keep = _with_past(observations, present, noise.lags)
        scale = 1.0 / noise.innovation_sd[observations.channel[keep]]
        taps = _taps(observations, noise.lags)
        return replace(
            noise,
            taps=taps,
            keep=keep,
            scale=scale,
            constants=_constants(observations, taps, keep, scale, noise.constant_sd),
            site=observations.site[keep],
            channel=observations.channel[keep],
            block=_blocks(observations, keep),
        )
    if scatter is None:
        raise AssertionError("steady errors come with the scatter of replicates")
    mean = scatter.covariance.mean(axis=0, keepdims=True)
    return steady_noise(
        observations, replace(scatter, covariance=np.repeat(mean, len(observations.groups), axis=0))
    )


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2))) if values.size else 0.0


def _taps(observations: Observations, lags: Sequence[Array]) -> Array:
    """Return the coefficients of each row's past errors: lags x rows; none from before its series."""
    taps = np.zeros((max((one.size for one in lags), default=0), observations.values.size))
    for cell in cells(observations):
        for lag, coefficient in enumerate(lags[int(observations.channel[cell[0]])]):
            taps[lag, cell[lag + 1 :]] = coefficient
    return taps


def _filter(taps: Array, rows: Array) -> Array:
    filtered = rows.copy()
    for lag, weight in enumerate(taps, start=1):
        past = weight[lag:] if rows.ndim == 1 else weight[lag:, None]
        filtered[lag:] -= past * rows[:-lag]
    return filtered


def _with_past(observations: Observations, present: NDArray[np.bool_], lags: Sequence[Array]) -> Indices:
    kept = []
    for cell in cells(observations):
        order = lags[int(observations.channel[cell[0]])].size
        here = present[cell].astype(np.float64)
        complete = lfilter(np.ones(order + 1), [1.0], here)
        full = np.flatnonzero(np.round(complete) == order + 1)
        kept.append(cell[full])
    return np.concatenate(kept).astype(np.intp)


def _fit_lags(observations: Observations, residual: Array, channel: int) -> Array:
    """Return the autoregression of one channel's errors, its order by BIC."""
    table, target = [], []
    for values in (
        residual[cell] for cell in cells(observations) if observations.channel[cell[0]] == channel
    ):
        most = min(STATISTICS.noise.most_lags, values.size // 4)
        if most < STATISTICS.noise.most_lags:
            continue
        columns = [
            values[STATISTICS.noise.most_lags - lag : values.size - lag]
            for lag in range(1, STATISTICS.noise.most_lags + 1)
        ]
        table.append(np.stack(columns, axis=1))
        target.append(values[STATISTICS.noise.most_lags :])
    if not table:
        return np.zeros(0)
    past, now = np.vstack(table), np.concatenate(target)
    good = np.isfinite(past).all(axis=1) & np.isfinite(now)
    past, now = past[good], now[good]
    if now.size < 10 * STATISTICS.noise.most_lags or not np.any(now):
        return np.zeros(0)
    best = np.zeros(0, dtype=np.float64)
    best_score = now.size * math.log(float(np.mean(now**2)))
    for order in range(1, STATISTICS.noise.most_lags + 1):
        coefficients, *_ = np.linalg.lstsq(past[:, :order], now, rcond=None)
        if _rings(coefficients):
            continue
        variance = max(float(np.mean((now - past[:, :order] @ coefficients) ** 2)), 1e-300)
        score = now.size * math.log(variance) + order * math.log(now.size)
        if score < best_score:
            best, best_score = coefficients.astype(np.float64), score
    return best


def _rings(lags: NDArray[np.floating]) -> bool:
    """Return True where the autoregression oscillates, like a system with wrong dynamics in the model."""
    poles = np.roots(np.concatenate(([1.0], -lags)))
    return bool(
        np.any((np.abs(poles) > STATISTICS.noise.ringing) & (np.abs(poles.imag) > 1e-9) & (poles.real > 0.0))
    )


def _blocks(observations: Observations, keep: Indices) -> Indices:
    """Return the stretch of each kept row: whole runs, or parts of them where runs are few."""
    sites = len(observations.groups)
    parts = max(1, math.ceil(STATISTICS.noise.least_blocks / sites))
    share = np.zeros(observations.values.size)
    for cell in cells(observations):
        share[cell] = np.arange(cell.size) / cell.size
    blocks: Indices = (observations.site[keep] * parts + np.floor(share[keep] * parts)).astype(np.intp)
    return blocks
