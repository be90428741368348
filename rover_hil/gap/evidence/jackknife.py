"""Jackknife over runs: how consistently independent runs of series support the parameters of a fit.

Errors of series are estimated sample by sample; differences between runs (the start, a radius after another
warm-up) are not part of them. The jackknife leaves out one run at a time and measures how much a parameter
depends on the choice of runs.
"""

import math

import numpy as np
from scipy import special

from rover_hil.gap.data.problem import Indices
from rover_hil.gap.noise.parameters import STATISTICS
from rover_hil.gap.noise.sensor_noise import SensorNoise
from sim_backends.models.interface import Array


def clusters(noise: SensorNoise) -> Indices:
    """Return the cluster of each whitened row: its run, or its stretch where runs are few."""
    found = noise.site if np.unique(noise.site).size >= STATISTICS.jackknife.least_runs else noise.block
    numbered: Indices = np.unique(found, return_inverse=True)[1].astype(np.intp)
    return numbered


def scatter_of_runs(by_runs: float, informed: Array) -> tuple[float, float]:
    """Return the ratio of the scatter over runs to that of samples, at least 1, and its degrees of freedom.

    Runs estimate the part of the variance that comes from them; the rest, by priors, is known (Satterthwaite,
    Biometrics Bulletin 2, 1946).

    Args:
        by_runs: Standard error by the jackknife over that by samples and priors.
        informed: Part of the variance by samples and priors that comes from each run.

    Returns:
        The factor, and its degrees of freedom.
    """
    share = min(max(float(informed.sum()), 1e-12), 1.0)
    by_runs /= math.sqrt(share)
    active = float(informed.sum() ** 2 / max(float((informed**2).sum()), 1e-300))
    freedom = max(active - 1.0, 0.0)
    is_sure = (
        freedom >= 1.0
        and by_runs**2
        > 2.0 * special.gammaincinv(freedom / 2.0, STATISTICS.jackknife.beyond_chance) / freedom
    )
    agreeing = STATISTICS.jackknife.scattering_runs if is_sure else STATISTICS.jackknife.agreeing_runs
    estimated = share * max((agreeing + freedom * by_runs**2) / (agreeing + freedom), 1.0)
    together = 1.0 - share + estimated
    return math.sqrt(together), (agreeing + freedom) * (together / estimated) ** 2


def as_normal(z: float, spread: float, freedom: float) -> float:
    """Return the size of the standard normal that is as improbable as z over the scatter of runs."""
    # Not scipy.stats, whose distributions take a hundred times as long for one number.
    probability = float(special.stdtr(freedom, -abs(z) / spread))
    return min(abs(z), max(0.0, -float(special.ndtri(max(probability, 1e-300)))))
