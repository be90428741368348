"""Inputs between samples: held or interpolated, delayed and smoothed.

Series are points x runs x samples (or steps), of one point where they are the same at all; times are runs x
samples, of one run where they are the same in all.
"""

import numpy as np

from sim_backends.models.interface import Array


def mean_over_steps(samples: Array, times_s: Array, delay_s: Array, substeps: int, *, is_held: bool) -> Array:
    """Return the mean of an input over each integration step.

    A sampled input that is held changes in jumps. Its mean over a step depends smoothly on the delay, so
    that the delay can be fitted.

    Args:
        samples: Values at the sample times: runs x samples.
        times_s: Of the samples.
        delay_s: One per point; 0 or more.
        substeps: Integration steps per sample.
        is_held: Held from each sample to the next; otherwise interpolated.

    Returns:
        points x runs x steps. Before the first sample the input had its first value.
    """
    late = delay_s[:, None, None]
    lengths = np.diff(times_s)
    widths = np.repeat(lengths, substeps, axis=1) / substeps
    edges = (times_s[:, :-1, None] + lengths[:, :, None] * (np.arange(substeps) / substeps)).reshape(
        times_s.shape[0], -1
    )
    edges = np.concatenate((edges, times_s[:, -1:]), axis=1)
    if not is_held:
        return _interpolated(samples[None], times_s, edges[:, :-1] + 0.5 * widths - late)
    integral = np.cumsum(samples[:, :-1] * lengths, axis=1)
    integral = np.concatenate((np.zeros((samples.shape[0], 1)), integral), axis=1)
    before = samples[:, :1] * np.minimum(edges - late, 0.0)
    found: Array = np.diff(_interpolated(integral[None], times_s, edges - late) + before) / widths
    return found


def _interpolated(series: Array, times_s: Array, at_s: Array) -> Array:
    """Return series at other times, points x runs x times; the ends hold."""
    runs = series.shape[1]
    points = max(series.shape[0], at_s.shape[0])
    at_s = np.broadcast_to(at_s, (points, runs, at_s.shape[2]))
    times_s = np.broadcast_to(times_s, (runs, times_s.shape[1]))
    found = np.empty(at_s.shape)
    for run in range(runs):
        if series.shape[0] == 1:
            found[:, run] = np.interp(at_s[:, run], times_s[run], series[0, run])
        else:
            for point in range(points):
                found[point, run] = np.interp(at_s[point, run], times_s[run], series[point, run])
    return found


def delayed(samples: Array, times_s: Array, delay_s: Array) -> Array:
    """Return series at the samples, each point delayed by a time >= 0."""
    return _interpolated(samples, times_s, times_s - delay_s[:, None, None])


def lagged(series: Array, widths_s: Array, time_constant_s: Array) -> Array:
    """Return an input behind a first-order lag that starts settled, as its mean over each integration step.

    Args:
        series: Means over the steps. The input is constant during a step.
        widths_s: Duration of each step: runs x steps.
        time_constant_s: One per point; 0 or more.
    """
    keep, inside = _decay(widths_s, time_constant_s)
    full = np.broadcast_to(series, (keep.shape[0], *series.shape[1:]))
    mean = np.empty(full.shape)
    value = full[..., 0].copy()
    for step in range(full.shape[2]):
        difference = value - full[..., step]
        mean[..., step] = full[..., step] + inside[..., step] * difference
        value = full[..., step] + keep[..., step] * difference
    return mean


def lagged_samples(samples: Array, widths_s: Array, time_constant_s: Array) -> Array:
    """Return a measured series behind a first-order lag that starts settled.

    Args:
        samples: At the sample times; straight lines between.
        widths_s: Time between samples: runs x samples less one.
        time_constant_s: One per point; 0 or more.
    """
    keep, behind = _decay(widths_s, time_constant_s)
    full = np.broadcast_to(samples, (keep.shape[0], *samples.shape[1:]))
    smoothed = np.empty(full.shape)
    value = full[..., 0].copy()
    smoothed[..., 0] = value
    for sample in range(1, full.shape[2]):
        before, now, step = full[..., sample - 1], full[..., sample], sample - 1
        value = now - behind[..., step] * (now - before) + keep[..., step] * (value - before)
        smoothed[..., sample] = value
    return smoothed


def _decay(widths_s: Array, time_constant_s: Array) -> tuple[Array, Array]:
    """Return what is left of a difference after each step, and its mean during it: points x runs x steps."""
    ratio = np.maximum(time_constant_s[:, None, None] / widths_s, 1e-300)
    keep = np.exp(-1.0 / ratio)
    return keep, ratio * (1.0 - keep)


def played(series: Array, half_play: Array) -> Array:
    """Return a series behind a play: it stays until the signal is that far away.

    Args:
        series: The signal.
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
