"""The proposal of the next run of a machine."""

import json
import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.gap_machines.small_carts import SmallCart, make_cart, make_model
from drivers.errors import ConfigError
from rover_hil.gap import effects
from rover_hil.gap.data.table import read_table
from rover_hil.gap.decision.analysis import analyse_machine
from rover_hil.gap.findings import Analysis
from rover_hil.gap.next_run.allowed import Allowed, InputRange, read_allowed
from rover_hil.gap.next_run.criterion import separation_of
from rover_hil.gap.next_run.hypotheses import NO_EFFECT, SOMETHING_ELSE, hypotheses_of
from rover_hil.gap.next_run.planned import PlannedRun, planned_runs, require_durations
from rover_hil.gap.next_run.prediction import Prediction
from rover_hil.gap.next_run.proposal import Proposal
from rover_hil.gap.next_run.shapes import shaped
from rover_hil.gap.output.next_run_file import NEXT_RUN_NAME, next_run_text
from rover_hil.gap.output.report import report_text
from rover_hil.gap.output.results import write_results
from rover_hil.gap.parameters import MACHINES
from rover_hil.gap.verdict import Answer
from rover_hil.gap.workflow import analyse
from sim_backends.models.interface import Run
from tests.rover_hil.command import Command, assert_one_sentence
from tests.rover_hil.gap.axis import axis_model, measured_runs
from tests.rover_hil.gap.small_machine import MODEL, small_runs, table_text

DRAG = 16
"""Number of a cart whose quadratic drag its runs do not distinguish from viscous friction."""
WIDE: Mapping[str, object] = {"inputs": {"force": {"low": -3.0, "high": 4.0}}}


@pytest.fixture(scope="module")
def cart() -> SmallCart:
    return make_cart(DRAG)


@pytest.fixture(scope="module")
def confused(cart: SmallCart) -> Analysis:
    return analyse(make_model(), cart.runs, allowed=Allowed.model_validate(WIDE))


def _proposal(analysis: Analysis) -> Proposal:
    assert analysis.proposal is not None
    return analysis.proposal


def test_the_designed_run_separates_what_the_runs_confuse(cart: SmallCart, confused: Analysis) -> None:
    assert confused.verdict.verdict is Answer.NAMED_SET
    proposal = _proposal(confused)
    best = proposal.options[0]
    assert not best.planned.is_repeat
    assert {one.name for one in proposal.named} >= {"quadratic_drag", "viscous_friction"}
    assert best.separation.distances[0, 1] > 5.0
    rng = np.random.default_rng(5)
    made = [
        replace(cart.made(best.planned, rng), name=f"next{index}") for index in range(max(proposal.times, 1))
    ]
    assert confused.plan is not None
    locked = " or ".join(f'run == "{name}"' for name in confused.plan.confirm)
    after = analyse(make_model(), [*cart.runs, *made], confirm=locked).verdict
    assert after.verdict is Answer.NAMED
    assert [list(names) for names in after.confidence_set] == [[cart.law]]


@pytest.mark.nightly
def test_the_chosen_run_is_never_worse_than_a_repetition(confused: Analysis) -> None:
    for number in (DRAG, 10):
        analysis = confused
        if number != DRAG:
            one = make_cart(number)
            analysis = analyse(make_model(), one.runs, allowed=one.allowed)
        best, *others = _proposal(analysis).options
        assert all(best.outcome.right >= other.outcome.right for other in others)
        assert any(one.planned.is_repeat for one in (best, *others))


def test_the_probability_is_stated_with_its_error_and_never_certain(confused: Analysis) -> None:
    for table in confused.verdict.next_runs:
        assert 0.0 < float(str(table["probability_right"])) <= 0.99
        assert 0.0 < float(str(table["probability_error"])) < 0.1
    proposal = _proposal(confused)
    assert sum(one.weight for one in proposal.hypotheses) == pytest.approx(1.0)
    assert proposal.hypotheses[-1].is_else
    assert proposal.before < proposal.after_times.right
    assert "it makes a right verdict more probable, from about" in confused.verdict.next_run
    json.dumps(list(confused.verdict.next_runs))


