"""A base parameter far from its nominal value: when it is the finding, and where it is reported."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from rover_hil.gap.fit.base_parameters import Trial, far, headline, judged, with_base_parameters
from rover_hil.gap.output.model_file import read_model_file
from rover_hil.gap.output.results import (
    MODEL_NAME,
    REPORT_NAME,
    VERDICT_NAME,
    write_report,
    write_results,
)
from rover_hil.gap.verdict import Answer, FittedBase, FoundEffect, Verdict
from rover_hil.gap.workflow import analyse
from sim_backends.state_model.model import StateModel
from tests.rover_hil.gap.axis import axis_model, measured_runs

TRACK = FittedBase(
    name="track", unit="m", nominal=0.2, prior_sd=0.001, value=0.21, ci95=(0.2095, 0.2105), pull=10.0
)
AGREES = Verdict(verdict=Answer.NO_GAP, sentence="No gap: the rover agrees.", p_gap=0.5)
PROVEN = Trial(equals=(), closure=0.99, improved=1.0)


def judge(row: FittedBase, trial: Trial, verdict: Verdict = AGREES) -> Verdict:
    return with_base_parameters(verdict, judged([row], lambda _: trial))


def test_a_proven_value_is_named_and_told_first() -> None:
    verdict = judge(TRACK, PROVEN)
    assert verdict.verdict is Answer.NAMED
    assert verdict.confidence_set == [["track"]]
    assert verdict.sentence.startswith(
        "Wrong in the model: track is 0.21 m (0.2095 to 0.2105), not 0.2: 10.0 prior deviations."
    )
    assert len(headline(verdict)) < 160


@pytest.mark.parametrize(
    ("row", "trial", "answer", "why"),
    [
        (replace(TRACK, ci95=(0.201, 0.22)), PROVEN, Answer.NOT_IDENTIFIABLE, "values in common"),
        (TRACK, replace(PROVEN, equals=((),)), Answer.NOT_IDENTIFIABLE, "other base parameters"),
        (
            TRACK,
            replace(PROVEN, equals=(("slip",),)),
            Answer.NAMED_SET,
            "equally: track (0.21, 0.2095 to 0.2105), slip",
        ),
        (TRACK, replace(PROVEN, equals=(("slip",),), closure=0.3), Answer.NOT_IDENTIFIABLE, "equally: track"),
        (TRACK, replace(PROVEN, closure=None), Answer.NOT_IDENTIFIABLE, "too small to prove"),
        (TRACK, replace(PROVEN, closure=0.3), Answer.NOT_IDENTIFIABLE, "30% of the gap"),
        (TRACK, replace(PROVEN, improved=0.5), Answer.NOT_IDENTIFIABLE, "50% of the locked runs"),
    ],
)
def test_each_premise_that_fails_is_told(row: FittedBase, trial: Trial, answer: Answer, why: str) -> None:
    verdict = judge(row, trial)
    assert verdict.verdict is answer
    assert why in verdict.sentence.split(". ")[0] + verdict.base_parameters[0].why
    assert not verdict.base_parameters[0].is_named
    assert "prior deviations" in headline(verdict)


def test_what_is_left_keeps_the_name_uncertain() -> None:
    """A gap that nothing explains may have pulled the value."""
    left = replace(AGREES, verdict=Answer.UNNAMED, sentence="There is a gap.")
    assert judge(TRACK, PROVEN, left).verdict is Answer.PARTLY_NAMED
    named = replace(
        AGREES,
        verdict=Answer.NAMED,
        sentence="Missing: slip.",
        effects=[FoundEffect(name="slip", parameters={})],
        confidence_set=[["slip"]],
    )
    verdict = judge(TRACK, PROVEN, named)
    assert verdict.verdict is Answer.PARTLY_NAMED
    assert "Probably missing: slip" in verdict.sentence


@pytest.mark.parametrize(("upper", "answer"), [(0.9, Answer.NAMED), (1.1, Answer.PARTLY_NAMED)])
def test_what_is_left_below_the_tolerance_weakens_the_name_no_more_than_that_of_an_effect(
    upper: float, answer: Answer
) -> None:
    left = replace(
        AGREES,
        verdict=Answer.UNNAMED,
        sentence="There is a gap; below the tolerance.",
        error_budget={"x": {"tolerance": 1.0, "upper_after": upper}},
    )
    verdict = judge(TRACK, PROVEN, left)
    assert (verdict.verdict, verdict.confidence_set) == (answer, [["track"]])
    assert ("With this value: there is a gap" in verdict.sentence) is (upper < 1.0)


def test_a_value_and_its_rival_are_no_part_of_a_name_where_a_gap_remains_too() -> None:
    """Neither of them is certain; the sentence states both."""
    left = replace(AGREES, verdict=Answer.UNNAMED, sentence="There is a gap.")
    rivals = replace(PROVEN, equals=(("slip",),), sizes={("slip",): "slip (share 0.04, 0.03 to 0.05)"})
    rows = judged([TRACK], lambda _: rivals)
    verdict = with_base_parameters(replace(left, rejected=[{"name": "slip", "why": "weak"}]), rows)
    assert (verdict.verdict, verdict.confidence_set) == (Answer.UNNAMED, [])
    assert "equally: track (0.21, 0.2095 to 0.2105), slip (share 0.04, 0.03 to 0.05)" in verdict.sentence


def test_what_replaces_a_value_stays_in_the_set_beside_a_proven_one() -> None:
    """Of two values far from nominal one is proven; the other, or an effect in its place, is open."""
    left = replace(AGREES, verdict=Answer.UNNAMED, sentence="There is a gap.")
    radius = replace(TRACK, name="radius")
    open_ = replace(PROVEN, equals=(("slip",),), sizes={("slip",): "slip (share 0.04, 0.03 to 0.05)"})
    rows = judged([TRACK, radius], lambda name: PROVEN if name == "track" else open_)
    verdict = with_base_parameters(left, rows)
    assert verdict.verdict is Answer.PARTLY_NAMED
    assert verdict.confidence_set == [["track", "radius"], ["track", "slip"]]
    assert "equally: radius (0.21, 0.2095 to 0.2105), slip (share 0.04, 0.03 to 0.05)." in verdict.sentence


def test_a_proven_value_is_named_beside_values_that_are_not_decided() -> None:
    """The fitted values explain the runs together: what is proven of one does not wait for the others."""
    rows = [replace(TRACK, name=name) for name in ("track", "radius", "mass")]
    weak = replace(PROVEN, closure=0.3)
    alike = replace(PROVEN, equals=(("slip",),))
    trials = {"track": PROVEN, "radius": alike, "mass": weak}
    verdict = with_base_parameters(AGREES, judged(rows, trials.__getitem__))
    assert verdict.verdict is Answer.PARTLY_NAMED
    assert verdict.confidence_set == [["track", "radius"], ["track", "slip"]]
    verdict = with_base_parameters(AGREES, judged(rows, (trials | {"radius": weak}).__getitem__))
    assert verdict.verdict is Answer.PARTLY_NAMED
    assert verdict.confidence_set == [["track"]]


def test_a_value_within_its_prior_changes_nothing() -> None:
    def never(_: str) -> Trial:
        raise AssertionError("no comparison is needed")

    rows = judged([replace(TRACK, pull=2.9)], never)
    assert with_base_parameters(AGREES, rows) == replace(AGREES, base_parameters=rows)


def axis(**nominal: float) -> StateModel:
    model = axis_model()
    parameters = [
        replace(item, nominal=nominal.get(item.name, item.nominal), prior_sd=0.1) for item in model.parameters
    ]
    return replace(model, parameters=tuple(parameters), port_effects=model.port_effects[:2])


@pytest.fixture(scope="module")
def command(tmp_path_factory: pytest.TempPathFactory) -> Callable[[], Path]:
    folder = tmp_path_factory.mktemp("finding")
    analysis = analyse(axis(gain=7.0), measured_runs(8))
    write_results(folder, analysis, "axis", "")
    write_report(folder, analysis)
    return lambda: folder


def test_a_wrong_gain_of_a_machine_is_named_in_every_file(command: Callable[[], Path]) -> None:
    folder = command()
    verdict = json.loads((folder / VERDICT_NAME).read_text("utf-8"))
    assert (verdict["verdict"], verdict["confidence_set"]) == ("NAMED", [["gain"]]), verdict["sentence"]
    gain = verdict["base_parameters"][0]
    # How often intervals hold the truth is counted over seeds, in test_released_fit.py.
    assert gain["value"] == pytest.approx(8.0, rel=0.01)
    assert gain["ci95"][0] > 7.5
    written = read_model_file(folder / MODEL_NAME).parameters
    assert written["gain"].value == gain["value"]
    assert written["damping"].value == 4.0
    page = (folder / REPORT_NAME).read_text("utf-8")
    assert "Wrong in the model: gain is " in page
    assert "wrong in the model</td>" in page


def test_what_was_known_before_stands_in_the_file_on_the_page_and_in_the_table(tmp_path: Path) -> None:
    priors = {"gain": 0.123, "damping": 0.0772}
    model = axis_model()
    parameters = tuple(replace(item, prior_sd=priors[item.name]) for item in model.parameters)
    model = replace(model, parameters=parameters, port_effects=model.port_effects[:2])
    analysis = analyse(model, measured_runs(8))
    write_results(tmp_path, analysis, "axis", "")
    write_report(tmp_path, analysis)
    written = json.loads((tmp_path / VERDICT_NAME).read_text("utf-8"))["base_parameters"]
    assert {one["name"]: one["prior_sd"] for one in written} == priors
    page = (tmp_path / REPORT_NAME).read_text("utf-8")
    assert '<th class="number">prior sd</th>' in page
    lines = analysis.verdict.lines()
    head = next(line for line in lines if line.startswith("Base parameter"))
    for name, prior_sd in priors.items():
        row = page.split(f"<tr><td>{name}</td>", 1)[1].split("</tr>", 1)[0]
        assert f'<td class="number">{prior_sd:.2g}</td>' in row
        line = next(line for line in lines if line.startswith(name))
        assert line[head.index("prior sd") :].split()[0] == f"{prior_sd:.2g}"


def supplied_axis(supply_sd: float) -> StateModel:
    """Return an axis with too small a gain; gain and supply stand side by side in the product."""
    model = axis(gain=7.0)
    supply = replace(model.parameters[0], name="supply", unit="1", nominal=1.0, prior_sd=supply_sd)
    return replace(
        model,
        parameters=(*model.parameters, replace(supply, lower=0.1, upper=5.0)),
        derivative=lambda x, u, p, port: {
            "speed": port("acceleration", p.gain * p.supply * u.voltage - p.damping * x.speed)
        },
    )


def test_a_value_that_another_base_parameter_replaces_is_told_with_it() -> None:
    """The runs cannot say which of them is wrong."""
    verdict = analyse(supplied_axis(0.1 / 7.0), measured_runs(8)).verdict
    assert verdict.verdict is Answer.NAMED_SET, verdict.sentence
    assert sorted(map(list, verdict.confidence_set)) == [["gain"], ["supply"]]
    assert "explain the runs equally" in verdict.sentence


@pytest.mark.parametrize("force", [1.0, 3.0])
def test_what_a_nominal_value_pushes_away_is_told_where_a_gap_remains(force: float) -> None:
    """With the nominal gain the supply leaves its prior: locked runs compare both with the end of this prior.

    An unknown force explains what they leave better: they are reported without being in a set.
    """
    verdict = analyse(supplied_axis(0.02), measured_runs(8, disturbance=force)).verdict
    assert (verdict.verdict, verdict.confidence_set) == (Answer.UNNAMED, []), verdict.sentence
    told = verdict.sentence.split("explain the runs equally: ")[1].split(". ")[0]
    assert "gain (" in told
    assert "supply (1.1" in told


def test_effect_and_base_parameters_of_the_model_file_are_those_of_the_verdict(tmp_path: Path) -> None:
    """With friction in the runs and a wrong gain, both come from one fit without the prior of the gain."""
    analysis = analyse(axis(gain=7.0), measured_runs(8, dry=4.0))
    write_results(tmp_path, analysis, "axis", "")
    write_report(tmp_path, analysis)
    verdict, file = analysis.verdict, read_model_file(tmp_path / MODEL_NAME)
    (friction,) = verdict.effects
    for name, number in friction.parameters.items():
        assert file.effects[friction.name][name].value == number.value
    for one in verdict.base_parameters:
        assert file.parameters[one.name].value == one.value, one.name
    gain = next(one for one in verdict.base_parameters if one.name == "gain")
    assert gain.value == pytest.approx(8.0, rel=0.02)


def test_a_value_that_the_runs_hardly_show_is_not_told() -> None:
    """At the end of its range, with the nominal value inside its interval."""
    row = replace(TRACK, ci95=(0.1, 0.4))
    assert far([row, TRACK]) == [TRACK]
