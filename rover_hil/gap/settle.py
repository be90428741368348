"""The fit that goes into the extended model: base parameters move only where the data asks for it."""

import math

import numpy as np

from rover_hil.gap.fit import Fit, fit
from rover_hil.gap.noise import Noise
from rover_hil.gap.problem import Problem
from sim_backends.models.interface import Array

MOVES = 3.3
"""Standard deviations from nominal from which on a base parameter is moved: 1 % over ten of them."""


def settle(problem: Problem, noise: Noise, full: Fit) -> Fit:
    """Return a fit with effects and the base parameters that are not at their nominal values.

    A fit moves every parameter a little, which makes predictions worse in channels that have no part in the
    gap. Backward, the parameter that the data asks for least goes back to its nominal value.

    Args:
        problem: Model and observations.
        noise: Of the observations.
        full: Effects and all base parameters, with derivatives at the fit.
    """
    kept = np.arange(len(full.free))
    target = full.residual + full.jacobian @ full.pull
    while True:
        base = [place for place, index in enumerate(kept) if not full.free[index].key[0]]
        asked = _asked(full.jacobian[:, kept], target)
        least = min(base, key=lambda place: asked[place], default=None)
        if least is None or asked[least] >= MOVES:
            break
        kept = np.delete(kept, least)
    free = [full.free[index] for index in kept]
    staying = {item.key: item.mean for item in full.free if item not in free}
    fixed = {key: value for key, value in full.point.items() if key not in {item.key for item in full.free}}
    return fit(problem, noise, free, full.point, jacobian=full.jacobian[:, kept], fixed={**fixed, **staying})


def _asked(jacobian: Array, target: Array) -> Array:
    """Return the distance of each parameter from nominal, in deviations of its estimate if it were nominal.

    Under a prior of variance 1 with posterior variance v that is sqrt(v (1 - v)).
    """
    covariance = np.linalg.inv(jacobian.T @ jacobian + np.eye(jacobian.shape[1]))
    pull = covariance @ jacobian.T @ target
    variance = np.clip(np.diag(covariance), 1e-12, 1.0 - 1e-12)
    result: Array = np.abs(pull) / np.sqrt(variance * (1.0 - variance))
    return np.where(np.isfinite(result), result, math.inf)
