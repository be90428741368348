"""Records whose simulation runs away from any error at the start are compared in pieces."""

from dataclasses import replace

import numpy as np
import pytest

from rover_hil.gap.data.cut import cut_runs
from rover_hil.gap.data.pieces import error_sizes, stable_pieces
from rover_hil.gap.workflow import analyse
from sim_backends.models.interface import Run
from tests.rover_hil.gap.axis import axis_model, measured_runs
from tests.rover_hil.gap.unstable import STEP_S, balanced_runs, pendulum_model


def test_the_growth_of_an_error_is_that_of_the_equations() -> None:
    """Near the top an error grows by e to the root of 12, less damping, per second."""
    sizes = error_sizes(pendulum_model(), cut_runs(pendulum_model(), balanced_runs(1), 30 * STEP_S))
    per_s = np.diff(np.log(sizes[1:-1])) / (29 * STEP_S)
    assert np.median(per_s) == pytest.approx(np.sqrt(12.0 + 0.2**2) - 0.2, rel=0.05)


def test_unstable_records_are_cut_and_stable_ones_stay() -> None:
    pieces, told = stable_pieces(pendulum_model(), balanced_runs(2))
    assert [one.name for one in pieces[:2]] == ["run0 part 1", "run0 part 2"]
    assert len(told) == 1
    assert (
        "in runs run0, run1 an error at the start grows exponentially: they are compared in pieces" in told[0]
    )
    assert len(pieces) == 2 * 5
    runs = measured_runs(2, samples=300)
    assert stable_pieces(axis_model(), runs) == (runs, [])


def test_an_unstable_record_of_a_machine_whose_start_is_not_fitted_stays_whole_and_is_told() -> None:
    runs = balanced_runs(2)
    fixed = replace(pendulum_model(), run_parameters=(), start=lambda *_: {"angle": 0.1, "speed": 0.0})
    found, told = stable_pieces(fixed, runs)
    assert found == runs
    assert "in runs run0, run1 an error" in told[0]
    assert "let start() take every state from a RunParameter" in told[0]
    hanging = replace(fixed, start=lambda *_: {"angle": np.pi, "speed": 0.0})
    assert stable_pieces(hanging, runs) == (runs, [])


def test_a_position_that_drifts_with_its_speed_is_not_unstable() -> None:
    """An error of the speed grows in proportion to time in the position: the whole record counts."""
    pendulum = pendulum_model()
    free = replace(pendulum.parameters[0], nominal=0.0, lower=-1.0)
    drifting = replace(pendulum, parameters=(free, *pendulum.parameters[1:2], replace(free, name="damping")))
    runs = balanced_runs(1)
    rest = [replace(one, inputs={"current": 0.01 * one.inputs["current"]}) for one in runs]
    assert stable_pieces(drifting, rest) == (rest, [])


def test_a_model_that_agrees_with_unstable_records_has_no_gap() -> None:
    verdict = analyse(pendulum_model(), balanced_runs()).verdict
    assert verdict.verdict == "NO_GAP", verdict.sentence
    assert any("run0" in one and "grows exponentially" in one for one in verdict.warnings)
    assert len(verdict.warnings) <= 2  # one on the open runs, one on the locked ones
    assert next(one for one in verdict.base_parameters if one.name == "gain").ci95[1] < 5.2


@pytest.mark.slow
def test_what_is_missing_in_the_model_of_unstable_records_is_named() -> None:
    runs: list[Run] = balanced_runs(drag=0.6)
    verdict = analyse(pendulum_model(), runs).verdict
    assert [one.name for one in verdict.effects] == ["quadratic_drag"], verdict.sentence
    low, high = verdict.effects[0].parameters["coefficient"].ci95
    assert low < 0.6 < high
