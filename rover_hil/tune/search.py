"""Which values are tried next: CMA-ES (Hansen 2016, arXiv:1604.00772) on the unit cube.

CMA-ES uses nothing of the trials but their order. So rejected values need no cost: they come after all
acceptable ones. A batch of trials is one generation. The search is made anew from the trials before, and
depends on nothing else.
"""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from drivers.errors import ConfigError
from rover_hil.config.tune_settings import TunableSettings
from rover_hil.tune.journal import Attempt
from rover_hil.tune.unit_cube import from_unit, to_unit

try:
    from cmaes import CMA
except ModuleNotFoundError as missing:
    raise ConfigError("tuning needs cmaes: install rover-hil[tune]") from missing

Proposer = Callable[
    [Mapping[str, TunableSettings], Mapping[str, float], Sequence[Attempt], int], list[dict[str, float]]
]
"""Returns so many sets of values, from the ranges, the start values and the trials of earlier batches."""

FIRST_STEP = 0.25
"""First standard deviation, as a share of each range."""
EDGE = 0.02
"""The first mean stays this far inside the ranges."""
MOST_DRAWS = 1000
SEED = 1


def propose(
    parameters: Mapping[str, TunableSettings],
    start: Mapping[str, float],
    told: Sequence[Attempt],
    count: int,
) -> list[dict[str, float]]:
    """Return the values of the next batch, see `Proposer`; all batches have the same size."""
    optimiser = CMA(
        mean=np.clip(to_unit(parameters, start), EDGE, 1.0 - EDGE),
        sigma=FIRST_STEP,
        bounds=np.tile((0.0, 1.0), (len(parameters), 1)),
        n_max_resampling=MOST_DRAWS,
        seed=SEED,
        population_size=count,
    )
    trials = [attempt for attempt in told if not attempt.is_start]
    for first in range(0, len(trials), count):
        generation = trials[first : first + count]
        points = [optimiser.ask() for _ in generation]
        order = sorted(range(count), key=lambda index: rank(generation[index]))
        optimiser.tell([(points[index], float(place)) for place, index in enumerate(order)])
    return [from_unit(parameters, optimiser.ask()) for _ in range(count)]


def rank(attempt: Attempt) -> tuple[int, float]:
    """Return what sorts trials: acceptable ones by cost, then those given up, then rejected ones.

    Trials given up are sorted by the lower bound of their cost, rejected ones by the cases before.
    """
    if attempt.refused:
        return 2, -float(len(attempt.case_costs))
    return (1, attempt.at_least) if attempt.cost is None else (0, attempt.cost)
