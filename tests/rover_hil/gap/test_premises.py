"""The tests of a gap where their premises are hard to meet: short runs, coarse steps, better sensors."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from rover_hil.gap import Array, Channel, Parameter, Port, Run, RunParameter, StateModel, effects
from rover_hil.gap.data.problem import Problem, observe
from rover_hil.gap.evidence.gap_tests import gap_p
from rover_hil.gap.fit.holdout import hold_out
from rover_hil.gap.fit.machine_fit import MachineFits
from rover_hil.gap.parameters import MACHINES
from rover_hil.gap.verdict import Answer
from rover_hil.gap.workflow import analyse

SEED, STEP_S = 11, 0.1


def body(*, sigma: float = 0.1, quantum: float = 0.0) -> StateModel:
    return StateModel(
        name="body",
        states={"warmth": "K"},
        inputs={"heat": "K/s"},
        channels=(
            Channel(name="first", unit="K", sigma=sigma, quantum=quantum),
            Channel(name="second", unit="K", sigma=0.1, is_optional=True),
        ),
        parameters=(Parameter(name="loss", unit="1/s", nominal=0.2, prior_sd=0.02, lower=0.01, upper=2.0),),
        run_parameters=(RunParameter(name="start_warmth", unit="K", prior_sd=5.0),),
        ports=(Port(name="flow", unit="K/s", force_sd=0.5),),
        derivative=lambda x, u, p, port: {"warmth": port("flow", u.heat - p.loss * x.warmth)},
        start=lambda p, _: {"warmth": p.start_warmth},
        output=lambda x, *_: {"first": x.warmth, "second": 0.0 * x.warmth},
        step_s=STEP_S,
        port_effects=(effects.offset("flow", size=0.3),),
    )


def body_runs(
    seed: int, *, samples: int, noise: float = 0.1, quantum: float = 0.0, second_noise: float = 0.1
) -> list[Run]:
    rng = np.random.default_rng(seed)
    runs = []
    for number in range(8):
        heat = np.repeat(rng.uniform(0.0, 3.0, samples // 10 + 1), 10)[:samples]
        warmth, value = np.empty(samples), float(rng.normal(0.0, 3.0))
        for index in range(samples):
            warmth[index] = value
            keep = np.exp(-0.2 * STEP_S)
            value = keep * value + (1.0 - keep) / 0.2 * heat[index]
        first = warmth + noise * rng.standard_normal(samples)
        measured = {
            "first": quantum * np.round(first / quantum) if quantum else first,
            "second": second_noise * rng.standard_normal(samples),
        }
        runs.append(Run(name=f"run{number}", conditions={}, inputs={"heat": heat}, measured=measured))
    return runs


def p_of(model: StateModel, runs: list[Run]) -> float:
    problem = Problem(model, observe(model, runs))
    return gap_p(MachineFits(problem, model.effects).base(), problem, [], np.random.default_rng(0))


@pytest.mark.parametrize("seed", range(3))
def test_short_runs_without_a_gap_have_none(seed: int) -> None:
    assert p_of(body(), body_runs(seed, samples=36)) > MACHINES.tests.alpha


@pytest.mark.parametrize("seed", range(3))
def test_a_quiet_sensor_makes_no_structure_of_the_noise_of_another(seed: int) -> None:
    assert p_of(body(), body_runs(seed, samples=200, second_noise=0.06)) > MACHINES.tests.alpha


@pytest.mark.parametrize("seed", range(3))
def test_coarse_steps_are_no_slow_error(seed: int) -> None:
    runs = body_runs(seed, samples=200, noise=0.05, quantum=0.5)
    assert p_of(body(sigma=0.05, quantum=0.5), runs) > MACHINES.tests.alpha


def test_what_has_no_prediction_on_locked_runs_is_an_error_and_no_closure() -> None:
    """The model takes the root of a negative number where the heater is strong."""

    def output(x: SimpleNamespace, u: SimpleNamespace, *_: object) -> dict[str, Array]:
        return {"first": np.sqrt(np.where(u.heat > 1.5, -1.0, 1.0)) * x.warmth, "second": 0.0 * x.warmth}

    model = replace(body(), output=output)
    runs = body_runs(SEED, samples=60)
    problem = Problem(body(), observe(body(), runs[:6]))
    base = MachineFits(problem, body().effects).base()
    found = hold_out(model, runs[6:], base, base, np.random.default_rng(SEED))
    assert found.channels["first"].after > 1e3


def test_a_channel_that_the_locked_runs_lack_is_left_out() -> None:
    runs = body_runs(SEED, samples=60)
    shifted = [
        replace(
            one, measured={name: values + 2.0 for name, values in one.measured.items() if name == "first"}
        )
        if one.name in ("run6", "run7")
        else replace(one, measured={**one.measured, "first": one.measured["first"] + 2.0})
        for one in runs
    ]
    verdict = analyse(body(), shifted, confirm='run == "run6" or run == "run7"').verdict
    assert verdict.verdict is not Answer.BAD_DATA
    assert set(verdict.gap) <= {"first"}


def test_noise_declared_too_large_is_told_and_closes_no_more_than_all() -> None:
    runs = [replace(one, inputs={"heat": one.inputs["heat"] - 1.0}) for one in body_runs(SEED, samples=200)]
    verdict = analyse(body(sigma=0.4), runs).verdict
    assert verdict.confidence_set == [["offset"]]
    assert verdict.gap["first"]["closure"] == 1.0
    assert "It closes 100% of the gap" in verdict.sentence
    assert [one for one in verdict.warnings if "far smaller than its noise" in one], verdict.warnings


def test_a_start_that_was_read_is_as_wrong_as_its_sensor() -> None:
    """The first reading is a sample of the record: as knowledge of the start it would count twice."""
    start = RunParameter(name="start_warmth", unit="K", prior_sd=0.1, channel="first")
    model = replace(
        body(), run_parameters=(start,), port_effects=(effects.gain_error("first", size=0.03, name="gain"),)
    )
    runs = [
        replace(one, measured={**one.measured, "first": 1.2 * one.measured["first"]})
        for one in body_runs(SEED, samples=36)
    ]
    verdict = analyse(model, runs).verdict
    assert verdict.confidence_set == [["gain"]], verdict.sentence
    assert verdict.effects[0].parameters["share"].value == pytest.approx(0.2, abs=0.01)
