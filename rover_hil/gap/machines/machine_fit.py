"""Fits of a machine with a set of effects, and how well each predicts runs that it was not fitted to."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from typing import TypeAlias

import numpy as np
from scipy import stats

from rover_hil.gap.data.parameters import DATA
from rover_hil.gap.data.problem import Free, Indices, Point, Problem, cells, effect_free
from rover_hil.gap.machines.called_machine import CalledMachine
from rover_hil.gap.machines.descent import descend, descend_together
from rover_hil.gap.machines.parameters import MACHINES
from rover_hil.gap.machines.steady import SteadyMachine
from rover_hil.gap.statistics.fit import Fit
from rover_hil.gap.statistics.sensor_noise import SensorNoise, declared_noise
from sim_backends.models.interface import Array, EffectCard
from sim_backends.models.parameter_key import ParameterKey

Names: TypeAlias = tuple[str, ...]
Shapes: TypeAlias = Mapping[str, Mapping[str, float]]
"""Effect to the shapes that its fit starts from."""


class EvidenceKind(Enum):
    """What speaks for an explanation, and how the size of the errors is known."""

    RUNS = "runs that the others predict; the noise of each sensor is declared"
    LEARNED = "the same; the noise is learned from the runs, so that a small rest proves nothing"
    ROWS = "the likelihood of all values; their noise is known by replicates"


RIDGE = 1e-12
FAR = 1e9
"""Error of a start from which the machine runs away."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LeftOut:
    """What each run says about a fit when it is left out, by linearisation.

    Attributes:
        squares: Squared error of each run predicted by the others, its own unknowns fitted, in units of the
            declared noise.
        counts: Values of each run.
        moved: Change of each parameter of all runs when one is left out, in prior deviations.
        by_samples: Standard error of each parameter from the samples, in prior deviations.
        informed: Information of each run on each parameter.
        keys: These parameters.
    """

    squares: Array
    counts: Array
    moved: Array
    by_samples: Array
    informed: Array
    keys: tuple[ParameterKey, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class MachineFit:
    """A machine with some effects, fitted to the output error.

    Attributes:
        names: The effects, sorted.
        fit: Parameters, residual and derivatives.
        noise: Size of the errors that the fit assumed.
        declared_sd: Declared noise by channel.
        left_out: Leave-one-run-out results.
        evidence: What it is compared by.
        charge: For free shapes, in minus two log-likelihood (Laplace).
        freedom: Degrees of freedom behind the size of the errors.
    """

    names: Names
    fit: Fit
    noise: SensorNoise
    declared_sd: Array
    left_out: LeftOut
    evidence: EvidenceKind = EvidenceKind.RUNS
    charge: float = 0.0
    freedom: float = math.inf

    @property
    def cost(self) -> float:
        """Minus two log-posterior by the declared noise."""
        return float(self.errors @ self.errors + self.fit.pull @ self.fit.pull) + self.charge

    @property
    def pulls(self) -> float:
        """Cost of base parameters away from nominal, where it is compared with that of errors."""
        if self.evidence is not EvidenceKind.LEARNED:
            return 0.0
        base = [item.key.is_base for item in self.fit.free]
        return float(np.sum(self.fit.pull[np.array(base, dtype=np.bool_)] ** 2))

    @property
    def count(self) -> float:
        """Number of values."""
        return float(self.left_out.counts.sum())

    @property
    def inflation(self) -> float:
        """Ratio of the remaining cost to that of errors alone, at least 1, where values count one by one."""
        if self.evidence is not EvidenceKind.ROWS:
            return 1.0
        return max(1.0, (self.cost - self.charge) / max(self.count - len(self.names), 1.0))

    @property
    def errors(self) -> Array:
        """Measured minus simulated, in units of the declared noise."""
        return in_declared_units(self.fit, self.noise, self.declared_sd)

    @property
    def error(self) -> float:
        """Sum of squared errors of runs predicted by the others, in units of the declared noise."""
        return float(self.left_out.squares.sum())

    @property
    def merit(self) -> float:
        """Minus two log-likelihood of the left-out runs, each with errors of its own size; smaller is better.

        One run that lies far outside the others, and is extrapolated badly, cannot decide alone. Runs of few
        values are not left out.
        """
        if self.evidence is EvidenceKind.ROWS:
            return self.cost
        counts = self.left_out.counts
        return float(np.sum(counts * np.log(self.left_out.squares / counts))) + self.pulls

    @property
    def excess(self) -> float:
        """The part of it that the declared noise does not explain; positive."""
        return max(self.error - float(self.left_out.counts.sum()), 1e-9)


class MachineFits:
    """Fits of sets of effects, cached.

    Args:
        problem: Model and observations.
        cards: Effects to choose from.
    """

    def __init__(self, problem: Problem, cards: Sequence[EffectCard]) -> None:
        self.problem = problem
        self.cards = {card.name: card for card in cards}
        self._known: dict[Names, MachineFit] = {}
        self._slopes: dict[ParameterKey, Array] = {}

    @property
    def evidence(self) -> EvidenceKind:
        """What explanations are compared by."""
        if isinstance(self.problem.model, SteadyMachine):
            return EvidenceKind.ROWS
        is_learned = isinstance(self.problem.model, CalledMachine) and bool(self.problem.model.learned)
        return EvidenceKind.LEARNED if is_learned else EvidenceKind.RUNS

    @property
    def freedom(self) -> float:
        """Degrees of freedom behind the size of the errors."""
        return self.problem.model.freedom if isinstance(self.problem.model, SteadyMachine) else math.inf

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
        starts: list[Point] = [plain, *self._far_starts(names, plain, begin)]
        ranked = sorted(starts, key=lambda one: self._start_cost(free, one, fixed))
        return ranked[: 1 if self.evidence is EvidenceKind.ROWS else MACHINES.fit.called_starts]

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
        """Return minus two log-posterior at a start."""
        error = self.problem.observations.values - self.problem.predict({**fixed, **start})
        whitened = declared_noise(self.problem.observations).whiten(np.clip(np.nan_to_num(error), -FAR, FAR))
        pull = np.array([(start[item.key] - item.mean) / item.sd for item in free])
        return float(whitened @ whitened + pull @ pull)

    def _charge(self, found: Fit) -> float:
        names = {item.key.effect for item in found.free if item.key.effect}
        shapes = [
            ParameterKey(effect=name, name=item.name)
            for name in names
            for item in self.cards[name].parameters[1:]
        ]
        return found.shape_information(shapes) if shapes else 0.0

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
        """Return the fit of a set of effects.

        Args:
            names: The effects.
            shapes: Their shapes to start from; the nominal ones where left out.
            begin: Parameters to start from.
        """
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
        """Return the base parameters that effects release, at their nominal values."""
        nominal = {item.name: item.nominal for item in self.problem.model.parameters}
        released = [self.cards[name].releases for name in names]
        return {ParameterKey(name=one): nominal[one] for one in released if one is not None}

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
                charge=self._charge(found) if self.evidence is EvidenceKind.ROWS else 0.0,
                freedom=self.freedom,
            )
        return [self._known[tuple(sorted(names))] for names, *_ in options]


