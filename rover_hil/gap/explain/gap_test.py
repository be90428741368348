"""Test for a gap: lack of fit against replicates, and scores of effects and of free-form terms."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rover_hil.gap.data.problem import Observations
from rover_hil.gap.explain.parameters import EXPLAIN
from rover_hil.gap.explain.terms import Term, directions
from rover_hil.gap.statistics.fit import Fit
from rover_hil.gap.statistics.noise import Noise
from rover_hil.gap.statistics.parameters import STATISTICS
from rover_hil.gap.statistics.replicates import Scatter
from rover_hil.gap.statistics.score import (
    Score,
    family_draws,
    family_p,
    of_terms,
    one_sided_z,
    quantile,
    score_all,
)
from sim_backends.models.interface import Array


@dataclass(frozen=True, slots=True, kw_only=True)
class GapTest:
    """Result: whether the model disagrees with the data beyond errors and priors.

    Attributes:
        p: Probability of such a disagreement without gap, over all tests.
        parts: The same by kind of test.
        free: Scores of the free-form terms, the highest first.
        threshold: Least significant free-form score.
    """

    p: float
    parts: dict[str, float]
    free: tuple[Score, ...]
    threshold: float


def find_gap(
    observations: Observations,
    noise: Noise,
    scatter: Scatter | None,
    fitted: Fit,
    terms: Sequence[Term],
    effects_fitted: int,
    p_effects: float | None,
    rng: np.random.Generator,
) -> GapTest:
    """Test the residual of a fit.

    Args:
        observations: The observations.
        noise: Of the observations.
        scatter: Of the replicates; None for series.
        fitted: The model's fit.
        terms: Free-form terms.
        effects_fitted: Number of effects in the fit.
        p_effects: Probability of the scores of the other effects; None where they were not computed.
        rng: For the calibration.
    """
    scores = score_all(
        fitted, noise, directions(observations, noise, terms), is_steady=observations.is_steady
    )
    free = of_terms(scores)
    draws = family_draws(free, noise.freedom, rng)
    greatest = max((one_sided_z(score) for score in free), default=0.0)
    parts = {"free": family_p(free, greatest, draws, noise.freedom)}
    if p_effects is not None:
        parts["effects"] = p_effects
    if scatter is not None:
        parts["lack of fit"] = _lack_of_fit(observations, scatter, fitted, effects_fitted, rng)
    weights = {
        "effects": EXPLAIN.gap.effects_weight,
        "free": EXPLAIN.gap.free_weight,
        "lack of fit": EXPLAIN.gap.fit_weight,
    }
    total = sum(weights[name] for name in parts)
    return GapTest(
        p=min(1.0, *(p * total / weights[name] for name, p in parts.items())),
        parts=parts,
        free=tuple(sorted(free, key=lambda score: -one_sided_z(score))),
        threshold=quantile(draws, EXPLAIN.gap.alpha),
    )


def _lack_of_fit(
    observations: Observations, scatter: Scatter, fitted: Fit, effects_fitted: int, rng: np.random.Generator
) -> float:
    """Return the probability of such a sum of squares, in total or in any channel.

    Under its priors the sum of squares of residuals and pulls has as many degrees of freedom as there are
    rows; each channel's part is uncertain by the number of its replicates.
    """
    channels = [int(index) for index in np.unique(observations.channel)]
    squares = np.array(
        [float(np.sum(fitted.residual[observations.channel == index] ** 2)) for index in channels]
    )
    count = np.array([float(np.sum(observations.channel == index)) for index in channels])
    drawn = np.stack(
        [_draw(count[place], float(scatter.freedom[index]), rng) for place, index in enumerate(channels)],
        axis=1,
    )
    spare = 1.0 - effects_fitted / max(float(count.sum()), 1.0)
    total = _share_above(drawn.sum(axis=1) * spare, fitted.cost)
    each = [_share_above(drawn[:, place] * spare, squares[place]) for place in range(len(channels))]
    return min(1.0, 2.0 * min(total, len(channels) * min(each)))


def _draw(count: float, freedom: float, rng: np.random.Generator) -> Array:
    drawn = rng.chisquare(count, STATISTICS.score.draws)
    return (
        drawn / (rng.chisquare(freedom, STATISTICS.score.draws) / freedom)
        if math.isfinite(freedom)
        else drawn
    )


def _share_above(draws: Array, value: float) -> float:
    return (1.0 + float(np.sum(draws >= value))) / (1.0 + draws.size)
