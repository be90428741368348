"""The fit whose base parameters far from nominal are determined by the runs alone.

A prior that the runs contradict is wrong. If it stays, parameters that resemble this one take over a part of
the same cause, and the interval of each is as narrow as the priors make it, around a wrong value.
"""

import numpy as np

from rover_hil.gap.data.problem import Problem, split_point
from rover_hil.gap.evidence.evidence import MachineFit
from rover_hil.gap.fit.base_parameters import FAR_SD
from rover_hil.gap.fit.machine_fit import MachineFits
from sim_backends.models.parameter_key import ParameterKey


def released_fit(problem: Problem, found: MachineFit) -> tuple[MachineFit, Problem]:
    """Return a fit without the priors that the runs contradict, and the problem that it solves.

    While a base parameter is more than three prior deviations from nominal, the prior whose removal lowers
    the cost most becomes as wide as that of an effect, one at a time. What it pushed into parameters that
    resemble it returns: the fit also starts from their nominal values, since the way back may be a curved
    valley.
    """
    while name := _contradicted(problem, found):
        problem = Problem(problem.model, problem.observations, problem.held, (*problem.released, name))
        returned = {
            key: item.nominal
            for item in problem.model.parameters
            if (key := ParameterKey(name=item.name)) in found.fit.point and item.name not in problem.released
        }
        shapes = split_point({item.key: item.mean for item in found.fit.free})[1]
        starts = (found.fit.point, {**found.fit.point, **returned})
        fits = [
            MachineFits(problem, problem.model.effects).fit_all([(found.names, shapes, one)], is_near=True)[0]
            for one in starts
        ]
        found = min(fits, key=lambda one: one.cost)
    return found, problem


def _contradicted(problem: Problem, found: MachineFit) -> str:
    """Return the base parameter whose prior costs most, if one is far from nominal; else an empty text.

    Without its prior, the cost falls by the square of the pull over the share of its variance that the prior
    determines (Gaussian posterior).
    """
    kept = {item.name for item in problem.model.parameters if item.name not in problem.released}
    base = [index for index, item in enumerate(found.fit.free) if item.key.is_base and item.key.name in kept]
    pull = found.fit.pull[base]
    if not np.any(np.abs(pull) > FAR_SD):
        return ""
    by_prior = 1.0 - np.diag(found.fit.covariance)[base]
    gain = pull**2 / np.maximum(by_prior, np.finfo(np.float64).eps)
    return found.fit.free[base[int(np.argmax(gain))]].key.name
