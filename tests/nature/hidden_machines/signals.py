"""Effects on signals: how nature does them, and their lines in a user's list."""

from collections.abc import Callable

import numpy as np

from tests.nature.hidden_machines.effect import Array, Effect, Where


def _offset(signal: Array, _: object, size: float) -> Array:
    return signal + size


def _gain(signal: Array, _: object, size: float) -> Array:
    return signal * (1.0 + size)


def _sag(signal: Array, _: object, size: float) -> Array:
    return signal * (1.0 - size * np.abs(signal))


def _dead_zone(signal: Array, _: object, size: float) -> Array:
    return np.asarray(signal - np.clip(signal, -size, size))


def _late(signal: Array, dt: float, size: float) -> Array:
    """Return the signal of `size` seconds before; the first value had been there for long."""
    index = np.arange(signal.shape[1]) - size / dt
    low = np.clip(np.floor(index).astype(int), 0, None)
    high = np.clip(low + 1, 0, signal.shape[1] - 1)
    share = np.where(index < 0.0, 0.0, index - np.floor(index))
    return np.asarray((1.0 - share) * signal[:, low] + share * signal[:, high])


def _lagged(signal: Array, dt: float, size: float) -> Array:
    """Return the signal behind a first-order lag that starts settled, in the middle of each step.

    What it is at the end of a step would be early by half a step.
    """
    if size <= 0.0:
        return signal
    result, value, keep = np.empty_like(signal), signal[:, 0], np.exp(-dt / size)
    for k in range(signal.shape[1]):
        before, value = value, keep * value + (1.0 - keep) * signal[:, k]
        result[:, k] = 0.5 * (before + value)
    return result


def _played(signal: Array, _: float, size: float) -> Array:
    """Return where a follower stands that has `size` of free way to either side."""
    result, value = np.empty_like(signal), signal[:, 0]
    for k in range(signal.shape[1]):
        value = np.clip(value, signal[:, k] - size, signal[:, k] + size)
        result[:, k] = value
    return result


def offset(where: Where, place: str, typical: float) -> Effect:
    """Return a constant that is added."""
    name = f"{place}_offset"
    line = f'effects.offset("{place}", size={{size}}, name="{name}")'
    return _on(where, place, name, _offset, typical, line, "offset", is_signed=True)


def gain(where: Where, place: str, typical: float) -> Effect:
    """Return a wrong scale."""
    name = f"{place}_gain"
    line = f'effects.gain_error("{place}", size={{size}}, name="{name}")'
    return _on(where, place, name, _gain, typical, line, "share", most=0.5, is_signed=True)


def sag(place: str, typical: float) -> Effect:
    """Return a supply that falls under load."""
    name = f"{place}_sag"
    line = f'effects.supply_sag("{place}", size={{size}}, name="{name}")'
    return _on("input", place, name, _sag, typical, line, "per_unit", most=8.0 * typical)


def dead_zone(place: str, typical: float) -> Effect:
    """Return a zone around zero without effect."""
    name = f"{place}_dead_zone"
    line = f'effects.dead_zone("{place}", size={{size}}, name="{name}")'
    return _on("input", place, name, _dead_zone, typical, line, "half_width", most=6.0 * typical)


def backlash(port: str, typical: float) -> Effect:
    """Return play in a coupling whose port is its twist."""
    line = f'effects.backlash("{port}", size={{size}}, name="{port}_backlash")'
    return _on("port", port, f"{port}_backlash", _dead_zone, typical, line, "half_play")


def play(place: str, typical: float) -> Effect:
    """Return play in a linkage."""
    name = f"{place}_play"
    line = f'effects.play("{place}", size={{size}}, name="{name}")'
    return _on("input", place, name, _played, typical, line, "half_play", most=6.0 * typical)


def delay(where: Where, place: str, typical: float, longest: float) -> Effect:
    """Return a delay."""
    name = f"{place}_delay"
    line = f'effects.delay("{place}", size={{size}}, longest={longest}, name="{name}")'
    return _on(where, place, name, _late, typical, line, "time", most=0.7 * longest)


def lag(where: Where, place: str, typical: float, longest: float) -> Effect:
    """Return a first-order lag."""
    name = f"{place}_lag"
    line = f'effects.lag("{place}", size={{size}}, longest={longest}, name="{name}")'
    return _on(where, place, name, _lagged, typical, line, "time", most=0.7 * longest)


def saturation(where: Where, place: str, greatest: float) -> Effect:
    """Return a limit; its strength is the share of the greatest signal that is cut off."""

    def act(signal: Array, _: object, size: float) -> Array:
        limit = greatest * (1.0 - size)
        return np.clip(signal, -limit, limit)

    name = f"{place}_saturation"
    line = f'effects.saturation("{place}", limits={{limits}}, name="{name}")'
    return Effect(name, where, place, act, 0.3, 0.6, line, "limit", lambda size: greatest * (1.0 - size))


def wrong(parameter: str, typical: float) -> Effect:
    """Return a base parameter whose error is beyond its prior."""
    line = f'effects.wrong_parameter("{parameter}", size={{size}})'
    name = f"wrong_{parameter}"
    return _on("parameter", parameter, name, _offset, typical, line, "error", is_signed=True)


def _on(
    where: Where, place: str, name: str, act: Callable[..., Array], typical: float, line: str, parameter: str,
    most: float = np.inf, is_signed: bool = False,
) -> Effect:  # fmt: skip
    return Effect(name, where, place, act, typical, most, line, parameter, is_signed=is_signed)
