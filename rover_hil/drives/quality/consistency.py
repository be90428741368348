"""Whether the covariance of an estimate agrees with its errors: one judgement for every command."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

CONFIDENCE = 0.95
LEAST_SHARE_INSIDE = 0.8
"""Of the errors within their 95 % region; fewer, and the covariance is too small."""
LEAST_ERRORS = 6
FREEDOM = 3
"""The errors of one drive add up and count as one error of x, y and yaw."""
MOST_TOO_LARGE = 100.0
"""The greatest factor that is reported."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Consistency:
    """Errors compared with their covariance.

    Attributes:
        count: Number of errors.
        inside: Share of them in the 95 % region of the estimate.
        growth: Factor by which the standard deviations are too small; below 1, too large.
        interval: Least and greatest growth, 95 %.
    """

    count: int
    inside: float
    growth: float
    interval: tuple[float, float]

    @property
    def is_decided(self) -> bool:
        """Whether there are enough errors."""
        return self.count >= LEAST_ERRORS

    @property
    def is_too_small(self) -> bool:
        """Whether the covariance is too small, beyond chance."""
        return self.is_decided and self.inside < LEAST_SHARE_INSIDE and self.interval[0] > 1.0

    @property
    def is_too_large(self) -> bool:
        """Whether the covariance is too large, beyond chance."""
        return self.is_decided and self.interval[1] < 1.0

    def words(self, what: str) -> str:
        """Return whether the covariance holds; `what` is compared, in the plural."""
        if not self.is_decided:
            return f"not decided: {self.count} {what}, {LEAST_ERRORS} are needed"
        share = f"{100 * self.inside:.0f} % of the {what} lie in their 95 % region"
        if self.is_too_small:
            return f"too small by a factor of {self.growth:.1f}: {share}"
        if self.is_too_large:
            return (
                f"too large by a factor of {min(MOST_TOO_LARGE, 1.0 / max(self.growth, 1e-9)):.1f}: {share}"
            )
        return f"holds: {share}"


def consistency(nees: Sequence[float], dimensions: Sequence[int], drives: int) -> Consistency:
    """Return how errors and covariance agree.

    Args:
        nees: Squared errors over their covariance; expected are `dimensions`.
        dimensions: Of each error.
        drives: Number of drives that they are from.
    """
    if not nees or not drives:
        return Consistency(count=0, inside=math.nan, growth=math.nan, interval=(math.nan, math.nan))
    bounds = {size: float(chi2.ppf(CONFIDENCE, size)) for size in set(dimensions)}
    inside = [each <= bounds[size] for each, size in zip(nees, dimensions, strict=True)]
    growth = math.sqrt(np.mean([each / size for each, size in zip(nees, dimensions, strict=True)]))
    freedom = FREEDOM * drives
    low, high = (
        growth * math.sqrt(freedom / float(chi2.ppf(0.5 + sign * 0.5 * CONFIDENCE, freedom)))
        for sign in (1.0, -1.0)
    )
    return Consistency(count=len(nees), inside=float(np.mean(inside)), growth=growth, interval=(low, high))
