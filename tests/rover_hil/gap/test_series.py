"""The gap workflow on logged series: correlated errors, heavy tails, rounding, several effects."""

import pytest

from rover_hil.gap.verdict import Answer, Verdict
from rover_hil.gap.workflow import analyse
from tests.cases import first_often
from tests.nature.axis import Drive, TrueAxis
from tests.rover_hil.gap.gap_data import axis_runs, make_axis

DRIVES = {
    "white": Drive(),
    "correlated": Drive(kind="correlated"),
    "heavy tails": Drive(kind="heavy"),
    "quantised": Drive(quantum=0.5),
}


def verdict_of(seed: int, drive: Drive, **hidden: float) -> Verdict:
    return analyse(make_axis(), axis_runs(seed, drive, **hidden), seed=seed).verdict


@pytest.mark.parametrize("kind", first_often(DRIVES))
def test_without_effect_nothing_is_named(kind: str) -> None:
    verdicts = [verdict_of(seed, DRIVES[kind]) for seed in range(10, 16)]
    assert {one.verdict for one in verdicts} == {Answer.NO_GAP}


@pytest.mark.parametrize("kind", first_often(DRIVES))
@pytest.mark.parametrize(
    ("name", "hidden"),
    first_often(
        [
            ("dry_friction", {"dry": 0.01}),
            ("delay", {"late": 0.01}),
            ("sag", {"sag": 0.02}),
            ("sensor_offset", {"zero": 0.5}),
        ]
    ),
)
def test_a_single_effect_is_named_alone(kind: str, name: str, hidden: dict[str, float]) -> None:
    verdict = verdict_of(4, DRIVES[kind], **hidden)
    assert verdict.verdict is Answer.NAMED, verdict.sentence
    assert [list(names) for names in verdict.confidence_set] == [[name]]


def test_two_effects_are_found_with_their_sizes() -> None:
    verdict = verdict_of(5, Drive(), dry=0.01, late=0.01)
    assert [list(names) for names in verdict.confidence_set] == [["delay", "dry_friction"]]
    effects = {effect.name: effect.parameters for effect in verdict.effects}
    assert effects["delay"]["time"].value == pytest.approx(0.01, abs=0.002)
    assert effects["dry_friction"]["level"].value == pytest.approx(0.01 / TrueAxis().damping, rel=0.25)


def test_friction_is_not_swallowed_by_the_gain() -> None:
    """The gain may move within its prior only, and is fitted together with the friction."""
    verdict = verdict_of(6, Drive(), dry=0.0125)
    closure = verdict.gap["speed"]["closure"]
    assert isinstance(closure, float)
    assert closure > 0.95


def test_a_friction_that_no_card_has_becomes_an_equation() -> None:
    model = make_axis()
    cards = tuple(card for card in model.effects if card.name not in ("dry_friction", "gain_error"))
    object.__setattr__(model, "effects", cards)
    verdict = analyse(model, axis_runs(7, Drive(), dry=0.02), seed=7).verdict
    assert verdict.verdict in (Answer.UNNAMED, Answer.PARTLY_NAMED), verdict.sentence
    assert verdict.unnamed
    assert "rad/s" in str(verdict.unnamed[0]["equation"])


def test_samples_are_not_counted_as_experiments() -> None:
    """Ten times the samples of the same slow error must not make an effect ten times as sure."""
    short = verdict_of(8, Drive(kind="correlated", correlation=0.9, samples=200))
    sizes = {str(one["name"]): float(one["size"]) for one in short.detectable}
    white = verdict_of(8, Drive(samples=200))
    independent = {str(one["name"]): float(one["size"]) for one in white.detectable}
    assert sizes["sensor_offset"] > 2.5 * independent["sensor_offset"]
