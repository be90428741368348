"""What runs say of a fitted number, beside what samples say."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rover_hil.gap.evidence.jackknife import as_normal, clusters, scatter_of_runs
from rover_hil.gap.noise.parameters import STATISTICS
from rover_hil.gap.noise.sensor_noise import SensorNoise
from sim_backends.models.interface import Array

SAMPLES = 200


def noise_of(runs: int) -> SensorNoise:
    site = np.repeat(np.arange(runs), SAMPLES).astype(np.intp)
    return SensorNoise(
        channel_sd=np.ones(1),
        keep=np.arange(site.size, dtype=np.intp),
        row_sd=np.ones(site.size),
        site=site,
        channel=np.zeros(site.size, dtype=np.intp),
        block=np.arange(site.size, dtype=np.intp) // (SAMPLES // 4),
    )


def z_of(strengths: Array) -> float:
    """Return the certainty of the mean of strengths, each with an error of size one."""
    count = strengths.size
    by_samples = 1.0 / np.sqrt(count)
    by_runs = float(np.std(strengths, ddof=1)) / np.sqrt(count)
    spread, freedom = scatter_of_runs(by_runs / by_samples, np.full(count, 1.0 / count))
    return as_normal(float(strengths.mean()) / by_samples, spread, freedom)


@pytest.mark.parametrize("runs", [3, 6, 12])
def test_runs_that_agree_are_as_sure_as_their_samples(runs: int) -> None:
    assert 4.0 < z_of(np.full(runs, 8.0)) <= 8.0 * np.sqrt(runs)


def test_runs_that_disagree_take_away_what_samples_are_sure_of() -> None:
    strengths = 10.0 * np.random.default_rng(2).standard_normal(9) + 3.0
    assert abs(strengths.mean()) * 3.0 > 5.0
    assert z_of(strengths) < 3.0


def test_without_effect_runs_that_scatter_seldom_ask_for_one() -> None:
    rng = np.random.default_rng(3)
    z = np.array([z_of(4.0 * rng.standard_normal(9)) for _ in range(1000)])
    # 5 and 0.5 % would be perfect; what is left of the belief in the samples costs the rest.
    assert np.mean(z > 1.96) < 0.09
    assert np.mean(z > 2.81) <= 0.02


@given(seed=st.integers(0, 1000), size=st.floats(0.1, 10.0))
def test_z_never_exceeds_that_of_samples(seed: int, size: float) -> None:
    strengths = size + np.random.default_rng(seed).standard_normal(7)
    assert 0.0 <= z_of(strengths) <= abs(float(strengths.mean())) * np.sqrt(7.0) + 1e-9


def test_few_runs_are_cut_into_stretches() -> None:
    least = STATISTICS.jackknife.least_runs
    assert np.unique(clusters(noise_of(least))).size == least
    assert np.unique(clusters(noise_of(least - 1))).size == 4 * (least - 1)
