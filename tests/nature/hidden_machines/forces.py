"""Effects at ports: how nature does them, and their lines in a user's list. Forces are subtracted."""

from collections.abc import Callable

import numpy as np

from tests.nature.hidden_machines.effect import Array, Effect, Term

Values = dict[str, Array]
SHARP = 0.3
"""Nature's friction changes its sign within this share of the user's `slow`, on a law of another form."""

MOST = 30.0
"""Greatest strength over the usual one: beyond it a machine only stands still."""


def _sense(velocity: Array, slow: float) -> Array:
    return np.asarray(velocity / np.sqrt(velocity**2 + (SHARP * slow) ** 2))


def _force(
    port: str, name: str, shape: Callable[[Values], Array], typical: float, call: str, parameter: str,
    is_signed: bool = False,
) -> Effect:  # fmt: skip
    def act(signal: Array, x: Values, size: float) -> Array:
        return signal - size * shape(x)

    full = f"{port}_{name}"
    line = f'effects.{name}("{port}", {call}, size={{size}}, name="{full}")'
    return Effect(full, "port", port, act, typical, MOST * typical, line, parameter, is_signed=is_signed)


def dry(port: str, velocity: str, typical: float, slow: float) -> Effect:
    """Return Coulomb friction."""
    call = f'velocity="{velocity}", slow={slow}'
    return _force(port, "coulomb_friction", lambda x: _sense(x[velocity], slow), typical, call, "level")


def uneven(port: str, velocity: str, typical: float, slow: float) -> Effect:
    """Return the even part of dry friction."""
    call = f'velocity="{velocity}", slow={slow}'
    return _force(
        port, "asymmetric_friction", lambda x: _sense(x[velocity], slow) ** 2, typical, call, "excess", True
    )


def stribeck(port: str, velocity: str, typical: float, slow: float, speed: float) -> Effect:
    """Return friction that disappears with speed."""

    def shape(x: Values) -> Array:
        return _sense(x[velocity], slow) * np.exp(-((x[velocity] / speed) ** 2))

    call = f'velocity="{velocity}", speed={speed}, slow={slow}'
    return _force(port, "stribeck_friction", shape, typical, call, "excess")


def drag(port: str, velocity: str, typical: float) -> Effect:
    """Return drag with the square of speed."""
    call = f'velocity="{velocity}"'
    return _force(
        port, "quadratic_drag", lambda x: x[velocity] * np.abs(x[velocity]), typical, call, "coefficient"
    )


def cubic(port: str, position: str, typical: float) -> Effect:
    """Return a restoring force with the cube of a position."""
    call = f'position="{position}"'
    return _force(
        port, "cubic_stiffness", lambda x: x[position] ** 3, typical, call, "coefficient", is_signed=True
    )


def cogging(port: str, position: str, typical: float, period: float, phase: float) -> Effect:
    """Return a force that repeats with position."""

    def shape(x: Values) -> Array:
        return np.asarray(np.sin(2.0 * np.pi * x[position] / period + phase))

    return _force(port, "cogging", shape, typical, f'position="{position}", period={period:.6g}', "amplitude")


def end_stop(port: str, position: str, typical: float, place: float, places: tuple[float, ...]) -> Effect:
    """Return a stiff stop beyond a positive place."""
    call = f'position="{position}", places={places}'
    return _force(
        port, "end_stop", lambda x: np.maximum(x[position] - place, 0.0), typical, call, "stiffness"
    )


def term(
    port: str,
    name: str,
    shape: Callable[[Values], Array],
    typical: float,
    *right: tuple[tuple[str, ...], str],
) -> Effect:
    """Return a force outside the catalogue; `right` are sources and form of each term that describes it."""

    def act(signal: Array, x: Values, size: float) -> Array:
        return signal - size * shape(x)

    terms = tuple(Term(port, sources, (form,)) for sources, form in right)
    return Effect(f"{port}_{name}", "port", port, act, typical, MOST * typical, terms=terms)


def root_friction(port: str, velocity: str, typical: float) -> Effect:
    """Return friction with the root of speed, as of a thin film of a thinning liquid."""

    def shape(x: Values) -> Array:
        return np.asarray(np.sign(x[velocity]) * np.sqrt(np.abs(x[velocity])))

    return term(port, "root_friction", shape, typical, ((velocity,), "root"))


def drift(port: str, typical: float, over_s: float) -> Effect:
    """Return a force that grows with the time since the start of a run, as by warming; no term is right."""
    return term(port, "drift", lambda x: -x["time"] / over_s, typical)
