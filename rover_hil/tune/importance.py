"""Which parameters the cost depends on."""

from collections.abc import Sequence

import numpy as np

from rover_hil.config.tune_settings import TuneSettings
from rover_hil.drives.arrays import Array
from rover_hil.tune.journal import Attempt
from rover_hil.tune.unit_cube import to_unit

TRIALS_PER_COEFFICIENT = 2


def importance(attempts: Sequence[Attempt], tune: TuneSettings) -> dict[str, float]:
    """Return which share of the variance of the cost's logarithm is lost without each parameter.

    The model is a parabola in each parameter, fitted to the acceptable trials whose cost is known. A search
    tries most values near the best ones: the shares hold there, and they do not sum to 1.

    Returns:
        Shares from 0 to 1 by key; empty with fewer than two trials per coefficient, or without any variance.
    """
    known = [(to_unit(tune.parameters, each.values), each.cost) for each in attempts if each.cost is not None]
    size = len(tune.parameters)
    if len(known) < TRIALS_PER_COEFFICIENT * (1 + 2 * size):
        return {}
    points = np.array([point for point, _ in known])
    costs = np.log(np.array([max(cost, np.finfo(float).tiny) for _, cost in known]))
    total = float(np.sum((costs - costs.mean()) ** 2))
    if total <= 0.0:
        return {}
    whole = _residual(points, costs)
    return {
        key: min(1.0, max(0.0, (_residual(np.delete(points, index, axis=1), costs) - whole) / total))
        for index, key in enumerate(tune.parameters)
    }


def _residual(points: Array, costs: Array) -> float:
    columns = np.column_stack((np.ones(len(points)), points, points**2))
    coefficients, *_ = np.linalg.lstsq(columns, costs, rcond=None)
    return float(np.sum((costs - columns @ coefficients) ** 2))
