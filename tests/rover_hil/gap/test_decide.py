"""The one decision: who wins a draw, what a unit of observation is, and when nothing of the list is right."""

from dataclasses import replace

import numpy as np
import pytest

from rover_hil.gap.data.problem import Problem, observe
from rover_hil.gap.decision.decide import winners_of
from rover_hil.gap.evidence.units import Units, observation_units, predict_units
from rover_hil.gap.fit.machine_fit import MachineFits
from rover_hil.gap.parameters import MACHINES
from rover_hil.gap.verdict import Answer
from rover_hil.gap.workflow import analyse
from tests.rover_hil.gap.axis import axis_model, measured_runs

NO_LUCK = np.zeros((1, 3))


def winner(excess: list[float], sizes: list[int], densities: list[float], least: float | None = None) -> int:
    """Return the winner of one draw with one channel whose tolerance is its noise."""
    table = np.array(excess)[None, :, None]
    found = winners_of(np.array([densities]), table, np.array(sizes), np.ones(1), least, NO_LUCK)
    return int(found[0])


def test_the_smallest_explanation_within_the_tolerance_of_the_best_wins() -> None:
    assert winner([0.9, 0.1, 0.0], [0, 1, 2], [-90.0, -2.0, -1.0]) == 0
    assert winner([9.0, 0.1, 0.0], [0, 1, 2], [-900.0, -2.0, -1.0]) == 1
    assert winner([9.0, 5.0, 0.0], [0, 1, 2], [-900.0, -500.0, -1.0]) == 2


def test_of_one_size_the_more_probable_wins() -> None:
    assert winner([9.0, 0.2, 0.3], [0, 1, 1], [-900.0, -20.0, -30.0]) == 1


def test_without_a_tolerance_each_effect_must_gain_enough() -> None:
    assert winner([0.0, 0.0, 0.0], [0, 1, 2], [-8.0, -1.0, 0.0], least=7.0) == 1
    assert winner([0.0, 0.0, 0.0], [0, 1, 2], [-6.0, -1.0, 0.0], least=7.0) == 0


def units_of_axis(count: int) -> tuple[Units, Problem, MachineFits]:
    model = axis_model()
    runs = measured_runs(count)
    problem = Problem(model, observe(model, runs))
    fits = MachineFits(problem, model.effects)
    return observation_units(problem, fits.base()), problem, fits


def test_few_runs_are_cut_into_stretches_and_many_are_not() -> None:
    many, _, _ = units_of_axis(7)
    assert (many.kind, many.count) == ("runs", 7)
    few, problem, fits = units_of_axis(3)
    assert few.kind == "stretches of runs"
    assert MACHINES.decide.least_units <= few.count <= MACHINES.decide.most_stretches
    predicted = predict_units(fits.base(), few)
    assert predicted.counts.sum() == problem.observations.values.size
    # Without a gap the errors of units that were left out are those of the sensor.
    assert predicted.squares.sum() / predicted.counts.sum() == pytest.approx(1.0, abs=0.15)


def test_runs_of_one_condition_are_one_unit() -> None:
    model = axis_model()
    runs = measured_runs(6)
    again = [replace(one, name=f"{one.name} again") for one in runs]
    problem = Problem(model, observe(model, [*runs, *again]))
    units = observation_units(problem, MachineFits(problem, model.effects).base())
    assert (units.kind, units.count) == ("conditions", 6)


def test_the_probability_of_a_name_and_of_none_are_stated() -> None:
    named = analyse(axis_model(), measured_runs(dry=2.5)).verdict
    assert named.verdict is Answer.NAMED
    assert named.probabilities[0]["effects"] == ["coulomb_friction"]
    assert float(str(named.probabilities[0]["probability"])) > 0.95
    assert named.probabilities[-1] == {"effects": ["none of these"], "probability": 0.0}


def test_an_error_below_the_tolerance_is_not_explained() -> None:
    model = axis_model()
    loose = replace(model, channels=(replace(model.channels[0], tolerance=2.0),))
    verdict = analyse(loose, measured_runs(dry=2.5)).verdict
    assert (verdict.verdict, verdict.effects) == (Answer.NO_GAP, [])
    assert verdict.sentence.startswith("No gap above the tolerance")