def test_where_no_allowed_run_changes_the_probabilities_none_is_proposed(cart: SmallCart) -> None:
    force = float(np.mean([run.inputs["force"].mean() for run in cart.runs]))
    model = make_model()
    twins = model.with_effects([model.port_effects[2], effects.offset("push", size=0.5)])
    runs = make_cart(2).runs
    narrow = Allowed.model_validate({"inputs": {"force": {"low": force, "high": force + 1e-3}}})
    verdict = analyse(twins, runs, allowed=narrow).verdict
    assert len(verdict.confidence_set) == 2
    assert verdict.next_run == ""


@pytest.mark.nightly
def test_where_none_of_the_explanations_is_right_no_run_separates_them() -> None:
    verdict = analyse(axis_model(), measured_runs(disturbance=4.0)).verdict
    assert (verdict.verdict, verdict.next_run) == (Answer.UNNAMED, "")
    assert verdict.probabilities[-1] == {"effects": ["none of these"], "probability": 1.0}


def test_without_a_gap_there_is_no_next_run() -> None:
    analysis = analyse(axis_model(), measured_runs())
    assert analysis.verdict.verdict is Answer.NO_GAP
    assert analysis.proposal is None
    assert analysis.verdict.next_run == ""


def test_before_a_decision_the_effects_with_the_best_scores_are_the_explanations() -> None:
    findings = analyse_machine(axis_model(), measured_runs(), [], 0, lambda _: None)
    assert findings.decision is None
    found, _ = hypotheses_of(findings)
    assert [one.name for one in (found[0], found[-1])] == [NO_EFFECT, SOMETHING_ELSE]
    assert sum(one.weight for one in found) == pytest.approx(1.0)


def _prediction(mean: float, spread: float = 0.0) -> Prediction:
    return Prediction(
        mean=np.array([mean, 0.0]),
        slopes=np.zeros((2, 1)),
        shared=np.array([[spread], [0.0]]),
        starts=np.zeros((2, 0)),
        errors=np.zeros((2, 0)),
        excess=1.0,
        channel=np.zeros(2, dtype=np.intp),
        mean_rows=np.zeros(2),
        sd_rows=np.ones(2),
    )


def test_the_separation_is_that_of_box_and_hill_with_one_vote() -> None:
    found = separation_of([_prediction(0.0), _prediction(3.0)], [0.5, 0.5])
    assert found.distances[0, 1] == pytest.approx(3.0)
    assert found.divergence == pytest.approx(0.25 * 9.0)
    # One minus the overlap (Bhattacharyya) of two normal distributions three deviations apart.
    assert found.votes == pytest.approx(0.5 * (1.0 - math.exp(-9.0 / 8.0)))
    wide = separation_of([_prediction(0.0, 2.0), _prediction(3.0, 2.0)], [0.5, 0.5])
    assert wide.distances[0, 1] == pytest.approx(3.0 / math.sqrt(5.0))


def test_a_width_separates_too_but_no_run_has_more_than_one_vote() -> None:
    found = separation_of([_prediction(0.0), _prediction(0.0, 1e3)], [0.5, 0.5])
    assert found.distances[0, 1] == pytest.approx(0.0)
    assert found.divergence > 1e5
    assert found.votes == pytest.approx(0.5)


def _planned(
    allowed: Mapping[str, object], runs: list[Run] | None = None, most: int = 200
) -> list[PlannedRun]:
    found = runs or small_runs()
    return planned_runs(MODEL, found, {}, Allowed.model_validate(allowed), most=most)


def test_without_a_declaration_measured_runs_are_repeated_and_scaled_within_their_range() -> None:
    runs = small_runs()
    planned = _planned({}, runs)
    greatest = max(float(np.abs(run.inputs["power"]).max()) for run in runs)
    assert [one.is_repeat for one in planned[: len(runs)]] == [True] * len(runs)
    assert all(np.abs(one.run.inputs["power"]).max() <= greatest * (1 + 1e-9) for one in planned)
    assert any("times -1" in one.words for one in planned)
    assert {one.run.inputs["power"].size for one in planned} == {60}


