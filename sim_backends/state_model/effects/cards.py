"""Parts that the cards of standard effects have in common."""

import math
from collections.abc import Callable, Mapping
from types import SimpleNamespace

import numpy as np

from sim_backends.models.interface import Array, EffectCard, Parameter, parameter


def strength(
    name: str, unit: str, size: float, *, is_signed: bool = False, upper: float = math.inf, meaning: str = ""
) -> Parameter:
    """Return a strength that is 0 without effect; positive unless `is_signed`."""
    return parameter(name, unit, 0.0, size, -upper if is_signed else 0.0, upper, meaning)


def shape(name: str, unit: str, value: float) -> Parameter:
    """Return a positive shape parameter, known to a factor of ten."""
    return parameter(name, unit, value, value, value / 10.0, value * 10.0)


def card(
    name: str,
    sentence: str,
    place: str,
    parameters: Callable[[Mapping[str, str]], tuple[Parameter, ...]],
    claims: tuple[str, ...],
    experiment: str,
    source: str,
    grid: Mapping[str, tuple[float, ...]] | None = None,
    releases: str | None = None,
) -> Callable[[Mapping[str, str]], EffectCard]:
    """Return what makes a card given as a row of a table, of the units of all signals; see `EffectCard`."""
    return lambda units: EffectCard(
        name=name,
        sentence=sentence,
        place=place,
        parameters=parameters(units),
        claims=claims,
        experiment=experiment,
        source=source,
        shape_grid=grid or {},
        releases=releases,
    )


def per(unit: str, other: str) -> str:
    """Return the unit of a quotient."""
    if other == "1":
        return unit
    return f"{unit}/({other})" if "/" in other or " " in other else f"{unit}/{other}"


def smooth_sign(value: Array, slow: float) -> Array:
    """Return the sign, rounded off below `slow`."""
    sign: Array = np.tanh(value / slow)
    return sign


def state(machine: SimpleNamespace, name: str) -> Array:
    """Return a state of the machine."""
    values: Array = getattr(machine, name)
    return values
