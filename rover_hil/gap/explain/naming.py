"""Name the missing effects: the best subset, fitted together with the base parameters."""

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from rover_hil.gap.data.problem import Problem
from rover_hil.gap.explain.candidates import (
    Candidate,
    best_of_each,
    candidate_directions,
    card_directions,
    imitating_parameter,
    is_visible,
)
from rover_hil.gap.explain.parameters import EXPLAIN
from rover_hil.gap.explain.search import Explanation, Search, linear_gain
from rover_hil.gap.statistics.fit import Fit
from rover_hil.gap.statistics.jackknife import is_clearly_worse
from rover_hil.gap.statistics.noise import Noise
from rover_hil.gap.statistics.score import cosine, family_draws, family_p, one_sided_z, quantile, score_all
from sim_backends.models.interface import Array, EffectCard


@dataclass(frozen=True, slots=True, kw_only=True)
class Naming:
    """Result of the search.

    Attributes:
        scores: Best score of each effect at the base model.
        p_name: Probability of the greatest score without gap.
        best: The chosen explanation; None where no effect is significant.
        members: Explanations that the data does not distinguish from the best, the best first.
        tried: All fitted explanations.
        absorbed: Effects imitated by base parameters, and the parameter.
        threshold: Least significant score.
        inflation: Ratio of the remaining cost to that of errors alone, at least 1.
    """

    scores: tuple[Candidate, ...]
    p_name: float
    best: Explanation | None
    members: tuple[Explanation, ...]
    tried: Mapping[tuple[str, ...], Explanation]
    absorbed: Mapping[str, str]
    threshold: float
    inflation: float


def name_effects(
    problem: Problem,
    noise: Noise,
    start: Fit,
    cards: Sequence[EffectCard],
    rng: np.random.Generator,
    advance: Callable[[str], None] = lambda _: None,
) -> Naming:
    """Search for the effects that explain the gap.

    Args:
        problem: Model and observations.
        noise: Of the observations.
        start: The base model's fit.
        cards: The effects.
        rng: For the calibration.
        advance: Called with the current step.
    """
    advance("scoring effects")
    changes = card_directions(problem, noise, start, cards)
    scores = score_all(start, noise, changes, is_steady=problem.observations.is_steady)
    candidates = best_of_each(scores, cards)
    visible = [item for item in candidates if is_visible(item, is_steady=problem.observations.is_steady)]
    names = {item.card.name for item in visible}
    counted = [score for score in scores if score.direction.name in names]
    draws = family_draws(counted, noise.freedom, rng)
    search = Search(problem, noise, start, visible, scores)
    # The scatter between runs of series is known only without the effects: fit first, then test.
    greatest = max((one_sided_z(score, by_samples=True) for score in counted), default=0.0)
    p_name = family_p(counted, greatest, draws, noise.freedom) if counted else 1.0
    chosen = None
    if p_name <= EXPLAIN.naming.alpha:
        chosen = _choose(problem, noise, start, search, visible[: EXPLAIN.naming.top], draws, advance)
    if counted and not problem.observations.is_steady:
        by_runs = [one.jackknife_z for one in search.tried.values()] or list(map(one_sided_z, counted))
        p_name = family_p(counted, max(by_runs), draws, noise.freedom)
    best, members = chosen or (None, [])
    return Naming(
        scores=tuple(candidates),
        p_name=p_name,
        best=best,
        members=tuple(members),
        tried=search.tried,
        absorbed=_absorbed(start, candidates),
        threshold=quantile(draws, EXPLAIN.naming.alpha),
        inflation=1.0 if best is None else inflation_of(problem, best),
    )


def _absorbed(start: Fit, candidates: Sequence[Candidate]) -> dict[str, str]:
    return {
        item.card.name: imitating_parameter(start, item.score)
        for item in candidates
        if item.score.remaining_share < EXPLAIN.naming.imitated and item.card.releases is None
    }


def _choose(
    problem: Problem,
    noise: Noise,
    start: Fit,
    search: Search,
    top: Sequence[Candidate],
    draws: Array,
    advance: Callable[[str], None],
) -> tuple[Explanation, list[Explanation]] | None:
    threshold = quantile(draws, EXPLAIN.naming.more_alpha) ** 2
    by_size: dict[int, list[Explanation]] = {}
    for size in range(1, min(EXPLAIN.naming.most_effects, len(top)) + 1):
        subsets = _promising(problem, noise, search, top, size, by_size)
        for number, names in enumerate(subsets):
            advance(f"fitting {size} effect{'s' if size > 1 else ''}, {number + 1} of {len(subsets)}")
            search.explain(names)
        fitted = [one for key, one in search.tried.items() if len(key) == size]
        by_size[size] = sorted(fitted, key=lambda one: one.cost)
        if size > 1 and by_size[size - 1][0].cost - by_size[size][0].cost < EXPLAIN.naming.worth * threshold:
            break
    best = _largest_needed(problem, start, by_size, draws)
    if best is None:
        return None
    return best, _members(problem, noise, start, by_size, best, draws)


