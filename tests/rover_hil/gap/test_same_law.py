"""A law in no list that is the same law as an effect: it is this effect, and does not object to its name."""

from dataclasses import replace
from functools import cache

from rover_hil.gap import effects
from rover_hil.gap.decision.analysis import MachineFindings, analyse_machine
from rover_hil.gap.decision.verdict import decide_machine
from rover_hil.gap.verdict import Answer
from tests.rover_hil.gap.axis import axis_model, measured_runs

DRY = 8.0
SIGN = "acceleration += c sign(speed)"


@cache
def blunt_friction() -> MachineFindings:
    """Return the findings where the friction of the model fades at a higher speed than the real one."""
    model = axis_model()
    blunt = effects.coulomb_friction("acceleration", velocity="speed", size=2.0, slow=0.3)
    model = replace(model, port_effects=(blunt, *model.port_effects[1:]))
    locked = measured_runs(3, dry=DRY, seed=5)
    return analyse_machine(model, measured_runs(dry=DRY), locked, 0, lambda _: None)


def test_it_counts_as_the_effect_although_it_predicts_better() -> None:
    decision = blunt_friction().decision
    assert decision is not None
    assert decision.chosen.names == ("coulomb_friction",)
    assert [one.names for _, one in decision.ranked()] == [("coulomb_friction",)]


def test_another_law_takes_part() -> None:
    decision = blunt_friction().decision
    assert decision is not None
    unlisted = {name for one in decision.candidates if not one.is_listed for name in one.names}
    assert SIGN not in unlisted
    assert "acceleration += c speed^2 voltage" in unlisted


def test_more_of_the_law_of_an_effect_does_not_object_to_its_name() -> None:
    verdict = decide_machine(blunt_friction())
    assert verdict.verdict is Answer.PARTLY_NAMED, verdict.sentence
    assert "is missing too" not in verdict.sentence
    draft = blunt_friction().drafts[0]
    assert (draft.equation, draft.is_confirmed) == (SIGN, True)
    assert draft.is_law_of(("coulomb_friction",))
    assert not draft.is_law_of(("offset", "delay"))
