"""Inputs of runs: steps, triangles, sines, sweeps and sums of sines, each after a hold."""

from collections.abc import Callable

import numpy as np

from tests.nature.hidden_machines.machine import Array, Input

HOLD = 0.06
"""Share of a run at its start during which nothing changes, so that nothing before the run matters."""


def _steps(share: Array, rng: np.random.Generator) -> Array:
    count = int(rng.integers(4, 9))
    edges = np.sort(rng.uniform(0.0, 1.0, count - 1))
    return np.asarray(rng.uniform(-1.0, 1.0, count)[np.searchsorted(edges, share)])


def _triangle(share: Array, rng: np.random.Generator) -> Array:
    phase = rng.uniform(1.0, 3.0) * share + 0.25
    return np.asarray(rng.choice([-1.0, 1.0]) * (4.0 * np.abs(phase % 1.0 - 0.5) - 1.0))


def _sine(share: Array, rng: np.random.Generator) -> Array:
    return np.asarray(np.sin(2.0 * np.pi * rng.uniform(1.0, 5.0) * share))


def _sweep(share: Array, rng: np.random.Generator) -> Array:
    return np.asarray(np.sin(2.0 * np.pi * (1.0 + rng.uniform(2.0, 6.0) * share) * share))


def _sines(share: Array, rng: np.random.Generator) -> Array:
    waves = [np.sin(2.0 * np.pi * (rate * share + rng.uniform())) for rate in rng.uniform(0.5, 8.0, 4)]
    total = np.sum(waves, axis=0)
    return np.asarray(total / np.max(np.abs(total)))


def _square(share: Array, rng: np.random.Generator) -> Array:
    high = (rng.uniform(1.5, 5.0) * share) % 1.0 < 0.5
    return np.asarray(np.where(high, 1.0, -1.0) * rng.choice([-1.0, 1.0]))


SHAPES: tuple[Callable[[Array, np.random.Generator], Array], ...] = (
    _steps, _steps, _triangle, _sine, _sweep, _sines, _square,
)  # fmt: skip


def excite(command: Input, samples: int, rng: np.random.Generator) -> Array:
    """Return one run of a command, rounded as it is logged."""
    hold = int(HOLD * samples)
    share = np.clip((np.arange(samples) - hold) / (samples - hold), 0.0, None)
    shape = SHAPES[int(rng.integers(len(SHAPES)))](share, rng)
    shape[:hold] = shape[hold]
    middle, half = 0.5 * (command.high + command.low), 0.5 * (command.high - command.low)
    series = middle + half * rng.uniform(0.4, 1.0) * shape
    digits = 4 - int(np.floor(np.log10(half)))
    return np.asarray(np.round(series, digits))
