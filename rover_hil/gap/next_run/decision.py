"""The verdict after the next run, simulated: how probable is it that it will be right?"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from rover_hil.gap.data.problem import predict_points
from rover_hil.gap.next_run.hypotheses import Hypothesis
from rover_hil.gap.next_run.prediction import Planning, Prediction, clipped
from rover_hil.gap.next_run.refit import NewRun
from rover_hil.gap.next_run.rules import Flags, simulated_decisions
from rover_hil.gap.noise.random_force import root_of
from rover_hil.gap.parameters import MACHINES
from sim_backends.models.interface import Array
from sim_backends.models.parameter_key import ParameterKey

POINTS_AT_ONCE = 100
"""Draws that are predicted together."""
Data: TypeAlias = tuple[Array, Array]
"""Draws x blocks of a new run, and the squared noise inside the blocks of each draw."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """Probabilities of the verdict after a run.

    Attributes:
        right: Only the true explanation is left, or none where the cause is something else; at most 0.99.
        wrong: Only a wrong one is left.
        error: Standard error of `right` by the number of simulated decisions.
        by_hypothesis: The same as `right`, if each explanation is the true one.
    """

    right: float
    wrong: float
    error: float
    by_hypothesis: tuple[float, ...]


def simulate_runs(
    planning: Planning,
    predictions: Sequence[Sequence[Prediction]],
    rng: np.random.Generator,
) -> list[Outcome]:
    """Return the probabilities after each planned run.

    An explanation is drawn by its weight, its parameters from their posterior, the unknowns of the run from
    their prior; the machine is integrated with them; model error and noise are added. The errors of all runs
    under each explanation, fitted again by linearisation, decide by the rules of the search.
    """
    tables: list[list[Array]] = [[] for _ in planning.planned]
    for index in range(len(planning.hypotheses)):
        data = _integrated(planning, predictions, index, MACHINES.decision.draws, rng)
        for site, new in enumerate(data):
            tables[site].append(_table(planning.hypotheses, predictions[site], [new]))
    return [
        _outcome(planning.hypotheses, own, [float(some[0].mean_rows.size)])
        for own, some in zip(tables, predictions, strict=True)
    ]


def _integrated(
    planning: Planning,
    predictions: Sequence[Sequence[Prediction]],
    index: int,
    draws: int,
    rng: np.random.Generator,
) -> list[Data]:
    """Return simulated outcomes of each planned run under one explanation."""
    rows = _drawn_rows(planning, index, draws, rng)
    found = []
    for site, blocks in enumerate(planning.blocks):
        prediction = predictions[site][index]
        means = np.stack([blocks.of(one) for one in rows])
        means[~np.isfinite(means).all(axis=1)] = prediction.mean
        errors = rng.standard_normal((draws, prediction.errors.shape[1])) @ prediction.errors.T
        noise = prediction.excess * rng.standard_normal(means.shape)
        found.append((means + errors + noise, _rest(prediction, draws, rng)))
    return found


def _table(hypotheses: Sequence[Hypothesis], predictions: Sequence[Prediction], new: Sequence[Data]) -> Array:
    """Return the squared errors of all runs when they are left out: explanation x draw x run."""
    found = []
    for hypothesis, one in zip(hypotheses, predictions, strict=True):
        runs = [
            NewRun(
                errors=clipped(data - one.mean).T, slopes=one.slopes, starts=one.starts, channel=one.channel
            )
            for data, _ in new
        ]
        squares = hypothesis.refit.squares(runs)
        squares[:, -len(new) :] += np.stack([rest for _, rest in new], axis=1)
        found.append(squares)
    return np.stack(found)


def _rest(prediction: Prediction, draws: int, rng: np.random.Generator) -> Array:
    """Return the squared noise inside the blocks, which is the same under every explanation."""
    inside = prediction.mean_rows.size - prediction.mean.size
    if inside <= 0:
        return np.zeros(draws)
    return prediction.excess**2 * rng.chisquare(inside, draws)


def _drawn_rows(planning: Planning, index: int, draws: int, rng: np.random.Generator) -> list[Array]:
    """Return predictions of all rows with parameters from their posterior."""
    hypothesis, problem = planning.hypotheses[index], planning.problems[index]
    own, begin = planning.own_free(index), planning.points()[index]
    root = root_of(hypothesis.covariance)
    points: list[dict[ParameterKey, float]] = []
    for _ in range(draws):
        pulls = hypothesis.pulls + root @ rng.standard_normal(len(hypothesis.shared))
        values = {item.key: item.at(pull) for item, pull in zip(hypothesis.shared, pulls, strict=True)}
        starts = {item.key: item.at(rng.standard_normal()) for item in own}
        points.append({**begin, **values, **starts})
    rows: list[Array] = []
    for first in range(0, len(points), POINTS_AT_ONCE):
        rows += predict_points(problem.model, problem.sites, points[first : first + POINTS_AT_ONCE])
    return rows


def _outcome(hypotheses: Sequence[Hypothesis], tables: Sequence[Array], counts: Sequence[float]) -> Outcome:
    """Return the shares of right and wrong decisions."""
    number = np.concatenate((hypotheses[0].fit.left_out.counts, counts))
    is_listed = np.array([one.machine is hypotheses[-1].machine for one in hypotheses[:-1]])
    right, wrong, variance = [], 0.0, 0.0
    for truth, own in enumerate(tables):
        kept = simulated_decisions(hypotheses, own, number)
        draws = own.shape[1]
        others = is_listed & (np.arange(is_listed.size) != truth)
        is_wrong: Flags = kept.is_alone[others].any(axis=0) & kept.is_whole
        is_right: Flags = kept.is_alone[truth] if truth < is_listed.size else ~kept.is_whole
        share = (float(is_right.sum()) + 1.0) / (draws + 2.0)
        weight = hypotheses[truth].weight
        right.append(share)
        wrong += weight * float(is_wrong.mean())
        variance += weight**2 * share * (1.0 - share) / draws
    weights = [one.weight for one in hypotheses]
    return Outcome(
        right=min(float(np.dot(weights, right)), MACHINES.decision.most_certain),
        wrong=wrong,
        error=math.sqrt(variance),
        by_hypothesis=tuple(right),
    )


def simulate_repeats(
    hypotheses: Sequence[Hypothesis],
    predictions: Sequence[Prediction],
    times: int,
    rng: np.random.Generator,
) -> Outcome:
    """Return the probabilities after making a run several times, all linearised."""
    tables = [
        _table(hypotheses, predictions, _linear(truth, MACHINES.decision.draws, times, rng))
        for truth in predictions
    ]
    return _outcome(hypotheses, tables, [float(predictions[0].mean_rows.size)] * times)


def _linear(truth: Prediction, draws: int, times: int, rng: np.random.Generator) -> list[Data]:
    """Return simulated outcomes of a run that is made several times."""
    pulls = rng.standard_normal((draws, truth.shared.shape[1])) @ truth.shared.T
    found = []
    for _ in range(times):
        factor = np.hstack((truth.starts, truth.errors))
        errors = rng.standard_normal((draws, factor.shape[1])) @ factor.T
        data = truth.mean + pulls + errors + truth.excess * rng.standard_normal(pulls.shape)
        found.append((data, _rest(truth, draws, rng)))
    return found
