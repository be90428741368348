"""Fits of a machine to its output error, many of them in lockstep.

An integration costs nearly the same for one point as for hundreds. Each fit therefore asks for the
predictions it needs next, and all fits are served by one integration (Levenberg-Marquardt, with several
dampings tried at once).
"""

import math
from collections.abc import Generator, Iterator, Mapping, Sequence
from typing import TypeAlias

import numpy as np
from scipy.optimize import lsq_linear

from rover_hil.gap.data.derivatives import Derivatives
from rover_hil.gap.data.problem import DerivativeRequest, Free, Observations, Point, Problem
from rover_hil.gap.evidence.fit import RIDGE, Fit
from rover_hil.gap.fit.called_machine import CalledMachine
from rover_hil.gap.noise.sensor_noise import SensorNoise, declared_noise, noise_of_residual
from rover_hil.gap.parameters import MACHINES
from sim_backends.models.interface import Array, Model
from sim_backends.models.parameter_key import ParameterKey

Descent: TypeAlias = Generator[Sequence[Point], Sequence[Array], tuple[Fit, SensorNoise]]

POINTS_AT_ONCE = 256
"""Points that are predicted together."""
VALUES_TOGETHER = 32_000_000
"""Predicted values that fits in lockstep hold."""
POINTS_OF_A_DESCENT = 30
"""Predictions that one of them holds, about."""
FAR = 1e6
"""Residual, in declared deviations, where a model has no solution."""