def in_declared_units(fit: Fit, noise: SensorNoise, declared_sd: Array) -> Array:
    """Return measured minus simulated of a fit in units of the declared noise of each channel."""
    errors: Array = fit.residual * (noise.channel_sd / declared_sd)[noise.channel]
    return errors


def _stronger(free: Sequence[Free], begin: Point, share: float) -> Point:
    """Return a start with effects of a share of their natural size."""
    start = {item.key: begin.get(item.key, item.start) for item in free}
    strengths = {item.key.effect: item for item in reversed(free) if item.key.is_of_effect}
    for item in strengths.values():
        start[item.key] = float(np.clip(item.mean + share * item.sd / DATA.fit.weak, item.lower, item.upper))
    return start


def start_of_runs(problem: Problem, shared: Point | None = None) -> Point:
    """Return starting values of the unknowns of each run: of many draws those that fit its beginning best.

    A fit from a wrong initial state may end in another period of an oscillation.

    Args:
        problem: Model and observations.
        shared: Parameters of all runs; nominal where left out.
    """
    free = [item for item in problem.run_free() if not item.key.is_deviation]
    if not free:
        return {}
    names = list(dict.fromkeys(item.key.name for item in free))
    draws = stats.qmc.Sobol(len(names), seed=0).random(MACHINES.fit.start_draws)
    pulls = stats.norm.ppf(0.01 + 0.98 * draws)
    pulls[0] = 0.0
    points = [{**(shared or {}), **_drawn(free, dict(zip(names, pull, strict=True)))} for pull in pulls]
    problem.prepare_points(points)
    declared = declared_noise(problem.observations).channel_sd[problem.observations.channel]
    weight = _beginning(problem) / declared**2
    best: dict[ParameterKey, float] = {}
    costs = np.stack([_costs(problem, point, weight) for point in points])
    for run, site in enumerate(problem.sites):
        chosen = points[int(np.argmin(costs[:, run]))]
        best.update({key: value for key, value in chosen.items() if key.run == site.name})
    return best


def _drawn(free: Sequence[Free], pulls: Mapping[str, float]) -> Point:
    """Return the same draw of the unknowns, by name in prior deviations, in every run."""
    by_item = [(item, pulls[item.key.name]) for item in free]
    return {
        item.key: float(np.clip(item.mean + pull * item.sd, item.lower, item.upper)) for item, pull in by_item
    }


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


