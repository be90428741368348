import io

import numpy as np
import pytest

from controllers.estimation.filter.guarded_filter import FilterStep
from rover_hil.scomp.kept_steps import KeptSteps
from rover_hil.scomp.smoother import smooth


def walk_filter(readings: np.ndarray, process2: float, noise2: float) -> list[FilterStep]:
    """Filter a random walk of one angle, each step read once."""
    state, variance = np.array([readings[0]]), np.array([[noise2]])
    steps = [FilterStep(transition=np.eye(1), predicted=(state, variance), estimate=(state, variance))]
    for reading in readings[1:]:
        predicted, spread = state, variance + process2
        gain = spread / (spread + noise2)
        off = (reading - predicted + np.pi) % (2 * np.pi) - np.pi
        state, variance = predicted + gain[0] * off, (1.0 - gain) * spread
        state = (state + np.pi) % (2 * np.pi) - np.pi
        steps.append(
            FilterStep(transition=np.eye(1), predicted=(predicted, spread), estimate=(state, variance))
        )
    return steps


def batch(readings: np.ndarray, process2: float, noise2: float) -> tuple[np.ndarray, np.ndarray]:
    """Solve for the whole walk at once by least squares."""
    count = len(readings)
    steps = np.diff(np.eye(count), axis=0)
    information = np.eye(count) / noise2 + steps.T @ steps / process2
    return np.linalg.solve(information, readings / noise2), np.linalg.inv(information)


def test_smoothing_is_the_least_squares_of_the_whole_walk() -> None:
    readings = np.cumsum(0.1 * np.random.default_rng(1).standard_normal(30))
    smoothed = smooth(walk_filter(readings, 0.01, 0.04), angles=[])
    states, covariance = batch(readings, 0.01, 0.04)
    assert np.array([state[0] for state, _ in smoothed]) == pytest.approx(states, abs=1e-9)
    assert np.array([spread[0, 0] for _, spread in smoothed]) == pytest.approx(np.diag(covariance), abs=1e-9)


def test_smoothing_crosses_half_a_turn() -> None:
    readings = np.pi - 0.3 + 0.02 * np.arange(30)
    wrapped = (readings + np.pi) % (2 * np.pi) - np.pi
    smoothed = np.unwrap([state[0] for state, _ in smooth(walk_filter(wrapped, 0.01, 0.04), angles=[0])])
    assert smoothed == pytest.approx(batch(readings, 0.01, 0.04)[0], abs=1e-9)


@pytest.mark.parametrize("online", [True, False])
def test_steps_in_a_file_give_the_same_estimates(monkeypatch: pytest.MonkeyPatch, online: bool) -> None:
    monkeypatch.setattr("rover_hil.scomp.kept_steps.BLOCK", 7)
    steps = walk_filter(np.cumsum(0.1 * np.random.default_rng(3).standard_normal(30)), 0.01, 0.04)
    whole = [step.estimate for step in steps] if online else smooth(steps, angles=[0])
    growing: list[FilterStep] = []
    kept = KeptSteps(growing, io.BytesIO())
    for step in steps:
        growing.append(step)
        kept.save()
    assert len(kept) == 30
    assert len(growing) <= 8
    found = {
        first + at: each
        for first, block in kept.estimates([0], online=online)
        for at, each in enumerate(block)
    }
    assert sorted(found) == list(range(30))
    for number, (state, spread) in enumerate(whole):
        assert found[number][0] == pytest.approx(state, abs=1e-12)
        assert found[number][1] == pytest.approx(spread, abs=1e-12)
