"""Name what is missing: best subset of effects, fitted together with the base parameters."""

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from rover_hil.gap.candidates import (
    Candidate,
    absorber,
    best_of_each,
    candidate_directions,
    card_directions,
    is_visible,
)
from rover_hil.gap.fit import Fit
from rover_hil.gap.noise import Noise
from rover_hil.gap.problem import Problem
from rover_hil.gap.score import asked, cosine, family_draws, family_p, quantile, score_all
from rover_hil.gap.search import Explanation, Search, linear_gain
from sim_backends.models.interface import Array, EffectCard

NAME_ALPHA = 0.005
"""Family-wise probability of a first name without gap."""
MORE_ALPHA = 0.005
"""The same for each further name."""
SET_LEVEL = 0.99
"""Level of the likelihood ratio that keeps one rival in the set: with all rivals it stays above 95 %."""
MOST_EFFECTS = 3
TOP = 8
IMITATED = 0.1
"""Share below which an effect that is not asked for is said to be imitated by base parameters."""
SHARE_OF_REST = 0.5
"""What a further name must explain of what is left."""
TRIED_PER_SIZE = 8
ALIKE = 0.9
"""Cosine from which on two effects are not tried together."""
WORTH = 0.6
"""Share of the gain that counts from which on larger subsets are tried."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Naming:
    """What came out.

    Attributes:
        scores: Best score of each effect at the base model.
        p_name: Probability of the greatest score without gap.
        best: The chosen explanation; None where no effect is asked for.
        members: Explanations that the data does not tell from the best, the best first.
        tried: All fitted explanations.
        absorbed: Effects that base parameters hide, and the parameter that does it.
        line: The score that counts.
        inflation: By how much what is left exceeds what errors explain, at least 1.
    """

    scores: tuple[Candidate, ...]
    p_name: float
    best: Explanation | None
    members: tuple[Explanation, ...]
    tried: Mapping[tuple[str, ...], Explanation]
    absorbed: Mapping[str, str]
    line: float
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
        advance: Told what is being done.
    """
    advance("scoring effects")
    changes = card_directions(problem, noise, start, cards)
    scores = score_all(start, noise, changes, is_steady=problem.seen.is_steady)
    candidates = best_of_each(scores, cards)
    visible = [item for item in candidates if is_visible(item, is_steady=problem.seen.is_steady)]
    names = {item.card.name for item in visible}
    counted = [score for score in scores if score.direction.name in names]
    draws = family_draws(counted, noise.freedom, rng)
    p_name = family_p(counted, max(map(asked, counted)), draws, noise.freedom) if counted else 1.0
    search = Search(problem, noise, start, visible, scores)
    is_asked = p_name <= NAME_ALPHA
    chosen = _choose(problem, noise, start, search, visible[:TOP], draws, advance) if is_asked else None
    best, members, inflation = chosen or (None, [], 1.0)
    return Naming(
        scores=tuple(candidates),
        p_name=p_name,
        best=best,
        members=tuple(members),
        tried=search.tried,
        absorbed=_absorbed(start, candidates),
        line=quantile(draws, NAME_ALPHA),
        inflation=inflation,
    )


def _absorbed(start: Fit, candidates: Sequence[Candidate]) -> dict[str, str]:
    return {
        item.card.name: absorber(start, item.score)
        for item in candidates
        if item.score.left < IMITATED and item.card.releases is None
    }


