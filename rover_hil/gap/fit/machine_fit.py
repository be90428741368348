"""Fits of a machine with a set of effects, and how well each predicts runs that it was not fitted to."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TypeAlias

import numpy as np
from scipy import stats

from rover_hil.gap.data.parameters import DATA
from rover_hil.gap.data.problem import Free, Point, Problem, cells, effect_free
from rover_hil.gap.evidence.evidence import Evidence, MachineFit, Names, in_declared_units
from rover_hil.gap.evidence.fit import Fit
from rover_hil.gap.evidence.left_out import leave_one_run_out
from rover_hil.gap.fit.called_machine import CalledMachine
from rover_hil.gap.fit.descent import descend, descend_together
from rover_hil.gap.noise.sensor_noise import SensorNoise, declared_noise
from rover_hil.gap.parameters import MACHINES
from sim_backends.models.interface import Array, EffectCard
from sim_backends.models.parameter_key import ParameterKey

Shapes: TypeAlias = Mapping[str, Mapping[str, float]]
"""Effect to the shapes that its fit starts from."""


FAR = 1e9
"""Error of a start from which the machine runs away."""


class MachineFits:
    """Fits of sets of effects, cached."""

    def __init__(self, problem: Problem, cards: Sequence[EffectCard]) -> None:
        self.problem = problem
        self.cards = {card.name: card for card in cards}
        self._known: dict[Names, MachineFit] = {}
        self._slopes: dict[ParameterKey, Array] = {}

    @property
    def evidence(self) -> Evidence:
        """What explanations are compared by."""
        model = self.problem.model
        return model.evidence if isinstance(model, CalledMachine) else Evidence()

    def _starts(
        self, names: Names, free: Sequence[Free], begin: Point, fixed: Point, *, is_near: bool
    ) -> list[Point]:
        """Return the points that a fit starts from: near the given one, and with stronger effects."""
        plain: Point = {item.key: begin.get(item.key, item.start) for item in free}
        if not names or is_near:
            return [plain]
        if not isinstance(self.problem.model, CalledMachine):
            return [plain, *(_stronger(free, begin, share) for share in MACHINES.fit.start_shares)]
        # A prediction is dear, a start is one, a fit many: only the best starts are fitted.
        # Sizes beyond a limit are the same start, and each counts once.
        starts = {tuple(one.values()): one for one in (plain, *self._far_starts(names, plain, begin))}
        ranked = sorted(starts.values(), key=lambda one: self._start_cost(free, one, fixed))
        return ranked[: self.evidence.most_starts()]

    def _far_starts(self, names: Names, plain: Point, begin: Point) -> list[Point]:
        """Return starts with new effects of several sizes; base parameters as given, and nominal.

        Without a large effect the base parameters compensate so much that derivatives there are useless.
        """
        new = [self.cards[name] for name in names if self.cards[name].strength_key not in begin]
        nominal = {item.key: item.start for item in self.problem.base_free() if item.key in plain}
        starts: list[Point] = []
        for share in MACHINES.fit.called_shares:
            moved: dict[ParameterKey, float] = {}
            for card in new:
                first, single = card.parameters[0], self._known.get((card.name,))
                size = first.nominal + share * first.prior_sd
                if len(new) > 1 and single is not None:
                    size = single.fit.point[card.strength_key]
                elif share == 0.0 and card.releases is not None:
                    # What the base parameter has taken on itself.
                    released = ParameterKey(name=card.releases)
                    size += begin.get(released, 0.0) - self.fixed((card.name,))[released]
                moved[card.strength_key] = min(max(size, first.lower), first.upper)
            starts += [{**plain, **moved}, {**plain, **nominal, **moved}]
        return starts

    def _start_cost(self, free: Sequence[Free], start: Point, fixed: Point) -> float:
        """Return minus two log-posterior with the base parameters that known derivatives give a start.

        At the start itself a right effect looks bad beside the base parameters that were fitted without it.
        """
        noise = declared_noise(self.problem.observations)
        error = self.problem.observations.values - self.problem.predict({**fixed, **start})
        whitened = noise.whiten(np.clip(np.nan_to_num(error), -FAR, FAR))
        pull = np.array([item.pull_in(start) for item in free])
        cost = float(whitened @ whitened + pull @ pull)
        known = [place for place, item in enumerate(free) if item.key in self._slopes]
        if not known:
            return cost
        sizes = [free[place].sd * self._slopes[free[place].key] for place in known]
        slopes = noise.whiten(np.stack(sizes, axis=1))
        aim = slopes.T @ whitened - pull[known]
        return cost - float(aim @ np.linalg.solve(slopes.T @ slopes + np.eye(len(known)), aim))

    def _charge(self, found: Fit) -> float:
        names = {item.key.effect for item in found.free if item.key.effect}
        shapes = [
            ParameterKey(effect=name, name=item.name)
            for name in names
            for item in self.cards[name].parameters[1:]
        ]
        return self.evidence.charge(found, shapes)

    @property
    def tried(self) -> Mapping[Names, MachineFit]:
        """All fits so far."""
        return self._known

    def base(self) -> MachineFit:
        """Return the fit without effects."""
        found = self.best((), {}, start_of_runs(self.problem))
        if isinstance(self.problem.model, CalledMachine) and found.fit.free:
            # Each prediction costs its own time, and derivatives by base parameters hardly change.
            columns = self.problem.derivatives(found.fit.point, found.fit.free)
            self._slopes = {item.key: columns[:, place] for place, item in enumerate(found.fit.free)}
        return found

    def best(self, names: Sequence[str], shapes: Shapes, begin: Point) -> MachineFit:
        """Return the fit of a set of effects."""
        return self.fit_all([(tuple(names), shapes, begin)])[0]

    def free(self, names: Names, shapes: Shapes) -> list[Free]:
        """Return the parameters that are fitted with some effects."""
        cards = [self.cards[name] for name in names]
        released = [card.releases for card in cards if card.releases is not None]
        found = self.problem.base_free(leave_out=released, names=names)
        for card in cards:
            found += [
                replace(item, step=MACHINES.fit.fine_step * item.step)
                for item in effect_free(card, shapes.get(card.name))
            ]
        return found

    def fixed(self, names: Names) -> dict[ParameterKey, float]:
        """Return the base parameters that are held, and those that effects release, at nominal values."""
        nominal = {item.name: item.nominal for item in self.problem.model.parameters}
        released = [self.cards[name].releases for name in names]
        values = {one: nominal[one] for one in released if one is not None} | self.problem.held
        return {ParameterKey(name=one): value for one, value in values.items()}

    def fit_all(
        self, options: Sequence[tuple[Names, Shapes, Point]], *, is_near: bool = False
    ) -> list[MachineFit]:
        """Return the fits of several sets of effects, made together; see `best`.

        Args:
            options: Effects, shapes and parameters to start from.
            is_near: The start is near the result; otherwise stronger effects are tried too.
        """
        new = {tuple(sorted(names)): (shapes, begin) for names, shapes, begin in options}
        new = {names: one for names, one in new.items() if names not in self._known}
        descents, owners = [], []
        for names, (shapes, begin) in new.items():
            free, fixed = self.free(names, shapes), self.fixed(names)
            starts = self._starts(names, free, begin, fixed, is_near=is_near)
            for start in starts:
                descents.append(descend(self.problem, free, start, fixed, self._slopes))
                owners.append(names)
        best: dict[Names, tuple[float, Fit, SensorNoise]] = {}
        declared = declared_noise(self.problem.observations).channel_sd
        for names, (found, noise) in zip(owners, descend_together(self.problem, descents), strict=True):
            errors = in_declared_units(found, noise, declared)
            square = float(errors @ errors)
            if names not in best or square < best[names][0]:
                best[names] = (square, found, noise)
        for names, (_, found, noise) in best.items():
            self._known[names] = MachineFit(
                names=names,
                fit=found,
                noise=noise,
                declared_sd=declared,
                left_out=leave_one_run_out(found, noise, declared, self.problem.owner[noise.keep]),
                evidence=self.evidence,
                charge=self._charge(found),
            )
        return [self._known[tuple(sorted(names))] for names, *_ in options]


def _stronger(free: Sequence[Free], begin: Point, share: float) -> Point:
    """Return a start with effects of a share of their natural size."""
    start = {item.key: begin.get(item.key, item.start) for item in free}
    strengths = {item.key.effect: item for item in reversed(free) if item.key.is_of_effect}
    for item in strengths.values():
        start[item.key] = float(np.clip(item.mean + share * item.sd / DATA.fit.weak, item.lower, item.upper))
    return start


def start_of_runs(problem: Problem, shared: Point | None = None) -> Point:
    """Return starting values of the unknowns of each run: of many draws those that fit its beginning best.

    A fit from a wrong initial state may end in another period of an oscillation. Parameters of all runs that
    are not in `shared` are nominal.
    """
    free = [item for item in problem.run_free() if not item.key.is_deviation]
    if not free:
        return {}
    names = list(dict.fromkeys(item.key.name for item in free))
    draws = stats.qmc.Sobol(len(names), seed=0).random(MACHINES.fit.start_draws)
    pulls = stats.norm.ppf(0.01 + 0.98 * draws)
    pulls[0] = 0.0
    # The same draw of the unknowns, by name in prior deviations, in every run.
    drawn = [dict(zip(names, pull, strict=True)) for pull in pulls]
    # One that was read is drawn as near its reading as its step says; its prior is wider.
    near = {item.key: item.step / (DATA.fit.step_share * item.sd) for item in free}
    points = [
        {**(shared or {}), **{item.key: item.at(near[item.key] * one[item.key.name]) for item in free}}
        for one in drawn
    ]
    problem.prepare_points(points)
    declared = declared_noise(problem.observations).channel_sd[problem.observations.channel]
    weight = _beginning(problem) / declared**2
    best: dict[ParameterKey, float] = {}
    costs = np.stack([_costs(problem, point, weight) for point in points])
    for run, site in enumerate(problem.sites):
        chosen = points[int(np.argmin(costs[:, run]))]
        best.update({key: value for key, value in chosen.items() if key.run == site.name})
    return best


def _costs(problem: Problem, point: Point, weight: Array) -> Array:
    """Return the weighted squared error of each run."""
    error = problem.observations.values - problem.predict(point)
    size = np.clip(np.where(np.isfinite(error), error, FAR), -FAR, FAR)
    squares = np.bincount(problem.observations.site, weights=weight * size**2, minlength=len(problem.sites))
    return squares.astype(np.float64)


def _beginning(problem: Problem) -> Array:
    """Return 1 for rows in the first part of their series, else 0."""
    mask = np.zeros(problem.observations.values.size)
    for cell in cells(problem.observations):
        mask[cell[: max(int(MACHINES.fit.beginning * cell.size), 10)]] = 1.0
    return mask
