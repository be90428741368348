"""Sizes of the effects of a machine, with intervals over runs."""

import math
from dataclasses import dataclass

from scipy import stats

from rover_hil.gap.machines.machine_fit import EvidenceKind, MachineFit, jackknife_error
from rover_hil.gap.statistics.jackknife import scatter_of_runs
from sim_backends.models.parameter_key import ParameterKey

MANY = 1e9
"""Degrees of freedom of a normal distribution."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Size:
    """A fitted parameter with its 95 % interval, in its unit."""

    value: float
    low: float
    high: float


def size_of(found: MachineFit, key: ParameterKey) -> Size:
    """Return a parameter of all runs with its interval.

    The interval covers the noise of samples and what changes when a run is left out (jackknife, Student's t).
    """
    left_out = found.left_out
    index = left_out.keys.index(key)
    item = next(one for one in found.fit.free if one.key == key)
    by_samples = float(left_out.by_samples[index])
    value = found.fit.point[key]
    if found.evidence is EvidenceKind.ROWS:
        far = float(
            stats.t.ppf(0.975, found.freedom) if math.isfinite(found.freedom) else stats.norm.ppf(0.975)
        )
        half = far * math.sqrt(found.inflation) * by_samples * item.sd
        return Size(value=value, low=max(value - half, item.lower), high=min(value + half, item.upper))
    ratio = jackknife_error(left_out, index) / by_samples
    spread, freedom = scatter_of_runs(ratio, left_out.informed[:, index])
    half = float(stats.t.ppf(0.975, freedom)) * spread * by_samples * item.sd
    return Size(value=value, low=max(value - half, item.lower), high=min(value + half, item.upper))
