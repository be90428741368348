"""The gap workflow on steady runs of a nature that knows nothing of the model or its cards."""

import math
from collections.abc import Mapping

import pytest

from rover_hil.gap.verdict import Answer, Verdict
from rover_hil.gap.workflow import analyse
from tests.cases import first_often
from tests.nature.cart import Experiment
from tests.rover_hil.gap.gap_data import cart_runs
from tests.rover_hil.gap.gap_models import Cart

REGULAR = Experiment()
QUANTA = {
    "slip": 0.005,
    "slip_angle_deg": 0.5,
    "sinkage_up_mm": 1.0,
    "sinkage_down_mm": 1.0,
    "torque_up_nm": 0.05,
    "torque_down_nm": 0.05,
}
SINGLES = {
    "slope_failure": {"creep": 0.3},
    "friction_angle": {"friction": -7.0},
    "shear_modulus": {"shear": 16.0},
    "sinkage_modulus": {"softness": 0.14},
    "cog_offset": {"offset": 12.0},
    "heading_offset": {"heading": 4.0},
    "camera_yaw": {"yaw": 0.8},
    "slip_sinkage": {"digging": 80.0},
    "wheel_radius": {"radius": 0.8},
}
TRUTHS = {
    "friction_angle": ("friction_angle_change", -7.0),
    "shear_modulus": ("shear_modulus_change", 16.0),
    "cog_offset": ("lateral_mm", 12.0),
    "heading_offset": ("heading_deg", 4.0),
    "camera_yaw": ("yaw_deg", 0.8),
    "wheel_radius": ("radius_percent", 0.8),
}


def verdict_of(seed: int, hidden: Mapping[str, float], experiment: Experiment = REGULAR) -> Verdict:
    return analyse(Cart(), cart_runs(seed, experiment, **hidden), seed=seed).verdict


@pytest.mark.parametrize(
    "experiment",
    first_often(
        [Experiment(), Experiment(kind="heavy"), Experiment(quantum=QUANTA), Experiment(setting_deg=0.5)]
    ),
    ids=["white", "heavy tails", "quantised", "poorly set"],
)
def test_without_effect_nothing_is_named(experiment: Experiment) -> None:
    verdicts = [verdict_of(seed, {}, experiment) for seed in range(10, 14)]
    assert {one.verdict for one in verdicts} == {Answer.NO_GAP}
    for one in verdicts:
        assert not one.effects
        assert not one.confidence_set
        assert one.gap == {}, "locked runs must stay locked where there is nothing to prove"
        assert len(one.detectable) == len(Cart.effects)


@pytest.mark.parametrize("name", first_often(SINGLES))
def test_a_single_effect_is_named_alone(name: str) -> None:
    verdict = verdict_of(3, SINGLES[name])
    assert verdict.verdict is Answer.NAMED, verdict.sentence
    assert [list(names) for names in verdict.confidence_set] == [[name]]
    assert [effect.name for effect in verdict.effects] == [name]
    assert verdict.p_gap is not None
    assert verdict.p_gap < 0.01
    assert name not in {one["name"] for one in verdict.rejected}
    assert len(verdict.rejected) == len(Cart.effects) - 1


@pytest.mark.slow
def test_intervals_hold_the_truth() -> None:
    """One parameter each, so that its truth is a number; 90 % of 95 % intervals is 3 sd below the mean."""
    held = []
    for name, (parameter, truth) in TRUTHS.items():
        for seed in range(20, 22):
            verdict = verdict_of(seed, SINGLES[name])
            effects = {effect.name: effect for effect in verdict.effects}
            if name in effects:
                low, high = effects[name].parameters[parameter].ci95
                # A released parameter carries the whole distance from its nominal value.
                spread = 2.0 if name in ("friction_angle", "shear_modulus") else 0.0
                scale = {"friction_angle": 1.0, "shear_modulus": 2.0}.get(name, 0.0)
                held.append(low - spread * scale <= truth <= high + spread * scale)
    assert len(held) >= 11
    assert sum(held) >= 0.85 * len(held)


