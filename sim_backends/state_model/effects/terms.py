"""Free-form terms of an equation: what a draft of a new effect consists of."""

from collections.abc import Callable, Mapping
from types import SimpleNamespace

import numpy as np

from sim_backends.models.interface import Array, EffectCard
from sim_backends.models.ranges import require_positive
from sim_backends.state_model.effects.cards import card, per, state, strength
from sim_backends.state_model.port_effect import PortEffect

SHARP = 0.02
"""Width of a smoothed sign, as a share of the scale of its argument."""

FORMS: Mapping[str, tuple[str, float, Callable[[Array, float], Array]]] = {
    "constant": ("1", 0, lambda x, _: np.ones_like(x)),
    "linear": ("{x}", 1, lambda x, _: x),
    "sign": ("sign({x})", 0, lambda x, scale: np.tanh(x / (SHARP * scale))),
    "square": ("{x}^2", 2, lambda x, _: x**2),
    "signed_square": ("{x} |{x}|", 2, lambda x, _: x * np.abs(x)),
    "cube": ("{x}^3", 3, lambda x, _: x**3),
    "root": ("sign({x}) sqrt|{x}|", 0.5, lambda x, scale: np.sign(x) * np.sqrt(np.abs(x))),
    "size": ("|{x}|", 1, lambda x, _: np.abs(x)),
}
"""Form to its text, the power of the unit of its argument, and its value."""


def term(port: str, *, source: str, form: str, size: float, scale: float, name: str = "") -> PortEffect:
    """Return a term added to the signal at a port.

    Args:
        port: The signal.
        source: State or input that the term depends on.
        form: A key of `FORMS`.
        size: Natural size of the coefficient.
        scale: Usual size of the source, in its unit.
        name: Of the card; by default the equation.
    """
    require_positive(f"effect {name or 'term'}", size=size, scale=scale)
    text, order, function = FORMS[form]

    def build(units: Mapping[str, str]) -> EffectCard:
        unit = units[source]
        below = "1" if order == 0 else unit if order == 1 else f"({unit})^{order:g}"
        return card(
            name or f"{port} += c {text.format(x=source)}",
            f"A term {text.format(x=source)} is missing in {port}.",
            port,
            (strength("coefficient", per(units[port], below), size, is_signed=True),),
            (),
            "",
            "residual of the runs",
        )

    def change(value: Array, x: SimpleNamespace, v: SimpleNamespace, _: Array | None) -> Array:
        changed: Array = value + v.coefficient * function(state(x, source), scale)
        return changed

    return PortEffect(port=port, build=build, change=change, states=(source,))


def threshold(port: str, *, source: str, place: float, size: float, name: str = "") -> PortEffect:
    """Return a term that grows beyond a value of its source; see `term`."""
    require_positive(f"effect {name or 'threshold'}", size=size)

    def build(units: Mapping[str, str]) -> EffectCard:
        above = ">" if place > 0.0 else "<"
        return card(
            name or f"{port} += c max({source} {above} {place:.3g})",
            f"A term beyond {source} {above} {place:.3g} {units[source]} is missing in {port}.",
            port,
            (strength("coefficient", per(units[port], units[source]), size, is_signed=True),),
            (),
            "",
            "residual of the runs",
        )

    def change(value: Array, x: SimpleNamespace, v: SimpleNamespace, _: Array | None) -> Array:
        source_value = state(x, source) - place
        beyond = np.maximum(source_value, 0.0) if place > 0.0 else np.minimum(source_value, 0.0)
        changed: Array = value + v.coefficient * beyond
        return changed

    return PortEffect(port=port, build=build, change=change, states=(source,))


def product(port: str, *, sources: tuple[str, str], size: float, name: str = "") -> PortEffect:
    """Return a product of two states or inputs added to the signal at a port; see `term`."""
    require_positive(f"effect {name or 'product'}", size=size)
    one, other = sources

    def build(units: Mapping[str, str]) -> EffectCard:
        return card(
            name or f"{port} += c {one} {other}",
            f"A term {one} {other} is missing in {port}.",
            port,
            (
                strength(
                    "coefficient", per(units[port], f"{units[one]} {units[other]}"), size, is_signed=True
                ),
            ),
            (),
            "",
            "residual of the runs",
        )

    def change(value: Array, x: SimpleNamespace, v: SimpleNamespace, _: Array | None) -> Array:
        changed: Array = value + v.coefficient * state(x, one) * state(x, other)
        return changed

    return PortEffect(port=port, build=build, change=change, states=sources)
