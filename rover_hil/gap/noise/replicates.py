"""Scatter of steady experiments, estimated from replicates alone and independent of any model.

The covariance of the channels of one run is

    diag(a_c^2 + (b_c m_c)^2) + sum_k tau_k^2 g_k g_k^T

with m the measured mean and g_k the model's change per unit of condition k: settings are never reproduced
exactly, and such an error moves all channels together, most where the model is steep. The variances are
fitted to the differences between replicates by restricted maximum likelihood; AICc decides on the
second term.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize

from rover_hil.gap.data.problem import Group, Indices
from rover_hil.gap.noise.parameters import STATISTICS
from sim_backends.models.interface import Array, Channel, Run

FLOOR_SHARE = 1e-6
"""Added to a covariance of channels, over their variance, so that it can be inverted."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Scatter:
    """Scatter of replicates.

    Attributes:
        covariance: Of the channels of one run, for each group: groups x channels x channels.
        freedom: Degrees of freedom behind each channel's variance; infinite where the sensor's is given.
    """

    covariance: Array
    freedom: Array


@dataclass(frozen=True, slots=True)
class _Evidence:
    deviations: Array
    """Runs x channels, from the mean of their group; NaN where not measured."""
    group: Indices
    means: Array
    """Groups x channels."""
    counts: Array
    """Runs of each group."""


def pooled_freedom(groups: Sequence[Group], channels: Sequence[Channel]) -> Array:
    """Return the number of differences between replicates per channel."""
    return np.array(
        [
            sum(max(0, sum(1 for run in group.runs if item.name in run.measured) - 1) for group in groups)
            for item in channels
        ],
        dtype=np.float64,
    )


def estimate_scatter(groups: Sequence[Group], channels: Sequence[Channel], gradient: Array) -> Scatter:
    """Fit the variances.

    Args:
        groups: Runs under equal conditions.
        channels: What was measured.
        gradient: The model's change per unit of each condition: groups x channels x conditions.

    Returns:
        The scatter; a channel with too few replicates keeps the sensor's own deviation.
    """
    evidence = _gather(groups, channels)
    freedom = pooled_freedom(groups, channels)
    known = np.array([item.noise_sd for item in channels])
    learned = freedom >= STATISTICS.replicates.least_freedom
    floors = np.array([max(item.quantum**2 / 12.0, 0.0) for item in channels])
    covariance = np.zeros((len(groups), len(channels), len(channels)))
    if learned.any():
        chosen = np.flatnonzero(learned)
        of_chosen = replace(
            evidence, deviations=evidence.deviations[:, chosen], means=evidence.means[:, chosen]
        )
        part = _fit(of_chosen, gradient[:, chosen], floors[chosen])
        covariance[np.ix_(np.arange(len(groups)), chosen, chosen)] = part
    for index in np.flatnonzero(~learned):
        covariance[:, index, index] = known[index] ** 2
    return Scatter(covariance=covariance, freedom=np.where(learned, freedom, np.inf))


def winsorise(groups: Sequence[Group], channels: Sequence[Channel], scatter: Scatter) -> list[Run]:
    """Return all runs, values limited to some deviations from the median of their replicates."""
    runs = []
    for index, group in enumerate(groups):
        clipped = {}
        for place, item in enumerate(channels):
            values = [run.measured[item.name][0] for run in group.runs if item.name in run.measured]
            if len(values) < 3:
                continue
            reach = STATISTICS.replicates.clip_sd * math.sqrt(scatter.covariance[index, place, place])
            clipped[item.name] = (np.median(values) - reach, np.median(values) + reach)
        runs += [
            replace(
                run,
                measured={
                    name: np.clip(values, *clipped[name]) if name in clipped else values
                    for name, values in run.measured.items()
                },
            )
            for run in group.runs
        ]
    return runs


def group_covariance(channels: Sequence[Channel], single: Array, counts: Array) -> Array:
    """Return the covariance of the means of a group of replicates."""
    mean = single / np.sqrt(counts[:, None] * counts[None, :])
    shared = [_shared_variance(one, float(single[place, place])) for place, one in enumerate(channels)]
    covariance: Array = mean + np.diag(shared)
    return covariance


def _shared_variance(channel: Channel, variance: float) -> float:
    """Return the variance that replicates have in common: the model's own error, and rounding.

    Where the scatter is small against the step, all replicates are rounded alike; the correlation of
    two rounding errors is exp(-(2 pi sd / step)^2) (characteristic function of the scatter).
    """
    if channel.quantum <= 0.0:
        return channel.tolerance**2
    alike = math.exp(-((2.0 * math.pi / channel.quantum) ** 2) * variance)
    return channel.tolerance**2 + channel.quantum**2 / 12.0 * alike


def _gather(groups: Sequence[Group], channels: Sequence[Channel]) -> _Evidence:
    table = [
        [
            [run.measured[item.name][0] if item.name in run.measured else math.nan for item in channels]
            for run in group.runs
        ]
        for group in groups
    ]
    means = np.array([_nan_mean(np.array(rows)) for rows in table])
    deviations = np.vstack([np.array(rows) - means[index] for index, rows in enumerate(table)])
    counts = np.array([len(rows) for rows in table])
    return _Evidence(deviations, np.repeat(np.arange(len(groups)), counts), means, counts.astype(np.float64))


