"""Where the model disagrees: channel, condition and time. Exploratory."""

import itertools
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from scipy import special

from rover_hil.gap.data.derivatives import Mask
from rover_hil.gap.data.problem import Observations, Point, Problem
from rover_hil.gap.noise.sensor_noise import SensorNoise
from rover_hil.gap.parameters import MACHINES
from sim_backends.models.interface import Array


@dataclass(frozen=True, slots=True, kw_only=True)
class ResidualLocation:
    """A part of the data where measurement and model differ.

    Attributes:
        channel: Which.
        condition: Which part, in words.
        size: Mean of measured minus simulated.
        unit: Of the size.
        n: Values it is the mean of.
        standard_error: Of the size.
    """

    channel: str
    condition: str
    size: float
    unit: str
    n: int
    standard_error: float

    def sentence(self) -> str:
        """Return it as text."""
        return (
            f"{self.channel}, {self.condition}: {self.size:+.3g} ± {1.96 * self.standard_error:.2g} "
            f"{self.unit} (n = {self.n})"
        )


def localise_residuals(
    problem: Problem, noise: SensorNoise, point: Point, input_units: Mapping[str, str]
) -> list[ResidualLocation]:
    """Return, by channel, the part of the data with the most significant difference, the highest first."""
    observations = problem.observations
    residual = observations.values - problem.predict(point)
    parts = list(_parts(observations, problem.model.condition_units, input_units))
    tests = len(parts) * len(observations.channels)
    found = []
    for index, channel in enumerate(observations.channels):
        in_channel = (observations.channel == index) & np.isfinite(residual)
        best: tuple[float, ResidualLocation] | None = None
        for words, mask in parts:
            here = in_channel & mask
            mean, error, n = _mean(observations, noise, residual, here)
            if error <= 0.0:
                continue
            z = abs(mean) / error
            p = tests * 2.0 * float(special.ndtr(-z))
            if p <= MACHINES.localise.alpha and (best is None or z > best[0]):
                place = ResidualLocation(
                    channel=channel.name,
                    condition=words,
                    size=mean,
                    unit=channel.unit,
                    n=n,
                    standard_error=error,
                )
                best = (z, place)
        if best is not None:
            found.append(best)
    return [place for _, place in sorted(found, key=lambda item: -item[0])]


def _mean(
    observations: Observations, noise: SensorNoise, residual: Array, here: Mask
) -> tuple[float, float, int]:
    count = int(here.sum())
    if count == 0:
        return 0.0, 0.0, 0
    if observations.is_steady:
        weight = 1.0 / noise.row_sd[here] ** 2
        mean = float(np.sum(weight * residual[here]) / np.sum(weight))
        return mean, float(1.0 / math.sqrt(np.sum(weight))), int(observations.counts[here].sum())
    means = np.array(
        [
            float(residual[here & (observations.site == site)].mean())
            for site in np.unique(observations.site[here])
        ]
    )
    if means.size < 3:
        return 0.0, 0.0, 0
    return float(means.mean()), float(means.std(ddof=1) / math.sqrt(means.size)), count


def _parts(
    observations: Observations, units: Mapping[str, str], input_units: Mapping[str, str]
) -> Iterator[tuple[str, Mask]]:
    everything = np.ones(observations.values.size, dtype=bool)
    yield "everywhere", everything
    cuts: dict[str, list[tuple[str, Mask]]] = {}
    for name, unit in units.items():
        by_site = np.array([group.site.conditions[name] for group in observations.groups])
        if np.ptp(by_site) > 0.0:
            cuts[name] = list(_cuts(name, unit, by_site[observations.site]))
    for one in cuts.values():
        yield from one
    for first, second in itertools.combinations(cuts.values(), 2):
        for (words, mask), (others, other) in itertools.product(first, second):
            yield f"{words} and {others}", mask & other
    if not observations.is_steady:
        yield from _series_parts(observations, input_units)


def _cuts(name: str, unit: str, values: Array) -> Iterator[tuple[str, Mask]]:
    levels = np.unique(values)
    if levels.size > MACHINES.localise.most_levels:
        levels = np.quantile(values, np.linspace(0.0, 1.0, 5))
    tail = "" if unit == "1" else f" {unit}"
    for level in levels[1:]:
        yield f"{name} >= {level:.4g}{tail}", values >= level
    for level in levels[:-1]:
        yield f"{name} <= {level:.4g}{tail}", values <= level
    if levels.size <= MACHINES.localise.most_levels:
        for level in levels[1:-1]:
            yield f"{name} = {level:.4g}{tail}", values == level


def _series_parts(observations: Observations, input_units: Mapping[str, str]) -> Iterator[tuple[str, Mask]]:
    for name, unit in input_units.items():
        if name == "t_s":
            continue
        values = np.concatenate(
            [np.tile(group.site.inputs[name], len(group.site.measured)) for group in observations.groups]
        )
        if values.size != observations.values.size:
            continue
        large = float(np.quantile(np.abs(values), 0.75))
        small = float(np.quantile(np.abs(values), 0.25))
        yield f"{name} > 0", values > 0.0
        yield f"{name} < 0", values < 0.0
        yield f"|{name}| > {large:.3g} {unit}", np.abs(values) > large
        yield f"|{name}| < {small:.3g} {unit}", np.abs(values) < small
        yield f"{name} > {large:.3g} {unit}", values > large
        yield f"{name} < {-large:.3g} {unit}", values < -large
    change = np.concatenate(([True], np.diff(observations.site * 100 + observations.channel) != 0))
    start = np.maximum.accumulate(np.where(change, np.arange(change.size), 0))
    age = np.arange(change.size) - start
    third = float(np.quantile(age, 2.0 / 3.0))
    yield f"before sample {third / 2:.0f}", age < third / 2
    yield f"after sample {third:.0f}", age > third
