"""Changes of a signal: of an input, a channel, or a port inside the equations."""

from collections.abc import Callable, Mapping
from types import SimpleNamespace

import numpy as np

from sim_backends.models.interface import Array, EffectCard, parameter
from sim_backends.models.ranges import require_not_negative, require_positive
from sim_backends.state_model.effects.cards import card, state, strength
from sim_backends.state_model.port_effect import Action, Change, PortEffect

MOST_SHARE = 2.0
"""Greatest share of an excess that a limit removes; 1 is a hard limit."""
SHARE = "of the excess that is removed; 1 is a hard limit"
EDGE_SHARE = 0.01
"""Height below the limit over which an overflow begins, as a share of it: a level stays at the limit."""


def _signal(
    port: str,
    name: str,
    sentence: str,
    strength_of: tuple[str, str, float, bool],
    claims: tuple[str, ...],
    experiment: str,
    change: Change,
) -> PortEffect:
    """Return an effect with one strength: its name, unit with {unit} for that of the port, size, sign."""
    require_positive(f"effect {name}", size=strength_of[2])
    label, unit, size, is_signed = strength_of
    build = card(
        name,
        sentence,
        port,
        lambda units: (strength(label, unit.replace("{unit}", units[port]), size, is_signed=is_signed),),
        claims,
        experiment,
        "engineering practice",
    )
    return PortEffect(port=port, build=build, change=change)


def offset(port: str, *, size: float, name: str = "offset") -> PortEffect:
    """Return a constant added to a signal; `size` in its unit.

    Signal: `s + offset`; any sign.
    """
    return _signal(
        port,
        name,
        "A constant is added to the signal.",
        ("offset", "{unit}", size, True),
        ("the same at all times",),
        "log at rest",
        lambda value, _, v, __: value + v.offset,
    )


def gain_error(port: str, *, size: float, name: str = "gain_error") -> PortEffect:
    """Return a wrong scale of a signal; `size` is a share.

    Signal: `s (1 + share)`; any sign.
    """
    return _signal(
        port,
        name,
        "The scale of the signal is wrong.",
        ("share", "1", size, True),
        ("in proportion to the signal",),
        "a known value of the signal",
        lambda value, _, v, __: value * (1.0 + v.share),
    )


def supply_sag(port: str, *, size: float, name: str = "supply_sag") -> PortEffect:
    """Return a supply that falls under load; `size` is the relative loss per unit of the signal.

    Signal: `s (1 - per_unit abs(s))`; per_unit >= 0.
    """
    return _signal(
        port,
        name,
        "The supply falls under load, so that large signals lose more.",
        ("per_unit", "1/({unit})", size, False),
        ("grows with the square of the signal",),
        "measure the supply under load",
        lambda value, _, v, __: value * (1.0 - v.per_unit * np.abs(value)),
    )


def dead_zone(port: str, *, size: float, name: str = "dead_zone") -> PortEffect:
    """Return a zone around zero where the signal has no effect; `size` is its half width.

    Signal: zero inside `half_width`; outside, closer to zero by it; half_width >= 0.
    """
    return _signal(
        port,
        name,
        "Small signals have no effect; larger ones are reduced by the half width of the zone.",
        ("half_width", "{unit}", size, False),
        ("a constant loss outside the zone", "changes its sign with the signal"),
        "slow ramps through zero",
        lambda value, _, v, __: value - np.clip(value, -v.half_width, v.half_width),
    )


def backlash(port: str, *, size: float, name: str = "backlash") -> PortEffect:
    """Return play in a coupling whose port is the twist between its sides; `size` is half of the play.

    Signal: zero inside `half_play`, as a dead zone; half_play >= 0.
    """
    return _signal(
        port,
        name,
        "A coupling transmits nothing while its teeth cross their play.",
        ("half_play", "{unit}", size, False),
        ("a jump of the twist at each reversal of the torque",),
        "reverse the torque slowly, with a sensor on both sides",
        lambda value, _, v, __: value - np.clip(value, -v.half_play, v.half_play),
    )


def play(port: str, *, size: float, name: str = "play") -> PortEffect:
    """Return play in a linkage without inertia: an input or channel follows only when the play is crossed.

    Signal: follows only when the play is crossed; half_play >= 0. At an input or channel only.

    Args:
        port: The input or channel.
        size: Natural size of half of the play, in its unit.
        name: Of the card.
    """
    require_positive(f"effect {name}", size=size)

    build = card(
        name,
        "A linkage with play follows only when its play is crossed.",
        port,
        lambda units: (strength("half_play", units[port], size),),
        ("stays where it is after each reversal", "lags by half of the play in both directions"),
        "slow reversals",
        "hysteresis of play: Krasnoselskii and Pokrovskii 1989",
    )
    return PortEffect(port=port, build=build, action=Action.PLAY)


def _numbered(key: str, values: tuple[float, ...]) -> dict[str, float]:
    return {f"{key}[{index}]": value for index, value in enumerate(values)}


