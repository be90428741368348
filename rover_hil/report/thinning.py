"""Long series made short for a picture, without losing peaks or gaps."""

from collections.abc import Sequence

import numpy as np

from rover_hil.drives.arrays import Array
from rover_hil.report.tracks import Series, spans

THIN_BINS = 400
GAP_FACTOR = 10.0
VISIBLE_SHARE = 1 / 600
"""Of the width of a picture: less cannot be seen."""


def with_gaps(series: Series) -> Series:
    """Return the series with NaN where nothing was received for long, so that no line is drawn there."""
    steps_s = np.diff(series.t_s)
    if not steps_s.any():
        return series
    # Poses repeat their time in every cycle without new wheel positions.
    gaps = np.flatnonzero(steps_s > GAP_FACTOR * np.median(steps_s[steps_s > 0.0])) + 1
    return Series(np.insert(series.t_s, gaps, series.t_s[gaps]), np.insert(series.value, gaps, np.nan))


def thin(series: Series, bins: int = THIN_BINS) -> Series:
    """Return the lowest and the highest value of each of `bins` bins, so that no peak gets lost."""
    size = len(series.t_s) // bins
    if size <= 2:
        return series
    count = len(series.t_s) // size
    blocks = series.value[: count * size].reshape(count, size)
    lowest = np.where(np.isnan(blocks), np.inf, blocks).argmin(axis=1)
    highest = np.where(np.isnan(blocks), -np.inf, blocks).argmax(axis=1)
    first = np.arange(count) * size
    remainder = np.arange(count * size, len(series.t_s))
    kept = np.unique(np.concatenate((first + lowest, first + highest, remainder)))
    return Series(series.t_s[kept], series.value[kept])


def visible_spans(t_s: Array, keys: Sequence[str]) -> list[tuple[float, float]]:
    """Return start and end of each stretch with a key that is not empty; gaps too short to see are closed."""
    least_s = VISIBLE_SHARE * float(t_s[-1] - t_s[0])
    points: list[tuple[float, float]] = []
    for start_s, end_s, key in spans(t_s, keys):
        if not key:
            continue
        if points and start_s - points[-1][1] < least_s:
            points[-1] = points[-1][0], end_s
        else:
            points.append((start_s, end_s))
    return points
