"""Relation between two sources over a window of time: slope, correlation, and their 95 % intervals.

Linear regression y = a + s x with one more column where an offset grows with time, as by a bias of a gyro
(Draper and Smith, Applied Regression Analysis, 3rd edition, chapter 1). Three changes:

- Noise of x: the known variance of its errors is removed from the sum of its squares (attenuation; Fuller,
  Measurement Error Models, section 1.2).
- The variance of the residuals is at least the known variance of the errors of y and of s x.
- Residuals that follow each other closely count for fewer: n (1 - r) / (1 + r) by their autocorrelation r
  (Bayley and Hammersley, 1946).

Assumed: errors are normal, those of x and y are independent of each other and of the motion, and their
autocorrelation falls as that of a first-order process.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Places = NDArray[np.complex128]
"""Positions x + i y."""

NORMAL_95 = 1.959964
"""Quantile of 97.5 % of the standard normal distribution."""
LEAST_READINGS = 6
GREATEST_AUTOCORRELATION = 0.9
GREATEST_NOISE_SHARE = 0.5
"""Greatest share of the squares of x that its noise may make up."""


class Interval(NamedTuple):
    """An estimate with its 95 % interval.

    Attributes:
        value: The estimate.
        low: Lower end of its interval.
        high: Upper end.
    """

    value: float
    low: float
    high: float


class Relation(NamedTuple):
    """How one source follows another.

    Attributes:
        slope: Change of y over change of x; 1 where both measure the same, negative for the opposite sign.
        correlation: Of both, -1 to 1.
        readings: How many independent readings it is based on.
    """

    slope: Interval
    correlation: Interval
    readings: float


def relate(
    x: Sequence[float] | Array,
    y: Sequence[float] | Array,
    *,
    x_sd: float = 0.0,
    y_sd: float = 0.0,
    time_s: Array | None = None,
) -> Relation | None:
    """Return the relation of y to x; None where there are too few readings, or x moves too little.

    Args:
        x: Readings of one source.
        y: Those of the other, of the same quantity at the same times.
        x_sd: Standard deviation of the errors of x, in its unit, not negative.
        y_sd: The same of y.
        time_s: Times, where an offset between both may grow with time; else None.
    """
    count = len(x)
    columns = 1 if time_s is None else 2
    freedom = count - columns - 1
    if count < LEAST_READINGS or freedom < 2:
        return None
    x_part, y_part = (_without_drift(np.asarray(values, float), time_s) for values in (x, y))
    squares = float((x_part**2).sum())
    moved = squares - (count - columns) * x_sd**2
    if not (moved > (1.0 - GREATEST_NOISE_SHARE) * squares > 0.0 and math.isfinite(squares)):
        return None
    slope = float((x_part * y_part).sum()) / moved
    residual = y_part - slope * x_part
    kept = _independent_share(residual)
    variance = max(float((residual**2).sum()) / freedom, y_sd**2 + (slope * x_sd) ** 2)
    readings = max(count * kept, columns + 3.0)
    half = _student_95(readings - columns - 1.0) * math.sqrt(variance / (kept * moved))
    return Relation(
        Interval(slope, slope - half, slope + half), _correlation(x_part, y_part, readings), readings
    )


def _without_drift(values: Array, time_s: Array | None) -> Array:
    """Return the values less their mean, and with times less their slope over these, by least squares."""
    left: Array = values - values.mean()
    if time_s is not None:
        since_s = time_s - time_s.mean()
        squares = float((since_s**2).sum())
        if squares > 0.0:
            left = left - float((since_s * left).sum()) / squares * since_s
    return left


def _independent_share(residual: Array) -> float:
    """Return how many independent readings as many residuals are worth, as a share of their number."""
    squares = float((residual**2).sum())
    if squares <= 0.0:
        return 1.0
    correlation = float((residual[1:] * residual[:-1]).sum()) / squares
    correlation = min(max(correlation, 0.0), GREATEST_AUTOCORRELATION)
    return (1.0 - correlation) / (1.0 + correlation)


def _correlation(x: Array, y: Array, readings: float) -> Interval:
    """Return the correlation with its interval by Fisher's transformation."""
    scale = math.sqrt(float((x**2).sum()) * float((y**2).sum()))
    value = 0.0 if scale <= 0.0 else min(max(float((x * y).sum()) / scale, -1.0), 1.0)
    centre = math.atanh(min(max(value, -1.0 + 1e-12), 1.0 - 1e-12))
    half = NORMAL_95 / math.sqrt(max(readings - 3.0, 1.0))
    return Interval(value, math.tanh(centre - half), math.tanh(centre + half))


def _student_95(freedom: float) -> float:
    """Return the quantile of 97.5 % of Student's distribution (Abramowitz and Stegun, 26.7.5)."""
    z = NORMAL_95
    return (
        z
        + (z**3 + z) / (4.0 * freedom)
        + (5.0 * z**5 + 16.0 * z**3 + 3.0 * z) / (96.0 * freedom**2)
        + (3.0 * z**7 + 19.0 * z**5 + 17.0 * z**3 - 15.0 * z) / (384.0 * freedom**3)
    )


class PlaneRelation(NamedTuple):
    """How positions of one source follow those of another whose axes may have any direction.

    Attributes:
        scale: Length by the second over length by the first, not negative.
        angle_rad: From the axes of the first to those of the second.
        mirrored_deviations: By how many standard deviations mirrored axes explain the positions better than
            axes that are only turned; negative where they explain them worse.
    """

    scale: Interval
    angle_rad: float
    mirrored_deviations: float


def relate_places(first_m: Places, second_m: Places, second_sd_m: float) -> PlaneRelation | None:
    """Return the relation of positions x + i y; None where there are too few, or the first do not move.

    Least squares of q = o + c p, and of q = o + c conj(p) for mirrored axes (Umeyama, 1991, in the plane).
    Assumed: as for `relate`, with errors of equal variance on both axes of the second source only.

    Args:
        first_m: By the wheels, (n,), complex.
        second_m: By the other source at the same times.
        second_sd_m: Standard deviation of x and of y of the second, not negative.
    """
    count = len(first_m)
    first, second = first_m - first_m.mean(), second_m - second_m.mean()
    squares = float((abs(first) ** 2).sum())
    if count < LEAST_READINGS or not (squares > 0.0 and math.isfinite(squares)):
        return None
    turned, mirrored = (complex((np.conj(each) * second).sum()) / squares for each in (first, np.conj(first)))
    left = [second - turned * first, second - mirrored * np.conj(first)]
    sums = [float((abs(residual) ** 2).sum()) for residual in left]
    best = int(sums[1] < sums[0])
    kept = min(_independent_share(left[best].real), _independent_share(left[best].imag))
    freedom = 2.0 * (count - 2)
    variance = max(sums[best] / freedom, second_sd_m**2) / kept
    factor = (turned, mirrored)[best]
    half = _student_95(max(freedom * kept, 2.0)) * math.sqrt(variance / squares)
    apart = (sums[0] - sums[1]) / variance
    return PlaneRelation(
        Interval(abs(factor), max(abs(factor) - half, 0.0), abs(factor) + half),
        math.atan2(factor.imag, factor.real),
        math.copysign(math.sqrt(abs(apart)), apart),
    )
