"""Is there a gap? Without random force, the noise of the sensors alone must explain the misfit."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy import stats
from scipy.linalg import cho_factor, cho_solve

from rover_hil.gap.data.problem import Problem
from rover_hil.gap.evidence.evidence import MachineFit
from rover_hil.gap.evidence.score import Score, family_draws, family_p, one_sided_z
from rover_hil.gap.noise.parameters import STATISTICS
from rover_hil.gap.noise.random_force import force_basis
from rover_hil.gap.noise.sensor_noise import declared_noise
from rover_hil.gap.parameters import MACHINES
from sim_backends.state_model.model import StateModel, has_ports


def gap_p(
    found: MachineFit,
    problem: Problem,
    scores: Sequence[Score],
    rng: np.random.Generator,
    free: Sequence[Score] = (),
) -> float:
    """Return the probability of such a misfit if only the sensors err.

    Several kinds of tests share it: the size of the misfit, its part that a force at a port can produce, the
    scores of the effects, of a fit without any, and those of free-form terms where there are no ports
    (weighted Bonferroni). A test that these runs do not allow takes no share from the others.
    """
    machine = problem.model
    parts = found.evidence.misfit_p(
        found,
        lambda: (
            [_structure_p(problem, machine, found, knots) for knots in MACHINES.tests.knot_counts]
            if has_ports(machine) and not _is_coarse(problem)
            else []
        ),
    )
    weights = [1.0 for _ in parts]
    for family, weight in ((scores, MACHINES.tests.effects_weight if free else 1.0), (free, 1.0)):
        if family:
            draws = family_draws(family, found.evidence.freedom, rng)
            greatest = max(one_sided_z(one) for one in family)
            parts.append(family_p(family, greatest, draws, found.evidence.freedom))
            weights.append(weight)
    shared = [sum(weights) / weight * p for weight, p in zip(weights, parts, strict=True)]
    return min(1.0, *shared)


def _is_coarse(problem: Problem) -> bool:
    """Return True where a sensor rounds to steps much larger than its noise, which is slow itself."""
    channels = problem.observations.channels
    return any(one.quantum > MACHINES.tests.coarse * (one.sigma or 0.0) for one in channels)


def _structure_p(problem: Problem, machine: StateModel, found: MachineFit, knots: int) -> float:
    """Return the probability of as much misfit along the responses to slow forces, against the rest.

    Each channel is measured by its own misfit, so that a sensor that is better than declared makes the
    ordinary noise of another channel no structure.
    """
    residual = found.errors
    noise = declared_noise(problem.observations)
    size = np.ones(residual.size)
    for channel in np.unique(noise.channel):
        here = noise.channel == channel
        size[here] = max(math.sqrt(float(np.mean(residual[here] ** 2))), 1e-12)
    assumed = (found.noise.channel_sd / noise.channel_sd)[noise.channel] / size
    scaled = residual / size
    fit = replace(
        found.fit, residual=scaled, jacobian=found.fit.jacobian.mapped(lambda rows: rows * assumed[:, None])
    )
    longest = max(site.measured[one].size for site in problem.sites for one in site.measured)
    spacing = max((longest - 1) / knots, float(STATISTICS.force.samples_per_knot))
    weight = 1.0 / (noise.row_sd[noise.keep] * size)
    basis = force_basis(problem, machine, found.fit.point, noise.keep, weight, spacing=spacing)
    # The responses of a run are zero elsewhere: of their projection only products are needed.
    gram = fit.jacobian.gram() + np.eye(len(fit.free))
    unit = 1.0 / np.sqrt(np.diag(gram))
    root = cho_factor(gram * np.outer(unit, unit), lower=True)
    slope = fit.jacobian.along(scaled)
    along, freedom = 0.0, 0
    for run, responses in enumerate(basis.responses):
        here = noise.site == run
        values, places = fit.jacobian.rows(here)
        absorbed = np.zeros((len(fit.free), responses.shape[1]))
        absorbed[places] = values.T @ responses
        shift = unit[:, None] * cho_solve(root, unit[:, None] * absorbed)
        products = responses.T @ responses - absorbed.T @ shift
        squares, vectors = np.linalg.eigh(products)
        is_reached = squares > max(MACHINES.tests.reached**2 * float(squares.max(initial=0.0)), 1e-300)
        aim = responses.T @ scaled[here] - shift.T @ slope
        parts = vectors[:, is_reached].T @ aim / np.sqrt(squares[is_reached])
        along += float(parts @ parts)
        freedom += int(is_reached.sum())
    remaining = scaled.size - len(found.fit.free) - freedom
    if freedom == 0 or remaining <= 0:
        return 1.0
    level = max(float(scaled @ scaled) - along, 1e-12) / remaining
    return float(stats.f.sf(along / freedom / level, freedom, remaining))
