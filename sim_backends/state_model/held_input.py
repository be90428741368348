"""Inputs between samples: held or interpolated, delayed and smoothed."""

import numpy as np

from sim_backends.models.interface import Array


def mean_over_steps(samples: Array, step_s: float, delay_s: Array, substeps: int, *, is_held: bool) -> Array:
    """Return the mean of an input over each integration step.

    A sampled input that is held changes in jumps. Its mean over a step depends smoothly on the delay, so
    that the delay can be fitted.

    Args:
        samples: Values at the sample times: runs x samples.
        step_s: Time between samples.
        delay_s: One per point; 0 or more.
        substeps: Integration steps per sample.
        is_held: Held from each sample to the next; otherwise interpolated.

    Returns:
        points x runs x steps. Before the first sample the input had its first value.
    """
    count = (samples.shape[1] - 1) * substeps
    width_s = step_s / substeps
    begin = np.arange(count) * width_s - delay_s[:, None]
    if not is_held:
        return _interpolated(samples, (begin + 0.5 * width_s) / step_s)
    integral = np.concatenate((np.zeros((samples.shape[0], 1)), np.cumsum(samples, axis=1)), axis=1) * step_s
    before = samples[:, :1] * np.minimum(begin, 0.0)[:, None, :]
    before_end = samples[:, :1] * np.minimum(begin + width_s, 0.0)[:, None, :]
    first = _interpolated(integral, begin / step_s) + before
    last = _interpolated(integral, (begin + width_s) / step_s) + before_end
    mean: Array = (last - first) / width_s
    return mean


def _interpolated(samples: Array, place: Array) -> Array:
    """Return values at fractional sample numbers, points x steps -> points x runs x steps."""
    clipped = np.clip(place, 0.0, samples.shape[1] - 1.0)
    index = np.minimum(clipped.astype(np.intp), samples.shape[1] - 2)
    share = (clipped - index)[:, None, :]
    low = np.moveaxis(samples[:, index], 1, 0)
    high = np.moveaxis(samples[:, index + 1], 1, 0)
    values: Array = low + share * (high - low)
    return values


def delayed(samples: Array, delay_steps: Array) -> Array:
    """Return series, points x runs x samples, each point delayed by a number of samples >= 0."""
    place = np.arange(samples.shape[2])[None, :] - delay_steps[:, None]
    clipped = np.clip(place, 0.0, samples.shape[2] - 1.0)
    index = np.minimum(clipped.astype(np.intp), samples.shape[2] - 2)
    share = (clipped - index)[:, None, :]
    index = np.broadcast_to(index[:, None, :], (index.shape[0], *samples.shape[1:]))
    full = np.broadcast_to(samples, index.shape)
    low = np.take_along_axis(full, index, axis=2)
    high = np.take_along_axis(full, index + 1, axis=2)
    values: Array = low + share * (high - low)
    return values


def lagged(series: Array, step_s: float, time_constant_s: Array) -> Array:
    """Return an input behind a first-order lag that starts settled, as its mean over each integration step.

    Args:
        series: Means over the steps: 1 or points x runs x steps. The input is constant during a step.
        step_s: Duration of a step.
        time_constant_s: One per point; 0 or more.
    """
    ratio = np.maximum(time_constant_s / step_s, 1e-300)[:, None]
    keep = np.exp(-1.0 / ratio)
    inside = ratio * (1.0 - keep)
    full = np.broadcast_to(series, (keep.shape[0], *series.shape[1:]))
    mean = np.empty(full.shape)
    value = full[..., 0].copy()
    for step in range(full.shape[2]):
        difference = value - full[..., step]
        mean[..., step] = full[..., step] + inside * difference
        value = full[..., step] + keep * difference
    return mean


def lagged_samples(samples: Array, step_s: float, time_constant_s: Array) -> Array:
    """Return a measured series behind a first-order lag that starts settled.

    Args:
        samples: At the sample times: 1 or points x runs x samples; straight lines between.
        step_s: Time between samples.
        time_constant_s: One per point; 0 or more.
    """
    ratio = np.maximum(time_constant_s / step_s, 1e-300)[:, None]
    keep = np.exp(-1.0 / ratio)
    behind = ratio * (1.0 - keep)
    full = np.broadcast_to(samples, (keep.shape[0], *samples.shape[1:]))
    smoothed = np.empty(full.shape)
    value = full[..., 0].copy()
    smoothed[..., 0] = value
    for sample in range(1, full.shape[2]):
        before, now = full[..., sample - 1], full[..., sample]
        value = now - behind * (now - before) + keep * (value - before)
        smoothed[..., sample] = value
    return smoothed


def played(series: Array, half_play: Array) -> Array:
    """Return a series, points x runs x steps, behind a play: it stays until the signal is that far away.

    Args:
        series: The signal: 1 or points x runs x steps.
        half_play: One per point; 0 or more.
    """
    half = half_play[:, None]
    full = np.broadcast_to(series, (half.shape[0], *series.shape[1:]))
    behind = np.empty(full.shape)
    value = full[..., 0].copy()
    for step in range(full.shape[2]):
        value = np.clip(value, full[..., step] - half, full[..., step] + half)
        behind[..., step] = value
    return behind
