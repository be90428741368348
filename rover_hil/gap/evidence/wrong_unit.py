"""A channel whose measured values are a large multiple of what the model predicts: its unit is wrong."""

import math

import numpy as np

from rover_hil.gap.data.problem import Point, Problem, cells
from rover_hil.gap.parameters import MACHINES


def wrong_unit(problem: Problem, fitted: Point) -> str:
    """Return which channel is a large multiple or a small part of the prediction; empty for none.

    Compared are changes within runs, with all parameters at their nominal values. Of a law that is missing
    the shape would be another one; a number that is hardly known explains as much after the fit.
    """
    observations = problem.observations
    free = problem.base_free()
    predicted = problem.predict({item.key: item.at(0.0) for item in free})
    errors = observations.values - problem.predict(fitted)
    for index, channel in enumerate(observations.channels):
        products, left = np.zeros(3), 0.0
        for rows in cells(observations):
            here = rows[np.isfinite(errors[rows]) & np.isfinite(predicted[rows])]
            if not here.size or observations.channel[here[0]] != index:
                continue
            measured, model = (part[here] - part[here].mean() for part in (observations.values, predicted))
            products += (measured @ measured, measured @ model, model @ model)
            left += float(errors[here] @ errors[here])
        own, both, of_model = (float(one) for one in products)
        if own * of_model <= 0.0 or both**2 < MACHINES.tests.same_shape * own * of_model:
            continue
        ratio = both / of_model
        is_large = abs(math.log(abs(ratio))) > math.log(MACHINES.tests.most_ratio)
        if is_large and left > own - both * ratio:
            return (
                f"all of {channel.name} is {ratio:.3g} times that of the model: check its unit, "
                f"{channel.unit} (degrees are 57.3 times radians, millimetres 1000 times metres)"
            )
    return ""
