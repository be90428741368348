"""Strengths and parameters that differ between the units under test share one prior."""

from dataclasses import replace

import numpy as np
import pytest

from drivers.errors import ConfigError
from rover_hil.gap import Run, StateModel, effects, parameter
from rover_hil.gap.data.problem import Problem, observe
from rover_hil.gap.verdict import Verdict
from rover_hil.gap.workflow import analyse
from tests.rover_hil.gap.small_machine import MODEL, small_runs

pytestmark = pytest.mark.nightly

SAMPLES, SIGMA, UNITS, EACH = 160, 0.02, 5, 3
DRAGS = np.array([0.08, 0.14, 0.20, 0.26, 0.32])
DRAG = effects.quadratic_drag("heat", velocity="warmth", size=0.2)


def runs_of_units() -> list[Run]:
    """Return three runs of each of five units with different drag, by Heun's method with small steps."""
    rng = np.random.default_rng(21)
    runs = []
    for number, run in enumerate(small_runs(samples=SAMPLES, count=UNITS * EACH)):
        drag = DRAGS[number % UNITS]
        warmth, value = np.empty(SAMPLES), 0.3
        for index, power in enumerate(run.inputs["power"]):
            warmth[index] = value
            for _ in range(10):
                first = power - 0.5 * value - drag * value * abs(value)
                ahead = value + 0.01 * first
                value += 0.005 * (first + power - 0.5 * ahead - drag * ahead * abs(ahead))
        runs.append(
            replace(
                run,
                conditions={"serial_number": float(number % UNITS)},
                measured={"reading": warmth + rng.normal(0.0, SIGMA, SAMPLES)},
            )
        )
    return runs


def model(*, is_scattering: bool) -> StateModel:
    drag = effects.scattering(DRAG, sd=0.1, by="serial_number") if is_scattering else DRAG
    return replace(MODEL, condition_units={"serial_number": "1"}, port_effects=(drag, MODEL.port_effects[1]))


@pytest.fixture(scope="module")
def verdicts() -> dict[bool, Verdict]:
    return {kind: analyse(model(is_scattering=kind), runs_of_units()).verdict for kind in (False, True)}


def test_the_mean_strength_has_an_interval_for_further_units(verdicts: dict[bool, Verdict]) -> None:
    size = {one.name: one for one in verdicts[True].effects}["quadratic_drag"].parameters["coefficient"]
    assert size.ci95[0] <= DRAGS.mean() <= size.ci95[1]
    by_units = 2.0 * DRAGS.std(ddof=1) / np.sqrt(UNITS)
    assert by_units < size.ci95[1] - size.ci95[0] < 8.0 * by_units


def test_deviations_of_the_units_close_what_one_strength_leaves(verdicts: dict[bool, Verdict]) -> None:
    left = {
        kind: float(str(one.error_budget["reading"]["model_error_after"])) for kind, one in verdicts.items()
    }
    assert left[False] > 2.0 * SIGMA
    assert left[True] < 0.5 * SIGMA


def test_an_unknown_condition_is_refused() -> None:
    with pytest.raises(ConfigError, match="scatters by 'serial_number', not a condition"):
        replace(MODEL, port_effects=(effects.scattering(DRAG, sd=0.1, by="serial_number"),))


def test_a_delay_cannot_scatter() -> None:
    late = effects.delay("power", size=0.1, longest=0.5)
    with pytest.raises(ConfigError, match="a delay has one size in all runs"):
        replace(MODEL, port_effects=(effects.scattering(late, sd=0.1),))


def test_a_parameter_that_scatters_has_a_value_in_each_run() -> None:
    gain = replace(parameter("gain", "K/s/W", 1.0, 0.05, 0.5, 2.0), scatter_sd=0.1)
    machine = replace(MODEL, parameters=(gain, *MODEL.parameters[1:]))
    runs = small_runs(count=2)
    key = f"gain~@{runs[1].name}"
    plain, moved = machine.predict_points(runs, [({}, {}), ({key: 0.2}, {})])
    whole = machine.predict(runs, {"gain": 1.2}, {})
    assert np.array_equal(moved[0]["reading"], plain[0]["reading"])
    assert np.allclose(moved[1]["reading"], whole[1]["reading"])


def test_large_serial_numbers_are_different_units() -> None:
    gain = replace(MODEL.parameters[0], scatter_sd=0.1, scatter_by="serial_number")
    runs = [
        replace(run, conditions={"serial_number": 1e6 + 1.0 + index})
        for index, run in enumerate(small_runs())
    ]
    assert len({gain.owner_in(run) for run in runs}) == len(runs)
    assert gain.owner_in(runs[0]) == "serial_number=1000001.0"


def test_two_runs_of_one_unit_share_its_deviation_and_no_other(verdicts: dict[bool, Verdict]) -> None:
    machine = model(is_scattering=True)
    problem = Problem(machine, observe(machine, runs_of_units()))
    free = problem.run_free(["quadratic_drag"])
    deviations = [item for item in free if item.key.is_deviation]
    assert len(deviations) == UNITS
    rows = [problem.rows_of(item.key) for item in deviations]
    assert np.array_equal(np.sum(rows, axis=0), np.ones(problem.observations.values.size))
    assert all(int(one.sum()) == EACH * SAMPLES for one in rows)
    starts = [item for item in free if not item.key.is_deviation]
    assert all(int(problem.rows_of(item.key).sum()) == SAMPLES for item in starts)


def test_with_two_units_runs_are_left_out_one_by_one() -> None:
    machine = model(is_scattering=True)
    runs = [run for run in runs_of_units() if run.conditions["serial_number"] < 2.0]
    problem = Problem(machine, observe(machine, runs))
    assert np.unique(problem.owner).size == len(runs)


def test_parameters_scatter_by_one_condition_only() -> None:
    gain = replace(MODEL.parameters[0], scatter_sd=0.1, scatter_by="load")
    drag = effects.scattering(DRAG, sd=0.1, by="serial_number")
    with pytest.raises(ConfigError, match="scatter by load and by serial_number"):
        replace(
            MODEL,
            condition_units={"serial_number": "1", "load": "kg"},
            parameters=(gain, *MODEL.parameters[1:]),
            port_effects=(drag,),
        )
