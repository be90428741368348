"""Numbers with their interval."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import t as student

CONFIDENCE = 0.95
LEAST_DRIVES = 4
"""With fewer drives every part of a drive counts as one observation."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Interval:
    """A mean with its 95 % interval.

    Attributes:
        value: The mean; NaN without an observation.
        low, high: The interval; infinite with one observation.
        count: Number of observations.
    """

    value: float
    low: float
    high: float
    count: int

    @property
    def is_known(self) -> bool:
        """Whether there is an interval."""
        return math.isfinite(self.high)

    def agrees_with(self, other: "Interval") -> bool:
        """Return whether both are known, and one contains the mean of the other."""
        return (
            self.is_known
            and other.is_known
            and (self.low <= other.value <= self.high or other.low <= self.value <= other.high)
        )

    def times(self, factor: float) -> "Interval":
        """Return it in another unit."""
        low, high = sorted((factor * self.low, factor * self.high))
        return replace(self, value=factor * self.value, low=low, high=high)

    def words(self, unit: str) -> str:
        """Return value and interval with a unit."""
        if self.count == 0:
            return "not known"
        value = f"{short(self.value)} {unit}"
        if not self.is_known:
            return f"{value} (a single observation, no interval)"
        return f"{value} (95 %: {short(self.low)} to {short(self.high)})"


def short(value: float) -> str:
    """Return a number with two digits at least, without an exponent unless it is small; "-" where unknown."""
    if not math.isfinite(value):
        return "-"
    return f"{value:.0f}" if abs(value) >= 10.0 else f"{value:.2g}"


def mean_of(
    parts: Sequence[Sequence[float]], least: float = -math.inf, *, is_of_next: bool = False
) -> Interval:
    """Return the mean of observations; `parts` are those of each drive.

    Observations of one drive have errors in common. With `LEAST_DRIVES` drives or more the mean of each drive
    is one observation.

    Args:
        parts: The observations.
        least: No mean can be smaller.
        is_of_next: The interval contains a further observation, not the mean.
    """
    drives = [list(each) for each in parts if len(each)]
    values = [value for each in drives for value in each]
    if len(drives) >= LEAST_DRIVES:
        values = [float(np.mean(each)) for each in drives]
    if not values:
        return Interval(value=math.nan, low=math.nan, high=math.nan, count=0)
    mean, count = float(np.mean(values)), len(values)
    half = math.inf
    if count > 1:
        quantile = float(student.ppf(0.5 + 0.5 * CONFIDENCE, count - 1))
        share = 1.0 / count + float(is_of_next)
        half = quantile * float(np.std(values, ddof=1)) * math.sqrt(share)
    return Interval(value=mean, low=max(mean - half, least), high=mean + half, count=count)
