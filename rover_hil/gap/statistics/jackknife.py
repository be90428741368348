"""Jackknife over runs: how consistently independent runs of series support the parameters of a fit.

Errors of series are estimated sample by sample; differences between runs (the start, a radius after another
warm-up) are not part of them. The jackknife leaves out one run at a time and measures how much a parameter
depends on the choice of runs.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import special, stats

from rover_hil.gap.data.problem import Indices, Key
from rover_hil.gap.statistics.fit import Fit
from rover_hil.gap.statistics.noise import Noise
from rover_hil.gap.statistics.parameters import STATISTICS
from sim_backends.models.interface import Array


@dataclass(frozen=True, slots=True, kw_only=True)
class JackknifeEstimate:
    """Significance of a fitted parameter by its scatter over runs.

    Attributes:
        z: Distance from its null as an equivalent standard normal; the smaller of the values by errors of
            samples and by scatter between runs.
        widening: Factor on the standard error by errors of samples that covers the scatter, at least 1.
    """

    z: float
    widening: float


def clusters(noise: Noise) -> Indices:
    """Return the cluster of each whitened row: its run, or its stretch where runs are few."""
    found = noise.site if np.unique(noise.site).size >= STATISTICS.jackknife.least_runs else noise.block
    numbered: Indices = np.unique(found, return_inverse=True)[1].astype(np.intp)
    return numbered


def jackknife(
    fit: Fit, noise: Noise, keys: Sequence[Key], given: Sequence[Key] = ()
) -> list[JackknifeEstimate]:
    """Return the jackknife estimate of each of `keys`.

    Args:
        fit: With derivatives near the fitted point.
        noise: Of the observations.
        keys: Fitted parameters.
        given: Parameters taken as known: shapes, which have no meaning without their strength.
    """
    used = [index for index, item in enumerate(fit.free) if item.key not in given]
    positions = [[fit.free[index].key for index in used].index(key) for key in keys]
    jacobian, pull = fit.jacobian[:, used], fit.pull[used]
    normal = jacobian.T @ jacobian + np.eye(len(used))
    covariance = np.linalg.inv(normal)
    number = clusters(noise)
    parts = [np.flatnonzero(number == one) for one in range(int(number.max(initial=-1)) + 1)]
    moved, informed = np.zeros((len(parts), len(used))), np.zeros((len(parts), len(used)))
    squares = [jacobian[rows].T @ jacobian[rows] for rows in parts]
    for index, rows in enumerate(parts):
        # Without a run that holds almost all information only the priors would remain.
        without = normal - STATISTICS.jackknife.almost_all * squares[index]
        moved[index] = np.linalg.solve(without, jacobian[rows].T @ fit.residual[rows])
        informed[index] = np.sum((jacobian[rows] @ covariance) ** 2, axis=0)
    return [
        _jackknife(moved[:, k], informed[:, k], float(pull[k]), float(covariance[k, k])) for k in positions
    ]


def _jackknife(moved: Array, informed: Array, pull: float, variance: float) -> JackknifeEstimate:
    by_samples = math.sqrt(max(variance, 1e-300))
    count = moved.size
    by_runs = (
        math.sqrt((count - 1) / count * float(np.sum((moved - moved.mean()) ** 2))) if count > 1 else 0.0
    )
    spread, freedom = scatter_of_runs(by_runs / by_samples, informed)
    wider = spread * float(stats.t.ppf(0.975, freedom)) / 1.96
    return JackknifeEstimate(
        z=math.copysign(as_normal(pull / by_samples, spread, freedom), pull), widening=max(wider, 1.0)
    )


def scatter_of_runs(by_runs: float, informed: Array) -> tuple[float, float]:
    """Return the ratio of the scatter over runs to that of samples, at least 1, and its degrees of freedom.

    Args:
        by_runs: Standard error by the jackknife over that by samples.
        informed: Information of each run on the parameter.

    Returns:
        The factor, and its degrees of freedom.
    """
    active = float(informed.sum() ** 2 / max(float((informed**2).sum()), 1e-300))
    freedom = max(active - 1.0, 0.0)
    is_sure = (
        freedom >= 1.0
        and by_runs**2
        > 2.0 * special.gammaincinv(freedom / 2.0, STATISTICS.jackknife.beyond_chance) / freedom
    )
    agreeing = STATISTICS.jackknife.scattering_runs if is_sure else STATISTICS.jackknife.agreeing_runs
    together = (agreeing + freedom * by_runs**2) / (agreeing + freedom)
    return math.sqrt(max(together, 1.0)), agreeing + freedom


def as_normal(z: float, spread: float, freedom: float) -> float:
    """Return the size of the standard normal that is as improbable as z over the scatter of runs."""
    # Not scipy.stats, whose distributions take a hundred times as long for one number.
    probability = float(special.stdtr(freedom, -abs(z) / spread))
    return min(abs(z), max(0.0, -float(special.ndtri(max(probability, 1e-300)))))


def is_clearly_worse(rival: Fit, best: Fit, noise: Noise, level: float) -> bool:
    """Return True where an alternative explains the runs worse than the best, by a paired t-test over runs.

    Each run's difference is divided by its standard deviation without a gap, from the distance between the
    two.
    """
    number = clusters(noise)
    worse = np.bincount(number, weights=rival.residual**2 - best.residual**2)
    apart = np.sqrt(np.bincount(number, weights=(rival.residual - best.residual) ** 2))
    differences = worse[apart > 0.0] / apart[apart > 0.0]
    if differences.size < 2:
        return False
    spread = max(float(np.std(differences, ddof=1)), 1e-12)
    t = float(differences.mean()) * math.sqrt(differences.size) / spread
    return t > float(stats.t.ppf(level, differences.size - 1))
