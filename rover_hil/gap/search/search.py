"""Search for the effects that explain a machine's runs: add, drop and swap.

Each effect of an explanation must help to predict runs that it was not fitted to.
"""

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

from rover_hil.gap.data.problem import Point
from rover_hil.gap.evidence.card_changes import card_changes
from rover_hil.gap.evidence.evidence import MachineFit, Names
from rover_hil.gap.evidence.score import Score, cosine, linear_gain, one_sided_z, score_all
from rover_hil.gap.fit.machine_fit import MachineFits, Shapes
from rover_hil.gap.parameters import MACHINES
from sim_backends.models.interface import EffectCard
from sim_backends.models.parameter_key import ParameterKey


@dataclass(frozen=True, slots=True, kw_only=True)
class EffectEvidence:
    """Why one effect belongs to an explanation.

    Attributes:
        name: The effect.
        z: Its strength over the scatter of runs, as a standard normal.
        share: Share of the excess error without it that it explains, on runs it was not fitted to.
        agreeing: Share of the runs that it improves.
        objection: Why it is not accepted; empty where it is.
    """

    name: str
    z: float
    share: float
    agreeing: float
    objection: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Found:
    """Result of a search.

    Attributes:
        best: The explanation where the search ended; the fit without effects where there is none.
        objections: Effects that were fitted and not accepted, and why.
    """

    best: MachineFit
    objections: Mapping[str, str]


class MachineSearch:
    """Finds the effects that explain the runs."""

    def __init__(self, fits: MachineFits, advance: Callable[[str], None]) -> None:
        self._fits = fits
        self._advance = advance
        self._objections: dict[str, str] = {}
        self._scores: dict[Names, list[Score]] = {}

    def run(self) -> Found:
        """Return the explanation that predicts left-out runs best."""
        base = self._fits.base()
        best = base
        for _ in range(MACHINES.search.most_rounds):
            if best.names and best.is_within_noise:
                break
            better = self._better(best)
            if better is None:
                break
            best = better
        self._visit_twins(best)
        return Found(best=best, objections=self._objections)

    def scores(self, at: MachineFit) -> list[Score]:
        """Return the first-order score of every further effect; of the base fit at each of its shapes."""
        if at.names not in self._scores:
            found = score_effects(self._fits, at)
            # Of the many that a search makes only the best shapes are kept: each is as long as the data.
            self._scores[at.names] = best_shapes(found) if at.names else found
        return self._scores[at.names]

    def evidence(self, found: MachineFit) -> list[EffectEvidence]:
        """Return the evidence for each effect of an explanation."""
        return [self._evidence(found, name) for name in found.names]

    def candidates(self) -> list[MachineFit]:
        """Return the visited fits without an effect at its limit, or two large ones that nearly cancel."""
        return [
            one
            for one in self._fits.tried.values()
            if not one.evidence.is_imitation(one)
            and not any(_at_bound(one, self._fits.cards[name]) for name in one.names)
        ]

    def _better(self, best: MachineFit) -> MachineFit | None:
        """Return a better explanation that is accepted; with a pair only where no single effect suffices."""
        singles = self._fitted([*self._singles(best), *self._swapped(best)])
        better = self._best_of(singles, best)
        if is_small(best):
            return better
        if better is not None and (better.is_within_noise or better.evidence.explains_most(best, better)):
            return better
        pairs = self._fitted(self._pairs(best))
        return self._best_of([*singles, *pairs], best)

    def _fitted(self, options: Sequence[tuple[Names, Shapes, MachineFit]]) -> list[MachineFit]:
        self._advance(f"fitting {len(options)} explanations")
        fitted = self._fits.fit_all([(names, shapes, begin.fit.point) for names, shapes, begin in options])
        self._fits.fit_all(
            [self._without(one, name) for one in fitted for name in one.names if len(one.names) > 1],
            is_near=True,
        )
        return fitted

    def _best_of(self, fitted: Sequence[MachineFit], best: MachineFit) -> MachineFit | None:
        better = [one for one in fitted if one.merit < best.merit]
        accepted = [
            one
            for one in sorted(better, key=lambda one: one.merit)
            if len(one.names) > len(best.names) or not one.is_equal(best)
        ]
        return next((one for one in accepted if self._is_accepted(one)), None)

    def _singles(self, best: MachineFit) -> list[tuple[Names, Shapes, MachineFit]]:
        """Return the explanations with one effect more."""
        if len(best.names) >= MACHINES.search.most_effects:
            return []
        ranked = ranked_scores(self.scores(best))
        return [_extended(best, (one,)) for one in ranked[: MACHINES.search.singles]]

    def _pairs(self, best: MachineFit) -> list[tuple[Names, Shapes, MachineFit]]:
        """Return the explanations with two effects more that gain most, to first order."""
        if len(best.names) + 2 > MACHINES.search.most_effects:
            return []
        ranked = ranked_scores(self.scores(best))[: MACHINES.search.pair_top]
        pairs = [
            pair for pair in itertools.combinations(ranked, 2) if abs(cosine(*pair)) < MACHINES.search.same
        ]
        pairs.sort(key=linear_gain, reverse=True)
        return [_extended(best, pair) for pair in pairs[: MACHINES.search.pairs]]

    def _swapped(self, best: MachineFit) -> list[tuple[Names, Shapes, MachineFit]]:
        """Return the explanations with one effect replaced."""
        options: list[tuple[Names, Shapes, MachineFit]] = []
        for name in best.names:
            part = self._part(best, name)
            ranked = [one for one in ranked_scores(self.scores(part)) if one.direction.name != name]
            options += [_extended(part, (score,)) for score in ranked[:2] if one_sided_z(score) > 0.0]
        return options

    def _part(self, found: MachineFit, name: str) -> MachineFit:
        return self._fits.fit_all([self._without(found, name)])[0]

    def _without(self, found: MachineFit, name: str) -> tuple[Names, Shapes, Point]:
        begin = {key: value for key, value in found.fit.point.items() if key.effect != name}
        return tuple(one for one in found.names if one != name), {}, begin

    def _is_accepted(self, found: MachineFit) -> bool:
        evidence = self.evidence(found)
        for one in evidence:
            if one.objection and len(found.names) == 1:
                self._objections[one.name] = one.objection
        return all(not one.objection for one in evidence)

    def _evidence(self, found: MachineFit, name: str) -> EffectEvidence:
        card = self._fits.cards[name]
        part = self._part(found, name)
        share, agreeing = found.explained(part)
        z = found.evidence.z(part, found, card.strength_key)
        least_share, needed = found.evidence.needed(found, share)
        objection = ""
        if found.evidence.is_imitation(found):
            objection = "large effects nearly cancel: they imitate a third"
        elif share < least_share:
            objection = (
                f"explains {max(share, 0.0):.0%} of the remaining error on left-out runs, "
                f"{least_share:.0%} required"
            )
        elif agreeing < MACHINES.search.agreeing_share:
            objection = f"improves {agreeing:.0%} of the runs only"
        elif abs(z) < needed:
            objection = f"runs disagree on its size: {abs(z):.1f} standard deviations, {needed:g} required"
        else:
            objection = _at_bound(found, card)
        return EffectEvidence(name=name, z=z, share=share, agreeing=agreeing, objection=objection)

    def _visit_twins(self, best: MachineFit) -> None:
        """Fit the explanations in which an effect that is most similar takes the place of one of the best."""
        for name in best.names:
            part = self._part(best, name)
            for score in self._twins(part, best, name):
                self._fits.best(
                    (*part.names, score.direction.name),
                    {score.direction.name: score.direction.shapes},
                    part.fit.point,
                )

    def _twins(self, part: MachineFit, best: MachineFit, name: str) -> list[Score]:
        """Return the effects most similar to one of the best explanation."""
        scores = self.scores(part)
        own = [one for one in scores if one.direction.name == name]
        if not own:
            return []
        target = max(own, key=one_sided_z)
        others = [
            one
            for one in best_shapes(scores)
            if one.direction.name not in best.names and abs(cosine(one, target)) > MACHINES.search.twins
        ]
        return sorted(others, key=lambda one: -abs(cosine(one, target)))[:3]