def test_inputs_durations_and_starts_are_chosen_within_what_is_allowed() -> None:
    planned = _planned(
        {
            "inputs": {"power": {"low": 0.0, "high": 2.0, "shapes": ["step", "sine"], "amplitudes": [0.5]}},
            "starts": {"first": {"low": 0.0, "high": 1.0}},
            "duration_s": [4.0, 8.0],
            "forbidden": ["run*"],
        }
    )
    assert {one.shape for one in planned} == {"step", "sine"}
    assert {one.times_s.size for one in planned} == {40, 80}
    assert {one.starts["first"] for one in planned} == {0.0, 0.5, 1.0}
    assert all(
        one.run.inputs["power"].min() >= 0.5 and one.run.inputs["power"].max() <= 1.5 for one in planned
    )
    begin = next(one for one in planned if one.starts["first"] == 1.0)
    # A start that a channel measures is its first reading.
    assert MODEL.run_parameters[0].nominal_in(begin.run) == 1.0


def test_a_declared_limit_excludes_repetitions_beyond_it() -> None:
    assert not _planned({"inputs": {"power": {"low": -0.01, "high": 0.01, "shapes": ["repeat"]}}})


def test_few_runs_are_drawn_from_every_shape() -> None:
    limits = {"low": -3.0, "high": 3.0}
    many = _planned({"inputs": {"power": limits}}, small_runs(samples=40, count=50), most=40)
    assert len(many) <= 40
    assert {one.shape for one in many} == {"repeat", "step", "ramp", "sine", "sweep", "multi_sine", "square"}
    assert 3 <= sum(one.is_repeat for one in many) <= 10


def test_the_stated_duration_is_that_of_the_run() -> None:
    steps: Mapping[str, object] = {"power": {"low": 0.0, "high": 2.0, "shapes": ["step"]}}
    long = _planned({"inputs": steps, "forbidden": ["*"], "duration_s": [5.0, 600.0]})
    assert {one.times_s.size for one in long} == {50, 4000}
    assert all(f" for {one.times_s.size * one.step_s:g} s" in one.words for one in long)


@pytest.mark.parametrize("duration_s", [[0.5, 1.0], [600.0]])
def test_durations_that_no_run_can_have_are_refused(duration_s: list[float]) -> None:
    steps: Mapping[str, object] = {"power": {"low": 0.0, "high": 2.0, "shapes": ["step"]}}
    allowed = {"inputs": steps, "duration_s": duration_s}
    assert not _planned(allowed)
    with pytest.raises(ConfigError, match="a run has 30 to 4000 samples, 3 to 400 s"):
        require_durations(MODEL, small_runs(), Allowed.model_validate(allowed))


def test_no_planned_run_is_longer_than_allowed() -> None:
    planned = _planned({"duration_s": [3.0, 4.05]})
    assert {one.times_s.size for one in planned} == {30, 40}


def test_corners_of_many_ranges_are_drawn_before_they_are_built() -> None:
    names = [f"c{number}" for number in range(80)]
    model = replace(MODEL, condition_units=dict.fromkeys(names, "1"))
    allowed = Allowed.model_validate({"conditions": {name: {"low": 0.0, "high": 1.0} for name in names}})
    planned = planned_runs(model, small_runs(count=1), {}, allowed, most=10)
    assert len({one.words for one in planned}) == 10


def test_a_rate_excludes_jumps() -> None:
    limits = {"low": -1.0, "high": 1.0, "shapes": ["step", "ramp"], "rate": 0.5}
    shapes = {one.shape for one in _planned({"inputs": {"power": limits}, "forbidden": ["*"]})}
    assert shapes == {"ramp"}


@pytest.mark.parametrize("shape", ["step", "ramp", "sine", "sweep", "multi_sine", "square"])
def test_shapes_use_their_amplitude_and_stay_inside(shape: str) -> None:
    times_s = 0.1 * np.arange(200.0)
    limits = InputRange(low=-2.0, high=2.0)
    for share in MACHINES.planned.amplitude_shares:
        values = shaped(shape, limits, 2.0 * share, 5.0, times_s)
        assert values is not None
        assert np.abs(values).max() == pytest.approx(2.0 * share, rel=0.02)
    assert shaped(shape, limits, 2.1, 5.0, times_s) is None


