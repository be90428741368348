"""Cached fits of subsets of effects."""

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from scipy.optimize import lsq_linear

from rover_hil.gap.data.problem import Free, Key, Point, Problem, effect_free
from rover_hil.gap.explain.candidates import Candidate, imitating_parameter
from rover_hil.gap.explain.parameters import EXPLAIN
from rover_hil.gap.statistics.fit import Fit, fit, whitened_jacobian
from rover_hil.gap.statistics.jackknife import jackknife
from rover_hil.gap.statistics.noise import Noise
from rover_hil.gap.statistics.score import Score, one_sided_z
from sim_backends.models.interface import Array, Parameter

Shapes: TypeAlias = Mapping[str, Mapping[str, float]]
"""Effect to its shape parameters."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Explanation:
    """A subset of effects, fitted.

    Attributes:
        names: Effects, sorted.
        fit: Base parameters and effects together.
        cost: Minus two log-posterior; free shapes are charged for (Laplace's approximation).
        jackknife_z: Significance of its weakest effect over runs, as a standard normal; infinite for steady
            experiments, whose scatter between runs is in the errors.
        widening: Factor on standard errors that covers the scatter between runs.
    """

    names: tuple[str, ...]
    fit: Fit
    cost: float
    jackknife_z: float
    widening: float


class Search:
    """Fits subsets of effects and caches them.

    Args:
        problem: Model and observations.
        noise: Of the observations.
        start: The base model's fit, with derivatives taken there.
        candidates: Effects to choose from.
        scores: Of every effect at every shape, for starting values.
    """

    def __init__(
        self,
        problem: Problem,
        noise: Noise,
        start: Fit,
        candidates: Sequence[Candidate],
        scores: Sequence[Score],
    ) -> None:
        self._problem = problem
        self._noise = noise
        self._start = start
        self._by_name = {item.card.name: item for item in candidates}
        self._scores: dict[str, list[Score]] = {name: [] for name in self._by_name}
        for score in scores:
            if score.direction.name in self._scores:
                self._scores[score.direction.name].append(score)
        self.tried: dict[tuple[str, ...], Explanation] = {}

    def explain(self, names: Sequence[str]) -> Explanation:
        """Return the fit of a subset."""
        key = tuple(sorted(names))
        if key not in self.tried:
            same_size = (one.fit.cost for names, one in self.tried.items() if len(names) == len(key))
            hopeless = min(same_size, default=math.inf) + EXPLAIN.search.hopeless
            best: Fit | None = None
            for shapes, begin in self._starts(key):
                found = self._fit(key, shapes, begin, hopeless)
                if best is None or found.cost < best.cost:
                    best = found
                hopeless = min(hopeless, best.cost + EXPLAIN.search.hopeless)
            if best is None:
                raise AssertionError("every subset has starting shapes")
            cost = best.cost + self._charge(key, best)
            sure, widening = self._jackknife(key, best, cost)
            self.tried[key] = Explanation(names=key, fit=best, cost=cost, jackknife_z=sure, widening=widening)
        return self.tried[key]

    def _jackknife(self, names: tuple[str, ...], fitted: Fit, cost: float) -> tuple[float, float]:
        if self._problem.observations.is_steady:
            return math.inf, 1.0
        cards = [self._by_name[name].card for name in names]
        if any(
            _is_at_limit(card.parameters[0], fitted.value((card.name, card.parameters[0].name)))
            for card in cards
        ):
            return 0.0, 1.0
        strengths = [(card.name, card.parameters[0].name) for card in cards]
        if cancellation(fitted, strengths) > EXPLAIN.search.most_cancellation:
            return 0.0, 1.0
        shapes = [(card.name, item.name) for card in cards for item in card.parameters[1:]]
        found = jackknife(fitted, self._noise, strengths, given=shapes)
        by_runs = min(abs(one.z) for one in found)
        if len(names) == 1:
            by_runs = max(by_runs, *(one_sided_z(score) for score in self._scores[names[0]]))
        # A released base parameter must also lie beyond its prior.
        gain = math.sqrt(max(self._start.cost - cost, 0.0))
        return min(gain, by_runs), max(one.widening for one in found)

    def _charge(self, names: tuple[str, ...], fitted: Fit) -> float:
        shapes = [(name, item.name) for name in names for item in self._by_name[name].card.parameters[1:]]
        return fitted.shape_information(shapes) if shapes else 0.0

    def free(self, names: Sequence[str], shapes: Shapes) -> list[Free]:
        """Return the parameters of a subset, without base parameters that its effects release."""
        cards = [self._by_name[name].card for name in names]
        released = [card.releases for card in cards if card.releases is not None]
        free = self._problem.base_free(leave_out=released)
        for card in cards:
            free += effect_free(card, shapes[card.name])
        return free

    def _starts(self, names: tuple[str, ...]) -> list[tuple[Shapes, Point]]:
        """Return starting points: near the base model, and for one effect also far from it."""
        starts = []
        for shapes in self._shapes(names):
            free = self.free(names, shapes)
            begin: Point = self._begin(names, shapes)
            if len(names) > 1:
                starts.append((shapes, begin))
                continue
            near, far = [begin, self._as_base(names[0], begin)], self._far(names[0], shapes)
            if self._problem.observations.is_steady:
                chosen = self._cheapest(free, near + far, 1)
            else:
                chosen = self._cheapest(free, near, 1) + self._cheapest(free, far, EXPLAIN.search.far_starts)
            starts += [(shapes, point) for point in chosen]
        return starts

    def _cheapest(self, free: Sequence[Free], points: Sequence[Point], count: int) -> list[Point]:
        return sorted(points, key=lambda point: self._cost(free, point))[:count]

    def _fit(self, names: tuple[str, ...], shapes: Shapes, begin: Point, hopeless: float) -> Fit:
        free = self.free(names, shapes)
        return fit(
            self._problem,
            self._noise,
            free,
            begin,
            jacobian=self._warm(names, free, begin),
            fixed=self._fixed(names),
            hopeless=hopeless,
        )

    def _shapes(self, names: tuple[str, ...]) -> list[Shapes]:
        """Return starting shapes: those with the greatest gain to first order, and those fitted before."""
        ranked = sorted(
            itertools.product(*(self._scores[name] for name in names)),
            key=lambda scores: -linear_gain(scores),
        )
        shapes: list[Shapes] = [
            {score.direction.name: score.direction.shapes for score in scores}
            for scores in ranked[: EXPLAIN.search.starts]
        ]
        if len(names) == 1 or not any(self._by_name[name].card.shape_grid for name in names):
            return shapes[: EXPLAIN.search.starts if len(names) == 1 else 1]
        known = {name: self._known_shapes(name) or shapes[0][name] for name in names}
        return [known, shapes[0]]

    def _known_shapes(self, name: str) -> Mapping[str, float] | None:
        single = self.tried.get((name,))
        if single is None:
            return None
        return {
            item.name: single.fit.value((name, item.name)) for item in self._by_name[name].card.parameters[1:]
        }

    def _fixed(self, names: Sequence[str]) -> dict[Key, float]:
        nominal = {item.name: item.nominal for item in self._problem.model.parameters}
        released = (self._by_name[name].card.releases for name in names)
        return {("", one): nominal[one] for one in released if one is not None}

    def _begin(self, names: tuple[str, ...], shapes: Shapes) -> dict[Key, float]:
        begin = dict(self._start.point)
        part = self._nearest(names)
        if part is not None:
            begin.update(part.fit.point)
        for name in names:
            card = self._by_name[name].card
            strength = card.parameters[0]
            if (name, strength.name) not in begin:
                guess = strength.nominal
                if len(names) == 1:
                    guess += self._strength(name, shapes[name])
                begin[name, strength.name] = float(np.clip(guess, strength.lower, strength.upper))
            if card.shape_grid:
                begin.update({(name, shape): value for shape, value in shapes[name].items()})
        return begin

    def _as_base(self, name: str, begin: Point) -> Point:
        """Return the fitted base model: an effect cannot make it worse."""
        card = self._by_name[name].card
        strength = card.parameters[0]
        value = strength.nominal
        if card.releases is not None:
            key = ("", card.releases)
            value += self._start.point.get(key, 0.0) - self._fixed((name,))[key]
        return {**begin, (name, strength.name): float(np.clip(value, strength.lower, strength.upper))}

    def _far(self, name: str, shapes: Shapes) -> list[Point]:
        """Return points with a strong effect, with nominal base parameters or only the imitating one nominal.

        Without a large effect the base parameters compensate so much that derivatives there are useless: a
        delay of several samples is not found from that point.
        """
        candidate = self._by_name[name]
        strength = candidate.card.parameters[0]
        shape = {(name, key): value for key, value in shapes[name].items()}
        sizes = [sign * share * strength.prior_sd for share in EXPLAIN.search.far for sign in (1.0, -1.0)]
        wanted = [strength.nominal + size for size in (*sizes, self._strength(name, shapes[name]))]
        values = {float(np.clip(value, strength.lower, strength.upper)) for value in wanted}
        imitator = ("", imitating_parameter(self._start, candidate.score))
        straight = {key: value for key, value in self._start.point.items() if key != imitator}
        return [
            {**base, **shape, (name, strength.name): value}
            for base in ({}, straight)
            for value in sorted(values - {strength.nominal})
        ]

    def _cost(self, free: Sequence[Free], point: Point) -> float:
        values = self._at(free, point)
        pull = np.array([(values[item.key] - item.mean) / item.sd for item in free])
        observations = self._problem.observations.values
        error = observations - self._problem.predict(values)
        residual = self._noise.whiten(np.where(np.isnan(observations), 0.0, error))
        cost = float(residual @ residual + pull @ pull)
        return cost if math.isfinite(cost) else math.inf

    def _at(self, free: Sequence[Free], point: Point) -> Point:
        fixed = self._fixed(sorted({item.key[0] for item in free if item.key[0]}))
        return {**fixed, **{item.key: point.get(item.key, item.start) for item in free}}

    def _strength(self, name: str, shapes: Mapping[str, float]) -> float:
        score = next(one for one in self._scores[name] if one.direction.shapes == shapes)
        return score.strength if one_sided_z(score) > 0.0 else 0.3 * score.direction.size

    def _nearest(self, names: tuple[str, ...]) -> Explanation | None:
        parts = [one for key, one in self.tried.items() if set(key) < set(names)]
        return min(parts, key=lambda one: one.cost, default=None)

    def _warm(self, names: tuple[str, ...], free: Sequence[Free], begin: Point) -> Array:
        """Return starting derivatives: from smaller subsets where possible, else computed."""
        known = [self._start, *(one.fit for one in self._parts(names))]
        columns: dict[Key, Array] = {}
        for fitted in known:
            columns.update({item.key: fitted.jacobian[:, index] for index, item in enumerate(fitted.free)})
        missing = [item for item in free if item.key not in columns]
        taken = whitened_jacobian(self._problem, self._noise, missing, begin)
        columns.update({item.key: taken[:, index] for index, item in enumerate(missing)})
        return np.stack([columns[item.key] for item in free], axis=1)

    def _parts(self, names: tuple[str, ...]) -> list[Explanation]:
        """Return the smaller subsets that were fitted: single effects, then the best."""
        singles = [self.tried[(name,)] for name in names if len(names) > 1 and (name,) in self.tried]
        nearest = self._nearest(names)
        return [*singles, nearest] if nearest is not None else singles


def _is_at_limit(strength: Parameter, value: float) -> bool:
    """Return True for a strength at its limit: it then represents another effect."""
    limits = [one for one in (strength.lower, strength.upper) if math.isfinite(one)]
    return any(
        abs(value - one) <= EXPLAIN.search.at_limit * abs(one - strength.nominal)
        for one in limits
        if one != strength.nominal
    )


def cancellation(fitted: Fit, strengths: Sequence[Key]) -> float:
    """Return the ratio of the change by effects one by one to that of all together, at least 1.

    Large effects that nearly cancel imitate another effect by their small difference.
    """
    positions = [index for index, item in enumerate(fitted.free) if item.key in strengths]
    changes = fitted.jacobian[:, positions] * fitted.pull[positions]
    together = float(np.linalg.norm(changes.sum(axis=1)))
    return float(np.linalg.norm(changes, axis=0).sum()) / max(together, 1e-300)


def linear_gain(scores: Sequence[Score], pulled: float = 0.0) -> float:
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
    return float(aim @ aim - 2.0 * unexplained) - pulled