def leave_one_run_out(found: Fit, noise: SensorNoise, declared_sd: Array, owner: Indices) -> LeftOut:
    """Return how the other runs predict each run, and how its absence moves the parameters.

    Where units under test differ, all runs of one unit are left out together.

    Args:
        found: With derivatives at the fitted point.
        noise: The errors that it assumed.
        declared_sd: Declared noise by channel.
        owner: Number of the run, or of the unit under test, of each row with a value.
    """
    shared = shared_parameters(found)
    runs, parts = zip(*parts_of_runs(found, owner), strict=True)
    normal = np.eye(len(shared)) + sum(matrix.T @ matrix for _, matrix, _ in parts)
    # Derivatives of very different size leave rounding errors in the normal matrix.
    normal += np.diag(np.full(len(shared), RIDGE * float(np.diag(normal).max(initial=1.0))))
    covariance = np.linalg.inv(normal)
    scale = (noise.channel_sd / declared_sd)[noise.channel]
    # A bound that holds a parameter with all runs holds it without one of them too.
    is_free = 1.0 - held_parameters(found)
    moved, squares, informed = [], [], []
    for run, (error, matrix, rows) in zip(runs, parts, strict=True):
        without = normal - MACHINES.fit.left_out * matrix.T @ matrix
        without = np.where(np.outer(is_free, is_free) > 0.0, without, np.diag(np.diag(normal)))
        change = -np.linalg.solve(without, is_free * (matrix.T @ error))
        outside = (error - matrix @ change)[:rows] * scale[owner == run]
        moved.append(change)
        squares.append(float(outside @ outside))
        informed.append(np.sum((matrix @ covariance) ** 2, axis=0))
    return LeftOut(
        squares=np.array(squares),
        counts=np.array([float(rows) for *_, rows in parts]),
        moved=np.array(moved),
        by_samples=np.sqrt(np.diag(covariance)),
        informed=np.array(informed),
        keys=tuple(found.free[index].key for index in shared),
    )


def shared_parameters(found: Fit) -> list[int]:
    """Return the places of the parameters of all runs."""
    return [index for index, item in enumerate(found.free) if not item.key.run]


def held_parameters(found: Fit) -> "np.ndarray[tuple[int, ...], np.dtype[np.bool_]]":
    """Return which parameters of all runs a bound keeps from a better value."""
    return np.array([_is_held(found, index) for index in shared_parameters(found)], dtype=np.bool_)


def parts_of_runs(found: Fit, owner: Indices) -> list[tuple[int, tuple[Array, Array, int]]]:
    """Return each run with its errors and derivatives, without what its own unknowns can absorb.

    Args:
        found: With derivatives at the fitted point.
        owner: Number of the run, or of the unit under test, of each row with a value.

    Returns:
        Number; errors, derivatives by the parameters of all runs, and how many of their rows are samples.
    """
    shared = shared_parameters(found)
    return [(int(run), _without_own(found, owner == run, shared)) for run in np.unique(owner)]


def _is_held(found: Fit, index: int) -> bool:
    """Return True where a bound keeps a parameter from a better value."""
    item, value = found.free[index], found.point[found.free[index].key]
    slope = float(found.jacobian.columns([index])[:, 0] @ found.residual - found.pull[index])
    rounding = 1e-9 * max(item.sd, abs(value))
    return (value <= item.lower + rounding and slope < 0.0) or (
        value >= item.upper - rounding and slope > 0.0
    )


def _without_own(
    found: Fit, here: "np.ndarray[tuple[int, ...], np.dtype[np.bool_]]", shared: Sequence[int]
) -> tuple[Array, Array, int]:
    """Return error and derivatives of one run without what its own unknowns can absorb, and its rows."""
    values, places = found.jacobian.rows(here)
    column = {place: index for index, place in enumerate(places)}
    own = [place for place in places if place not in shared and np.any(values[:, column[place]])]
    error = np.concatenate((found.residual[here], -found.pull[own]))
    matrix = np.zeros((values.shape[0] + len(own), len(shared)))
    matrix[: values.shape[0]] = values[:, [column[place] for place in shared]]
    if own:
        starts = values[:, [column[place] for place in own]]
        basis = np.linalg.qr(np.vstack((starts, np.eye(len(own)))))[0]
        error = error - basis @ (basis.T @ error)
        matrix = matrix - basis @ (basis.T @ matrix)
    return error, matrix, int(here.sum())


def jackknife_error(left_out: LeftOut, index: int) -> float:
    """Return the standard error of a parameter by leaving out runs, in prior deviations."""
    moved = left_out.moved[:, index]
    count = moved.size
    return math.sqrt((count - 1) / count * float(np.sum((moved - moved.mean()) ** 2)))
