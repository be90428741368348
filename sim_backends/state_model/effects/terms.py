"""Free-form terms of an equation: what a draft of a new effect consists of.

A source is a state or an input, or the difference of two in the same unit: `"room - body"`.
"""

from collections import Counter
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

MINUS = " - "
"""Between the names of a difference."""


def term(port: str, *, source: str, form: str, size: float, scale: float, name: str = "") -> PortEffect:
    """Return a term added to the signal at a port.

    Signal: `s + coefficient f(x)`; any sign. `form`: `constant`, `linear`, `sign`, `square`,
    `signed_square`, `cube`, `root` (`sign(x) sqrt(abs(x))`), `size` (`abs(x)`).

    Args:
        port: The signal.
        source: State or input that the term depends on, or a difference.
        form: A key of `FORMS`.
        size: Natural size of the coefficient.
        scale: Usual size of the source, in its unit.
        name: Of the card; by default the equation.
    """
    require_positive(f"effect {name or 'term'}", size=size, scale=scale)
    text, order, function = FORMS[form]
    formula = text.format(x=_text(source)).replace("|(", "|").replace(")|", "|")

    def below(units: Mapping[str, str]) -> str:
        unit = _unit(units, source)
        return "1" if order == 0 else unit if order == 1 else f"({unit})^{order:g}"

    return PortEffect(
        port=port,
        build=_term_card(port, formula, below, size, name),
        change=lambda value, x, v, _: value + v.coefficient * function(_value(x, source), scale),
        states=_names(source),
    )


def _term_card(
    port: str, formula: str, below: Callable[[Mapping[str, str]], str], size: float, name: str
) -> Callable[[Mapping[str, str]], EffectCard]:
    """Return what makes the card of a term; `below` is the unit of the formula."""
    return card(
        name or f"{port} += c {formula}",
        f"A term {formula} is missing in {port}.",
        port,
        lambda units: (strength("coefficient", per(units[port], below(units)), size, is_signed=True),),
        (),
        "",
        "residual of the runs",
    )


def threshold(port: str, *, source: str, place: float, size: float, name: str = "") -> PortEffect:
    """Return a term that grows beyond a value of its source; see `term`.

    Signal: `s + coefficient (x - place)` beyond the place, away from zero; any sign.
    """
    require_positive(f"effect {name or 'threshold'}", size=size)

    formula = f"max({_text(source)} {'>' if place > 0.0 else '<'} {place:.3g})"
    build = _term_card(port, formula, lambda units: _unit(units, source), size, name)

    def change(value: Array, x: SimpleNamespace, v: SimpleNamespace, _: Array | None) -> Array:
        source_value = _value(x, source) - place
        beyond = np.maximum(source_value, 0.0) if place > 0.0 else np.minimum(source_value, 0.0)
        changed: Array = value + v.coefficient * beyond
        return changed

    return PortEffect(port=port, build=build, change=change, states=_names(source))


def product(port: str, *, sources: tuple[str, ...], size: float, name: str = "") -> PortEffect:
    """Return a product of sources added to the signal at a port; see `term`. A source may appear again.

    Signal: `s + coefficient x y ...`; any sign.
    """
    require_positive(f"effect {name or 'product'}", size=size)
    powers = Counter(sources)
    text = " ".join(_power(_text(one), power) for one, power in powers.items())

    def below(units: Mapping[str, str]) -> str:
        return " ".join(
            _power(_unit(units, one) if power == 1 else f"({_unit(units, one)})", power)
            for one, power in powers.items()
        )

    def change(value: Array, x: SimpleNamespace, v: SimpleNamespace, _: Array | None) -> Array:
        changed: Array = v.coefficient * _value(x, sources[0])
        for one in sources[1:]:
            changed = changed * _value(x, one)
        return value + changed

    build = _term_card(port, text, below, size, name)
    read = tuple(name for one in powers for name in _names(one))
    return PortEffect(port=port, build=build, change=change, states=read)


def _names(source: str) -> tuple[str, ...]:
    return tuple(source.split(MINUS))


def _value(x: SimpleNamespace, source: str) -> Array:
    one, *others = _names(source)
    value = state(x, one)
    for other in others:
        value = value - state(x, other)
    return value


def _unit(units: Mapping[str, str], source: str) -> str:
    return units[_names(source)[0]]


def _text(source: str) -> str:
    return f"({source})" if MINUS in source else source


def _power(text: str, power: int) -> str:
    return text if power == 1 else f"{text}^{power}"