@pytest.mark.nightly
def test_a_range_of_a_channel_excludes_runs_that_leave_it(cart: SmallCart) -> None:
    allowed = Allowed.model_validate({**WIDE, "channels": {"speedometer": {"low": -0.5, "high": 2.5}}})
    proposal = _proposal(analyse(make_model(), cart.runs, allowed=allowed))
    for option in proposal.options:
        for one in option.predictions:
            assert one.mean_rows.min() >= -0.5
            assert one.mean_rows.max() <= 2.5


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[inputs.power]\nlow = 1\nhigh = 0\n", "low = 1 is above high = 0"),
        ("[inputs.power]\nlow = 0\nhigh = 1\nshapes = ['stair']\n", "inputs.power.shapes"),
        ("speed = 3\n", "speed: Extra inputs"),
        ("[inputs", "is not valid TOML"),
    ],
)
def test_a_mistake_in_the_file_is_one_sentence(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "allowed.toml"
    path.write_text(text)
    with pytest.raises(ConfigError, match=words):
        read_allowed(path)


def test_a_name_that_the_model_does_not_have_is_refused() -> None:
    allowed = Allowed.model_validate({"starts": {"speed": {"low": 0.0, "high": 1.0}}})
    with pytest.raises(ConfigError, match=r"\[starts.speed\]: model body has no such name; there are first"):
        allowed.require_names(MODEL)


def test_the_command_takes_a_file_for_machines_only(command: Command, tmp_path: Path) -> None:
    data, file = tmp_path / "runs.csv", tmp_path / "allowed.toml"
    data.write_text(table_text(small_runs(), time="time [s]"))
    file.write_text("[inputs.pressure]\nlow = 0\nhigh = 1\n")
    model = tmp_path / "machine.py"
    model.write_text(
        "from tests.rover_hil.gap.small_machine import MODEL\n\n\ndef make():\n    return MODEL\n"
    )
    out = str(tmp_path / "out")
    assert command("gap", f"{model}:make", str(data), "--out", out, "--allowed", str(file)) == 2
    assert_one_sentence(command.error, "[inputs.pressure]: model body has no such name")
    assert command("gap", "side-slope", str(data), "--out", out, "--allowed", str(file)) == 2
    assert_one_sentence(command.error, "--allowed: side-slope is no StateModel")
    missing = str(tmp_path / "none.toml")
    assert command("gap", f"{model}:make", str(data), "--out", out, "--allowed", missing) == 2
    assert_one_sentence(command.error, "cannot read the allowed runs")


def test_the_file_holds_inputs_and_predictions_and_is_data_once_measured(
    cart: SmallCart, confused: Analysis, tmp_path: Path
) -> None:
    write_results(tmp_path, confused, "cart.py:make", "2026-11-22")
    path = tmp_path / NEXT_RUN_NAME
    head, *rows = path.read_text().splitlines()
    names = head.split(",")
    assert names[:3] == ["run", "time [s]", "force [N]"]
    assert "speedometer by something else high [m/s]" in names
    best = _proposal(confused).options[0].planned
    assert len(rows) == best.times_s.size
    table = {name: [row.split(",")[index] for row in rows] for index, name in enumerate(names)}
    low, high = (
        np.array(table[f"speedometer by quadratic_drag {side} [m/s]"], dtype=float)
        for side in ("low", "high")
    )
    made = cart.made(best, np.random.default_rng(8)).measured["speedometer"]
    assert np.mean((made >= low) & (made <= high)) > 0.8
    lines = [f"{row},{value:.6f}" for row, value in zip(rows, made, strict=True)]
    path.write_text("\n".join([f"{head},speedometer [m/s]", *lines]))
    (run,) = read_table(make_model(), path)
    assert run.inputs["force"] == pytest.approx(best.run.inputs["force"], abs=1e-4)
    none = replace(confused, proposal=None)
    write_results(tmp_path, none, "cart.py:make", "2026-11-22")
    assert not path.exists()


def test_the_page_shows_the_next_run(confused: Analysis) -> None:
    page = report_text(confused)
    assert "<h2>The next run</h2>" in page
    assert 'alt="speedometer in the next run"' in page
    assert _proposal(confused).options[0].planned.words in page
    assert "something else" in page
    assert len(next_run_text(_proposal(confused)).splitlines()) > 30
