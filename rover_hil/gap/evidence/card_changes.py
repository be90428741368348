"""The change of the prediction by each effect, to first order."""

import itertools
import math
from collections.abc import Mapping, Sequence

from rover_hil.gap.data.problem import Point, Problem, effect_free
from rover_hil.gap.evidence.fit import Fit
from rover_hil.gap.evidence.score import Direction, Score
from sim_backends.models.interface import EffectCard, Parameter
from sim_backends.models.parameter_key import ParameterKey


def card_changes(problem: Problem, point: Point, cards: Sequence[EffectCard]) -> list[Direction]:
    """Return the changes by each effect at each of its shapes, before whitening."""
    pairs = [(card, shapes) for card in cards for shapes in shape_points(card)]
    problem.prepare_derivatives(
        [(with_shapes(point, card, shapes), effect_free(card, shapes)[0]) for card, shapes in pairs]
    )
    return [_change(problem, point, card, shapes) for card, shapes in pairs]


def with_shapes(point: Point, card: EffectCard, shapes: Mapping[str, float]) -> Point:
    """Return a point with the shapes of an effect."""
    return {**point, **{ParameterKey(effect=card.name, name=name): value for name, value in shapes.items()}}


def _change(problem: Problem, point: Point, card: EffectCard, shapes: Mapping[str, float]) -> Direction:
    strength = card.parameters[0]
    here = with_shapes(point, card, shapes)
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


def imitating_parameter(start: Fit, score: Score) -> str:
    """Return the base parameter most similar to a direction."""
    best, most = "", -1.0
    change = score.direction.change
    for index, item in enumerate(start.free):
        column = start.jacobian.columns([index])[:, 0]
        length = math.sqrt(float(column @ column) * float(change @ change))
        alike = abs(float(column @ change)) / length if length > 0.0 else 0.0
        if alike > most:
            best, most = item.key.name, alike
    return best
