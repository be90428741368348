"""Terms of free-form equations with their units: dependences that no effect describes."""

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rover_hil.gap.data.problem import Observations, cells
from rover_hil.gap.evidence.score import Direction
from rover_hil.gap.noise.sensor_noise import SensorNoise
from rover_hil.gap.parameters import MACHINES
from sim_backends.models.interface import Array

ONE = "1"


@dataclass(frozen=True, slots=True, kw_only=True)
class Term:
    """A function of conditions, inputs or predicted channels, one value per row.

    Attributes:
        text: As in an equation.
        unit: Of its values.
        values: One per row.
    """

    text: str
    unit: str
    values: Array


def steady_terms(observations: Observations, units: Mapping[str, str]) -> list[Term]:
    """Return polynomials up to second order, and differences of conditions of one unit."""
    sources = _condition_sources(observations, units)
    terms = [Term(text=ONE, unit=ONE, values=np.ones(observations.values.size))]
    terms += sources
    for one in sources:
        terms.append(Term(text=f"{one.text}^2", unit=power(one.unit, 2), values=one.values**2))
    for one, other in itertools.combinations(sources, 2):
        if one.unit == other.unit:
            gap = one.values - other.values
            terms.append(Term(text=f"|{one.text} - {other.text}|", unit=one.unit, values=np.abs(gap)))
        terms.append(
            Term(
                text=f"{one.text} {other.text}",
                unit=product(one.unit, other.unit),
                values=one.values * other.values,
            )
        )
    return terms


def series_terms(
    observations: Observations, predicted: Array, input_units: Mapping[str, str], units: Mapping[str, str]
) -> list[Term]:
    """Return shapes of inputs and predicted channels (odd, even, dry, rate, sum), and of time."""
    sources = _series_sources(observations, predicted, input_units)
    terms = [Term(text=ONE, unit=ONE, values=np.ones(observations.values.size))]
    terms += _condition_sources(observations, units)
    for one in sources:
        x = one.values
        level = float(np.sqrt(np.mean(x**2)))
        terms += [
            one,
            Term(text=f"{one.text}^2", unit=power(one.unit, 2), values=x**2),
            Term(text=f"{one.text} |{one.text}|", unit=power(one.unit, 2), values=x * np.abs(x)),
            Term(text=f"sign({one.text})", unit=ONE, values=np.tanh(x / max(0.05 * level, 1e-300))),
            Term(text=f"|{one.text}|", unit=one.unit, values=np.abs(x)),
            Term(
                text=f"change of {one.text} per sample",
                unit=one.unit,
                values=_by_cell(observations, x, _rate),
            ),
            Term(text=f"sum of {one.text}", unit=one.unit, values=_by_cell(observations, x, np.cumsum)),
        ]
    samples = _by_cell(observations, np.ones(observations.values.size), np.cumsum)
    terms.append(Term(text="sample", unit=ONE, values=samples))
    return [
        term
        for term in terms
        if term.text == ONE or (np.isfinite(term.values).all() and np.ptp(term.values) > 0.0)
    ]


def directions(observations: Observations, noise: SensorNoise, terms: Sequence[Term]) -> list[Direction]:
    """Return one direction per term and channel, in units of the channel per unit of the term."""
    return [replace(one, change=noise.whiten(one.change)) for one in term_changes(observations, terms)]


def term_changes(observations: Observations, terms: Sequence[Term]) -> list[Direction]:
    """Return the same before whitening."""
    found = []
    for index, channel in enumerate(observations.channels):
        in_channel = observations.channel == index
        if not in_channel.any():
            continue
        for term in terms:
            level = float(np.sqrt(np.mean(term.values[in_channel] ** 2)))
            if level <= 0.0:
                continue
            found.append(
                Direction(
                    name=f"{channel.name}: {term.text}",
                    change=np.where(in_channel, term.values, 0.0),
                    sign=0,
                    shapes={},
                    size=1.0 / level,
                    unit=ratio(channel.unit, term.unit),
                )
            )
    return found


def ratio(above: str, below: str) -> str:
    """Return the unit of a quotient."""
    if below == ONE:
        return above
    if above == below:
        return ONE
    return f"{above} per {below}" if _is_compound(above) or _is_compound(below) else f"{above}/{below}"


def power(unit: str, exponent: int) -> str:
    """Return the unit of a power."""
    if unit == ONE:
        return ONE
    return f"({unit})^{exponent}" if _is_compound(unit) or "^" in unit else f"{unit}^{exponent}"


def product(first: str, second: str) -> str:
    """Return the unit of a product."""
    if first == second:
        return power(first, 2)
    parts = [f"({unit})" if _is_compound(unit) else unit for unit in (first, second) if unit != ONE]
    return " ".join(parts) if len(parts) > 1 else (second if first == ONE else first)


def _is_compound(unit: str) -> bool:
    return "/" in unit or " " in unit


def _condition_sources(observations: Observations, units: Mapping[str, str]) -> list[Term]:
    sources = []
    for name, unit in units.items():
        by_site = np.array([group.site.conditions[name] for group in observations.groups])
        if np.ptp(by_site) > 0.0:
            sources.append(Term(text=name, unit=unit, values=by_site[observations.site]))
    return sources


def _series_sources(
    observations: Observations, predicted: Array, input_units: Mapping[str, str]
) -> list[Term]:
    sources = []
    for name, unit in input_units.items():
        if name == "t_s":
            continue
        parts = [
            observations.groups[int(observations.site[cell[0]])].site.inputs[name]
            for cell in cells(observations)
        ]
        values = np.concatenate(parts)
        if values.size == observations.values.size:
            sources.append(Term(text=name, unit=unit, values=values))
    for index, channel in enumerate(observations.channels):
        values = np.zeros(observations.values.size)
        for site in range(len(observations.groups)):
            here = observations.site == site
            in_channel = predicted[here & (observations.channel == index)]
            if in_channel.size and here.sum() % in_channel.size == 0:
                values[here] = np.tile(np.nan_to_num(in_channel), here.sum() // in_channel.size)
        sources.append(Term(text=channel.name, unit=channel.unit, values=values))
    return sources[: MACHINES.equations.most_sources]


def _by_cell(observations: Observations, values: Array, act: Callable[[Array], Array]) -> Array:
    changed = np.empty_like(values)
    for cell in cells(observations):
        changed[cell] = act(values[cell])
    return changed


def _rate(values: Array) -> Array:
    return np.gradient(values) if values.size > 1 else np.zeros_like(values)
