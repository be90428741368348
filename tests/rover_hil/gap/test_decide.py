"""The one decision: who wins a draw, what a unit of observation is, and when nothing of the list is right."""

from dataclasses import replace

import numpy as np
import pytest

from rover_hil.gap import effects
from rover_hil.gap.data.problem import Problem, observe
from rover_hil.gap.decision.decide import NONE, Candidate, Decision, kept_effects, winners_of
from rover_hil.gap.decision.structure import structure_of
from rover_hil.gap.evidence.units import Units, observation_units, predict_units
from rover_hil.gap.fit.machine_fit import MachineFits
from rover_hil.gap.parameters import MACHINES
from rover_hil.gap.verdict import Answer
from rover_hil.gap.workflow import analyse
from sim_backends.models.interface import Run
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


def test_an_error_below_the_tolerance_beside_a_wrong_parameter_is_no_difference_between_runs() -> None:
    model = axis_model()
    gain, damping = model.parameters
    channel = replace(model.channels[0], tolerance=2.0)
    wrong = replace(gain, nominal=1.6 * gain.nominal)
    verdict = analyse(
        replace(model, parameters=(wrong, damping), channels=(channel,)), measured_runs(8, dry=2.5)
    ).verdict
    assert verdict.verdict is Answer.NAMED
    assert "no gap above the tolerance" in verdict.sentence


def test_an_error_below_the_tolerance_is_not_explained() -> None:
    model = axis_model()
    loose = replace(model, channels=(replace(model.channels[0], tolerance=2.0),))
    verdict = analyse(loose, measured_runs(dry=2.5)).verdict
    assert (verdict.verdict, verdict.effects) == (Answer.NO_GAP, [])
    assert verdict.sentence.startswith("No gap above the tolerance")


def test_a_law_that_acts_in_the_test_runs_alone_is_a_gap() -> None:
    runs = measured_runs(8)
    plan = analyse(axis_model(), runs).plan
    assert plan is not None
    odd = {one.name: one for one in measured_runs(8, dry=2.5)}
    mixed = [odd[one.name] if one.name in plan.confirm else one for one in runs]
    verdict = analyse(axis_model(), mixed).verdict
    assert verdict.verdict is Answer.UNNAMED, verdict.sentence
    assert verdict.sentence.startswith(f"There is a gap in the test runs alone ({', '.join(plan.confirm)})")
    assert not verdict.effects
    assert not verdict.next_run


def test_a_gap_in_the_test_runs_alone_forbids_the_name_of_a_base_parameter() -> None:
    model, runs = axis_model(), measured_runs(8)
    gain, damping = model.parameters
    model = replace(model, parameters=(replace(gain, nominal=1.6 * gain.nominal), damping))
    sound = analyse(model, runs)
    assert sound.verdict.verdict is Answer.NAMED
    assert sound.plan is not None
    odd = {one.name: one for one in measured_runs(8, dry=2.5)}
    mixed = [odd[one.name] if one.name in sound.plan.confirm else one for one in runs]
    verdict = analyse(model, mixed).verdict
    assert verdict.verdict is Answer.UNNAMED, verdict.sentence
    assert verdict.sentence.startswith("There is a gap in the test runs alone (")
    assert not any(one.is_named for one in verdict.base_parameters)
    assert verdict.gap["speed_sensor"]["before"] == pytest.approx(0.51, abs=0.02)


def base_structure(runs: list[Run]) -> float:
    model = axis_model(has_friction=False)
    problem = Problem(model, observe(model, runs))
    return structure_of(problem, MachineFits(problem, model.effects).base())


def test_slow_noise_of_the_declared_size_is_no_structure_and_a_missing_law_is() -> None:
    assert base_structure(measured_runs(persistence=0.6)) == 0.0
    assert base_structure(measured_runs(dry=1.0)) > 1.0
    # A third of the noise, which its declared size, known to a tenth, does not exclude.
    assert 0.2 < base_structure(measured_runs(dry=0.3)) < 0.35


def test_slow_noise_of_a_sensor_does_not_object_to_a_name() -> None:
    verdict = analyse(axis_model(), measured_runs(dry=2.5, persistence=0.6)).verdict
    assert verdict.verdict is Answer.NAMED, verdict.sentence
    assert not any("a model error remains" in one for one in verdict.warnings)


def test_an_effect_that_sets_a_base_parameter_free_is_the_parameter_itself() -> None:
    model = axis_model(has_friction=False)
    model = replace(model, port_effects=(*model.port_effects, effects.wrong_parameter("gain", size=2.0)))
    problem = Problem(model, observe(model, measured_runs()))
    fits = MachineFits(problem, model.effects)
    found = [fits.base(), fits.best(("wrong_gain",), {}, fits.base().fit.point)]
    candidates = [Candidate(names=one.names, machine=model, fit=one, is_listed=True) for one in found]
    units = observation_units(problem, found[0])
    decision = Decision(candidates=tuple(candidates), units=units, winners=np.array([0, 1, 1, NONE]), best=1)
    assert decision.base_probability("gain") == 0.5
    assert decision.base_probability("damping") == 0.0


def test_an_effect_of_every_winner_is_kept_beside_an_unknown_force() -> None:
    model = axis_model()
    problem = Problem(model, observe(model, measured_runs()))
    base = MachineFits(problem, model.effects).base()
    names = [(), ("dry",), ("drag",), ("drag", "dry")]
    candidates = [Candidate(names=one, machine=model, fit=base, is_listed=True) for one in names]
    winners, is_none = np.array([1, 3, 3, 1]), np.array([True, True, True, False])
    excess = np.tile(np.array([100.0, 4.0, 100.0, 3.0])[None, :, None], (4, 1, 1))
    # Drag takes a quarter away of what dry friction leaves; dry friction most of what drag leaves.
    assert kept_effects(candidates, excess, winners, is_none) == {"dry": 0.75, "drag": 0.0}


def test_a_channel_in_another_unit_is_bad_data_and_no_cause_in_the_machine() -> None:
    runs = [
        replace(run, measured={name: 57.3 * values for name, values in run.measured.items()})
        for run in measured_runs(dry=1.0)
    ]
    verdict = analyse(axis_model(), runs).verdict
    assert verdict.verdict is Answer.BAD_DATA
    assert "all of speed_sensor is 5" in verdict.sentence
    assert "check its unit, rad/s" in verdict.sentence


def test_an_effect_far_larger_than_declared_is_no_part_of_a_name() -> None:
    model = axis_model()
    tiny = effects.coulomb_friction("acceleration", velocity="speed", size=0.05, slow=0.05)
    verdict = analyse(replace(model, port_effects=(tiny, *model.port_effects[1:])), measured_runs(dry=2.5))
    assert (verdict.verdict.verdict, verdict.verdict.effects) == (Answer.UNNAMED, [])
    assert "level of coulomb_friction is more than ten times as large as declared" in verdict.verdict.sentence
