"""The verdict after the next run, simulated: how probable is it that it will be right?"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rover_hil.gap.data.problem import Key, predict_points
from rover_hil.gap.machines.next_run.hypotheses import Hypothesis
from rover_hil.gap.machines.next_run.prediction import Planning, Prediction
from rover_hil.gap.machines.next_run.rules import Flags, kept_by_search
from rover_hil.gap.machines.parameters import MACHINES
from sim_backends.models.interface import Array

POINTS_AT_ONCE = 100


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


def without_run(hypotheses: Sequence[Hypothesis]) -> Outcome:
    """Return the probabilities as they are now."""
    nothing = np.zeros((len(hypotheses), 1, 0))
    return _outcome(hypotheses, [nothing for _ in hypotheses], np.zeros(0), room=0.0)


def simulate_runs(
    planning: Planning, predictions: Sequence[Sequence[Prediction]], rng: np.random.Generator
) -> list[Outcome]:
    """Return the probabilities after each planned run.

    An explanation is drawn by its weight, its parameters from their posterior, the unknowns of the run from
    their prior; the machine is integrated with them; model error and noise are added. The errors of the run
    under each explanation, linearised, decide with those of the measured runs by the rules of the search.

    Args:
        planning: The runs.
        predictions: Of each run, by explanation.
        rng: For the draws.
    """
    squares: list[list[Array]] = [[] for _ in planning.planned]
    for index, _ in enumerate(planning.hypotheses):
        rows = _drawn_rows(planning, index, rng)
        for site, blocks in enumerate(planning.blocks):
            prediction = predictions[site][index]
            means = np.stack([blocks.of(one) for one in rows])
            means[~np.isfinite(means).all(axis=1)] = prediction.mean
            errors = rng.standard_normal((len(rows), prediction.errors.shape[1])) @ prediction.errors.T
            noise = prediction.excess * rng.standard_normal(means.shape)
            rest = _rest(prediction, len(rows), rng)
            data = means + errors + noise
            found = [_left_out_squares(one, data) + rest for one in predictions[site]]
            squares[site].append(np.stack(found)[..., None])
    return [
        _outcome(planning.hypotheses, own, np.array([float(some[0].mean_rows.size)]))
        for own, some in zip(squares, predictions, strict=True)
    ]


def _rest(prediction: Prediction, draws: int, rng: np.random.Generator) -> Array:
    """Return the squared noise inside the blocks, which is the same under every explanation."""
    inside = prediction.mean_rows.size - prediction.mean.size
    if inside <= 0:
        return np.zeros(draws)
    return prediction.excess**2 * rng.chisquare(inside, draws)


def _left_out_squares(prediction: Prediction, data: Array) -> Array:
    """Return the squared errors of a run that is predicted by the others, its own unknowns fitted.

    As in the search, a left-out run keeps a small share of its information.
    """
    starts, shared = prediction.starts, prediction.shared
    root = np.linalg.cholesky(np.eye(prediction.mean.size) + starts @ starts.T)
    errors = np.linalg.solve(root, (data - prediction.mean).T)
    known = np.linalg.solve(root, shared)
    share = 1.0 - MACHINES.fit.left_out
    inner = np.eye(known.shape[1]) + share * known.T @ known
    left = errors - known @ np.linalg.solve(inner, share * known.T @ errors)
    found: Array = np.maximum((left**2).sum(axis=0), 1e-9)
    return found


def _drawn_rows(planning: Planning, index: int, rng: np.random.Generator) -> list[Array]:
    """Return predictions of all rows with parameters from their posterior."""
    hypothesis, problem = planning.hypotheses[index], planning.problems[index]
    own, begin = planning.own_free(index), planning.points()[index]
    root = np.linalg.cholesky(hypothesis.covariance + 1e-12 * np.eye(len(hypothesis.shared)))
    points: list[dict[Key, float]] = []
    for _ in range(MACHINES.decision.draws):
        pulls = hypothesis.pulls + root @ rng.standard_normal(len(hypothesis.shared))
        values = {
            item.key: float(np.clip(item.mean + item.sd * pull, item.lower, item.upper))
            for item, pull in zip(hypothesis.shared, pulls, strict=True)
        }
        starts = {
            item.key: float(np.clip(item.mean + item.sd * rng.standard_normal(), item.lower, item.upper))
            for item in own
        }
        points.append({**begin, **values, **starts})
    rows: list[Array] = []
    for first in range(0, len(points), POINTS_AT_ONCE):
        rows += predict_points(problem.model, problem.sites, points[first : first + POINTS_AT_ONCE])
    return rows


def _outcome(
    hypotheses: Sequence[Hypothesis], squares: Sequence[Array], counts: Array, room: float = 1.0
) -> Outcome:
    """Return the shares of right and wrong decisions.

    Args:
        hypotheses: The explanations.
        squares: By true explanation: squared errors, explanation x draw x new run.
        counts: Values of each new run.
        room: Right and wrong decisions to add: a share of few draws is never 0 or 1.
    """
    right, wrong, variance = [], 0.0, 0.0
    for truth, own in enumerate(squares):
        kept = kept_by_search(hypotheses, own, counts)
        draws = own.shape[1]
        alone = kept.is_alone if hypotheses[truth].is_else else np.delete(kept.is_alone, truth, axis=0)
        is_wrong: Flags = np.asarray(alone.any(axis=0))
        is_right: Flags = ~kept.is_within_noise if hypotheses[truth].is_else else kept.is_alone[truth]
        if hypotheses[truth].is_else:
            is_wrong = is_wrong & kept.is_within_noise
        share = (float(is_right.sum()) + room) / (draws + 2.0 * room)
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
    squares = []
    for truth in predictions:
        pulls = rng.standard_normal((MACHINES.decision.draws, truth.shared.shape[1])) @ truth.shared.T
        columns = []
        for _ in range(times):
            factor = np.hstack((truth.starts, truth.errors))
            errors = rng.standard_normal((MACHINES.decision.draws, factor.shape[1])) @ factor.T
            data = truth.mean + pulls + errors + truth.excess * rng.standard_normal(pulls.shape)
            rest = _rest(truth, MACHINES.decision.draws, rng)
            columns.append(np.stack([_left_out_squares(one, data) + rest for one in predictions]))
        squares.append(np.stack(columns, axis=2))
    return _outcome(hypotheses, squares, np.full(times, float(predictions[0].mean_rows.size)))
