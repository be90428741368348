"""Confidence of a trace: a logistic regression on the evidence of its strips."""

import math

import numpy as np

from controllers.ftrace.parameters import ConfidenceParameters


def confidence(log_odds: float, parameters: ConfidenceParameters) -> float:
    """Return the probability, 0..1, that the wheel's trace is in view and its angle is within 5 deg.

    Args:
        log_odds: Logarithm of the odds of a trace against bare ground.
        parameters: Fitted numbers.
    """
    return float(1 / (1 + np.exp(-np.clip(parameters.constant + parameters.odds * log_odds, -30.0, 30.0))))


def within(limit: float, sd: float) -> float:
    """Return the probability that a normal error of standard deviation `sd` is smaller than `limit`."""
    return math.erf(limit / (sd * math.sqrt(2.0)))
