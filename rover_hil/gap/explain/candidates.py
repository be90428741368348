"""Effects as candidates: the change of the prediction by each, and its score."""

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rover_hil.gap.data.problem import Point, Problem, effect_free
from rover_hil.gap.explain.parameters import EXPLAIN
from rover_hil.gap.statistics.fit import Fit
from rover_hil.gap.statistics.noise import Noise
from rover_hil.gap.statistics.score import Direction, Score, cosine, one_sided_z
from sim_backends.models.interface import Array, EffectCard, Parameter


@dataclass(frozen=True, slots=True, kw_only=True)
class Candidate:
    """An effect with the best of its shapes by score."""

    card: EffectCard
    score: Score


def card_directions(problem: Problem, noise: Noise, at: Fit, cards: Sequence[EffectCard]) -> list[Direction]:
    """Return the first-order change by each effect, at each of its shapes, from a fitted point."""
    changes = card_changes(problem, at.point, cards)
    return [replace(one, change=noise.whiten(one.change)) for one in changes]


def candidate_directions(
    problem: Problem, noise: Noise, at: Fit, candidates: Sequence[Candidate]
) -> list[Direction]:
    """Return the same for candidates, each at its best shape only."""
    changes = [_change(problem, at.point, item.card, item.score.direction.shapes) for item in candidates]
    return [replace(one, change=noise.whiten(one.change)) for one in changes]


def card_changes(problem: Problem, point: Point, cards: Sequence[EffectCard]) -> list[Direction]:
    """Return the changes by each effect at each of its shapes, before whitening."""
    pairs = [(card, shapes) for card in cards for shapes in shape_points(card)]
    problem.prepare_derivatives(
        [(_with_shapes(point, card, shapes), effect_free(card, shapes)[0]) for card, shapes in pairs]
    )
    return [_change(problem, point, card, shapes) for card, shapes in pairs]


def _with_shapes(point: Point, card: EffectCard, shapes: Mapping[str, float]) -> Point:
    return {**point, **{(card.name, name): value for name, value in shapes.items()}}


def _change(problem: Problem, point: Point, card: EffectCard, shapes: Mapping[str, float]) -> Direction:
    strength = card.parameters[0]
    here = _with_shapes(point, card, shapes)
    return Direction(
        name=card.name,
        change=problem.derivative(here, effect_free(card, shapes)[0]),
        sign=sign_rule(strength),
        shapes=shapes,
        size=strength.prior_sd,
        unit=strength.unit,
    )


def shape_points(card: EffectCard) -> list[dict[str, float]]:
    """Return the shapes to search: the grid, and nominal values of shapes outside it."""
    nominal = {item.name: item.nominal for item in card.parameters[1:]}
    names = list(card.shape_grid)
    return [
        {**nominal, **dict(zip(names, values, strict=True))}
        for values in itertools.product(*(card.shape_grid[name] for name in names))
    ]


def sign_rule(parameter: Parameter) -> int:
    """Return +1 or -1 where the parameter has a sign, else 0."""
    if parameter.lower >= parameter.nominal:
        return 1
    return -1 if parameter.upper <= parameter.nominal else 0


def best_of_each(scores: Sequence[Score], cards: Sequence[EffectCard]) -> list[Candidate]:
    """Return each effect at the shape with the highest score, the highest first."""
    by_name = {card.name: card for card in cards}
    best: dict[str, Score] = {}
    for score in scores:
        name = score.direction.name
        if name not in best or (one_sided_z(score), abs(score.z)) > (
            one_sided_z(best[name]),
            abs(best[name].z),
        ):
            best[name] = score
    candidates = [Candidate(card=by_name[name], score=score) for name, score in best.items()]
    return sorted(candidates, key=lambda item: -one_sided_z(item.score))


def is_visible(item: Candidate, *, is_steady: bool = True) -> bool:
    """Return True where the data can show an effect; a released parameter depends on its prior alone.

    In long series base parameters may absorb an effect almost completely, against their priors, and yet leave
    enough of one of natural size.
    """
    if item.card.releases is not None or item.score.remaining_share >= EXPLAIN.candidates.visible:
        return True
    shown = item.score.direction.size / item.score.standard_error
    return (
        not is_steady
        and item.score.remaining_share >= EXPLAIN.candidates.exact
        and shown >= EXPLAIN.candidates.shown
    )


def imitating_parameter(start: Fit, score: Score) -> str:
    """Return the base parameter most similar to a direction."""
    best, most = "", -1.0
    change = score.direction.change
    for index, item in enumerate(start.free):
        column = start.jacobian[:, index]
        length = math.sqrt(float(column @ column) * float(change @ change))
        alike = abs(float(column @ change)) / length if length > 0.0 else 0.0
        if alike > most:
            best, most = item.key[1], alike
    return best


def confusability(candidates: Sequence[Candidate]) -> tuple[list[str], Array]:
    """Return the names of the effects and the similarity of each pair after projection."""
    names = [item.card.name for item in candidates]
    matrix = np.array([[cosine(one.score, other.score) for other in candidates] for one in candidates])
    return names, matrix
