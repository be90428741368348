"""Values of tunable parameters as points of the unit cube, in which every range counts the same."""

import math
from collections.abc import Mapping

import numpy as np

from rover_hil.config.tune_settings import TunableSettings
from rover_hil.drives.arrays import Array


def to_unit(parameters: Mapping[str, TunableSettings], values: Mapping[str, float]) -> Array:
    """Return values as numbers from 0 (low) to 1 (high) in the order of `parameters`, by their scale."""
    return np.array([_share(parameter, values[key]) for key, parameter in parameters.items()])


def from_unit(parameters: Mapping[str, TunableSettings], point: Array) -> dict[str, float]:
    """Return the values of a point of the unit cube."""
    return {
        key: _value(parameter, share)
        for (key, parameter), share in zip(parameters.items(), point.tolist(), strict=True)
    }


def _share(parameter: TunableSettings, value: float) -> float:
    if parameter.scale == "log":
        return math.log(value / parameter.low) / math.log(parameter.high / parameter.low)
    return (value - parameter.low) / (parameter.high - parameter.low)


def _value(parameter: TunableSettings, share: float) -> float:
    if parameter.scale == "log":
        return parameter.low * math.pow(parameter.high / parameter.low, share)
    return parameter.low + (parameter.high - parameter.low) * share