def descend_together(problem: Problem, descents: Sequence[Descent]) -> Iterator[tuple[Fit, SensorNoise]]:
    """Yield the results of several fits in turn; as many as fit into memory are made together."""
    together = max(VALUES_TOGETHER // (POINTS_OF_A_DESCENT * problem.observations.values.size), 1)
    for first in range(0, len(descents), together):
        yield from _descended(problem, descents[first : first + together])


def _descended(problem: Problem, descents: Sequence[Descent]) -> list[tuple[Fit, SensorNoise]]:
    found: dict[int, tuple[Fit, SensorNoise]] = {}
    asked = {index: next(descent) for index, descent in enumerate(descents)}
    while asked:
        points = [point for some in asked.values() for point in some]
        rows: list[Array] = []
        for first in range(0, len(points), POINTS_AT_ONCE):
            rows += problem.predictions(points[first : first + POINTS_AT_ONCE])
        problem.evaluations += len(points)
        following: dict[int, Sequence[Point]] = {}
        for index, some in asked.items():
            own, rows = rows[: len(some)], rows[len(some) :]
            try:
                following[index] = descents[index].send(own)
            except StopIteration as stop:
                found[index] = stop.value
        asked = following
    return [found[index] for index in range(len(descents))]


def descend(
    problem: Problem,
    free: Sequence[Free],
    start: Point,
    fixed: Point,
    known: Mapping[ParameterKey, Array] | None = None,
) -> Descent:
    """Fit parameters; the generator yields the points where it needs predictions.

    Each round the errors are taken as large as the residual of each channel, at least as declared. Known are
    derivatives by some parameters near the start, per unit: they are used until no step with them gains.

    Returns:
        The fit, with derivatives at it, and the errors it assumed.
    """
    search = _Descent(problem, free, fixed)
    slopes = _Slopes(problem, free, known or {})
    pull = search.pull_of(start)
    (predicted,) = yield [search.point(pull)]
    last = np.zeros(pull.size)
    for _ in range(MACHINES.descent.most_rounds):
        residual = search.residual(predicted)
        noise = noise_of_residual(problem.observations, residual)
        request = slopes.request(search.point(pull), predicted)
        jacobian = search.jacobian(noise, request.matrix((yield request.points)))
        moved = None
        for dampings in _damping_groups(problem.model):
            trials = search.trials(pull, noise.whiten(search.filled(residual)), jacobian, dampings)
            if len(dampings) > 1 and np.any(last):
                trials += [search.clipped(pull + factor * last) for factor in MACHINES.descent.farther]
            rows = yield [search.point(trial) for trial in trials]
            moved = search.best(noise, (pull, predicted), trials, rows)
            if moved is not None or slopes.known:
                break
        gain = 0.0
        if moved is not None:
            last = moved[0] - pull
            pull, predicted, gain = moved
        if gain < max(MACHINES.descent.converged, MACHINES.descent.slow * residual.size):
            if not slopes.known:
                break
            slopes.known.clear()
    residual = search.residual(predicted)
    noise = noise_of_residual(problem.observations, residual)
    if moved is not None:
        request = slopes.request(search.point(pull), predicted)
        jacobian = search.jacobian(noise, request.matrix((yield request.points)))
    whitened = noise.whiten(search.filled(residual))
    fit = Fit(
        free=tuple(free),
        point=search.point(pull),
        residual=whitened,
        jacobian=jacobian,
        pull=pull,
        cost=float(whitened @ whitened + pull @ pull),
    )
    return fit, noise


class _Slopes:
    """Derivatives of a fit, of which some are known already."""

    def __init__(self, problem: Problem, free: Sequence[Free], known: Mapping[ParameterKey, Array]) -> None:
        self._problem = problem
        self._free = free
        self.known = {item.key: known[item.key] for item in free if item.key in known}

    def request(self, point: Point, predicted: Array) -> DerivativeRequest:
        """Return what the derivatives need that are not known; the prediction at the point is."""
        return DerivativeRequest(self._problem, point, self._free, self.known, predicted)


def _damping_groups(model: Model) -> tuple[tuple[float, ...], ...]:
    """Return the dampings that are tried at once; one where each prediction costs its own time."""
    groups = (MACHINES.descent.dampings, MACHINES.descent.small_dampings)
    return ((0.0,), *groups) if isinstance(model, CalledMachine) else groups


def residual_of(observations: Observations, predicted: Array) -> Array:
    """Return measured minus predicted; NaN where nothing was measured, very large without prediction."""
    far = FAR * declared_noise(observations).row_sd
    residual = observations.values - predicted
    found = np.where(np.isfinite(observations.values) & ~np.isfinite(predicted), far, residual)
    # A machine that runs away is finite for a while; its squares are not.
    return np.clip(found, -far, far)


class _Descent:
    def __init__(self, problem: Problem, free: Sequence[Free], fixed: Point) -> None:
        self._problem = problem
        self._free = free
        self._fixed = fixed
        self._missing = ~np.isfinite(problem.observations.values)
        self._sizes = np.array([item.sd for item in free])
        self._lower = np.array([(item.lower - item.mean) / item.sd for item in free])
        self._upper = np.array([(item.upper - item.mean) / item.sd for item in free])

    def pull_of(self, point: Point) -> Array:
        pull = np.array([item.pull_in(point) for item in self._free])
        return self.clipped(pull)

    def clipped(self, pull: Array) -> Array:
        """Return parameters inside their bounds."""
        inside: Array = np.clip(pull, self._lower, self._upper)
        return inside

    def point(self, pull: Array) -> Point:
        values = {item.key: item.at(one) for item, one in zip(self._free, pull, strict=True)}
        return {**self._fixed, **values}

    def residual(self, predicted: Array) -> Array:
        """Return measured minus predicted; NaN where nothing was measured."""
        return residual_of(self._problem.observations, predicted)

    def jacobian(self, noise: SensorNoise, change: Derivatives) -> Derivatives:
        """Return derivatives per prior deviation, in units of the errors; none is too large to be squared."""
        return change.scaled(self._sizes).mapped(
            lambda rows: np.clip(noise.whiten(rows), -FAR, FAR), noise.site
        )

    def filled(self, residual: Array) -> Array:
        found: Array = np.where(self._missing, 0.0, residual)
        return found

    def trials(
        self, pull: Array, residual: Array, jacobian: Derivatives, dampings: Sequence[float]
    ) -> list[Array]:
        """Return the points that steps of different length lead to."""
        with np.errstate(over="ignore", invalid="ignore"):
            normal = np.nan_to_num(jacobian.gram()) + np.eye(pull.size)
            slope = np.nan_to_num(jacobian.along(residual)) - pull
        return [self._step(pull, normal, slope, damping) for damping in dampings]

    def _step(self, pull: Array, normal: Array, slope: Array, damping: float) -> Array:
        if not pull.size:
            return pull
        # Derivatives of very different size leave rounding errors in the normal matrix.
        largest = RIDGE * float(np.diag(normal).max())
        root = np.linalg.cholesky(normal + np.diag(damping * np.diag(normal) + largest)).T
        target = np.linalg.solve(root.T, slope)
        step = np.linalg.solve(root, target)
        low, high = self._lower - pull, self._upper - pull
        if np.any(step < low) or np.any(step > high):
            step = lsq_linear(root, target, bounds=(low, np.maximum(high, low + 1e-12)), method="bvls").x
        moved: Array = np.clip(pull + step, self._lower, self._upper)
        return moved

    def best(
        self,
        noise: SensorNoise,
        here: tuple[Array, Array],
        trials: Sequence[Array],
        rows: Sequence[Array],
    ) -> tuple[Array, Array, float] | None:
        """Return the best trial with its prediction and gain; None where none is better."""
        before = self._cost(noise, *here)
        found = None
        for trial, predicted in zip(trials, rows, strict=True):
            gain = before - self._cost(noise, trial, predicted)
            if gain > 0.0 and (found is None or gain > found[2]):
                found = (trial, predicted, gain)
        return found

    def _cost(self, noise: SensorNoise, pull: Array, predicted: Array) -> float:
        with np.errstate(over="ignore", invalid="ignore"):
            whitened = noise.whiten(self.filled(self.residual(predicted)))
            cost = float(whitened @ whitened + pull @ pull)
        return cost if math.isfinite(cost) else math.inf
