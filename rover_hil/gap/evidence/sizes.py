"""Sizes of the effects of a machine, with intervals over runs."""

from dataclasses import dataclass

from rover_hil.gap.evidence.evidence import MachineFit
from sim_backends.models.parameter_key import ParameterKey


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
    return Size(value=value, low=max(value - half, item.lower), high=min(value + half, item.upper))
