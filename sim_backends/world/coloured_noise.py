"""Coloured noise: seeded, slowly varying, the same for every integration step."""

import math

import numpy as np

from drivers.clock import nanoseconds

KNOT_INTERVAL_NS = 100_000_000


class ColouredNoise:
    """Independent channels of unit-variance noise with an exponential correlation over time.

    Values are drawn at fixed knots 0.1 s apart and interpolated linearly, so the same seed gives the same
    noise for every integration step. Time must not run backwards.

    Args:
        channels: Number of values that `at` returns.
        correlation_time_s: Time in which the correlation falls to 1/e; must be much longer than 0.1 s.
        rng: Source of all randomness.
        start_ns: Time of the first knot.
    """

    def __init__(
        self, channels: int, correlation_time_s: float, rng: np.random.Generator, start_ns: int
    ) -> None:
        self._rng = rng
        self._memory = math.exp(-KNOT_INTERVAL_NS / nanoseconds(correlation_time_s))
        self._left_ns = start_ns
        self._left: list[float] = rng.standard_normal(channels).tolist()
        self._right = self._next_knot()

    def at(self, t_ns: int) -> list[float]:
        """Return the value of each channel at `t_ns`, which is not before the last call's."""
        while t_ns >= self._left_ns + KNOT_INTERVAL_NS:
            self._left_ns += KNOT_INTERVAL_NS
            self._left = self._right
            self._right = self._next_knot()
        share = (t_ns - self._left_ns) / KNOT_INTERVAL_NS
        return [a + share * (b - a) for a, b in zip(self._left, self._right, strict=True)]

    def _next_knot(self) -> list[float]:
        fresh = math.sqrt(1.0 - self._memory**2)
        steps = self._rng.standard_normal(len(self._left)).tolist()
        return [self._memory * old + fresh * step for old, step in zip(self._left, steps, strict=True)]
