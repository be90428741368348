"""Smoother of Rauch, Tung and Striebel: estimates of each moment from the whole drive."""

from collections.abc import Sequence

import numpy as np

from controllers.estimation.filter.guarded_filter import FilterStep
from rover_hil.drives.arrays import Array

Estimate = tuple[Array, Array]
"""State and covariance."""


def smooth(
    steps: Sequence[FilterStep], angles: Sequence[int], last: Estimate | None = None
) -> list[Estimate]:
    """Return state and covariance of every step, given all measurements; the last one stays as it is.

    filterpy's smoother is linear. It smooths the sum of the filter's corrections, carried on by the
    transitions: what is predicted for that sum is linear, and the motion model drops out.

    Args:
        steps: In order of time.
        angles: Indices of the states that are angles in rad; the results are as continuous as the estimates.
        last: The smoothed estimate of the last step, where the drive goes on after it.
    """
    from filterpy.kalman import rts_smoother  # pulls in scipy.stats, about a second

    states = np.array([step.estimate[0] for step in steps])
    covariances = np.array([step.estimate[1] for step in steps])
    corrections = states - np.array([step.predicted[0] for step in steps])
    turned = corrections[:, list(angles)]
    corrections[:, list(angles)] = np.remainder(turned + np.pi, 2.0 * np.pi) - np.pi
    # In units of the greatest deviations, so that states with small variances keep their precision.
    scale = np.sqrt(covariances.diagonal(axis1=1, axis2=2).max(axis=0))
    per_scale = np.outer(1.0 / scale, 1.0 / scale)
    transitions = [step.transition * np.outer(1.0 / scale, scale) for step in steps[1:]]
    sums = [corrections[0] / scale]
    for transition, correction in zip(transitions, corrections[1:], strict=True):
        sums.append(transition @ sums[-1] + correction / scale)
    noises = [
        step.predicted[1] * per_scale - transition @ (covariance * per_scale) @ transition.T
        for step, transition, covariance in zip(steps[1:], transitions, covariances, strict=False)
    ]
    forwards, scaled = np.array(sums), covariances * per_scale
    if last is not None:
        forwards[-1] += (last[0] - states[-1]) / scale
        scaled[-1] = last[1] * per_scale
    backwards, spreads, *_ = rts_smoother(forwards, scaled, transitions, noises)
    smoothed = states + (backwards - np.array(sums)) * scale
    spreads = 0.5 * (spreads + spreads.transpose(0, 2, 1)) / per_scale
    return list(zip(smoothed, spreads, strict=True))
