"""Neighbouring errors of a series depend on each other: slow ones, and rates as differences of places.

Without that a slow change seems too certain where errors are slow, and too uncertain in rates, whose errors
change sign from sample to sample.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_toeplitz

from rover_hil.gap.data.problem import Indices
from sim_backends.models.interface import Array


@dataclass(frozen=True, slots=True, kw_only=True)
class Autoregression:
    """Errors of channels as functions of those before, by channel.

    Attributes:
        lags: Coefficients of the errors before, the nearest first.
        new_sd: Standard deviation of what is new in an error, over that of the error.
    """

    lags: tuple[Array, ...]
    new_sd: tuple[float, ...]

    def whiten(self, rows: Array, keep: Indices, site: Indices, channel: Indices) -> Array:
        """Return what is new in each row, of unit size; 0 where the rows before are not known.

        Args:
            rows: Rows with errors of unit size, or columns of them.
            keep: Place of each row among all; missing values make a series begin anew.
            site: Run of each row.
            channel: Channel of each row.
        """
        is_first = (np.diff(keep, prepend=-2) != 1) | (np.diff(site, prepend=-1) != 0)
        is_first |= np.diff(channel, prepend=-1) != 0
        place = np.arange(keep.size)
        place -= np.maximum.accumulate(np.where(is_first, place, 0))
        found = np.zeros_like(rows, dtype=np.float64)
        for index, (lags, new_sd) in enumerate(zip(self.lags, self.new_sd, strict=True)):
            here = np.flatnonzero((channel == index) & (place >= lags.size))
            new = rows[here].astype(np.float64)
            for lag, coefficient in enumerate(lags.tolist(), start=1):
                new -= coefficient * rows[here - lag]
            found[here] = new / new_sd
        return found


def learn_autoregression(series: Sequence[Array]) -> tuple[Array, float]:
    """Return the lags of the errors of one channel, and the standard deviation of what is new in them.

    By the equations of Yule and Walker; the order is the likeliest (BIC), at most ten times the decimal
    logarithm of the number of samples.

    Args:
        series: Errors of each run; a missing one is NaN, and no neighbour of any.
    """
    cut = [part for one in series for part in np.split(one, np.flatnonzero(~np.isfinite(one)))]
    parts = [part[np.isfinite(part)] for part in cut]
    count, longest = sum(one.size for one in parts), max(one.size for one in parts)
    most = min(math.floor(10.0 * math.log10(max(count, 1))), longest - 1)
    products = [
        sum(float(one[lag:] @ one[: one.size - lag]) for one in parts if one.size > lag)
        for lag in range(most + 1)
    ]
    correlation = np.array(products) / count
    best, least, variance = np.zeros(0), math.inf, float(correlation[0])
    for order in range(most + 1) if correlation[0] > 0.0 else ():
        lags = solve_toeplitz(correlation[:order], correlation[1 : order + 1]) if order else np.zeros(0)
        new = float(correlation[0] - lags @ correlation[1 : order + 1])
        cost = count * math.log(max(new, 1e-300)) + order * math.log(count)
        if cost < least:
            best, least, variance = lags.astype(np.float64), cost, new
    return best, math.sqrt(max(variance, 0.0))