def _choose(
    problem: Problem,
    noise: Noise,
    start: Fit,
    search: Search,
    top: Sequence[Candidate],
    draws: Array,
    advance: Callable[[str], None],
) -> tuple[Explanation, list[Explanation], float] | None:
    line = quantile(draws, MORE_ALPHA) ** 2
    by_size: dict[int, list[Explanation]] = {}
    for size in range(1, min(MOST_EFFECTS, len(top)) + 1):
        subsets = _promising(problem, noise, search, top, size, by_size)
        for number, names in enumerate(subsets):
            advance(f"fitting {size} effect{'s' if size > 1 else ''}, {number + 1} of {len(subsets)}")
            search.explain(names)
        fitted = [one for key, one in search.tried.items() if len(key) == size]
        by_size[size] = sorted(fitted, key=lambda one: one.cost)
        if size > 1 and by_size[size - 1][0].cost - by_size[size][0].cost < WORTH * line:
            break
    best = by_size[1][0]
    if start.cost - best.cost < quantile(draws, 0.05) ** 2:
        return None
    for size in sorted(by_size)[1:]:
        more = by_size[size][0]
        gain = best.cost - more.cost
        needed = line * (len(more.names) - len(best.names)) * inflation_of(problem, more)
        if gain >= needed and gain >= SHARE_OF_REST * max(rest(problem, best), 0.0):
            best = more
    inflation = inflation_of(problem, best)
    reach = inflation * set_reach(noise.freedom)
    members = [one for one in by_size[len(best.names)] if one.cost <= best.cost + reach]
    return best, members, inflation


def set_reach(freedom: float) -> float:
    """Return how much worse a rival may be and stay in the set."""
    if math.isfinite(freedom):
        return float(stats.f.ppf(SET_LEVEL, 1, freedom))
    return float(stats.chi2.ppf(SET_LEVEL, 1))


def rest(problem: Problem, explanation: Explanation) -> float:
    """Return the cost beyond what errors alone would leave; 0 for series, whose errors are learned."""
    if not problem.seen.is_steady:
        return 0.0
    count = problem.seen.values.size - len(explanation.names)
    return explanation.fit.cost - count


def inflation_of(problem: Problem, explanation: Explanation) -> float:
    """Return by how much what is left exceeds what errors explain, at least 1."""
    if not problem.seen.is_steady:
        return 1.0
    count = max(problem.seen.values.size - len(explanation.names), 1)
    return max(1.0, explanation.fit.cost / count)


def _promising(
    problem: Problem,
    noise: Noise,
    search: Search,
    top: Sequence[Candidate],
    size: int,
    by_size: Mapping[int, Sequence[Explanation]],
) -> list[tuple[str, ...]]:
    """Return the subsets worth a fit: best to first order at the base model, and next to the best so far."""
    by_name = {item.card.name: item for item in top}
    subsets = [one for one in itertools.combinations(sorted(by_name), size) if are_apart(by_name, one)]
    if size == 1:
        return [names for names in subsets if asked(by_name[names[0]].score) > 1.0] or subsets[:1]
    ranked = sorted(subsets, key=lambda names: -linear_gain([by_name[name].score for name in names]))
    promising = ranked[: TRIED_PER_SIZE // 2]
    for part in by_size[size - 1][:2]:
        promising += _extensions(problem, noise, top, part)[: TRIED_PER_SIZE // 4]
    for part in by_size[size - 1][:1]:
        for name in part.names:
            search.explain((name,))
    unique = dict.fromkeys(tuple(sorted(names)) for names in promising)
    return [names for names in unique if are_apart(by_name, names)]


def are_apart(by_name: Mapping[str, Candidate], names: Sequence[str]) -> bool:
    """Tell whether no two look the same: two that do imitate a third by pulling against each other."""
    pairs = itertools.combinations(names, 2)
    return all(abs(cosine(by_name[one].score, by_name[other].score)) < ALIKE for one, other in pairs)


def _extensions(
    problem: Problem, noise: Noise, top: Sequence[Candidate], part: Explanation
) -> list[tuple[str, ...]]:
    others = [item for item in top if item.card.name not in part.names]
    changes = candidate_directions(problem, noise, part.fit, others)
    scores = score_all(part.fit, noise, changes, is_steady=problem.seen.is_steady)
    ranked = best_of_each(scores, [item.card for item in others])
    return [(*part.names, item.card.name) for item in ranked if asked(item.score) > 1.0]
