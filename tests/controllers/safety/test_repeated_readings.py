"""Readings that come again are distinguished from noise, tones, standstill and repeated motion."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from controllers.safety.repeated_readings import HISTORY, KEY, RepeatedReadings
from tests.cases import first_often


def noisy(count: int, steps_per_sd: float, seed: int) -> list[float]:
    """Return noise in steps of a converter."""
    values: list[float] = np.round(steps_per_sd * np.random.default_rng(seed).normal(size=count)).tolist()
    return values


def until_found(readings: RepeatedReadings[int], values: list[float]) -> int | None:
    """Return after how many readings they are a repetition."""
    for index, value in enumerate(values, 1):
        readings.add(value, value, index)
        if readings.is_repetition:
            return index
    return None


@given(seed=st.integers(0, 10_000), steps_per_sd=st.floats(0.02, 100.0))
@settings(max_examples=30, deadline=None)
def test_noise_of_any_resolution_is_no_repetition(seed: int, steps_per_sd: float) -> None:
    assert until_found(RepeatedReadings(), noisy(3000, steps_per_sd, seed)) is None


@pytest.mark.parametrize(("steps_per_sd", "most"), first_often([(50.0, 20), (3.0, 60), (1.5, 120)]))
def test_a_buffer_that_is_read_again_is_found(steps_per_sd: float, most: int) -> None:
    readings: RepeatedReadings[int] = RepeatedReadings()
    values = noisy(400, steps_per_sd, 7)
    assert until_found(readings, values) is None
    found = until_found(readings, values)
    assert found is not None
    assert KEY <= found <= most
    assert readings.lag == 400
    assert readings.length >= found
    # The first reading of the second time, and of the first.
    assert (readings.first, readings.copied) == (1, 1)
    # Live readings end it at once.
    assert until_found(readings, [1000.5]) is None
    assert readings.length == readings.lag == 0


@pytest.mark.parametrize(
    "values",
    [
        [0.0] * 500,
        [0.0, 1.0] * 250,
        [0.0, 0.0, 1.0, 0.0, 1.0, 2.0] * 80,
        [math.sin(0.1 * (index % 126)) for index in range(630)],
        [*range(100), *range(100, 0, -1)] * 4,
    ],
    ids=["constant", "two values", "tone", "motion without noise", "forth and back"],
)
def test_what_repeats_lawfully_is_no_repetition(values: list[float]) -> None:
    assert until_found(RepeatedReadings(), values) is None


def test_a_long_rest_hides_no_repetition_after_it() -> None:
    readings: RepeatedReadings[int] = RepeatedReadings()
    values = noisy(600, 50.0, 9)
    assert until_found(readings, [0.0] * 5000 + values) is None
    found = until_found(readings, values[-300:])
    assert found is not None
    assert found < 120


def positions(increments: list[float]) -> list[float]:
    angles: list[float] = np.cumsum(increments).tolist()
    return angles


def fed(values: list[float]) -> RepeatedReadings[None]:
    """Return what positions of a wheel leave, as the rule feeds them."""
    readings: RepeatedReadings[None] = RepeatedReadings()
    before = values[0]
    for value in values:
        readings.add(value, value - before, None)
        before = value
    return readings


def test_a_loop_of_positions_jumps_back_and_a_wheel_that_rolls_forth_and_back_does_not() -> None:
    forward = positions([3.0 + step for step in np.abs(noisy(300, 2.0, 3))])
    assert not fed(forward).is_repetition
    loop = fed([*forward, *(forward[-12:] * 8)])
    assert loop.is_repetition
    assert loop.has_jump
    once = fed([*forward, *forward[-200:]])
    assert once.is_repetition
    assert once.has_jump
    there_and_back = [*forward, *reversed(forward), *forward]
    assert not fed(there_and_back).has_jump


def test_the_memory_is_bounded() -> None:
    readings: RepeatedReadings[int] = RepeatedReadings()
    values = noisy(3 * HISTORY, 1000.0, 5)
    assert until_found(readings, values) is None
    assert len(readings._last_of) <= 2 * HISTORY + 1
    # What is older than the history is forgotten.
    assert until_found(readings, values[:100]) is None


def test_without_a_repetition_there_is_no_jump() -> None:
    assert not RepeatedReadings[int]().has_jump
