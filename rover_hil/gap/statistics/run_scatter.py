"""Scatter between runs: each run and channel has a random constant."""

from dataclasses import dataclass

import numpy as np

from rover_hil.gap.data.problem import Indices
from sim_backends.models.interface import Array

RATIOS = np.geomspace(1e-3, 1e8, 111)
"""Of the variance of the constants over that of the other errors' means, to choose the likeliest from."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RunScatter:
    """Whitens rows with random constants per series.

    Attributes:
        starts: First row of each series.
        direction: Effect of the constant on each row of its series, of unit length in each.
        shrink: Share of that direction that is removed, per series.
    """

    starts: Indices
    direction: Array
    shrink: Array

    def whiten(self, rows: Array) -> Array:
        """Return rows, or columns of rows, with constants as large as the other errors."""
        if not np.any(self.shrink):
            return rows
        table = rows.reshape(rows.shape[0], -1)
        parts = np.add.reduceat(self.direction[:, None] * table, self.starts, axis=0)
        sizes = np.diff(self.starts, append=rows.shape[0])
        taken = self.direction[:, None] * np.repeat(self.shrink[:, None] * parts, sizes, axis=0)
        whitened: Array = rows - taken.reshape(rows.shape)
        return whitened


def series_starts(site: Indices, channel: Indices) -> Indices:
    """Return the first row of each series; rows of a series are contiguous."""
    change = (np.diff(site) != 0) | (np.diff(channel) != 0)
    return np.concatenate(([0], np.flatnonzero(change) + 1)).astype(np.intp)


def run_scatter(starts: Indices, level: Array, variance: Array) -> RunScatter:
    """Return the scatter of constants.

    Args:
        starts: First row of each series.
        level: What a constant of 1 does to each row, in units of independent errors.
        variance: Of the constants, per series.
    """
    squares = np.add.reduceat(level**2, starts)
    sizes = np.diff(starts, append=level.size)
    length = np.repeat(np.sqrt(np.maximum(squares, 1e-300)), sizes)
    return RunScatter(
        starts=starts,
        direction=level / length,
        shrink=1.0 - 1.0 / np.sqrt(1.0 + variance * squares),
    )


def likeliest(starts: Indices, level: Array, residual: Array) -> tuple[float, float]:
    """Return the likeliest variance of the constants of one channel, and minus two log-likelihood with it.

    Args:
        starts: First row of each series of the channel.
        level: What a constant of 1 does to each row, after the filter.
        residual: The errors after the filter.
    """
    squares = np.maximum(np.add.reduceat(level**2, starts), 1e-300)
    along = np.add.reduceat(level * residual, starts) / np.sqrt(squares)
    count, runs = residual.size, starts.size
    within = max(float(residual @ residual - along @ along), 1e-300)
    single = within / max(count - runs, 1)
    ratio = RATIOS / float(np.median(squares))
    spread = 1.0 + ratio[:, None] * squares[None, :]
    cost = np.sum(np.log(spread) + along**2 / single / spread, axis=1)
    best = int(np.argmin(cost))
    total = count * float(np.log(single)) + within / single + float(cost[best])
    return float(ratio[best]) * single, total
