"""Base parameters of a model that predicts, and what explains its runs where one of them is nominal."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rover_hil.gap.base_parameters import Trial
from rover_hil.gap.data.problem import Key, Problem
from rover_hil.gap.explain.alternative_models import equal_term
from rover_hil.gap.explain.candidates import best_of_each, card_directions, is_visible
from rover_hil.gap.explain.holdout_validation import LockedRuns
from rover_hil.gap.explain.naming import set_reach
from rover_hil.gap.explain.parameters import EXPLAIN
from rover_hil.gap.explain.prepare import Prepared
from rover_hil.gap.explain.search import Explanation, Search
from rover_hil.gap.statistics.fit import Fit, fit
from rover_hil.gap.statistics.jackknife import is_clearly_worse
from rover_hil.gap.statistics.score import score_all
from rover_hil.gap.verdict import FittedBase
from sim_backends.models.interface import Run


def model_bases(
    prepared: Prepared, fitted: Fit, intervals: "dict[Key, tuple[float, float]]"
) -> list[FittedBase]:
    """Return the base parameters of a fit with their intervals."""
    items = {item.name: item for item in prepared.problem.model.parameters}
    return [
        FittedBase(
            name=free.key[1],
            unit=items[free.key[1]].unit,
            nominal=free.mean,
            prior_sd=free.sd,
            value=fitted.value(free.key),
            ci95=intervals[free.key],
            pull=float(pull),
        )
        for free, pull in zip(fitted.free, fitted.pull, strict=True)
        if not free.key[0]
    ]


def model_trial(
    prepared: Prepared, found: Explanation | None, inflation: float, locked: Sequence[Run], name: str
) -> Trial:
    """Return what the runs say of a base parameter, compared with its nominal value.

    Args:
        prepared: The base model and the runs to learn from.
        found: The named explanation; None for the base model.
        inflation: Ratio of the remaining cost to that of errors alone.
        locked: Runs for the validation.
        name: The base parameter.
    """
    noise, observations = prepared.noise, prepared.problem.observations
    names: tuple[str, ...] = ()
    best, cost = prepared.start, prepared.start.cost
    if found is not None:
        names, best, cost = found.names, found.fit, found.cost
    held = Problem(prepared.problem.model, observations, (name,))
    start = fit(held, noise, held.base_free(), prepared.start.point)
    cards = [card for card in held.model.effects if card.releases != name]
    scores = score_all(
        start, noise, card_directions(held, noise, start, cards), is_steady=observations.is_steady
    )
    candidates = best_of_each(scores, cards)
    search = Search(held, noise, start, candidates, scores)
    part = search.explain(names) if names else None
    part_fit, part_cost = (start, start.cost) if part is None else (part.fit, part.cost)
    reach = inflation * set_reach(noise.freedom)

    def is_as_good(rival: Fit, rival_cost: float) -> bool:
        if rival_cost <= cost + reach:
            return True
        is_share = part_cost - rival_cost >= EXPLAIN.naming.share_of_best * (part_cost - cost)
        return (
            not observations.is_steady
            and is_share
            and not is_clearly_worse(rival, best, noise, EXPLAIN.naming.set_level)
        )

    equals: list[tuple[str, ...]] = [()] if is_as_good(part_fit, part_cost) else []
    if not equals:
        others = [
            one
            for one in candidates
            if one.card.name not in names and is_visible(one, is_steady=observations.is_steady)
        ]
        rivals = [search.explain((*names, one.card.name)) for one in others[: EXPLAIN.naming.top]]
        equals += [one.names for one in rivals if is_as_good(one.fit, one.cost)]
    if not equals and not observations.is_steady:
        # A term of the same shape is the parameter written as an equation.
        without = replace(prepared, problem=held)
        term = equal_term(without, part_fit, best, part_cost - cost, is_alike_counted=False)
        equals += [(f"a term {term}",)] if term else []
    runs = LockedRuns(prepared, locked)
    before, after = runs.errors(part_fit.point), runs.errors(best.point)
    improved = np.mean((after / runs.floor**2).sum(axis=1) < (before / runs.floor**2).sum(axis=1))
    return Trial(equals=tuple(equals), closure=runs.closure(before, after), improved=float(improved))
