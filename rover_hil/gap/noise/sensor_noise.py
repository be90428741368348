"""Errors of a machine's channels at an absolute scale: the declared noise of each sensor, or more.

Every sample of a channel has the same weight, so that a fit minimises the output error. A misfit is not made
white: whitening gives the most weight to the fastest part of a signal, where lags and contacts that no model
has are strongest. Samples of one run are therefore not independent; significance comes from the runs.
"""

import math
from dataclasses import dataclass

import numpy as np

from rover_hil.gap.data.problem import Indices, Observations
from rover_hil.gap.noise.autoregression import Autoregression
from rover_hil.gap.noise.parameters import STATISTICS
from sim_backends.models.interface import Array


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorNoise:
    """Independent errors of equal size in each channel.

    Attributes:
        channel_sd: Size of the errors by channel.
        keep: Rows with a measured value.
        row_sd: Size of the error of each row.
        site: Run of each kept row.
        channel: Channel of each kept row.
        block: Stretch of each kept row: whole runs, or parts of them where runs are few.
        neighbours: How the errors of neighbouring samples depend on each other; None where they do not count.
    """

    channel_sd: Array
    keep: Indices
    row_sd: Array
    site: Indices
    channel: Indices
    block: Indices
    neighbours: Autoregression | None = None

    def whiten(self, rows: Array) -> Array:
        """Return the rows with a measured value, in units of their errors."""
        scale = 1.0 / self.channel_sd[self.channel]
        whitened: Array = rows[self.keep] * (scale if rows.ndim == 1 else scale[:, None])
        return self.decorrelated(whitened)

    def decorrelated(self, rows: Array) -> Array:
        """Return rows in units of their errors without what the errors before say of them."""
        if self.neighbours is None:
            return rows
        return self.neighbours.whiten(rows, self.keep, self.site, self.channel)


def declared_noise(observations: Observations, channel_sd: Array | None = None) -> SensorNoise:
    """Return errors as large as the channels declare, or as given."""
    sd = np.array([one.noise_sd for one in observations.channels]) if channel_sd is None else channel_sd
    keep = np.flatnonzero(np.isfinite(observations.values)).astype(np.intp)
    return SensorNoise(
        channel_sd=sd,
        keep=keep,
        row_sd=sd[observations.channel],
        site=observations.site[keep],
        channel=observations.channel[keep],
        block=blocks(observations, keep),
    )


def noise_of_residual(observations: Observations, residual: Array) -> SensorNoise:
    """Return errors as large as a residual, and not smaller than declared; those of replicates are known."""
    if observations.is_steady:
        return declared_noise(observations)
    sd = []
    for index, channel in enumerate(observations.channels):
        errors = residual[(observations.channel == index) & np.isfinite(residual)]
        size = math.sqrt(float(np.mean(errors**2))) if errors.size else 0.0
        sd.append(max(channel.noise_sd, size))
    return declared_noise(observations, np.array(sd))


def blocks(observations: Observations, keep: Indices) -> Indices:
    """Return the stretch of each kept row: whole runs, or parts of them where runs are few."""
    parts = max(1, math.ceil(STATISTICS.noise.least_blocks / len(observations.groups)))
    change = (np.diff(observations.site) != 0) | (np.diff(observations.channel) != 0)
    starts = np.concatenate(([0], np.flatnonzero(change) + 1))
    sizes = np.diff(starts, append=observations.site.size)
    share = np.concatenate([np.arange(size) / size for size in sizes])
    found: Indices = (observations.site[keep] * parts + np.floor(share[keep] * parts)).astype(np.intp)
    return found
