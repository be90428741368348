"""Score tests: how strongly the data supports a direction that the base model cannot follow.

At the fitted base parameters, the whitened residual and the pulls of the priors form one vector. The part
that the base parameters can absorb is projected out of it and of each direction. Without a gap the remaining
vector is standard normal along every direction, for any parameters.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import stats
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import lsq_linear

from rover_hil.gap.data.problem import Indices
from rover_hil.gap.evidence.fit import Fit
from rover_hil.gap.evidence.jackknife import as_normal, clusters, scatter_of_runs
from rover_hil.gap.noise.parameters import STATISTICS
from rover_hil.gap.noise.sensor_noise import SensorNoise
from sim_backends.models.interface import Array
from sim_backends.models.parameter_key import ParameterKey

MOST_DENSE = 4_000_000
"""Numbers of a matrix of all rows and all parameters that is made in full."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Direction:
    """A change of the whitened prediction, per unit.

    Attributes:
        name: Effect, or term of an equation.
        change: Per unit of strength.
        sign: +1 or -1 where the strength has a sign, else 0.
        shapes: Values of the other parameters.
        size: Natural size of the strength.
        unit: Of the strength.
    """

    name: str
    change: Array
    sign: int
    shapes: Mapping[str, float]
    size: float
    unit: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Score:
    """Support of the data for one direction.

    Attributes:
        direction: The direction.
        z: Standard normal without gap; one-sided where the strength has a sign. The smaller of the values by
            the noise model and by the scatter between independent stretches of data.
        z_by_samples: The former alone.
        strength: Estimate to first order, in the direction's unit.
        standard_error: Of the strength.
        projected: The direction after projection, of unit length.
    """

    direction: Direction
    z: float
    z_by_samples: float
    strength: float
    standard_error: float
    projected: Array


class Projection:
    """Projects vectors on what the fitted base parameters cannot absorb."""

    def __init__(self, fit: Fit) -> None:
        self._jacobian = fit.jacobian
        self._priors = fit.jacobian.count
        self._basis: Array | None = None
        if fit.residual.size * self._priors <= MOST_DENSE:
            self._basis = np.linalg.qr(np.vstack((fit.jacobian.dense(), np.eye(self._priors))))[0]
        else:
            gram = fit.jacobian.gram() + np.eye(self._priors)
            self._scale = 1.0 / np.sqrt(np.diag(gram))
            self._root = cho_factor(gram * np.outer(self._scale, self._scale), lower=True)
        self.residual = self.apply(fit.residual, -fit.pull)

    def apply(self, rows: Array, priors: Array | None = None) -> Array:
        """Return the projection of a whitened vector."""
        tail = np.zeros(self._priors) if priors is None else priors
        vector = np.concatenate((rows, tail))
        if self._basis is not None:
            residual: Array = vector - self._basis @ (self._basis.T @ vector)
            return residual
        # By the normal equations, so that unknowns of single runs need no full columns; repeated, since
        # these lose digits.
        for _ in range(3):
            aim = self._jacobian.along(vector[: rows.size]) + vector[rows.size :]
            shift = self._scale * cho_solve(self._root, self._scale * aim)
            vector = vector - np.concatenate((self._jacobian.times(shift), shift))
        return vector


def score_all(
    fit: Fit, noise: SensorNoise, directions: Sequence[Direction], *, is_steady: bool
) -> list[Score]:
    """Return one score per direction; directions that change nothing are omitted."""
    projection = Projection(fit)
    blocks = None if is_steady else clusters(noise)
    scores = []
    for direction in directions:
        with np.errstate(over="ignore"):
            full = float(direction.change @ direction.change)
        if full <= 0.0 or not math.isfinite(full):
            continue
        residual = projection.apply(direction.change)
        length = math.sqrt(float(residual @ residual))
        if length <= 1e-9 * math.sqrt(full):
            continue
        unit = residual / length
        by_samples = z = float(unit @ projection.residual)
        if blocks is not None:
            rows = blocks.size
            z = over_stretches(z, unit[:rows], projection.residual[:rows] - z * unit[:rows], blocks)
        scores.append(
            Score(
                direction=direction,
                z=z,
                z_by_samples=by_samples,
                strength=by_samples / length,
                standard_error=1.0 / length,
                projected=unit,
            )
        )
    return scores


def one_sided_z(score: Score, *, by_samples: bool = False) -> float:
    """Return the score of a direction; 0 where the data supports the forbidden sign."""
    z = score.z_by_samples if by_samples else score.z
    return max(0.0, score.direction.sign * z) if score.direction.sign else abs(z)


def of_terms(scores: Sequence[Score]) -> list[Score]:
    """Return scores of free-form terms; runs may disagree on those that are large."""
    return [
        replace(one, z=one.z_by_samples)
        if one.z_by_samples**2 > STATISTICS.score.large * one.direction.change.size
        else one
        for one in scores
    ]


