"""Errors of series: neighbours that depend on each other, runs that scatter, and what only priors know."""

import numpy as np
import pytest

from benchmarks.gap import battery_drives
from rover_hil.gap.evidence.jackknife import as_normal, scatter_of_runs
from rover_hil.gap.noise.autoregression import Autoregression, learn_autoregression
from sim_backends.models.interface import Array

SAMPLES, RUNS = 300, 6


def errors_of(kind: str, rng: np.random.Generator) -> list[Array]:
    """Return errors of runs: of rates, from places with white errors; slow ones; white ones."""
    if kind == "rates":
        return [np.diff(rng.standard_normal(SAMPLES + 1)) for _ in range(RUNS)]
    past = 0.8 if kind == "slow" else 0.0
    found = [rng.standard_normal(SAMPLES) for _ in range(RUNS)]
    for one in found:
        for index in range(1, SAMPLES):
            one[index] += past * one[index - 1]
    return found


def mean_z(kind: str, rng: np.random.Generator) -> float:
    """Return the certainty of a level that is the same in all runs, of errors without one."""
    series = errors_of(kind, rng)
    lags, new_sd = learn_autoregression(series)
    rows, size = np.concatenate(series), float(np.std(np.concatenate(series)))
    neighbours = Autoregression(lags=(lags,), new_sd=(new_sd / size,))
    site = np.repeat(np.arange(RUNS), SAMPLES).astype(np.intp)
    keep, channel = np.arange(rows.size, dtype=np.intp), np.zeros(rows.size, dtype=np.intp)
    level = np.where(np.arange(rows.size) % 50 < 25, 1.0, -1.0)
    error, change = (neighbours.whiten(one / size, keep, site, channel) for one in (rows, level))
    return float(error @ change / np.linalg.norm(change))


@pytest.mark.parametrize("kind", ["white", "rates", "slow"])
def test_a_change_is_as_certain_as_its_errors_allow(kind: str) -> None:
    """Of errors of one size, those of rates hide slow changes least, slow ones most."""
    rng = np.random.default_rng(4)
    scores = [mean_z(kind, rng) for _ in range(60)]
    assert 0.6 < float(np.std(scores)) < 1.4


def test_missing_values_and_other_channels_are_no_neighbours() -> None:
    neighbours = Autoregression(lags=(np.array([0.5]), np.zeros(0)), new_sd=(0.5, 1.0))
    keep = np.array([0, 1, 3, 4, 5, 6])
    channel = np.array([0, 0, 0, 0, 1, 1])
    found = neighbours.whiten(np.ones(6), keep, np.zeros(6, dtype=np.intp), channel)
    assert found.tolist() == [0.0, 1.0, 0.0, 1.0, 1.0, 1.0]


def test_a_channel_without_neighbours_keeps_its_errors() -> None:
    """Of a slow channel every third sample has a value: there is nothing before it to show what is new."""
    slow = np.cumsum(np.random.default_rng(4).standard_normal(SAMPLES))
    slow[np.arange(SAMPLES) % 3 > 0] = np.nan
    lags, new_sd = learn_autoregression([slow])
    keep = np.flatnonzero(np.isfinite(slow))
    neighbours = Autoregression(lags=(lags,), new_sd=(new_sd,))
    nothing = np.zeros(keep.size, dtype=np.intp)
    found = neighbours.whiten(slow[keep], keep, nothing, nothing)
    assert found == pytest.approx(slow[keep] / np.sqrt(np.mean(slow[keep] ** 2)))


def test_few_runs_do_not_weaken_what_the_priors_know() -> None:
    by_priors, by_runs = np.full(RUNS, 0.05 / RUNS), np.full(RUNS, 1.0 / RUNS)
    assert as_normal(4.0, *scatter_of_runs(0.1, by_priors)) > 3.9
    assert as_normal(4.0, *scatter_of_runs(0.5, by_runs)) < 3.2


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("number", "found"),
    [
        (481, ["encoder_dropouts"]),  # a shape at the end of its grid
        (491, ["side_drift", "slope_slip"]),  # squares of heavy-tailed errors on locked runs
        (501, ["stribeck_friction"]),  # five runs, in stretches
        (508, ["wheel_radius"]),  # known by priors
        (510, ["viscous_friction"]),  # far from the base parameters without it
        (566, ["gyro_scale"]),  # errors of rates
    ],
)
def test_hidden_effects_that_were_missed(number: int, found: list[str]) -> None:
    outcome = battery_drives.run(*battery_drives.cases(number + 1)[number])
    assert found in [sorted(one) for one in outcome.verdict.confidence_set]