def _nan_mean(rows: Array) -> Array:
    present = np.isfinite(rows)
    total = np.where(present, rows, 0.0).sum(axis=0)
    mean: Array = total / np.maximum(present.sum(axis=0), 1)
    return mean


def _fit(evidence: _Evidence, gradient: Array, floors: Array) -> Array:
    """Return the covariance of each group."""
    complete = bool(np.isfinite(evidence.deviations).all())
    scale = np.sqrt(np.maximum(_pooled(evidence), np.maximum(floors, 1e-300)))
    unit = _Unit(evidence, gradient, scale, floors)
    sensible = [k for k in range(gradient.shape[2]) if complete and np.abs(gradient[:, :, k]).max() > 0.0]
    if pooled_count(evidence) < STATISTICS.replicates.many * (gradient.shape[1] + len(sensible)):
        sensible = []
    plain, relative = unit.fit(False, sensible), unit.fit(True, sensible)
    return relative[1] if relative[0] < plain[0] else plain[1]


def pooled_count(evidence: _Evidence) -> float:
    """Return the number of differences between replicates over all channels."""
    return float((evidence.counts - 1.0).sum()) * float(evidence.deviations.shape[1])


def _pooled(evidence: _Evidence) -> Array:
    """Return the pooled variance within groups, per channel."""
    present = np.isfinite(evidence.deviations)
    squares = np.where(present, evidence.deviations, 0.0) ** 2
    within = np.array(
        [
            np.bincount(evidence.group[present[:, c]], minlength=len(evidence.counts))
            for c in range(squares.shape[1])
        ]
    )
    pooled: Array = squares.sum(axis=0) / np.maximum(np.maximum(within - 1, 0).sum(axis=1), 1)
    return pooled


class _Unit:
    """The likelihood of the replicates, each channel in units of its pooled deviation."""

    def __init__(self, evidence: _Evidence, gradient: Array, scale: Array, floors: Array) -> None:
        self._scale = scale
        self._means = np.abs(evidence.means) / scale
        level = np.maximum(np.sqrt((self._means**2).mean(axis=0)), 1e-12)
        self._means = self._means / level
        self._gradient = gradient / scale[None, :, None]
        self._floors = floors / scale**2
        deviations = np.where(np.isfinite(evidence.deviations), evidence.deviations, 0.0) / scale
        groups = len(evidence.counts)
        self._scatter = np.zeros((groups, scale.size, scale.size))
        np.add.at(self._scatter, evidence.group, deviations[:, :, None] * deviations[:, None, :])
        self._freedom = np.maximum(evidence.counts - 1.0, 0.0)

    def fit(self, with_relative: bool, settings: Sequence[int]) -> tuple[float, Array]:
        """Return AICc, and covariances in the units of the channels."""
        channels = self._scale.size
        steep = [max(float(np.sqrt((self._gradient[:, :, k] ** 2).mean())), 1e-12) for k in settings]
        start = np.concatenate(
            (
                np.full(channels, math.log(0.7)),
                np.full(channels if with_relative else 0, math.log(0.5)),
                [math.log(0.5 / one) for one in steep],
            )
        )

        bounds = [(centre - 6.0, centre + 3.0) for centre in start]
        result = minimize(
            self._cost, start, args=(with_relative, settings), jac=True, method="L-BFGS-B", bounds=bounds
        )
        covariance = self._covariance(result.x, with_relative, settings)
        free, count = start.size, float(self._freedom.sum()) * channels
        penalty = 2.0 * free * count / max(count - free - 1.0, 1.0)
        return float(result.fun) + penalty, covariance * self._scale[:, None] * self._scale[None, :]

    def _cost(self, logs: Array, with_relative: bool, settings: Sequence[int]) -> tuple[float, Array]:
        """Return minus two log-likelihood and its slope."""
        covariance = self._covariance(logs, with_relative, settings)
        inverse = np.linalg.inv(covariance)
        explained = inverse @ self._scatter
        fit = np.trace(explained, axis1=1, axis2=2).sum()
        cost = float(self._freedom @ np.linalg.slogdet(covariance)[1] + fit)
        slope = self._freedom[:, None, None] * inverse - explained @ inverse
        own = slope.diagonal(axis1=1, axis2=2)
        channels = self._scale.size
        squares = np.exp(2.0 * logs)
        parts = [np.where(squares[:channels] > self._floors, squares[:channels], 0.0) * own.sum(axis=0)]
        if with_relative:
            parts.append(squares[channels : 2 * channels] * (own * self._means**2).sum(axis=0))
        steep = self._gradient[:, :, list(settings)]
        along = np.einsum("gik,gij,gjk->k", steep, slope, steep)
        parts.append(squares[logs.size - len(settings) :] * along)
        return cost, 2.0 * np.concatenate(parts)

    def _covariance(self, logs: Array, with_relative: bool, settings: Sequence[int]) -> Array:
        channels = self._scale.size
        variance = np.maximum(np.exp(2.0 * logs[:channels]), self._floors) * np.ones_like(self._means)
        if with_relative:
            variance = variance + np.exp(2.0 * logs[channels : 2 * channels]) * self._means**2
        covariance = variance[:, :, None] * np.eye(channels)
        spread = np.exp(logs[logs.size - len(settings) :])
        for place, k in enumerate(settings):
            steep = self._gradient[:, :, k] * spread[place]
            covariance = covariance + steep[:, :, None] * steep[:, None, :]
        regular: Array = covariance + FLOOR_SHARE * np.eye(channels)
        return regular
