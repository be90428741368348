"""Drafts of a missing law: the form that is found, and what the locked runs say about it."""

from types import SimpleNamespace

import numpy as np
import pytest

from rover_hil.gap import Array, effects
from rover_hil.gap.decision import analysis
from rover_hil.gap.decision.analysis import MachineFindings, analyse_machine
from rover_hil.gap.decision.verdict import decide_machine
from rover_hil.gap.noise import random_force
from sim_backends.state_model.port_effect import PortEffect
from tests.rover_hil.gap.axis import axis_model, measured_runs

WEAR = 0.08
UNITS = {"heat": "W", "body": "degC", "room": "degC", "speed": "m/s"}


def findings(*, locked_wear: float = WEAR) -> MachineFindings:
    runs = measured_runs(6, wear=WEAR)
    locked = measured_runs(2, wear=locked_wear, seed=5)
    return analyse_machine(axis_model(has_friction=False), runs, locked, 0, lambda _: None)


def added(effect: PortEffect, signals: SimpleNamespace, coefficient: float) -> Array:
    assert effect.change is not None
    before = np.ones(signals.body.size)
    return effect.change(before, signals, SimpleNamespace(coefficient=coefficient), None) - before


def test_a_product_with_a_square_is_found_and_closes_the_gap_on_the_test_runs() -> None:
    draft = findings().drafts[0]
    assert draft.equation == "acceleration += c speed voltage^2"
    assert draft.coefficient == pytest.approx(-WEAR, rel=0.1)
    assert draft.low <= -WEAR <= draft.high
    assert draft.closure is not None
    assert draft.closure > 0.95
    assert draft.is_confirmed


def test_a_term_that_the_test_runs_contradict_is_not_confirmed() -> None:
    drafts = findings(locked_wear=-WEAR).drafts
    assert "acceleration += c speed voltage^2" in [one.equation for one in drafts]
    assert not any(one.is_confirmed for one in drafts)


@pytest.mark.parametrize(
    ("end", "words"),
    [
        (np.linalg.LinAlgError("SVD did not converge"), "LinAlgError: SVD did not converge"),
        (KeyboardInterrupt(), "interrupted by ctrl-C"),
    ],
)
def test_a_search_that_fails_leaves_the_analysis_complete(
    monkeypatch: pytest.MonkeyPatch, end: BaseException, words: str
) -> None:
    def fail(*_: object) -> None:
        raise end

    monkeypatch.setattr(analysis, "confirmed_drafts", fail)
    found = findings()
    assert found.drafts == ()
    assert found.tracked is not None
    sentence = decide_machine(found).sentence
    assert sentence.startswith("There is a gap")
    assert sentence.endswith(f"The search of a missing term did not end ({words}): the rest is complete.")


def test_a_covariance_without_full_rank_has_a_factor() -> None:
    covariance = 1e6 * np.ones((40, 40))
    covariance[:20] *= 1.0 + 1e-13
    root = random_force.root_of(0.5 * (covariance + covariance.T))
    np.testing.assert_allclose(root @ root.T, covariance, rtol=1e-6)


def test_a_source_may_be_a_difference() -> None:
    wave = np.array([-2.0, 0.0, 3.0])
    signals = SimpleNamespace(body=10.0 + wave, room=np.full(3, 10.0), speed=np.array([1.0, 2.0, 3.0]))
    square = effects.term("heat", source="body - room", form="signed_square", size=1.0, scale=1.0)
    assert square.states == ("body", "room")
    card = square.build(UNITS)
    assert card.name == "heat += c (body - room) |body - room|"
    assert card.parameters[0].unit == "W/(degC)^2"
    np.testing.assert_allclose(added(square, signals, 2.0), 2.0 * wave * abs(wave))
    beyond = effects.threshold("heat", source="body - room", place=1.0, size=1.0)
    np.testing.assert_allclose(added(beyond, signals, 2.0), [0.0, 0.0, 4.0])


def test_a_source_that_appears_twice_is_squared() -> None:
    signals = SimpleNamespace(body=np.array([12.0]), room=np.array([10.0]), speed=np.array([3.0]))
    effect = effects.product("heat", sources=("speed", "speed", "body - room"), size=1.0)
    card = effect.build(UNITS)
    assert card.name == "heat += c speed^2 (body - room)"
    assert card.parameters[0].unit == "W/((m/s)^2 degC)"
    np.testing.assert_allclose(added(effect, signals, 0.5), 0.5 * 9.0 * 2.0)
