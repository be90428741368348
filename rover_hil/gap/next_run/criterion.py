"""How well a run separates explanations: Box and Hill (1967), with one vote per run."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from rover_hil.gap.next_run.prediction import Prediction
from sim_backends.models.interface import Array

VOTE = 8.0
"""Divergence of two equally wide normal distributions, over minus the logarithm of their overlap."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Separation:
    """How far apart the predictions of a run are.

    Attributes:
        divergence: Box and Hill's expected gain of information: that of each pair of explanations, weighted
            by both of their probabilities.
        votes: The same where a pair counts at most once: with one minus the overlap of its predictions.
        distances: Distance of the predictions of each pair, in standard deviations by parameters, unknowns of
            the run, model error and noise.
    """

    divergence: float
    votes: float
    distances: Array


def separation_of(predictions: Sequence[Prediction], weights: Sequence[float]) -> Separation:
    """Return the separation of explanations by one run."""
    covariances = [one.covariance() for one in predictions]
    inverses = [np.linalg.inv(one) for one in covariances]
    divergence, votes = 0.0, 0.0
    distances = np.zeros((len(predictions), len(predictions)))
    for one, other in combinations(range(len(predictions)), 2):
        apart = predictions[one].mean - predictions[other].mean
        both = inverses[one] + inverses[other]
        trace = float(np.sum(covariances[one] * inverses[other]) + np.sum(covariances[other] * inverses[one]))
        gain = 0.5 * max(trace - 2.0 * apart.size, 0.0) + 0.5 * float(apart @ both @ apart)
        pair = weights[one] * weights[other]
        divergence += pair * gain
        votes += 2.0 * pair * (1.0 - float(np.exp(-gain / VOTE)))
        middle = 0.5 * (covariances[one] + covariances[other])
        far = float(np.sqrt(max(float(apart @ np.linalg.solve(middle, apart)), 0.0)))
        distances[one, other] = distances[other, one] = far
    return Separation(divergence=divergence, votes=votes, distances=distances)
