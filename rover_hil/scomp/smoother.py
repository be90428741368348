"""Smoother of Rauch, Tung and Striebel: estimates of each moment from the whole drive."""

from collections.abc import Sequence

import numpy as np

from controllers.slip.scomp.filter import FilterStep
from rover_hil.datasets.arrays import Array


def smooth(steps: Sequence[FilterStep], angles: Sequence[int]) -> list[tuple[Array, Array]]:
    """Return state and covariance of every step, given all measurements; the last one stays as it is.

    Args:
        steps: In order of time.
        angles: Indices of the states that are angles in rad; the results are as continuous as the estimates.
    """
    state, covariance = steps[-1].estimate
    smoothed = [(state, covariance)]
    for after, step in zip(reversed(steps), reversed(steps[:-1]), strict=False):
        filtered, spread = step.estimate
        predicted, predicted_spread = after.predicted
        # Scaled to correlations, so that states with small variances keep their precision.
        scale = np.sqrt(np.diag(predicted_spread))
        correlation = predicted_spread / np.outer(scale, scale)
        gain = np.linalg.solve(correlation, (after.transition @ spread) / scale[:, None]).T / scale
        off = state - predicted
        off[list(angles)] = np.remainder(off[list(angles)] + np.pi, 2.0 * np.pi) - np.pi
        state = filtered + gain @ off
        covariance = spread + gain @ (covariance - predicted_spread) @ gain.T
        covariance = 0.5 * (covariance + covariance.T)
        smoothed.append((state, covariance))
    smoothed.reverse()
    return smoothed
