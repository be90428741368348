"""Errors of series: slow ones, and constants that each run has of its own."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy.signal import lfilter

from rover_hil.gap.data.problem import Group, Observations
from rover_hil.gap.statistics.noise import SeriesNoise, for_other_runs, series_noise
from rover_hil.gap.statistics.run_scatter import likeliest, run_scatter
from rover_hil.gap.workflow import analyse
from sim_backends.models.interface import Array, Channel, Run
from tests.cases import first_often
from tests.nature.axis import Drive
from tests.rover_hil.gap.gap_data import axis_runs, make_axis

RUNS, SAMPLES = 12, 80
CHANNEL = Channel(name="speed", unit="m/s")


def observations(errors: Array) -> Observations:
    """Return one channel with these errors: runs x samples."""
    runs = [
        Run(name=f"run {index}", conditions={}, measured={"speed": row}) for index, row in enumerate(errors)
    ]
    size = errors.shape[1]
    return Observations(
        groups=tuple(Group(site=run, runs=(run,)) for run in runs),
        channels=(CHANNEL,),
        values=errors.ravel(),
        site=np.repeat(np.arange(len(runs)), size),
        channel=np.zeros(errors.size, dtype=np.intp),
        counts=np.ones(errors.size),
        is_steady=False,
    )


def learned(errors: Array) -> SeriesNoise:
    measured = observations(errors)
    return series_noise(measured, measured.values)


def score_of_a_constant(errors: Array) -> float:
    """Return the score of one constant for all runs, normal without one."""
    noise = learned(errors)
    change = noise.whiten(np.ones(errors.size))
    return float(change @ noise.whiten(errors.ravel())) / float(np.linalg.norm(change))


def white(seed: int) -> Array:
    return np.random.default_rng(seed).standard_normal((RUNS, SAMPLES))


def with_constants(seed: int) -> Array:
    return white(seed) + np.random.default_rng([seed, 1]).standard_normal((RUNS, 1))


def slow(seed: int) -> Array:
    fading: Array = lfilter([1.0], [1.0, -0.95], np.random.default_rng(seed).standard_normal((RUNS, 400)))
    return fading[:, -SAMPLES:]


@pytest.mark.parametrize("errors", first_often([with_constants, white, slow]))
def test_a_constant_of_all_runs_is_judged_by_the_scatter_between_them(
    errors: Callable[[int], Array],
) -> None:
    scores = [score_of_a_constant(errors(seed)) for seed in range(60)]
    assert float(np.std(scores)) == pytest.approx(1.0, abs=0.3)


def test_constants_of_runs_do_not_make_errors_look_slow() -> None:
    noise = learned(with_constants(1))
    assert noise.constant_sd[0] == pytest.approx(1.0, rel=0.5)
    assert noise.innovation_sd[0] == pytest.approx(1.0, rel=0.05)
    assert noise.lags[0].size == 0


def test_slow_errors_are_not_taken_for_constants() -> None:
    several = [learned(slow(seed)) for seed in range(6)]
    assert [float(noise.constant_sd[0]) for noise in several] == [0.0] * 6
    assert [float(noise.lags[0].sum()) for noise in several] == pytest.approx([0.95] * 6, abs=0.03)


def test_other_runs_have_constants_too() -> None:
    noise = learned(with_constants(3))
    others = for_other_runs(noise, None, observations(with_constants(4)[:3]))
    length = float(np.linalg.norm(others.whiten(np.ones(3 * SAMPLES))))
    assert length == pytest.approx(np.sqrt(3.0) / noise.constant_sd[0], rel=0.1)


def test_whitened_rows_of_constants_are_independent() -> None:
    starts, level = np.array([0, 4]), np.array([1.0, 1.0, 0.5, 2.0, 1.0, 3.0])
    scatter = run_scatter(starts, level, np.array([2.0, 0.5]))
    covariance = np.eye(6)
    covariance[:4, :4] += 2.0 * np.outer(level[:4], level[:4])
    covariance[4:, 4:] += 0.5 * np.outer(level[4:], level[4:])
    root = scatter.whiten(np.eye(6))
    assert root @ covariance @ root.T == pytest.approx(np.eye(6), abs=1e-12)
    assert scatter.whiten(level) == pytest.approx(root @ level)


def test_the_likeliest_scatter_is_none_where_there_is_none() -> None:
    starts = np.arange(0, RUNS * SAMPLES, SAMPLES)
    errors = white(5).reshape(RUNS, SAMPLES)
    errors -= errors.mean(axis=1, keepdims=True)
    variance, _ = likeliest(starts, np.ones(errors.size), errors.ravel())
    assert variance < 1e-3


@pytest.mark.slow
def test_exact_data_is_no_division_by_zero() -> None:
    runs = axis_runs(3, Drive(noise=0.0), dry=0.0125)
    verdict = analyse(make_axis(), runs, seed=3).verdict
    assert any("dry_friction" in names for names in verdict.confidence_set), verdict.sentence