def strength_z(fit: Fit, noise: SensorNoise, key: ParameterKey) -> float:
    """Return how certain a strength is, as a standard normal; its shapes have no meaning without it."""
    used = [i for i, item in enumerate(fit.free) if item.key == key or item.key.effect != key.effect]
    index = [fit.free[i].key for i in used].index(key)
    covariance = np.linalg.inv(fit.jacobian.gram()[np.ix_(used, used)] + np.eye(len(used)))
    by_samples = math.sqrt(float(covariance[index, index]))
    weight, step = np.zeros(len(fit.free)), np.zeros(len(fit.free))
    weight[used] = covariance[index] / by_samples
    # By these errors the fit may have an optimum nearby.
    step[used] = covariance @ (fit.jacobian.along(fit.residual) - fit.pull)[used]
    z = float(fit.pull[used[index]] + step[used[index]]) / by_samples
    errors = fit.residual - fit.jacobian.times(step)
    return over_stretches(z, fit.jacobian.times(weight), errors, clusters(noise))


def over_stretches(z: float, unit: Array, errors: Array, stretch: Indices) -> float:
    """Return z when only the scatter between stretches of data counts (jackknife, Student's t).

    Args:
        z: By the noise of samples.
        unit: Weight of each row in it; the priors have the rest, up to a sum of squares of 1.
        errors: What is left of each row, so that a real effect does not count as scatter.
        stretch: Number of the run of each row, or of a part of it.
    """
    parts = np.bincount(stretch, weights=unit * errors)
    leverage: Array = np.bincount(stretch, weights=unit**2).astype(np.float64)
    used = leverage > 1e-12
    parts, leverage = parts[used], np.minimum(leverage[used], 0.999)
    if leverage.size < STATISTICS.jackknife.least_runs:
        return z
    # The leverage of each is removed, as in the jackknife.
    by_runs = math.sqrt(float(np.sum((parts / (1.0 - leverage)) ** 2)))
    return math.copysign(as_normal(z, *scatter_of_runs(by_runs, leverage)), z)


def family_draws(scores: Sequence[Score], freedom: float, rng: np.random.Generator) -> Array:
    """Return draws of the greatest `one_sided_z` of a family when there is no gap, sorted.

    The directions' correlations are kept; the size of the errors is uncertain by its degrees of freedom.
    """
    if not scores:
        return np.zeros(STATISTICS.score.draws)
    matrix = np.stack([score.projected for score in scores], axis=1)
    correlation = matrix.T @ matrix
    values, vectors = np.linalg.eigh(correlation)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    draws = rng.standard_normal((STATISTICS.score.draws, len(scores))) @ root.T
    if math.isfinite(freedom):
        draws /= np.sqrt(rng.chisquare(freedom, (STATISTICS.score.draws, 1)) / freedom)
    signs = np.array([score.direction.sign for score in scores])
    sided = np.where(signs == 0, np.abs(draws), np.maximum(draws * signs, 0.0))
    most: Array = np.sort(sided.max(axis=1))
    return most


def family_p(scores: Sequence[Score], value: float, draws: Array, freedom: float) -> float:
    """Return the probability of a greatest score of at least `value` without gap.

    Beyond the draws Bonferroni's bound takes over.
    """
    exceeding = draws.size - int(np.searchsorted(draws, value))
    p_draws = (1 + exceeding) / (1 + draws.size)
    if exceeding > 10:
        return p_draws
    single = float(stats.t.sf(value, freedom) if math.isfinite(freedom) else stats.norm.sf(value))
    sides = sum(1 if score.direction.sign else 2 for score in scores)
    return min(p_draws, sides * single) if exceeding == 0 else min(1.0, p_draws)


def quantile(draws: Array, alpha: float) -> float:
    """Return the score that the family exceeds with probability `alpha` without gap."""
    return float(np.quantile(draws, 1.0 - alpha))


def cosine(first: Score, second: Score) -> float:
    """Return the similarity of two directions after projection, -1..1."""
    return float(first.projected @ second.projected)


def linear_gain(scores: Sequence[Score]) -> float:
    """Return the reduction of the cost by a subset to first order, with the signs of the effects."""
    matrix = np.stack([score.projected for score in scores], axis=1)
    target = np.array([score.z for score in scores])
    gram = matrix.T @ matrix + 1e-9 * np.eye(len(scores))
    root = np.linalg.cholesky(gram).T
    aim = np.linalg.solve(root.T, target)
    low = [0.0 if score.direction.sign > 0 else -np.inf for score in scores]
    high = [0.0 if score.direction.sign < 0 else np.inf for score in scores]
    if all(bound == -np.inf for bound in low) and all(bound == np.inf for bound in high):
        return float(aim @ aim)
    unexplained = lsq_linear(
        root, aim, bounds=(low, np.maximum(high, np.array(low) + 1e-9)), method="bvls"
    ).cost
    return float(aim @ aim - 2.0 * unexplained)
