"""What errors look like, as a transformation after which they are independent and of unit size."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from rover_hil.gap.problem import Indices, Observations, cells
from rover_hil.gap.replicates import Scatter
from sim_backends.models.interface import Array, Channel

MOST_LAGS = 8
HUBER_SD = 2.5
LEAST_BLOCKS = 24


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
        """Stretch of data of each whitened row; errors of two stretches are independent."""
        ...

    def whiten(self, rows: Array) -> Array:
        """Return rows, or columns of rows, in units of independent standard errors."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class SteadyNoise:
    """Errors of group means: scatter over the number of runs, and what replicates share."""

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


def steady_noise(seen: Observations, scatter: Scatter) -> SteadyNoise:
    """Return the errors of the means of `seen`."""
    size = seen.values.size
    matrix = np.zeros((size, size))
    row_sd = np.zeros(size)
    for index in range(len(seen.groups)):
        rows = np.flatnonzero(seen.site == index)
        channels = seen.channel[rows]
        single = scatter.covariance[index][np.ix_(channels, channels)]
        counts = seen.counts[rows]
        covariance = single / np.sqrt(counts[:, None] * counts[None, :])
        shared = [_shared_variance(seen.channels[c], float(single[i, i])) for i, c in enumerate(channels)]
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
        site=seen.site,
        channel=seen.channel,
        block=seen.site,
    )


def _shared_variance(channel: Channel, variance: float) -> float:
    """Return the variance of what replicates have in common: the model's own error, and rounding.

    Where the scatter is small beside the step, all replicates are rounded the same way; the correlation of
    two rounding errors is exp(-(2 pi sd / step)^2) (characteristic function of the scatter).
    """
    if channel.quantum <= 0.0:
        return channel.tolerance**2
    alike = math.exp(-((2.0 * math.pi / channel.quantum) ** 2) * variance)
    return channel.tolerance**2 + channel.quantum**2 / 12.0 * alike


@dataclass(frozen=True, slots=True, kw_only=True)
class SeriesNoise:
    """Errors of series: autoregressive per channel, heavy tails weighted down.

    Attributes:
        lags: Coefficients of past errors, per channel.
        innovation_sd: Of what is new in each error, per channel.
        keep: Rows that have all their past.
        scale: Factor of each kept row.
    """

    seen: Observations
    lags: tuple[Array, ...]
    innovation_sd: Array
    keep: Indices
    scale: Array
    row_sd: Array
    freedom: float
    site: Indices
    channel: Indices
    block: Indices

    def whiten(self, rows: Array) -> Array:
        """Return independent standard errors of the rows that have all their past."""
        filtered = _filter(self.seen, self.lags, rows)[self.keep]
        return filtered * (self.scale if rows.ndim == 1 else self.scale[:, None])


def series_noise(seen: Observations, residual: Array, *, is_final: bool = True) -> SeriesNoise:
    """Learn the errors from what is left between measurement and model.

    Args:
        seen: The observations.
        residual: Measured minus predicted; NaN where either is missing.
        is_final: Weight down what lies far out. Not before effects are out of the residual: an effect that
            acts now and then, like a delay, looks like heavy tails.
    """
    lags = tuple(_fit_lags(seen, residual, index) for index in range(len(seen.channels)))
    filled = np.where(np.isfinite(residual), residual, 0.0)
    innovations = _filter(seen, lags, filled)
    keep = _with_past(seen, np.isfinite(residual), lags)
    weight = np.ones(innovations.size)
    sigma = np.zeros(len(seen.channels))
    row_sd = np.zeros(innovations.size)
    for index, channel in enumerate(seen.channels):
        mine = keep[seen.channel[keep] == index]
        weight[mine], sigma[index] = _weigh(innovations[mine], channel, is_final=is_final)
        row_sd[seen.channel == index] = _rms(filled[(seen.channel == index) & np.isfinite(residual)])
    scale = np.sqrt(weight[keep]) / sigma[seen.channel[keep]]
    return SeriesNoise(
        seen=seen,
        lags=lags,
        innovation_sd=sigma,
        keep=keep,
        scale=scale,
        row_sd=row_sd,
        freedom=math.inf,
        site=seen.site[keep],
        channel=seen.channel[keep],
        block=_blocks(seen, keep),
    )


