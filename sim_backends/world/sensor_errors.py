"""Errors that simulated compasses and inertial sensors share: noise in blocks, lag of a direction."""

import math
from collections.abc import Iterator

import numpy as np

from drivers.angles import wrap_rad

NOISE_BLOCK = 1024


def standard_normals(rng: np.random.Generator) -> Iterator[float]:
    """Yield independent standard normal numbers; drawn in blocks, as single draws cost a microsecond."""
    while True:
        yield from rng.standard_normal(NOISE_BLOCK).tolist()


def standard_uniforms(rng: np.random.Generator) -> Iterator[float]:
    """Yield independent numbers spread evenly over [0, 1); drawn in blocks."""
    while True:
        yield from rng.random(NOISE_BLOCK).tolist()


class DirectionLag:
    """First-order low-pass of a direction: filters its unit vector, so it turns through the smaller angle.

    Exact for an input vector that moves in a straight line between steps (first-order hold). Turning at a
    constant rate w, the output lags by atan(w tau).

    Args:
        time_constant_s: tau; 0 means no lag.
        period_s: Time between steps.
    """

    def __init__(self, time_constant_s: float, period_s: float) -> None:
        ratio = time_constant_s / period_s
        self._keep = math.exp(-1.0 / ratio) if ratio > 0.0 else 0.0
        self._take_previous = (1.0 - self._keep) * ratio - self._keep
        self._take = 1.0 - (1.0 - self._keep) * ratio
        self._previous = (0.0, 0.0)
        self._state = (0.0, 0.0)

    def settle(self, angle_rad: float) -> None:
        """Set the steady state for the constant input `angle_rad`."""
        self._previous = self._state = (math.cos(angle_rad), math.sin(angle_rad))

    def step(self, angle_rad: float) -> float:
        """Return the delayed direction in rad in [-pi, pi), one period after the last step."""
        x, y = math.cos(angle_rad), math.sin(angle_rad)
        previous_x, previous_y = self._previous
        state_x, state_y = self._state
        state_x = self._keep * state_x + self._take_previous * previous_x + self._take * x
        state_y = self._keep * state_y + self._take_previous * previous_y + self._take * y
        self._previous = (x, y)
        self._state = (state_x, state_y)
        return wrap_rad(math.atan2(state_y, state_x))
