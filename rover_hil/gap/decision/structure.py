"""What an explanation leaves: an unknown force beside it, and structure in its errors."""

import math
from collections.abc import Sequence

import numpy as np

from rover_hil.gap.data.problem import Indices, Problem
from rover_hil.gap.evidence.evidence import MachineFit
from rover_hil.gap.evidence.units import Units, log_densities
from rover_hil.gap.fit.descent import residual_of
from rover_hil.gap.noise.random_force import random_force_noise
from rover_hil.gap.parameters import MACHINES
from rover_hil.gap.search.tracking import basis_of
from sim_backends.models.interface import Array, Machine
from sim_backends.state_model.model import has_ports


def force_densities(
    problem: Problem, machine: Machine, found: MachineFit, units: Units
) -> tuple[Array, Array] | None:
    """Return the logarithm of the density of each unit without and with unknown forces at the ports.

    The forces have the likeliest size and correlation time. A stretch has its share of the density of its
    run. None where the machine has no ports, or cannot be linearised.
    """
    if not has_ports(machine):
        return None
    own = Problem(machine, problem.observations, problem.held, problem.released)
    residual = residual_of(own.observations, own.predict(found.fit.point))
    basis = basis_of(own, machine, found.fit.point)
    if not all(np.isfinite(one).all() for one in basis.responses):
        return None
    noise = random_force_noise(own.observations, residual, basis)
    errors, whitened = found.errors, noise.whiten(np.nan_to_num(residual))
    runs = len(own.sites)
    count = np.bincount(noise.site, minlength=runs).astype(np.float64)
    logdet = 2.0 * count * math.log(noise.excess) - 2.0 * np.array(
        [float(np.log1p(-one).sum()) for one in noise.shrink]
    )
    plain = _by_run(errors, noise.site, count)
    forced = _by_run(whitened, noise.site, count) - 0.5 * logdet
    share = np.zeros((units.count, runs))
    np.add.at(share, (units.of_row, noise.site), 1.0 / count[noise.site])
    return share @ plain, share @ forced


def _by_run(errors: Array, site: Indices, count: Array) -> Array:
    """Return the density of each run; the size of its errors is as uncertain as in `Predicted`."""
    squares: Array = np.bincount(site, weights=errors**2, minlength=count.size).astype(np.float64)
    return log_densities(squares, count)


def structure_of(problem: Problem, found: MachineFit) -> float:
    """Return the size of the errors that are structure, of the worst channel, over its tolerance.

    The noise of a sensor, also slow noise, forgets itself: what errors share falls with their distance, as of
    an autoregression of the first order. What they share beyond that is structure, and so is what neighbours
    share and what is more than the noise: noise that is slow has the declared size, and noise that is
    declared too small is not shared. Channels that round to coarse steps have none.
    Where the noise is learned, it may be slow in any way.
    """
    greatest = 0.0
    residual, site, channel = found.decorrelated.fit.residual, found.noise.site, found.noise.channel
    for index, one in enumerate(problem.observations.channels):
        if one.quantum > MACHINES.tests.coarse * (one.sigma or 0.0) or problem.observations.is_steady:
            continue
        here = channel == index
        errors, runs = residual[here] * float(found.noise.channel_sd[index]), site[here]
        products = _products([errors[runs == run] for run in np.unique(runs)])
        noise = (1.0 + MACHINES.tests.sigma_uncertainty) * float(found.declared_sd[index])
        excess = float(np.mean((found.errors[here] * float(found.declared_sd[index])) ** 2)) - noise**2
        fast = min(float(products[1]), excess) if products.size > 1 else 0.0
        tolerance = one.tolerance or MACHINES.budget.tolerance * one.noise_sd
        lasting = 0.0 if found.evidence.is_learned else _lasting(products, errors.size)
        greatest = max(greatest, math.sqrt(max(fast, lasting, 0.0)) / tolerance)
    return greatest


def _products(series: Sequence[Array]) -> Array:
    """Return the mean product of errors of one run at the distances 0, 1, ... samples."""
    longest = min(MACHINES.decide.shared_lags, min(one.size for one in series) // 2)
    return np.array(
        [
            np.mean(np.concatenate([one[lag:] * one[: one.size - lag] for one in series]))
            for lag in range(longest + 1)
        ]
    )


def _lasting(products: Array, count: int) -> float:
    """Return what errors share beyond an autoregression of the first order; 0 where it may be chance.

    Args:
        products: Mean products of errors at the distances 0, 1, ...
        count: Number of errors.
    """
    distances = np.arange(2, products.size)
    if not distances.size or products[0] <= 0.0:
        return 0.0
    memory = min(max(float(products[1] / products[0]), 0.0), MACHINES.decide.most_memory)
    lasting = float(np.mean(products[2:] - products[0] * memory**distances))
    # Of as many products of independent errors, of which slow ones are fewer (Bartlett 1946).
    chance = float(products[0]) * (1.0 + memory) / (1.0 - memory) / math.sqrt(count * distances.size)
    return lasting if lasting > MACHINES.decide.shared_sd * chance else 0.0
