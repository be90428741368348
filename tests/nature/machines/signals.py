"""Inputs that excite, and what an actuator makes of them."""

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def steps(rng: np.random.Generator, samples: int, hold: tuple[int, int]) -> Array:
    """Return steps between -1 and 1 of random height; each is held for `hold` samples, from and to."""
    held: list[float] = []
    while len(held) < samples:
        held += [float(rng.uniform(-1.0, 1.0))] * int(rng.integers(*hold))
    return np.array(held[:samples])


def chirp(rng: np.random.Generator, samples: int, cycles: tuple[float, float]) -> Array:
    """Return a sine of amplitude 1 whose frequency rises linearly, in cycles per sample."""
    index = np.arange(samples)
    rate = (cycles[1] - cycles[0]) / samples
    turns = cycles[0] * index + 0.5 * rate * index**2
    return np.asarray(np.sin(math.tau * (turns + rng.uniform())))


def multi_sine(rng: np.random.Generator, samples: int, cycles: tuple[float, float]) -> Array:
    """Return the sum of six sines of random phase, scaled to 1; frequencies in cycles per sample."""
    frequencies = np.geomspace(cycles[0], cycles[1], 6) * rng.uniform(0.9, 1.1, 6)
    phases = rng.uniform(0.0, 1.0, 6)
    waves = np.sin(math.tau * (frequencies[:, None] * np.arange(samples) + phases[:, None])).sum(axis=0)
    return np.asarray(waves / np.abs(waves).max())


def triangle(rng: np.random.Generator, samples: int, period: tuple[int, int]) -> Array:
    """Return a triangular wave of amplitude 1 that starts at 0; `period` in samples, from and to."""
    turns = np.arange(samples) / float(rng.integers(*period)) + 0.25
    return np.asarray(1.0 - 4.0 * np.abs(turns - np.floor(turns) - 0.5))


def random_walk_force(rng: np.random.Generator, samples: int, correlation: float) -> Array:
    """Return an Ornstein-Uhlenbeck series of unit size, twice filtered; `correlation` in samples."""
    keep = math.exp(-1.0 / correlation)
    fresh = rng.standard_normal(samples + 200)
    value, smooth = 0.0, 0.0
    series = np.zeros(fresh.size)
    for index, shock in enumerate(fresh):
        value = keep * value + math.sqrt(1.0 - keep * keep) * shock
        smooth += 0.5 * (value - smooth)
        series[index] = smooth
    return series[200:]


def with_dead_zone(values: Array, width: float) -> Array:
    """Return what passes an actuator that does not answer within `width` of zero."""
    return np.asarray(np.sign(values) * np.maximum(np.abs(values) - width, 0.0))


def with_limit(values: Array, limit: float) -> Array:
    """Return the values cut off at `limit` on both sides."""
    return np.asarray(np.clip(values, -limit, limit))


def with_sag(values: Array, sag: float) -> Array:
    """Return the values each reduced by the share `sag` times its own size."""
    return np.asarray(values * (1.0 - sag * np.abs(values)))


def with_play(values: Array, width: float) -> Array:
    """Return what follows the values through a play of `width` in all; it starts in the middle."""
    followed = np.zeros(values.size)
    place = float(values[0])
    for index, value in enumerate(values):
        place = min(max(place, float(value) - width / 2), float(value) + width / 2)
        followed[index] = place
    return followed
