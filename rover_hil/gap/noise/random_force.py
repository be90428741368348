"""Errors of a machine: an unknown random force at each port, and the noise of its sensors.

    dx = f(x, u, theta) dt + sum B_p w_p,   y = h(x) + e

The force w_p is an Ornstein-Uhlenbeck process, linear between knots; e is white with the declared size.
Linearised at a fitted point the channels respond to the knots by G, so that the errors of one run have the
covariance D + G L G'. This is the grey-box form of Kristensen, Madsen and Jorgensen (Automatica 40, 2004):
model error is where physics acts, and its effect on the channels follows from the equations.
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rover_hil.gap.data.problem import Indices, Observations, Point, Problem, split_point
from rover_hil.gap.noise.parameters import STATISTICS
from sim_backends.models.interface import Array
from sim_backends.state_model.model import StateModel

SIZES = tuple(float(one) for one in np.geomspace(1e-3, 1e2, 16))
"""Sizes of the force to choose from, in units of the port's natural size."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ForceBasis:
    """Responses of the channels to forces.

    Attributes:
        ports: Names of the ports.
        scales: Natural size of the force at each.
        spacing: Distance of knots in samples.
        knots: Number of knots.
        responses: By run: kept rows x (ports x knots), per natural size and standard deviation of the sensor.
    """

    ports: tuple[str, ...]
    scales: tuple[float, ...]
    spacing: float
    knots: int
    responses: tuple[Array, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class RandomForceNoise:
    """Errors of a machine's runs.

    Attributes:
        basis: Responses, linearised at a fitted point.
        sizes: Size of the force at each port, in natural sizes, and correlation in distances of knots.
        excess: Factor on the declared noise of the sensors, at least 1.
        keep: Rows with a measured value.
        scale: One over the deviation of the sensor, of each kept row.
        directions: By run: orthonormal directions of the errors.
        shrink: By run: share of each direction that whitening removes.
        site: Run of each kept row.
    """

    basis: ForceBasis
    sizes: tuple[tuple[float, float], ...]
    excess: float
    keep: Indices
    scale: Array
    directions: tuple[Array, ...]
    shrink: tuple[Array, ...]
    site: Indices

    def whiten(self, rows: Array) -> Array:
        """Return independent standard errors of the rows with a measured value."""
        table = rows[self.keep].reshape(self.keep.size, -1) * self.scale[:, None]
        whitened = np.empty_like(table)
        for index, (directions, shrink) in enumerate(zip(self.directions, self.shrink, strict=True)):
            here = self.site == index
            part = table[here]
            whitened[here] = part - directions @ (shrink[:, None] * (directions.T @ part))
        found: Array = whitened.reshape((self.keep.size, *rows.shape[1:]))
        return found

    def smoothed_forces(self, residual: Array) -> list[tuple[Array, Array]]:
        """Return the most probable force of each run and its covariance, in natural sizes.

        Args:
            residual: Measured minus predicted without force, one value per row.

        Returns:
            By run: ports x knots in one vector, and its covariance.
        """
        prior = prior_covariance(self.basis, self.sizes)
        errors = residual[self.keep] * self.scale
        found = []
        for run, matrix in enumerate(self.basis.responses):
            responses = matrix / self.excess
            together = responses @ prior
            inner = np.eye(matrix.shape[1]) + responses.T @ together
            gain = np.linalg.solve(inner.T, together.T).T
            mean = gain.T @ errors[self.site == run]
            found.append((mean, prior - gain.T @ together))
        return found


def random_force_noise(observations: Observations, residual: Array, basis: ForceBasis) -> RandomForceNoise:
    """Return the errors of a machine's runs, with the likeliest size of the force at each port.

    Every channel has a declared noise; the residual is NaN where a value is missing.
    """
    keep = np.flatnonzero(np.isfinite(residual)).astype(np.intp)
    scale = 1.0 / np.array([one.noise_sd for one in observations.channels])[observations.channel[keep]]
    errors = [(residual[keep] * scale)[observations.site[keep] == run] for run in range(len(basis.responses))]
    sizes, excess = _Likelihood(basis, errors).best()
    root = root_of(prior_covariance(basis, sizes))
    directions, shrink = [], []
    for matrix in basis.responses:
        left, singular, _ = np.linalg.svd(matrix @ root / excess, full_matrices=False)
        used = singular > STATISTICS.force.flat
        directions.append(left[:, used])
        shrink.append(1.0 - 1.0 / np.sqrt(1.0 + singular[used] ** 2))
    return RandomForceNoise(
        basis=basis,
        sizes=sizes,
        excess=excess,
        keep=keep,
        scale=scale / excess,
        directions=tuple(directions),
        shrink=tuple(shrink),
        site=observations.site[keep],
    )


def force_basis(
    problem: Problem,
    machine: StateModel,
    point: Point,
    keep: Indices,
    scale: Array,
    spacing: float | None = None,
) -> ForceBasis:
    """Return the responses of kept rows to forces that are linear between knots.

    `keep` are the rows with a measured value, `scale` is one over the deviation of the sensor of each. The
    spacing of knots, in samples, is by default that of the longest run.
    """
    samples = max(site.count for site in problem.sites)
    if spacing is None:
        spacing = max((samples - 1) / STATISTICS.force.knots, float(STATISTICS.force.samples_per_knot))
    knots = math.ceil((samples - 1) / spacing) + 1
    hats = np.maximum(1.0 - np.abs(np.arange(samples) / spacing - np.arange(knots)[:, None]), 0.0)
    parameters, effects = split_point(point)
    columns = []
    for port in machine.ports:
        responses = machine.force_responses(problem.sites, parameters, effects, port, hats)
        columns += [_rows(problem, tables)[keep] * port.force_sd * scale for tables in responses]
    matrix = np.nan_to_num(np.stack(columns, axis=1)) if columns else np.zeros((keep.size, 0))
    site = problem.observations.site[keep]
    return ForceBasis(
        ports=tuple(port.name for port in machine.ports),
        scales=tuple(port.force_sd for port in machine.ports),
        spacing=spacing,
        knots=knots,
        responses=tuple(matrix[site == run] for run in range(len(problem.sites))),
    )


def prior_covariance(basis: ForceBasis, sizes: Sequence[tuple[float, float]]) -> Array:
    """Return the covariance of the forces at all knots, in natural sizes."""
    apart = np.abs(np.subtract.outer(np.arange(basis.knots), np.arange(basis.knots)))
    total = np.zeros((basis.knots * len(basis.ports),) * 2)
    for index, (size, length) in enumerate(sizes):
        here = slice(index * basis.knots, (index + 1) * basis.knots)
        total[here, here] = size**2 * np.exp(-apart / length)
    return total


class _Likelihood:
    """Minus two log-likelihood of errors under sizes of the forces."""

    def __init__(self, basis: ForceBasis, errors: Sequence[Array]) -> None:
        self._basis = basis
        self._count = sum(one.size for one in errors)
        self._square = float(sum(one @ one for one in errors))
        self._grams = [matrix.T @ matrix for matrix in basis.responses]
        self._moments = [matrix.T @ one for matrix, one in zip(basis.responses, errors, strict=True)]

    def best(self) -> tuple[tuple[tuple[float, float], ...], float]:
        """Return the likeliest sizes and the excess noise."""
        none = tuple((0.0, STATISTICS.force.lengths[0]) for _ in self._basis.ports)
        sizes, excess = list(none), 1.0
        for _ in range(STATISTICS.force.sweeps):
            before = (tuple(sizes), excess)
            for index in range(len(sizes)):
                sizes[index] = self._best_size(sizes, index, excess)
            excess = min(STATISTICS.force.excess, key=lambda one: self.cost(sizes, one))
            if before == (tuple(sizes), excess):
                break
        return tuple(sizes), excess

    def _best_size(
        self, sizes: Sequence[tuple[float, float]], index: int, excess: float
    ) -> tuple[float, float]:
        options = [(0.0, STATISTICS.force.lengths[0]), *itertools.product(SIZES, STATISTICS.force.lengths)]
        return min(options, key=lambda one: self.cost([*sizes[:index], one, *sizes[index + 1 :]], excess))

    def cost(self, sizes: Sequence[tuple[float, float]], excess: float) -> float:
        """Return minus two log-likelihood, but for a constant."""
        total = self._square / excess**2 + 2.0 * self._count * math.log(excess)
        if all(size == 0.0 for size, _ in sizes):
            return total
        root = root_of(prior_covariance(self._basis, sizes))
        for gram, moment in zip(self._grams, self._moments, strict=True):
            inner = np.eye(root.shape[0]) + root.T @ (gram / excess**2) @ root
            lower = np.linalg.cholesky(inner)
            aim = np.linalg.solve(lower, root.T @ moment / excess**2)
            total += 2.0 * float(np.log(np.diag(lower)).sum()) - float(aim @ aim)
        return total


def root_of(covariance: Array) -> Array:
    """Return the factor of a covariance, also of one without full rank."""
    try:
        return np.asarray(np.linalg.cholesky(covariance + 1e-12 * np.eye(covariance.shape[0])))
    except np.linalg.LinAlgError:  # that of a large force, with rounding errors above the added term
        variances, directions = np.linalg.eigh(covariance)
        return np.asarray(directions * np.sqrt(np.maximum(variances, 0.0)))


def _rows(problem: Problem, tables: Sequence[dict[str, Array]]) -> Array:
    return np.concatenate(
        [
            table[channel.name]
            for site, table in zip(problem.sites, tables, strict=True)
            for channel in problem.observations.channels
            if channel.name in site.measured
        ]
    )
