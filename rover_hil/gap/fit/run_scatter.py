"""Do the runs differ in the base parameters of the model?

Without a missing effect, parameters may still change from run to run: another warm-up, another unit. Each run
then gets base parameters of its own, within their priors. What they explain is no common effect.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rover_hil.gap.data.problem import Free
from rover_hil.gap.evidence.evidence import MachineFit
from rover_hil.gap.evidence.fit import Fit
from rover_hil.gap.fit.descent import descend, descend_together
from rover_hil.gap.fit.machine_fit import MachineFits
from rover_hil.gap.parameters import MACHINES
from sim_backends.models.interface import Array
from sim_backends.models.parameter_key import ParameterKey


@dataclass(frozen=True, slots=True, kw_only=True)
class RunScatter:
    """What differs between runs.

    Attributes:
        fit: Each run with base parameters of its own.
        channel_rms: Root mean square change of the predictions by these, by channel in its unit, without the
            share that noise alone causes.
        parameter_sd: Base parameter to its standard deviation over runs, in its unit; those that matter most.
    """

    fit: MachineFit
    channel_rms: Array
    parameter_sd: Mapping[str, float]

    def sentence(self, units: Mapping[str, str]) -> str:
        """Return the parameters that differ between runs, and by how much."""
        parts = [
            f"{name} by {sd:.2g}{'' if units[name] == '1' else f' {units[name]}'}"
            for name, sd in self.parameter_sd.items()
        ]
        return ", ".join(parts)


def run_scatter(fits: MachineFits, found: MachineFit) -> RunScatter:
    """Return what own base parameters of each run explain, and how much they differ."""
    problem = fits.problem
    if problem.observations.is_steady:
        none = np.zeros(found.noise.channel_sd.size)
        return RunScatter(fit=found, channel_rms=none, parameter_sd={})
    own = [
        one
        for item in problem.model.parameters
        if any(free.key == ParameterKey(name=item.name) for free in found.fit.free) and item.scatter_sd == 0.0
        for one in problem.deviations(item, item.prior_sd)
    ]
    start = {**found.fit.point, **{item.key: item.start for item in own}}
    free = [*found.fit.free, *own]
    ((fit, noise),) = descend_together(problem, [descend(problem, free, start, fits.fixed(found.names))])
    first = len(found.fit.free)
    covariance = fit.covariance
    by_noise: Array = (covariance - covariance @ covariance)[first:, first:]
    centred, point = _centred(fit, own)
    common = {key: value for key, value in point.items() if key not in {item.key for item in own}}
    moved = noise.whiten(problem.predict(point) - problem.predict(common))
    of_deviations = np.zeros_like(covariance)
    of_deviations[first:, first:] = by_noise
    expected = fit.jacobian.spread(of_deviations)
    count = noise.channel_sd.size
    rows = np.maximum(np.bincount(noise.channel, minlength=count), 1)
    excess = np.bincount(noise.channel, weights=moved**2 - expected, minlength=count) / rows
    return RunScatter(
        fit=replace(found, fit=fit, noise=noise),
        channel_rms=noise.channel_sd * np.sqrt(np.maximum(excess, 0.0)),
        parameter_sd=_parameter_sd(own, fit.jacobian.squares()[first:], centred, np.diag(by_noise)),
    )


def _centred(fit: Fit, own: Sequence[Free]) -> tuple[Array, dict[ParameterKey, float]]:
    """Return the deviations without their mean, which belongs to all runs, and the same point written so."""
    pull = fit.pull[len(fit.free) - len(own) :].copy()
    point = dict(fit.point)
    names = _names(own)
    for name in dict.fromkeys(names.tolist()):
        here = np.flatnonzero(names == name)
        mean = float(pull[here].mean())
        pull[here] -= mean
        point[ParameterKey(name=name)] += mean * own[int(here[0])].sd
        for index in here.tolist():
            point[own[index].key] = own[index].sd * float(pull[index])
    return pull, point


def _names(own: Sequence[Free]) -> "np.ndarray[tuple[int], np.dtype[np.str_]]":
    return np.array([item.key.name for item in own], dtype=np.str_)


def _parameter_sd(own: Sequence[Free], weight: Array, pull: Array, noise: Array) -> dict[str, float]:
    """Return the standard deviations of the parameters whose deviations change the predictions most."""
    excess = pull**2 - noise
    found: dict[str, tuple[float, float]] = {}
    names = _names(own)
    for name in dict.fromkeys(names.tolist()):
        here = names == name
        sd = own[int(np.argmax(here))].sd
        spread = float(excess[here].sum()) / max(int(here.sum()) - 1, 1)
        found[name] = (float(weight[here] @ excess[here]), sd**2 * spread)
    most = max((energy for energy, _ in found.values()), default=0.0)
    notable = [
        name
        for name, (energy, size) in found.items()
        if size > 0.0 and energy > MACHINES.scatter.notable * most
    ]
    notable.sort(key=lambda name: -found[name][0])
    return {name: math.sqrt(found[name][1]) for name in notable[: MACHINES.scatter.mentioned]}