def _weigh(innovations: Array, channel: Channel, *, is_final: bool) -> tuple[Array, float]:
    """Return Huber's weights and the deviation that makes weighted scores of unit size."""
    floor = max(channel.quantum / math.sqrt(12.0), (channel.sigma or 0.0), 1e-297) * 1e-3
    median = 1.4826 * float(np.median(np.abs(innovations))) if innovations.size else 0.0
    spread = max(median, 1e-3 * _rms(innovations), floor)
    weight = np.ones(innovations.size)
    if is_final:
        weight = np.minimum(1.0, HUBER_SD * spread / np.maximum(np.abs(innovations), 1e-300))
    # With weights w the squares of a score are w^2 e^2 where its information counts w: this ratio.
    variance = float(np.sum((weight * innovations) ** 2) / max(float(np.sum(weight)), 1e-300))
    return weight, max(math.sqrt(variance), floor)


def for_other_runs(noise: Noise, scatter: Scatter | None, seen: Observations) -> Noise:
    """Return the same kind and size of errors for observations that were not learned from."""
    if isinstance(noise, SeriesNoise):
        present = np.isfinite(seen.values)
        keep = _with_past(seen, present, noise.lags)
        return replace(
            noise,
            seen=seen,
            keep=keep,
            scale=1.0 / noise.innovation_sd[seen.channel[keep]],
            site=seen.site[keep],
            channel=seen.channel[keep],
            block=_blocks(seen, keep),
        )
    if scatter is None:
        raise AssertionError("steady errors come with the scatter of replicates")
    mean = scatter.covariance.mean(axis=0, keepdims=True)
    return steady_noise(seen, replace(scatter, covariance=np.repeat(mean, len(seen.groups), axis=0)))


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2))) if values.size else 0.0


def _filter(seen: Observations, lags: Sequence[Array], rows: Array) -> Array:
    filtered = np.empty_like(rows)
    for cell in cells(seen):
        part = slice(int(cell[0]), int(cell[-1]) + 1)
        taps = np.concatenate(([1.0], -lags[int(seen.channel[cell[0]])]))
        filtered[part] = lfilter(taps, [1.0], rows[part], axis=0)
    return filtered


def _with_past(seen: Observations, present: NDArray[np.bool_], lags: Sequence[Array]) -> Indices:
    kept = []
    for cell in cells(seen):
        order = lags[int(seen.channel[cell[0]])].size
        here = present[cell].astype(np.float64)
        complete = lfilter(np.ones(order + 1), [1.0], here)
        full = np.flatnonzero(np.round(complete) == order + 1)
        kept.append(cell[full])
    return np.concatenate(kept).astype(np.intp)


def _fit_lags(seen: Observations, residual: Array, channel: int) -> Array:
    """Return the autoregression of one channel's errors, its order by BIC."""
    table, target = [], []
    for values in (residual[cell] for cell in cells(seen) if seen.channel[cell[0]] == channel):
        most = min(MOST_LAGS, values.size // 4)
        if most < MOST_LAGS:
            continue
        columns = [values[MOST_LAGS - lag : values.size - lag] for lag in range(1, MOST_LAGS + 1)]
        table.append(np.stack(columns, axis=1))
        target.append(values[MOST_LAGS:])
    if not table:
        return np.zeros(0)
    past, now = np.vstack(table), np.concatenate(target)
    good = np.isfinite(past).all(axis=1) & np.isfinite(now)
    past, now = past[good], now[good]
    if now.size < 10 * MOST_LAGS or not np.any(now):
        return np.zeros(0)
    best = np.zeros(0, dtype=np.float64)
    best_score = now.size * math.log(float(np.mean(now**2)))
    for order in range(1, MOST_LAGS + 1):
        coefficients, *_ = np.linalg.lstsq(past[:, :order], now, rcond=None)
        left = max(float(np.mean((now - past[:, :order] @ coefficients) ** 2)), 1e-300)
        score = now.size * math.log(left) + order * math.log(now.size)
        if score < best_score:
            best, best_score = coefficients.astype(np.float64), score
    return best


def _blocks(seen: Observations, keep: Indices) -> Indices:
    """Return the stretch of each kept row: whole runs, or parts of them where runs are few."""
    sites = len(seen.groups)
    parts = max(1, math.ceil(LEAST_BLOCKS / sites))
    share = np.zeros(seen.values.size)
    for cell in cells(seen):
        share[cell] = np.arange(cell.size) / cell.size
    blocks: Indices = (seen.site[keep] * parts + np.floor(share[keep] * parts)).astype(np.intp)
    return blocks
