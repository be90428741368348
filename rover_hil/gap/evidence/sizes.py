"""Sizes of the effects of a machine, with intervals over runs."""

import math
from dataclasses import dataclass

from rover_hil.gap.evidence.evidence import MachineFit
from sim_backends.models.parameter_key import ParameterKey

PHASE = "phase"
"""Name of a parameter that returns to itself after a rotation."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Size:
    """A fitted parameter with its 95 % interval, in its unit."""

    value: float
    low: float
    high: float


def size_of(found: MachineFit, key: ParameterKey) -> Size:
    """Return a parameter of all runs with its interval."""
    index = found.left_out.keys.index(key)
    item = next(one for one in found.fit.free if one.key == key)
    value = found.fit.point[key]
    half = found.evidence.half_width(found, index) * item.sd
    low, high = max(value - half, item.lower), min(value + half, item.upper)
    turns = near(key, value, 0.0) - value
    return Size(value=value + turns, low=low + turns, high=high + turns)


def near(key: ParameterKey, value: float, other: float) -> float:
    """Return a value; of a phase, in rad, the one within half a rotation of another."""
    if key.name != PHASE:
        return value
    return value - 2.0 * math.pi * round((value - other) / (2.0 * math.pi))
