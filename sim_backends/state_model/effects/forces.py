"""Forces that depend on a state: friction, drag, stiffness, cogging, stops.

Each is subtracted from the signal at its port, which is a force, a torque, or any other rate of change.
"""

import math
from collections.abc import Mapping
from types import SimpleNamespace

import numpy as np

from sim_backends.models.interface import Array, Parameter, parameter
from sim_backends.models.ranges import require_positive
from sim_backends.state_model.effects.cards import card, per, shape, smooth_sign, state, strength
from sim_backends.state_model.port_effect import PortEffect

SPEED_GRID = (0.3, 1.0, 3.0)


def coulomb_friction(
    port: str, *, velocity: str, size: float, slow: float, name: str = "coulomb_friction"
) -> PortEffect:
    """Return dry friction: a constant force against the motion.

    Signal: `s - level tanh(v / slow)`; level >= 0, unit of the port.

    Args:
        port: Where it brakes.
        velocity: State that it opposes.
        size: Natural size, in the unit of the port.
        slow: Velocity below which the force fades, in the unit of the state: about 1 % of the usual one.
        name: Of the card.
    """
    require_positive(f"effect {name}", size=size, slow=slow)

    return PortEffect(
        port=port,
        build=card(
            name,
            "Dry friction opposes the motion with a force that does not depend on the speed.",
            port,
            lambda units: (strength("level", units[port], size),),
            (f"changes its sign with {velocity}", "does not grow with speed"),
            "move slowly in both directions, and reverse",
            "Coulomb 1785; Armstrong-Helouvry, Dupont, Canudas de Wit 1994",
        ),
        change=lambda value, x, v, _: value - v.level * smooth_sign(state(x, velocity), slow),
        states=(velocity,),
    )


def asymmetric_friction(
    port: str, *, velocity: str, size: float, slow: float, name: str = "asymmetric_friction"
) -> PortEffect:
    """Return the even part of dry friction, equal in both directions; see `coulomb_friction`.

    Signal: `s - excess tanh(v / slow)^2`; excess of any sign.
    """
    require_positive(f"effect {name}", size=size, slow=slow)

    return PortEffect(
        port=port,
        build=card(
            name,
            "Friction is stronger in one direction of motion than in the other.",
            port,
            lambda units: (strength("excess", units[port], size, is_signed=True),),
            (f"does not change its sign with {velocity}", "zero at rest"),
            "the same speeds in both directions, and rest",
            "Armstrong-Helouvry 1991: friction differs between directions",
        ),
        change=lambda value, x, v, _: value - v.excess * smooth_sign(state(x, velocity), slow) ** 2,
        states=(velocity,),
    )


def stribeck_friction(
    port: str, *, velocity: str, size: float, speed: float, slow: float, name: str = "stribeck_friction"
) -> PortEffect:
    """Return the part of dry friction that disappears with speed.

    Signal: `s - excess tanh(v / slow) exp(-(v / speed)^2)`; excess >= 0. Add it to Coulomb friction.

    Args:
        port: Where it brakes.
        velocity: State that it opposes.
        size: Natural size, in the unit of the port.
        speed: Velocity at which it has fallen to 37 %, known to a factor of ten.
        slow: Velocity below which the force fades.
        name: Of the card.
    """
    require_positive(f"effect {name}", size=size, speed=speed, slow=slow)

    def change(value: Array, x: SimpleNamespace, v: SimpleNamespace, _: Array | None) -> Array:
        rate = state(x, velocity)
        reduced: Array = value - v.excess * smooth_sign(rate, slow) * np.exp(-((rate / v.speed) ** 2))
        return reduced

    return PortEffect(
        port=port,
        build=card(
            name,
            "Friction is greatest just above rest and falls as a lubricant film forms.",
            port,
            lambda units: (strength("excess", units[port], size), shape("speed", units[velocity], speed)),
            ("gone at high speed", f"changes its sign with {velocity}"),
            "steady speeds from just above rest",
            "Stribeck 1902; Armstrong-Helouvry, Dupont, Canudas de Wit 1994",
            {"speed": tuple(speed * share for share in SPEED_GRID)},
        ),
        change=change,
        states=(velocity,),
    )


def presliding(
    port: str, *, velocity: str, size: float, distance: float, name: str = "presliding"
) -> PortEffect:
    """Return dry friction that builds up over a distance, like a spring before it slips (Dahl's model).

    Signal: `s - level z`, `dz/dt = (v - abs(v) z) / distance`, `z = 0` at the start; level >= 0. Call
    the port in `derivative`; the machine moves less than about `distance` per sample.

    Args:
        port: Where it brakes.
        velocity: State that it opposes.
        size: Natural size, in the unit of the port.
        distance: Motion over which it builds up, in the unit of the velocity times seconds.
        name: Of the card.
    """
    require_positive(f"effect {name}", size=size, distance=distance)

    def memory_rate(_: Array, x: SimpleNamespace, v: SimpleNamespace, own: Array) -> Array:
        rate = state(x, velocity)
        found: Array = (rate - np.abs(rate) * own) / v.distance
        return found

    return PortEffect(
        port=port,
        build=card(
            name,
            "Before it slips, a dry contact deflects like a spring: friction builds up over a distance.",
            port,
            lambda units: (
                strength("level", units[port], size),
                shape("distance", units[velocity].removesuffix("/s"), distance),
            ),
            ("lags behind a reversal", "constant in steady motion"),
            "small reversals at several amplitudes",
            "Dahl 1968",
            {"distance": tuple(distance * share for share in SPEED_GRID)},
        ),
        change=lambda value, _, v, own: value - v.level * (0.0 if own is None else own),
        memory_rate=memory_rate,
        states=(velocity,),
    )


