"""Names that are not certain: another law explains as much, or the strength is more than it can be."""

import math
from dataclasses import replace

import pytest

from benchmarks.gap.battery_drives import cases, run
from rover_hil.gap.findings import Analysis
from rover_hil.gap.verdict import Answer
from rover_hil.gap.workflow import analyse
from sim_backends.models.interface import EffectCard, Model
from tests.cases import first_often
from tests.nature.axis import Drive
from tests.rover_hil.gap.gap_data import axis_runs, make_axis


def analysis_of(model: Model, seed: int, **hidden: float) -> Analysis:
    return analyse(model, axis_runs(seed, Drive(), **hidden), seed=seed)


@pytest.mark.parametrize("fan", first_often([2e-4, 5e-4, 1e-3]))
def test_a_law_that_the_catalogue_does_not_have_is_not_named_for_sure(fan: float) -> None:
    """A sagging supply takes voltage with its square, a fan torque with the square of the speed."""
    verdict = analysis_of(make_axis(), 0, fan=fan).verdict
    assert verdict.verdict is Answer.PARTLY_NAMED, verdict.sentence


@pytest.mark.slow
def test_a_term_that_explains_as_much_as_a_name_is_told() -> None:
    analysis = analysis_of(make_axis(), 2, fan=2e-4)
    assert analysis.machine is not None
    assert analysis.machine.rival_terms
    assert f"the term {analysis.machine.rival_terms[0]} explains as much" in analysis.verdict.sentence


@pytest.mark.parametrize("hidden", first_often([{"dry": 0.01}, {"sag": 0.02}, {"late": 0.01}, {"zero": 0.5}]))
def test_a_right_name_has_no_rival(hidden: dict[str, float]) -> None:
    analysis = analysis_of(make_axis(), 4, **hidden)
    assert analysis.machine is not None
    assert analysis.machine.best.names
    assert not analysis.machine.rival_terms


def test_a_strength_at_its_limit_is_no_explanation() -> None:
    model = make_axis()
    friction = next(card for card in model.effects if card.name == "dry_friction")
    for upper, answer in ((math.inf, Answer.NAMED), (10.0, Answer.NAMED), (0.4, Answer.UNNAMED)):
        object.__setattr__(model, "effects", (_limited(friction, upper),))
        verdict = analysis_of(model, 4, dry=0.0125).verdict
        assert verdict.verdict is answer, verdict.sentence


def _limited(card: EffectCard, upper: float) -> EffectCard:
    return replace(card, parameters=(replace(card.parameters[0], upper=upper), *card.parameters[1:]))


@pytest.mark.slow
def test_fits_that_the_evidence_of_an_alternative_needs_are_no_error() -> None:
    """In this case of the battery such a fit has as many effects as the best one, and joins those judged."""
    hidden, scale, noise, seed = cases(486)[485]
    assert run(hidden, scale, noise, seed).verdict.verdict is not Answer.BAD_DATA