def saturation(port: str, *, limits: tuple[float, ...], name: str = "saturation") -> PortEffect:
    """Return a limit of a signal.

    Signal: between `-limit` and `limit` for share 1; share 0 to 2.

    Args:
        port: The signal.
        limits: Where its size may be limited, inside the range that the runs use.
        name: Of the card.
    """
    require_positive(f"effect {name}", **_numbered("limits", limits))

    return PortEffect(
        port=port,
        build=_limit_card(name, "The signal cannot exceed a limit.", port, port, limits, "large signals"),
        change=lambda value, _, v, __: value - v.share * (value - np.clip(value, -v.limit, v.limit)),
    )


def overflow(
    port: str, *, level: str, limits: tuple[float, ...], weir: float = 0.0, name: str = "overflow"
) -> PortEffect:
    """Return an overflow: above a level, what flows in runs off.

    Signal: above `limit` of the level the positive part of `s` is lost, for share 1; share 0 to 2.

    Args:
        port: The net inflow.
        level: State with the limit.
        limits: Where the edge may be.
        weir: What runs off per height above the edge, in the unit of the port per unit of the level. A run
            that begins above the edge needs it: about the area over the time in which it runs off.
        name: Of the card.
    """
    require_positive(f"effect {name}", **_numbered("limits", limits))
    require_not_negative(f"effect {name}", weir=weir)

    sentence = "Above an edge the inflow runs off."
    build = _limit_card(name, sentence, port, level, limits, "fill slowly to the edge")

    def change(value: Array, x: SimpleNamespace, v: SimpleNamespace, _: Array | None) -> Array:
        above = state(x, level) - v.limit
        share = np.clip(1.0 + above / (EDGE_SHARE * v.limit), 0.0, 1.0)
        lost = share * np.maximum(value, 0.0) + weir * np.maximum(above, 0.0)
        changed: Array = value - v.share * lost
        return changed

    return PortEffect(port=port, build=build, change=change, states=(level,))


def _limit_card(
    name: str, sentence: str, port: str, limited: str, limits: tuple[float, ...], experiment: str
) -> Callable[[Mapping[str, str]], EffectCard]:
    """Return what makes a card with a share and a limit, in the unit of the limited signal."""
    return card(
        name,
        sentence,
        port,
        lambda units: (
            strength("share", "1", 1.0, upper=MOST_SHARE, meaning=SHARE),
            parameter(
                "limit",
                units[limited],
                sorted(limits)[len(limits) // 2],
                max(limits),
                0.5 * min(limits),
                2.0 * max(limits),
            ),
        ),
        ("acts only beyond the limit",),
        experiment,
        "engineering practice",
        {"limit": limits},
    )


def quantisation(port: str, *, step: float, name: str = "quantisation") -> PortEffect:
    """Return a signal rounded to steps; the strength is the share of the rounding, 1 for whole steps.

    Signal: rounded to `step` for share 1; share 0 to 2.
    """
    require_positive(f"effect {name}", step=step)

    build = card(
        name,
        f"The signal is rounded to steps of {step:g}.",
        port,
        lambda _: (strength("share", "1", 1.0, upper=MOST_SHARE),),
        ("jumps by a step",),
        "slow ramps",
        "converters",
    )
    return PortEffect(
        port=port,
        build=build,
        change=lambda value, _, v, __: value + v.share * (step * np.round(value / step) - value),
    )


def delay(port: str, *, size: float, longest: float, name: str = "delay") -> PortEffect:
    """Return a delay of an input or a channel.

    Signal: later by `time`, 0 to `longest`. At an input or channel only.

    Args:
        port: The input or channel.
        size: Natural size, s.
        longest: Greatest delay, s.
        name: Of the card.
    """
    return _time(port, name, "The signal arrives later.", Action.DELAY, size, longest)


def lag(port: str, *, size: float, longest: float, name: str = "lag") -> PortEffect:
    """Return a first-order lag of an input or a channel; see `delay`.

    Signal: behind a first-order lag of `time`, 0 to `longest`, that starts settled. At an input or
    channel only.
    """
    return _time(port, name, "The signal follows with a first-order lag.", Action.LAG, size, longest)


def _time(port: str, name: str, sentence: str, action: Action, size: float, longest: float) -> PortEffect:
    require_positive(f"effect {name}", size=size, longest=longest)

    build = card(
        name,
        sentence,
        port,
        lambda _: (strength("time", "s", size, upper=longest),),
        ("shows only where the signal changes",),
        "steps and fast signals",
        "engineering practice",
    )
    return PortEffect(port=port, build=build, action=action)


def wrong_parameter(parameter: str, *, size: float, name: str = "") -> PortEffect:
    """Return an error of a base parameter beyond its prior.

    Signal: the base parameter plus `error` of any sign.

    Args:
        parameter: The base parameter.
        size: Natural size of the error, in its unit.
        name: Of the card; by default `wrong_` and the parameter.
    """
    name = name or f"wrong_{parameter}"
    require_positive(f"effect {name}", size=size)

    build = card(
        name,
        f"{parameter} is not what it was taken for.",
        parameter,
        lambda units: (strength("error", units[parameter], size, is_signed=True),),
        (f"what a change of {parameter} does",),
        f"measure {parameter} by other means",
        "tolerance",
        releases=parameter,
    )
    return PortEffect(port=parameter, build=build, action=Action.RELEASE)