@pytest.mark.parametrize(
    ("names", "hidden"),
    first_often(
        [
            (["camera_yaw", "slope_failure"], {"creep": 0.4, "yaw": 1.2}),
            (["slip_sinkage", "wheel_radius"], {"digging": 100.0, "radius": 1.0}),
            (["cog_offset", "wheel_radius"], {"offset": 15.0, "radius": -1.0}),
        ]
    ),
)
def test_both_effects_of_a_pair_are_named(names: list[str], hidden: dict[str, float]) -> None:
    verdict = verdict_of(5, hidden)
    assert verdict.verdict in (Answer.NAMED, Answer.NAMED_SET, Answer.PARTLY_NAMED), verdict.sentence
    assert names in [list(one) for one in verdict.confidence_set]


def test_a_second_effect_is_found_where_all_values_together_are_no_farther_off_than_by_chance() -> None:
    """It is weak: in a part of the draws the first effect alone is within what a second one must gain."""
    verdict = verdict_of(2, {"digging": 80.0, "yaw": 0.2})
    assert verdict.confidence_set == [["slip_sinkage"]], verdict.sentence
    assert "camera_yaw and slip_sinkage has a probability of" in verdict.sentence


@pytest.mark.parametrize("hidden", [{"stick": 0.2}, {"swing": 0.012}], ids=["sinkage with roll", "slip wave"])
def test_an_effect_outside_the_catalogue_gets_no_full_name(hidden: dict[str, float]) -> None:
    verdict = verdict_of(6, hidden)
    assert verdict.verdict in (Answer.UNNAMED, Answer.PARTLY_NAMED), verdict.sentence
    assert verdict.unnamed
    for one in verdict.unnamed:
        assert one["unit"]
        assert abs(float(str(one["cosine"]))) <= 1.0


def test_an_equation_names_the_term_that_nature_has() -> None:
    verdict = verdict_of(6, {"stick": 0.25})
    assert verdict.verdict is Answer.UNNAMED
    equations = [str(one["equation"]) for one in verdict.unnamed]
    assert any(text.startswith("sinkage_up_mm += ") and "roll_deg" in text for text in equations)
    assert any("mm/deg" in text for text in equations)


def test_a_forbidden_sign_is_never_named() -> None:
    """Soil that flows uphill: the card may only go downhill."""
    verdict = verdict_of(7, {"creep": -0.3})
    assert "slope_failure" not in {name for names in verdict.confidence_set for name in names}
    why = {one["name"]: one["why"] for one in verdict.rejected}
    assert "impossible sign" in why["slope_failure"]


def test_the_gap_shrinks_on_locked_runs() -> None:
    verdict = verdict_of(8, {"creep": 0.4})
    closure = verdict.gap["slip_angle_deg"]["closure"]
    assert isinstance(closure, float)
    assert 0.85 < closure < 1.15
    floor = verdict.gap["slip_angle_deg"]["noise_floor"]
    assert isinstance(floor, float)
    assert 0.2 < floor < 0.5
    where = verdict.where[0]
    assert where["channel"] == "slip_angle_deg"
    assert float(where["size"]) < -0.5


def test_the_same_seed_gives_the_same_verdict() -> None:
    first, second = (verdict_of(9, {"yaw": 0.8}) for _ in range(2))
    assert math.isclose(first.p_gap or 0.0, second.p_gap or 1.0)
    assert first.effects == second.effects
    assert first.gap == second.gap


def test_larger_effects_are_needed_where_runs_are_fewer() -> None:
    many = verdict_of(11, {})
    few = verdict_of(11, {}, Experiment(rolls=(0.0, 20.0)))
    sizes = [{str(one["name"]): float(one["size"]) for one in verdict.detectable} for verdict in (many, few)]
    assert all(sizes[1][name] > sizes[0][name] for name in ("camera_yaw", "cog_offset", "wheel_radius"))
