"""A measured linear drive (EMPS); the pendulum is a benchmark."""

from pathlib import Path

import numpy as np
import pytest

from rover_hil.gap.verdict import Answer, Verdict
from rover_hil.gap.workflow import analyse
from tests.rover_hil.gap.emps import emps_model, emps_runs

pytestmark = pytest.mark.nightly


@pytest.fixture(scope="module")
def emps(shared_data: Path) -> Verdict:
    runs = [*emps_runs(shared_data, "identification"), *emps_runs(shared_data, "pulses")]
    return analyse(emps_model(has_friction=True), runs, confirm='run == "pulses*"').verdict


def test_friction_of_the_drive_has_the_published_size(emps: Verdict) -> None:
    found = {one.name: one for one in emps.effects}
    level = found["coulomb_friction"].parameters["level"]
    assert 19.0 <= level.value <= 22.0
    assert level.ci95[0] <= 20.4 <= level.ci95[1]
    assert level.ci95[1] - level.ci95[0] <= 0.15 * level.value
    # What explains a small part beside a remaining error is not named.
    assert emps.verdict is Answer.PARTLY_NAMED
    assert list(found) == ["coulomb_friction"]
    viscous = next(one for one in emps.base_parameters if one.name == "viscous")
    assert 190.0 <= viscous.value <= 215.0
    assert viscous.ci95[0] <= 203.5 <= viscous.ci95[1]
    assert viscous.ci95[1] - viscous.ci95[0] <= 0.15 * viscous.value


def test_the_pulse_record_is_predicted_as_well_as_by_the_published_fit(
    emps: Verdict, shared_data: Path
) -> None:
    squares = []
    for run in emps_runs(shared_data, "pulses"):
        velocity, acceleration = run.inputs["velocity"], run.inputs["acceleration"]
        published = 95.1 * acceleration + 203.5 * velocity + 20.4 * np.sign(velocity) - 3.2
        squares.append(np.mean((run.measured["force"] - published) ** 2))
    after = emps.gap["force"]["after"]
    assert isinstance(after, float)
    assert after <= 1.2 * float(np.sqrt(np.mean(squares)))


def test_without_friction_cards_there_is_no_wrong_name_and_a_draft_of_a_sign(shared_data: Path) -> None:
    verdict = analyse(emps_model(has_friction=False), emps_runs(shared_data, "identification")).verdict
    assert verdict.verdict not in (Answer.NAMED, Answer.NAMED_SET, Answer.NO_GAP)
    assert verdict.draft[0]["term"] == "resistance += c sign(velocity)"
    assert float(verdict.draft[0]["coefficient"]) == pytest.approx(-20.4, abs=1.5)
