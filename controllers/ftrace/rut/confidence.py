"""Confidence of an angle: a logistic regression on the quality of the curve."""

from dataclasses import dataclass

import numpy as np

from controllers.ftrace.parameters import ConfidenceParameters


@dataclass(frozen=True, slots=True, kw_only=True)
class CurveQuality:
    """Predictors of the error of a curve.

    Attributes:
        spread_m: Spread of the curves that fit about as well.
        residual_m: Scatter of the blocks about the curve.
        bend_rad: Change of direction along the curve.
    """

    spread_m: float
    residual_m: float
    bend_rad: float


def confidence(quality: CurveQuality, parameters: ConfidenceParameters) -> float:
    """Return the probability, 0..1, that the error of the angle is below 5 deg."""
    slopes = parameters.spread, parameters.residual, parameters.bend
    least = np.array([parameters.least_m, parameters.least_m, parameters.least_bend_rad])
    values = np.array([quality.spread_m, quality.residual_m, quality.bend_rad])
    return float(1 / (1 + np.exp(-parameters.constant - np.dot(slopes, np.log(values + least)))))
