"""The workflow on a machine whose truth is simulated independently."""

import numpy as np
import pytest

from rover_hil.gap.verdict import Answer
from rover_hil.gap.workflow import analyse
from tests.rover_hil.gap.axis import SENSOR_RAD_S, axis_model, measured_runs

DRY = 2.5


def test_without_a_hidden_effect_there_is_no_gap() -> None:
    verdict = analyse(axis_model(), measured_runs()).verdict
    assert verdict.verdict is Answer.NO_GAP
    assert not verdict.effects
    budget = verdict.error_budget["speed_sensor"]
    assert float(str(budget["upper_before"])) <= float(str(budget["tolerance"])) == SENSOR_RAD_S


@pytest.mark.slow
def test_dry_friction_is_named_with_its_size_and_closes_the_gap() -> None:
    verdict = analyse(axis_model(), measured_runs(dry=DRY)).verdict
    assert verdict.verdict is Answer.NAMED
    assert [one.name for one in verdict.effects] == ["coulomb_friction"]
    level = verdict.effects[0].parameters["level"]
    assert level.ci95[0] <= DRY <= level.ci95[1]
    assert level.ci95[1] - level.ci95[0] < 0.1 * DRY
    closure = verdict.gap["speed_sensor"]["closure"]
    assert isinstance(closure, float)
    assert closure > 0.95
    assert verdict.gap["speed_sensor"]["noise_floor"] == SENSOR_RAD_S


@pytest.mark.slow
def test_without_its_card_friction_is_a_draft_of_the_form_of_a_sign() -> None:
    verdict = analyse(axis_model(has_friction=False), measured_runs(dry=DRY)).verdict
    assert verdict.verdict in (Answer.UNNAMED, Answer.PARTLY_NAMED)
    assert verdict.draft[0]["term"] == "acceleration += c sign(speed)"
    assert float(verdict.draft[0]["coefficient"]) == pytest.approx(-DRY, rel=0.05)


@pytest.mark.nightly
@pytest.mark.slow
def test_a_force_that_differs_between_runs_is_a_gap_without_a_name_in_units_of_the_channel() -> None:
    verdict = analyse(axis_model(), measured_runs(disturbance=4.0)).verdict
    assert verdict.verdict is Answer.UNNAMED
    assert "times the sensor noise" in verdict.sentence
    assert "that none of these is right has a probability of 100%" in verdict.sentence
    assert float(str(verdict.error_budget["speed_sensor"]["model_error_before"])) > 3.0 * SENSOR_RAD_S


@pytest.mark.slow
def test_the_model_error_is_the_misfit_without_the_sensor() -> None:
    analysis = analyse(axis_model(), measured_runs(disturbance=4.0))
    assert analysis.machine is not None
    before = analysis.machine.budget_before[0]
    base = analysis.machine.base
    residual = analysis.machine.problem.observations.values - analysis.machine.problem.predict(base.fit.point)
    assert before.model_error == pytest.approx(float(np.sqrt(np.mean(residual**2))), rel=0.05)
    assert before.model_error < before.upper


@pytest.mark.slow
def test_the_same_data_gives_the_same_verdict() -> None:
    first, second = (analyse(axis_model(), measured_runs(dry=DRY)).verdict for _ in range(2))
    assert first.sentence == second.sentence


@pytest.mark.parametrize(
    ("dry", "first", "ratio"),
    [
        (DRY, "there is a gap", "coulomb_friction (about 2."),
        (0.0, "no gap found (p = ", "times the sensor noise"),
    ],
)
def test_a_first_answer_comes_before_the_search(dry: float, first: str, ratio: str) -> None:
    said: list[str] = []
    runs = measured_runs(dry=dry)
    analyse(axis_model(), runs, advance=said.append, announce=lambda words: said.append(f"! {words}"))
    place = next(index for index, words in enumerate(said) if words.startswith("!"))
    assert said[place].startswith(f"! First answer: {first}")
    assert ratio in said[place]
    assert "rad/s" in said[place]
    assert said[place - 1] == "fitting the base model"
    assert len([words for words in said if words.startswith("!")]) == 1
