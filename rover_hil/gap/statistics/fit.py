"""Fitting parameters under their priors and bounds: damped Gauss-Newton."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import lsq_linear

from rover_hil.gap.data.problem import Free, Key, Point, Problem
from rover_hil.gap.statistics.noise import Noise
from rover_hil.gap.statistics.parameters import STATISTICS
from sim_backends.models.interface import Array


@dataclass(frozen=True, slots=True, kw_only=True)
class Fit:
    """Parameters fitted to observations.

    Attributes:
        free: Fitted parameters, in the order of the columns of `jacobian`.
        point: Fitted values.
        residual: Whitened: measured minus predicted.
        jacobian: Whitened: change of the prediction per prior deviation of each parameter.
        pull: Distance of each parameter from its prior mean, in prior deviations.
        cost: Sum of squares of `residual` and `pull`: minus two log-posterior.
    """

    free: tuple[Free, ...]
    point: Point
    residual: Array
    jacobian: Array
    pull: Array
    cost: float

    @property
    def covariance(self) -> Array:
        """Of the pulls, by linearisation at the fit."""
        size = len(self.free)
        normal = self.jacobian.T @ self.jacobian + np.eye(size)
        return np.linalg.inv(normal).astype(np.float64)

    def shape_information(self, shapes: Sequence[Key]) -> float:
        """Return the gain of free shape parameters in minus two log-likelihood (Laplace)."""
        normal = self.jacobian.T @ self.jacobian + np.eye(len(self.free))
        others = [index for index, item in enumerate(self.free) if item.key not in shapes]
        return float(np.linalg.slogdet(normal)[1] - np.linalg.slogdet(normal[np.ix_(others, others)])[1])

    def value(self, key: Key) -> float:
        """Return a fitted value."""
        return self.point[key]

    def standard_error(self, key: Key) -> float:
        """Return the standard error of a fitted value."""
        index = [item.key for item in self.free].index(key)
        return math.sqrt(max(float(self.covariance[index, index]), 0.0)) * self.free[index].sd


def whitened_jacobian(problem: Problem, noise: Noise, free: Sequence[Free], point: Point) -> Array:
    """Return the change of the whitened prediction per prior deviation of each parameter."""
    if not free:
        return np.zeros((noise.site.size, 0))
    return noise.whiten(problem.derivatives(point, free) * np.array([item.sd for item in free]))


def fit(
    problem: Problem,
    noise: Noise,
    free: Sequence[Free],
    start: Point,
    *,
    jacobian: Array | None = None,
    fixed: Point | None = None,
    hopeless: float = math.inf,
) -> Fit:
    """Return the most probable parameters.

    Args:
        problem: Model and observations.
        noise: Of the observations.
        free: Parameters to fit.
        start: Starting values; other parameters start at their own `start`.
        jacobian: First derivatives, as `Fit.jacobian`.
        fixed: Values of further parameters that are kept.
        hopeless: The fit ends if a further step as good as the last would not reach this cost.
    """
    search = _Search(problem, noise, tuple(free), dict(fixed or {}))
    pull = np.array([(start.get(item.key, item.start) - item.mean) / item.sd for item in free])
    pull = np.clip(pull, search.lower, search.upper)
    residual = search.residual(pull)
    fresh, share = jacobian is None, 1.0
    new = [index for index, item in enumerate(free) if item.key[0]]
    matrix = search.derivatives(pull) if jacobian is None else jacobian
    for turn in range(STATISTICS.fit.most_rounds):
        before = float(residual @ residual + pull @ pull)
        pull, residual, state = search.descend(pull, residual, matrix)
        if state == "settled" or (state == "stuck" and fresh and share < 1.0):
            break
        if state == "stuck" and fresh:
            share = STATISTICS.fit.fine
        cost = float(residual @ residual + pull @ pull)
        if fresh and 2.0 * cost - before > hopeless:
            break
        # Derivatives by base parameters hardly change: at first only those by effects are recomputed.
        fresh = fresh or turn > 0 or not new
        matrix = search.derivatives(pull, share) if fresh else search.renewed(pull, matrix, new)
    return Fit(
        free=tuple(free),
        point=search.point(pull),
        residual=residual,
        jacobian=matrix,
        pull=pull,
        cost=float(residual @ residual + pull @ pull),
    )


class _Search:
    def __init__(
        self, problem: Problem, noise: Noise, free: tuple[Free, ...], fixed: dict[Key, float]
    ) -> None:
        self._problem = problem
        self._noise = noise
        self._free = free
        self._fixed = fixed
        self.lower = np.array([(item.lower - item.mean) / item.sd for item in free])
        self.upper = np.array([(item.upper - item.mean) / item.sd for item in free])

    def point(self, pull: Array) -> Point:
        values = {
            item.key: float(np.clip(item.mean + item.sd * one, item.lower, item.upper))
            for item, one in zip(self._free, pull, strict=True)
        }
        return {**self._fixed, **values}

    def residual(self, pull: Array) -> Array:
        observations = self._problem.observations.values
        difference = observations - self._problem.predict(self.point(pull))
        return self._noise.whiten(np.where(np.isnan(observations), 0.0, difference))

    def derivatives(self, pull: Array, share: float = 1.0) -> Array:
        free = [replace(item, step=share * item.step) for item in self._free]
        return whitened_jacobian(self._problem, self._noise, free, self.point(pull))

    def renewed(self, pull: Array, jacobian: Array, columns: Sequence[int]) -> Array:
        """Return derivatives with these columns recomputed."""
        matrix = jacobian.copy()
        chosen = [self._free[index] for index in columns]
        matrix[:, columns] = whitened_jacobian(self._problem, self._noise, chosen, self.point(pull))
        return matrix

    def descend(self, pull: Array, residual: Array, jacobian: Array) -> tuple[Array, Array, str]:
        """Step down with these derivatives while they predict the gain."""
        normal = jacobian.T @ jacobian + np.eye(pull.size)
        cost = float(residual @ residual + pull @ pull)
        damping = 0.0
        for _ in range(STATISTICS.fit.most_steps):
            step, predicted_gain = self._step(pull, residual, jacobian, normal, damping)
            if predicted_gain < STATISTICS.fit.settled:
                # A damped step predicts little gain because it is short.
                return pull, residual, "settled" if damping == 0.0 else "stuck"
            trial = np.clip(pull + step, self.lower, self.upper)
            changed = self.residual(trial)
            value = float(changed @ changed + trial @ trial)
            kept = (cost - value) / predicted_gain if math.isfinite(value) else -1.0
            if kept > 0.0:
                pull, residual, cost = trial, changed, value
            if 0.0 < kept < STATISTICS.fit.good_share:
                return pull, residual, "worn"
            if kept <= 0.0:
                damping = max(10.0 * damping, 0.3)
        return pull, residual, "stuck" if damping > 0.0 else "worn"

    def _step(
        self, pull: Array, residual: Array, jacobian: Array, normal: Array, damping: float
    ) -> tuple[Array, float]:
        if not pull.size:
            return pull, 0.0
        root = np.linalg.cholesky(normal + damping * np.diag(np.diag(normal))).T
        slope = jacobian.T @ residual - pull
        target = np.linalg.solve(root.T, slope)
        low, high = self.lower - pull, self.upper - pull
        step = np.linalg.solve(root, target)
        if np.any(step < low) or np.any(step > high):
            high = np.maximum(high, low + 1e-12)
            step = lsq_linear(root, target, bounds=(low, high), method="bvls").x
        return step, float(2.0 * slope @ step - step @ normal @ step)