def _extended(best: MachineFit, scores: Sequence[Score]) -> tuple[Names, Shapes, MachineFit]:
    names = (*best.names, *(score.direction.name for score in scores))
    return names, {score.direction.name: score.direction.shapes for score in scores}, best


def score_effects(fits: MachineFits, at: MachineFit) -> list[Score]:
    """Return the first-order score of every effect that a fit is without, at each of its shapes."""
    others = [card for name, card in fits.cards.items() if name not in at.names]
    at = at.decorrelated
    changes = card_changes(fits.problem, at.fit.point, others)
    whitened = [replace(one, change=at.noise.whiten(one.change)) for one in changes]
    return score_all(at.fit, at.noise, whitened, is_steady=not fits.evidence.is_learned)


def is_small(found: MachineFit) -> bool:
    """Return True where a fit leaves less than the noise of the sensors: a pair is not worth its risk."""
    return found.excess < float(found.left_out.counts.sum())


def best_shapes(scores: Sequence[Score]) -> list[Score]:
    """Return each effect at its best shape."""
    best: dict[str, Score] = {}
    for score in scores:
        name = score.direction.name
        if name not in best or (one_sided_z(score), abs(score.z)) > (
            one_sided_z(best[name]),
            abs(best[name].z),
        ):
            best[name] = score
    return list(best.values())


def ranked_scores(scores: Sequence[Score]) -> list[Score]:
    """Return each effect at its best shape, the best supported first."""
    return sorted(best_shapes(scores), key=one_sided_z, reverse=True)


def _at_bound(found: MachineFit, card: EffectCard) -> str:
    """Return which parameter is at a bound that is neither its null nor a usual shape; empty for none."""
    for item in found.evidence.determined(card):
        value = found.fit.point[ParameterKey(effect=card.name, name=item.name)]
        known = (item.nominal, *card.shape_grid.get(item.name, ()))
        bounds = [one for one in (item.lower, item.upper) if math.isfinite(one) and one not in known]
        sizes = {one: max(abs(one - item.nominal), abs(one), 1e-300) for one in bounds}
        if any(abs(value - one) <= MACHINES.search.at_limit * size for one, size in sizes.items()):
            return f"its {item.name} is at its limit of {value:.4g} {item.unit}"
    return ""
