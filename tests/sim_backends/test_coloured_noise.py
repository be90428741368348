import math
from itertools import pairwise

import numpy as np
import pytest

from drivers.clock import nanoseconds
from sim_backends.world.coloured_noise import ColouredNoise


def test_it_has_unit_variance_and_the_correlation_time_asked_for() -> None:
    channels = 4000
    noise = ColouredNoise(channels, 2.0, np.random.default_rng(1), 0)
    now, later = noise.at(nanoseconds(5.0)), noise.at(nanoseconds(7.0))
    assert np.mean(now) == pytest.approx(0, abs=0.06)
    assert np.std(now) == pytest.approx(1, abs=0.04)
    assert np.corrcoef(now, later)[0, 1] == pytest.approx(math.exp(-1), abs=0.05)


def test_it_does_not_depend_on_when_it_is_asked() -> None:
    often = ColouredNoise(3, 1.0, np.random.default_rng(1), 0)
    for t_ms in range(5001):
        value = often.at(t_ms * 1_000_000)
    assert ColouredNoise(3, 1.0, np.random.default_rng(1), 0).at(nanoseconds(5.0)) == pytest.approx(value)


def test_it_is_continuous() -> None:
    noise = ColouredNoise(1, 0.5, np.random.default_rng(1), 0)
    values = [noise.at(t_ms * 1_000_000)[0] for t_ms in range(3000)]
    assert max(abs(b - a) for a, b in pairwise(values)) < 0.03
