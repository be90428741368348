"""A machine that follows its runs: the unknown force at each port is estimated with the parameters.

Without the force, a small error of the equations moves a long simulation far from the measurement, and the
effect of a card can no longer be linearised. With it the simulation stays on the measurement, and what the
force has to do is nearly linear in the missing effects. This is weak-constraint variational smoothing
(Tremolet, QJRMS 132, 2006); see Sarkka and Solin 2019 for the linear case.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rover_hil.gap.data.problem import DerivativeRequest, Free, Point, Problem
from rover_hil.gap.noise.random_force import (
    ForceBasis,
    RandomForceNoise,
    force_basis,
    prior_covariance,
    random_force_noise,
)
from rover_hil.gap.noise.sensor_noise import declared_noise
from rover_hil.gap.parameters import MACHINES
from sim_backends.models.interface import Array
from sim_backends.state_model.model import StateModel


@dataclass(frozen=True, slots=True, kw_only=True)
class Tracked:
    """A machine on its measured trajectory, linearised there, and where parameters and forces go next.

    Attributes:
        problem: The machine with the estimated forces.
        noise: Random forces and noise of the sensors.
        free: The parameters.
        point: Their values.
        pulls: Most probable parameters, in prior deviations.
        forces: By run: ports x knots, in natural sizes.
        covariances: By run, of the forces.
    """

    problem: Problem
    noise: RandomForceNoise
    free: tuple[Free, ...]
    point: Point
    pulls: Array
    forces: tuple[Array, ...]
    covariances: tuple[Array, ...]

    @property
    def next_point(self) -> Point:
        """The most probable parameters."""
        moved = {item.key: item.at(pull) for item, pull in zip(self.free, self.pulls, strict=True)}
        return {**self.point, **moved}


def track(problem: Problem, machine: StateModel, free: Sequence[Free], start: Point) -> Tracked | None:
    """Return the machine with the forces that keep it on its runs.

    None where a small change of the parameters moves the prediction so far that no step is a number.
    """
    point: Point = start
    basis = basis_of(problem, machine, point)
    width = basis.knots * len(basis.ports)
    forces = tuple(np.zeros(width) for _ in problem.sites)
    step = None
    for turn in range(MACHINES.tracking.rounds):
        found = _linearise(_forced(problem, machine, basis, forces), free, point, forces)
        if found is None:
            break
        step = found
        if turn == MACHINES.tracking.rounds - 1:
            break
        moved = _line_search(problem, machine, basis, free, (point, forces), step)
        if moved is None:
            break
        point, forces = moved
    return step


def basis_of(problem: Problem, machine: StateModel, point: Point) -> ForceBasis:
    """Return the responses of the runs of a machine to forces at its ports, linearised at some parameters."""
    keep = np.flatnonzero(np.isfinite(problem.observations.values)).astype(np.intp)
    scale = 1.0 / declared_noise(problem.observations).row_sd[keep]
    return force_basis(problem, machine, point, keep, scale)


def _forced(problem: Problem, machine: StateModel, basis: ForceBasis, forces: Sequence[Array]) -> Problem:
    by_run = {
        site.name: force_series(basis, values) for site, values in zip(problem.sites, forces, strict=True)
    }
    return Problem(machine.forced(by_run), problem.observations)


def force_series(basis: ForceBasis, values: Array) -> Mapping[str, Array]:
    """Return the force of one run at every sample, by port, in the unit of the port."""
    samples = np.arange(int((basis.knots - 1) * basis.spacing) + 1)
    knots = np.arange(basis.knots) * basis.spacing
    by_port = values.reshape(len(basis.ports), basis.knots)
    return {
        name: scale * np.interp(samples, knots, row)
        for name, scale, row in zip(basis.ports, basis.scales, by_port, strict=True)
    }


def _linearise(here: Problem, free: Sequence[Free], point: Point, forces: Sequence[Array]) -> Tracked | None:
    machine = here.model
    if not isinstance(machine, StateModel):
        raise AssertionError("a forced machine is a machine")
    basis = basis_of(here, machine, point)
    observations = here.observations
    residual = observations.values - here.predict(point)
    keep = np.flatnonzero(np.isfinite(observations.values)).astype(np.intp)
    sd = declared_noise(observations).row_sd
    for run, (matrix, force) in enumerate(zip(basis.responses, forces, strict=True)):
        rows = keep[observations.site[keep] == run]
        residual[rows] += sd[rows] * (matrix @ force)
    residual = np.where(np.isfinite(residual), residual, 0.0)
    sizes = np.array([item.sd for item in free])
    request = DerivativeRequest(here, point, free)
    columns = request.matrix(here.predictions(request.points)).scaled(sizes)
    pull = np.array([item.pull_in(point) for item in free])
    shift, noise = np.zeros(len(free)), None
    for _ in range(2):
        without = np.where(np.isfinite(observations.values), residual - columns.times(shift), np.nan)
        noise = random_force_noise(here.observations, without, basis)
        jacobian, errors = columns.mapped(noise.whiten, noise.site), noise.whiten(residual)
        with np.errstate(over="ignore", invalid="ignore"):
            normal = jacobian.gram() + np.eye(len(free))
        if not np.isfinite(normal).all():
            return None
        shift = np.linalg.solve(normal, jacobian.along(errors) - pull)
        if not np.isfinite(shift).all():
            return None
    if noise is None:
        raise AssertionError("estimated above")
    smoothed = noise.smoothed_forces(np.nan_to_num(residual - columns.times(shift)))
    return Tracked(
        problem=here,
        noise=noise,
        free=tuple(free),
        point=point,
        pulls=pull + shift,
        forces=tuple(mean for mean, _ in smoothed),
        covariances=tuple(covariance for _, covariance in smoothed),
    )


def _line_search(
    problem: Problem,
    machine: StateModel,
    basis: ForceBasis,
    free: Sequence[Free],
    begin: tuple[Point, tuple[Array, ...]],
    step: Tracked,
) -> tuple[Point, tuple[Array, ...]] | None:
    """Return parameters and forces a good part of the step further; None where no part is better."""
    before = _objective(problem, machine, basis, free, begin, step.noise)
    share = 1.0
    for _ in range(MACHINES.tracking.halvings):
        point = {
            key: begin[0].get(key, value) + share * (value - begin[0].get(key, value))
            for key, value in step.next_point.items()
        }
        forces = tuple(old + share * (new - old) for old, new in zip(begin[1], step.forces, strict=True))
        after = _objective(problem, machine, basis, free, (point, forces), step.noise)
        if after < (1.0 - MACHINES.tracking.progress) * before:
            return point, forces
        share *= 0.4
    return None


def _objective(
    problem: Problem,
    machine: StateModel,
    basis: ForceBasis,
    free: Sequence[Free],
    at: tuple[Point, tuple[Array, ...]],
    noise: RandomForceNoise,
) -> float:
    point, forces = at
    here = _forced(problem, machine, basis, forces)
    error = problem.observations.values - here.predict(point)
    scaled = error[noise.keep] * noise.scale
    if not np.isfinite(scaled).all():
        return float("inf")
    sizes = tuple((max(size, 1e-6), length) for size, length in noise.sizes)
    precision = np.linalg.inv(prior_covariance(basis, sizes) + 1e-12 * np.eye(forces[0].size))
    pull = np.array([item.pull_in(point) for item in free])
    return float(scaled @ scaled + pull @ pull + sum(force @ precision @ force for force in forces))
