"""How consistently independent runs of series ask for the numbers of a fit: the jackknife over runs.

Errors of series are learned from the data, sample by sample; what differs from run to run (where a run
begins, a radius after another warm-up) is no part of them. Left out one at a time, runs tell how much a
number depends on which of them were made.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from rover_hil.gap.data.problem import Indices, Key
from rover_hil.gap.statistics.fit import Fit
from rover_hil.gap.statistics.noise import Noise
from sim_backends.models.interface import Array

LEAST_RUNS = 6
"""From which on whole runs are left out; below, stretches of them."""
AGREEING_RUNS = 3.0
"""What is believed beforehand, in runs: that runs scatter no more than their samples do. Without it, an
effect that only one or two runs show could never be sure, however clearly they do."""
BEYOND_CHANCE, SCATTERING_RUNS = 0.9, 1.0
"""Level from which on runs do scatter more than their samples, and what is left of that belief then."""
ALMOST_ALL = 0.999
"""Share of what is known of a number that one run may hold."""


@dataclass(frozen=True, slots=True, kw_only=True)
class JackknifeEstimate:
    """What a fitted number rests on.

    Attributes:
        z: Distance from its null, as a standard normal would be as improbable; the smaller of the values by
            errors of samples and by scatter between runs.
        widening: Factor on the standard error by errors of samples that covers the scatter, at least 1.
    """

    z: float
    widening: float


def clusters(noise: Noise) -> Indices:
    """Return the number of the cluster of each whitened row: its run, or its stretch where runs are few."""
    found = noise.site if np.unique(noise.site).size >= LEAST_RUNS else noise.block
    numbered: Indices = np.unique(found, return_inverse=True)[1].astype(np.intp)
    return numbered


def jackknife(
    fit: Fit, noise: Noise, keys: Sequence[Key], given: Sequence[Key] = ()
) -> list[JackknifeEstimate]:
    """Return what each of `keys` rests on.

    Args:
        fit: With derivatives near the fitted point.
        noise: Of the observations.
        keys: Of fitted numbers.
        given: Numbers that are taken as known: shapes, which mean nothing without their strength.
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
        # A run that holds almost all that is known would leave nothing but the priors.
        without = normal - ALMOST_ALL * squares[index]
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
    """Return by how much more a number scatters than its samples say, at least 1, and how sure that is.

    Args:
        by_runs: Standard error by the jackknife over that by samples.
        informed: What each run knows of the number.

    Returns:
        The factor, and its degrees of freedom.
    """
    active = float(informed.sum() ** 2 / max(float((informed**2).sum()), 1e-300))
    freedom = max(active - 1.0, 0.0)
    is_sure = freedom >= 1.0 and by_runs**2 > stats.chi2.ppf(BEYOND_CHANCE, freedom) / freedom
    agreeing = SCATTERING_RUNS if is_sure else AGREEING_RUNS
    together = (agreeing + freedom * by_runs**2) / (agreeing + freedom)
    return math.sqrt(max(together, 1.0)), agreeing + freedom


def as_normal(z: float, spread: float, freedom: float) -> float:
    """Return the size of the standard normal that is as improbable as z over the scatter of runs."""
    t = abs(z) / spread
    return min(abs(z), max(0.0, float(-stats.norm.ppf(max(stats.t.sf(t, freedom), 1e-300)))))


def is_clearly_worse(rival: Fit, best: Fit, noise: Noise, level: float) -> bool:
    """Tell whether a rival explains the runs worse than the best, run by run (paired t-test).

    Each run's difference is taken in its own standard deviation: that of twice the squared distance between
    the two, were errors all there is.
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
