"""Base parameters that differ between runs are no common effect, and are reported as what they are."""

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from rover_hil.gap import Run
from rover_hil.gap.data.problem import Problem, observe
from rover_hil.gap.fit.machine_fit import MachineFits
from rover_hil.gap.fit.run_scatter import run_scatter
from rover_hil.gap.verdict import Answer, Verdict
from rover_hil.gap.workflow import analyse
from tests.rover_hil.gap.small_machine import MODEL, small_runs

SAMPLES, RUNS, SIGMA = 200, 10, 0.02
SHARES = np.random.default_rng(3).standard_normal(RUNS)


def runs_with_losses(losses: Sequence[float], drag: float = 0.0) -> list[Run]:
    """Return runs of the body, each with a loss of its own, by Heun's method with small steps."""
    rng = np.random.default_rng(8)
    runs = []
    for run, loss in zip(small_runs(samples=SAMPLES, count=len(losses)), losses, strict=True):
        warmth, value = np.empty(SAMPLES), 0.3
        for index, power in enumerate(run.inputs["power"]):
            warmth[index] = value
            for _ in range(10):
                first = power - loss * value - drag * value * abs(value)
                ahead = value + 0.01 * first
                value += 0.005 * (first + power - loss * ahead - drag * ahead * abs(ahead))
        reading = warmth + rng.normal(0.0, SIGMA, SAMPLES)
        runs.append(replace(run, measured={"reading": reading}))
    return runs


def answer(sd: float, drag: float = 0.0) -> Verdict:
    return analyse(MODEL, runs_with_losses((0.5 * (1.0 + sd * SHARES)).tolist(), drag)).verdict


def test_a_small_scatter_of_a_parameter_is_no_gap() -> None:
    verdict = answer(0.006)
    assert verdict.p_gap is not None
    assert verdict.p_gap < 0.01
    assert verdict.verdict is Answer.NO_GAP
    assert "parameters differ between runs" in verdict.sentence
    assert "loss by" in verdict.sentence


@pytest.mark.nightly
def test_a_large_scatter_is_a_gap_without_a_name_and_its_size_is_reported() -> None:
    verdict = answer(0.15)
    assert verdict.verdict is Answer.UNNAMED
    found = re.search(r"parameters differ between runs \(loss by ([\d.]+) 1/s\)", verdict.sentence)
    assert found is not None
    assert float(found[1]) == pytest.approx(0.5 * 0.15 * float(np.std(SHARES)), rel=0.35)
    scatter = verdict.error_budget["reading"]["run_scatter"]
    error = verdict.error_budget["reading"]["model_error_before"]
    assert isinstance(scatter, float)
    assert isinstance(error, float)
    assert scatter == pytest.approx(error, rel=0.2)


@pytest.mark.slow
def test_the_same_effect_in_every_run_is_named_beside_scatter() -> None:
    verdict = answer(0.01, drag=0.15)
    assert [one.name for one in verdict.effects] == ["quadratic_drag"]


def test_a_parameter_that_is_the_same_in_all_runs_does_not_scatter() -> None:
    """The difference from its nominal value belongs to all runs."""
    problem = Problem(MODEL, observe(MODEL, runs_with_losses([0.58] * 4)))
    fits = MachineFits(problem, MODEL.effects)
    found = run_scatter(fits, fits.base())
    assert found.channel_rms[0] < 0.2 * SIGMA
    assert found.parameter_sd.get("loss", 0.0) < 0.004


def test_runs_may_be_called_like_deviations() -> None:
    runs = runs_with_losses([0.5] * 4)
    odd = [replace(run, name=f"loss~{index}") for index, run in enumerate(runs)]
    scatters = []
    for some in (runs, odd):
        fits = MachineFits(Problem(MODEL, observe(MODEL, some)), MODEL.effects)
        scatters.append(run_scatter(fits, fits.base()).channel_rms)
    assert np.array_equal(scatters[0], scatters[1])
