"""The one judgement of a covariance."""

import numpy as np
import pytest

from rover_hil.drives.quality.consistency import LEAST_ERRORS, consistency
from rover_hil.drives.quality.learned_ground import LEAST_LEGS, ground_of


def drawn(factor: float, drives: int, seed: int = 1) -> list[float]:
    """Return squared errors of drives whose standard deviations are wrong by a factor; one error a drive."""
    errors = factor * np.random.default_rng(seed).normal(size=(drives, 3))
    return [float(value) for value in np.repeat((errors**2).sum(axis=1), 4)]


@pytest.mark.parametrize(("factor", "words"), [(4.0, "too small"), (0.1, "too large"), (1.0, "holds")])
def test_factors_are_found(factor: float, words: str) -> None:
    nees = drawn(factor, 20)
    found = consistency(nees, [3] * len(nees), 20)
    assert found.words("poses").startswith(words)
    assert found.interval[0] < factor < found.interval[1]


def test_intervals_contain_the_factor_at_their_rate() -> None:
    found = [consistency(nees, [3] * len(nees), 5) for nees in (drawn(1.0, 5, seed) for seed in range(300))]
    inside = [each.interval[0] <= 1.0 <= each.interval[1] for each in found]
    assert 0.92 <= np.mean(inside) <= 0.98
    assert np.mean([each.is_too_small for each in found]) <= 0.03
    assert np.mean([each.is_too_large for each in found]) <= 0.04


def test_one_drive_far_off_by_chance_is_not_judged_too_small() -> None:
    nees = [9.0] * 20
    assert consistency(nees, [3] * 20, 1).words("poses").startswith("holds")
    assert consistency(nees, [3] * 20, 10).words("poses").startswith("too small")


def test_few_errors_are_not_judged() -> None:
    assert "not decided: 2 marks" in consistency([1.0, 1.0], [3, 3], 2).words("marks")
    assert not consistency([], [], 0).is_decided
    assert consistency([1.0] * LEAST_ERRORS, [3] * LEAST_ERRORS, 2).is_decided


def test_few_legs_teach_nothing() -> None:
    assert ground_of(np.full(LEAST_LEGS - 1, 0.9 + 0j)) is None
    ground = ground_of(np.array([0.9, 0.8] * LEAST_LEGS) + 0.01j)
    assert ground is not None
    assert ground.mean == pytest.approx(0.15)
    assert ground.settings("runs")["slip"] == "learned"