def viscous_friction(port: str, *, velocity: str, size: float, name: str = "viscous_friction") -> PortEffect:
    """Return friction in proportion to speed.

    Signal: `s - coefficient v`; coefficient >= 0.

    Args:
        port: Where it brakes.
        velocity: State that it opposes.
        size: Natural size, in the unit of the port per unit of the velocity.
        name: Of the card.
    """
    return _power(
        port,
        velocity,
        1,
        size,
        name,
        "Grease and windage brake in proportion to speed.",
        ("grows in proportion to speed",),
        "two steady speeds far apart",
        "Stokes",
    )


def quadratic_drag(port: str, *, velocity: str, size: float, name: str = "quadratic_drag") -> PortEffect:
    """Return drag with the square of speed; `size` in the unit of the port per unit of velocity squared.

    Signal: `s - coefficient v abs(v)`; coefficient >= 0.
    """
    return _power(
        port,
        velocity,
        2,
        size,
        name,
        "Air or water brakes with the square of speed.",
        ("grows with the square of speed", "changes its sign with the velocity"),
        "high speeds",
        "Newton's drag",
    )


def cubic_stiffness(port: str, *, position: str, size: float, name: str = "cubic_stiffness") -> PortEffect:
    """Return a restoring force with the cube of a position; it may harden or soften.

    Signal: `s - coefficient q^3`; coefficient of any sign.

    Args:
        port: Where it acts.
        position: State that it restores.
        size: Natural size, in the unit of the port per unit of the position cubed.
        name: Of the card.
    """
    return _power(
        port,
        position,
        3,
        size,
        name,
        "A spring becomes stiffer or softer as it is deflected.",
        ("odd in the position", "greatest at large deflection"),
        "small and large amplitudes",
        "Duffing 1918",
        is_signed=True,
    )


def _power(
    port: str,
    source: str,
    order: int,
    size: float,
    name: str,
    sentence: str,
    claims: tuple[str, ...],
    experiment: str,
    reference: str,
    *,
    is_signed: bool = False,
) -> PortEffect:
    require_positive(f"effect {name}", size=size)

    def parameters(units: Mapping[str, str]) -> tuple[Parameter, ...]:
        unit = units[source] if order == 1 else f"({units[source]})^{order}"
        return (strength("coefficient", per(units[port], unit), size, is_signed=is_signed),)

    def change(value: Array, x: SimpleNamespace, v: SimpleNamespace, _: Array | None) -> Array:
        from_state = state(x, source)
        reduced: Array = value - v.coefficient * from_state * np.abs(from_state) ** (order - 1)
        return reduced

    build = card(name, sentence, port, parameters, claims, experiment, reference)
    return PortEffect(port=port, build=build, change=change, states=(source,))


def cogging(port: str, *, position: str, period: float, size: float, name: str = "cogging") -> PortEffect:
    """Return a force that repeats with position.

    Signal: `s - amplitude sin(2 pi q / period + phase)`; amplitude >= 0.

    Args:
        port: Where it acts.
        position: State that it depends on.
        period: In the unit of the position.
        size: Natural size, in the unit of the port.
        name: Of the card.
    """
    require_positive(f"effect {name}", period=period, size=size)

    def change(value: Array, x: SimpleNamespace, v: SimpleNamespace, _: Array | None) -> Array:
        angle = 2.0 * math.pi / period * state(x, position) + v.phase
        reduced: Array = value - v.amplitude * np.sin(angle)
        return reduced

    return PortEffect(
        port=port,
        build=card(
            name,
            "Teeth, magnets or an eccentric disc push and pull as the position advances.",
            port,
            lambda units: (
                strength("amplitude", units[port], size),
                parameter("phase", "rad", 0.0, 1.0, -2.0 * math.pi, 4.0 * math.pi),
            ),
            (f"repeats every {period:g} of {position}", "independent of speed"),
            "turn slowly over several periods",
            "cogging of permanent-magnet motors",
            {"phase": tuple(0.5 * math.pi * step for step in range(4))},
        ),
        change=change,
        states=(position,),
    )


def end_stop(
    port: str, *, position: str, size: float, places: tuple[float, ...], name: str = "end_stop"
) -> PortEffect:
    """Return a stiff stop beyond a position.

    Signal: `s - stiffness (q - place)` beyond the place; stiffness >= 0. A negative place is a lower
    stop.

    Args:
        port: Where it pushes back.
        position: State that it stops.
        size: Natural size of its stiffness, in the unit of the port per unit of the position.
        places: Where the stop may be; all positive for an upper stop, all negative for a lower one.
        name: Of the card.
    """
    require_positive(f"effect {name}", size=size)
    side = 1.0 if places[0] > 0.0 else -1.0
    lowest, highest = min(places), max(places)
    margin = 0.5 * max(highest - lowest, 0.2 * abs(highest))

    def change(value: Array, x: SimpleNamespace, v: SimpleNamespace, _: Array | None) -> Array:
        beyond = np.maximum(side * (state(x, position) - v.place), 0.0)
        reduced: Array = value - side * v.stiffness * beyond
        return reduced

    return PortEffect(
        port=port,
        build=card(
            name,
            "A stop pushes back beyond a position.",
            port,
            lambda units: (
                strength("stiffness", per(units[port], units[position]), size),
                parameter("place", units[position], places[0], margin, lowest - margin, highest + margin),
            ),
            ("acts only beyond the place",),
            "move slowly into the stop",
            "mechanical end stop",
            {"place": places},
        ),
        change=change,
        states=(position,),
    )
