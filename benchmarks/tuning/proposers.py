"""Searches that are compared: each proposes values in the unit cube from the trials before."""

import math
import statistics
import warnings
from collections.abc import Mapping, Sequence

import numpy as np
from cmaes import CMA
from scipy.stats import norm, qmc
from sklearn.exceptions import ConvergenceWarning  # type: ignore[import-untyped]
from sklearn.gaussian_process import GaussianProcessRegressor  # type: ignore[import-untyped]
from sklearn.gaussian_process.kernels import (  # type: ignore[import-untyped]
    ConstantKernel,
    Matern,
    WhiteKernel,
)

from rover_hil.config.tune_settings import TunableSettings
from rover_hil.drives.arrays import Array
from rover_hil.tune.journal import Attempt
from rover_hil.tune.unit_cube import from_unit, to_unit

Parameters = Mapping[str, TunableSettings]


def expected_costs(told: Sequence[Attempt]) -> list[float]:
    """Costs; of a trial given up, that of the best one times the ratio over the cases that it drove."""
    known = [(attempt.cost, attempt.number, attempt) for attempt in told if attempt.cost is not None]
    if not known:
        return [attempt.at_least for attempt in told]
    best_cost, _, best = min(known)
    return [
        best_cost * statistics.mean(cost / best.case_costs[seed] for seed, cost in a.case_costs.items())
        if a.cost is None and a.case_costs
        else (a.cost or math.nan)
        for a in told
    ]


def cma_es(
    parameters: Parameters, start: Mapping[str, float], told: Sequence[Attempt], count: int
) -> list[dict[str, float]]:
    """CMA-ES (Hansen 2016, arXiv:1604.00772) from the start; a batch is a generation, reported as ranks."""
    optimiser = CMA(
        mean=np.clip(to_unit(parameters, start), 0.02, 0.98),
        sigma=0.25,
        bounds=np.tile((0.0, 1.0), (len(parameters), 1)),
        n_max_resampling=1000,
        seed=1,
        population_size=count,
    )
    trials = [attempt for attempt in told if not attempt.is_start]
    for first in range(0, len(trials), count):
        generation = trials[first : first + count]
        points = [optimiser.ask() for _ in generation]
        order = sorted(range(count), key=lambda index, of=generation: _rank(of[index]))  # type: ignore[misc]
        optimiser.tell([(points[index], float(place)) for place, index in enumerate(order)])
    return [from_unit(parameters, optimiser.ask()) for _ in range(count)]


def _rank(attempt: Attempt) -> tuple[int, float]:
    """Return what sorts trials: acceptable ones by cost, then those given up, then rejected ones."""
    if attempt.refused:
        return 2, -float(len(attempt.case_costs))
    return (1, attempt.at_least) if attempt.cost is None else (0, attempt.cost)


def gaussian_process(
    parameters: Parameters, start: Mapping[str, float], told: Sequence[Attempt], count: int
) -> list[dict[str, float]]:
    """Expected improvement times the probability of being acceptable; the batch by believing the mean."""
    size, rng = len(parameters), np.random.default_rng(len(told))
    trials = [attempt for attempt in told if not attempt.is_start]
    if len(trials) < 2 * size:
        sobol = qmc.Sobol(size, seed=1)
        points = sobol.random(2 ** math.ceil(math.log2(len(trials) + count)))
        return [from_unit(parameters, point) for point in points[len(trials) : len(trials) + count]]
    x = np.array([to_unit(parameters, attempt.values) for attempt in told])
    acceptable = np.array([not attempt.refused for attempt in told])
    costs = np.where(acceptable, expected_costs(told), math.nan)
    proposed: list[Array] = []
    if not acceptable.any():
        return [from_unit(parameters, point) for point in rng.random((count, size))]
    y = np.log(costs[acceptable])
    model = _fit(x[acceptable], y)
    kernel = model.kernel_
    gate = _fit(x, acceptable.astype(float)) if not acceptable.all() else None
    believed_x, believed_y = x[acceptable], y
    best = (
        min(a.cost for a in told if a.cost is not None)
        if any(a.cost for a in told)
        else float(np.exp(y.min()))
    )
    for _ in range(count):
        model.set_params(optimizer=None, kernel=kernel)
        model.fit(believed_x, believed_y)
        centre = x[np.nanargmin(costs)]
        many = np.vstack(
            (
                rng.random((2000, size)),
                np.clip(centre + 0.1 * rng.standard_normal((1000, size)), 0.0, 1.0),
                np.clip(centre + 0.02 * rng.standard_normal((500, size)), 0.0, 1.0),
            )
        )
        mean, sd = model.predict(many, return_std=True)
        gain = math.log(best) - mean
        z = gain / np.maximum(sd, 1e-9)
        score = gain * norm.cdf(z) + sd * norm.pdf(z)
        if gate is not None:
            level, spread = gate.predict(many, return_std=True)
            score *= norm.cdf((level - 0.5) / np.maximum(spread, 1e-3))
        index = int(np.argmax(score))
        proposed.append(many[index])
        believed_x = np.vstack((believed_x, many[index]))
        believed_y = np.append(believed_y, mean[index])
    return [from_unit(parameters, point) for point in proposed]


def _fit(x: Array, y: Array) -> GaussianProcessRegressor:
    size = x.shape[1]
    kernel = ConstantKernel(1.0) * Matern(np.full(size, 0.3), (0.03, 10.0), nu=2.5) + WhiteKernel(1e-3)
    model = GaussianProcessRegressor(kernel, normalize_y=True, random_state=0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        model.fit(x, y)
    return model


def warm_started(
    parameters: Parameters, start: Mapping[str, float], told: Sequence[Attempt], count: int
) -> list[dict[str, float]]:
    """The Gaussian process after steps of each parameter alone, up and down, instead of a Sobol design."""
    size = len(parameters)
    trials = [attempt for attempt in told if not attempt.is_start]
    if len(trials) < 2 * size:
        centre = to_unit(parameters, start)
        steps = []
        for index in range(2 * size):
            point = centre.copy()
            point[index // 2] = (0.25, 0.75)[index % 2]
            steps.append(from_unit(parameters, point))
        return (steps * 2)[len(trials) : len(trials) + count]
    return gaussian_process(parameters, start, told, count)
