"""Shapes of an input over time."""

import math
from collections.abc import Callable, Mapping

import numpy as np

from rover_hil.gap.next_run.allowed import InputRange
from rover_hil.gap.parameters import MACHINES
from sim_backends.models.interface import Array


def centre_of(limits: InputRange) -> tuple[float, float]:
    """Return the value that a shape moves about, and its greatest amplitude: zero where it is inside."""
    if limits.low < 0.0 < limits.high:
        return 0.0, max(-limits.low, limits.high)
    return 0.5 * (limits.low + limits.high), 0.5 * (limits.high - limits.low)


def amplitudes_of(limits: InputRange) -> tuple[float, ...]:
    """Return the amplitudes to try, in the unit of the input."""
    greatest = centre_of(limits)[1]
    if limits.amplitudes:
        return tuple(one for one in limits.amplitudes if one <= greatest * (1.0 + 1e-9))
    return tuple(share * greatest for share in MACHINES.planned.amplitude_shares) if greatest > 0.0 else ()


def periods_of(limits: InputRange, duration_s: float, step_s: float) -> tuple[float, ...]:
    """Return the periods to try, s."""
    if limits.period_s is not None:
        low, high = sorted(limits.period_s)
        found: tuple[float, ...] = (low, math.sqrt(low * high), high)
    else:
        found = tuple(duration_s / count for count in MACHINES.planned.periods_of_run)
    return tuple(dict.fromkeys(one for one in found if one >= MACHINES.planned.shortest_samples * step_s))


def shaped(shape: str, limits: InputRange, amplitude: float, period_s: float, times_s: Array) -> Array | None:
    """Return an input over time; None where it would exceed its limits or rate.

    Args:
        shape: One of the shapes but `repeat`.
        limits: Of the input.
        amplitude: Greatest distance from the centre; negative to begin in the other direction.
        period_s: Period; of a sweep and a multi-sine the shortest one.
        times_s: Since the start of the run.
    """
    centre, _ = centre_of(limits)
    duration_s = float(times_s[-1]) + (float(times_s[1]) if times_s.size > 1 else 0.0)
    values: Array = centre + amplitude * _SHAPES[shape](times_s, duration_s, period_s)
    return values if fits(limits, values, times_s) else None


def fits(limits: InputRange, values: Array, times_s: Array) -> bool:
    """Return True where values stay within limits and rate; a jump has no rate."""
    if not limits.holds((float(values.min()), float(values.max()))):
        return False
    if limits.rate is None:
        return True
    rates = np.abs(np.diff(values)) / np.maximum(np.diff(times_s), 1e-300)
    return bool(rates.max(initial=0.0) <= limits.rate * (1.0 + 1e-6))


def has_period(shape: str) -> bool:
    """Return True for a shape whose period matters."""
    return shape in ("sine", "sweep", "multi_sine", "square")


def _sweep(times_s: Array, duration_s: float, period_s: float) -> Array:
    slow, fast = 1.0 / duration_s, 1.0 / period_s
    return np.sin(math.tau * (slow * times_s + 0.5 * (fast - slow) / duration_s * times_s**2))


def _multi_sine(times_s: Array, duration_s: float, period_s: float) -> Array:
    rates = np.geomspace(1.0 / duration_s, 1.0 / period_s, MACHINES.planned.sines)
    order = np.arange(MACHINES.planned.sines)
    phases = -math.pi * order * (order + 1) / MACHINES.planned.sines
    waves = np.sin(math.tau * rates[:, None] * times_s + phases[:, None]).sum(axis=0)
    found: Array = waves / max(float(np.abs(waves).max()), 1e-300)
    return found


_SHAPES: Mapping[str, Callable[[Array, float, float], Array]] = {
    "step": lambda t_s, duration_s, _: np.where(t_s >= MACHINES.planned.step_at * duration_s, 1.0, 0.0),
    "ramp": lambda t_s, duration_s, _: 2.0 * t_s / duration_s - 1.0,
    "sine": lambda t_s, _, period_s: np.sin(math.tau * t_s / period_s),
    "square": lambda t_s, _, period_s: np.where((t_s / period_s) % 1.0 < 0.5, 1.0, -1.0),
    "sweep": _sweep,
    "multi_sine": _multi_sine,
}