def _largest_needed(
    problem: Problem, start: Fit, by_size: Mapping[int, Sequence[Explanation]], draws: Array
) -> Explanation | None:
    """Return the explanation with as many effects as the data supports."""
    best: Explanation | None = None
    for size, ranked in sorted(by_size.items()):
        sure = quantile(draws, EXPLAIN.naming.alpha if size == 1 else EXPLAIN.naming.more_alpha)
        more = next((one for one in ranked if one.jackknife_z >= sure), None)
        if more is None:
            continue
        gain = (start.cost if best is None else best.cost) - more.cost
        added = size - (0 if best is None else len(best.names))
        needed = quantile(draws, EXPLAIN.naming.more_alpha) ** 2 * added * inflation_of(problem, more)
        if size == 1:
            needed = quantile(draws, 0.05) ** 2
        unexplained = 0.0 if best is None else max(unexplained_cost(problem, best), 0.0)
        if gain >= needed and gain >= EXPLAIN.naming.share_of_rest * unexplained:
            best = more
    return best


def _members(
    problem: Problem,
    noise: Noise,
    start: Fit,
    by_size: Mapping[int, Sequence[Explanation]],
    best: Explanation,
    draws: Array,
) -> list[Explanation]:
    """Return the explanations that the data does not distinguish from the best; in series, by runs."""
    alternatives, parts = by_size[len(best.names)], by_size.get(len(best.names) - 1, ())
    reach = inflation_of(problem, best) * set_reach(noise.freedom)
    members = [one for one in alternatives if one.cost <= best.cost + reach and one.jackknife_z > 0.0]
    if problem.observations.is_steady:
        return members
    threshold, least = (
        quantile(draws, EXPLAIN.naming.alpha),
        EXPLAIN.naming.share_of_best * (start.cost - best.cost),
    )
    others = [one for one in alternatives if one.jackknife_z >= threshold and start.cost - one.cost >= least]
    for part in parts:
        # An effect that adds nothing to others does not make them an alternative.
        others = [
            one
            for one in others
            if not set(part.names) < set(one.names) or part.cost - one.cost >= threshold**2
        ]
    members += [
        one for one in others if not is_clearly_worse(one.fit, best.fit, noise, EXPLAIN.naming.set_level)
    ]
    unique = {one.names: one for one in members}.values()
    return sorted(unique, key=lambda one: (one is not best, one.cost))


def set_reach(freedom: float) -> float:
    """Return the greatest extra cost of an alternative in the set."""
    if math.isfinite(freedom):
        return float(stats.f.ppf(EXPLAIN.naming.set_level, 1, freedom))
    return float(stats.chi2.ppf(EXPLAIN.naming.set_level, 1))


def unexplained_cost(problem: Problem, explanation: Explanation) -> float:
    """Return the cost beyond that of errors alone; 0 for series, whose errors are estimated."""
    if not problem.observations.is_steady:
        return 0.0
    count = problem.observations.values.size - len(explanation.names)
    return explanation.fit.cost - count


def inflation_of(problem: Problem, explanation: Explanation) -> float:
    """Return the ratio of the remaining cost to that of errors alone, at least 1."""
    if not problem.observations.is_steady:
        return 1.0
    count = max(problem.observations.values.size - len(explanation.names), 1)
    return max(1.0, explanation.fit.cost / count)


def _promising(
    problem: Problem,
    noise: Noise,
    search: Search,
    top: Sequence[Candidate],
    size: int,
    by_size: Mapping[int, Sequence[Explanation]],
) -> list[tuple[str, ...]]:
    """Return the subsets to fit: the best to first order, and extensions of the best so far."""
    by_name = {item.card.name: item for item in top}
    subsets = [one for one in itertools.combinations(sorted(by_name), size) if are_distinct(by_name, one)]
    if size == 1:
        return [names for names in subsets if one_sided_z(by_name[names[0]].score) > 1.0] or subsets[:1]
    ranked = sorted(subsets, key=lambda names: -linear_gain([by_name[name].score for name in names]))
    promising = ranked[: EXPLAIN.naming.tried_per_size // 2]
    for part in by_size[size - 1][:2]:
        promising += _extensions(problem, noise, top, part)[: EXPLAIN.naming.tried_per_size // 4]
    for part in by_size[size - 1][:1]:
        for name in part.names:
            search.explain((name,))
    unique = dict.fromkeys(tuple(sorted(names)) for names in promising)
    return [names for names in unique if are_distinct(by_name, names)]


def are_distinct(by_name: Mapping[str, Candidate], names: Sequence[str]) -> bool:
    """Return True where no two effects are alike: two that are imitate a third as their difference."""
    pairs = itertools.combinations(names, 2)
    return all(
        abs(cosine(by_name[one].score, by_name[other].score)) < EXPLAIN.naming.alike for one, other in pairs
    )


def _extensions(
    problem: Problem, noise: Noise, top: Sequence[Candidate], part: Explanation
) -> list[tuple[str, ...]]:
    others = [item for item in top if item.card.name not in part.names]
    changes = candidate_directions(problem, noise, part.fit, others)
    scores = score_all(part.fit, noise, changes, is_steady=problem.observations.is_steady)
    ranked = best_of_each(scores, [item.card for item in others])
    return [(*part.names, item.card.name) for item in ranked if one_sided_z(item.score) > 1.0]
