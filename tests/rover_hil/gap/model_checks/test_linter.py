"""What inputs can show of effects, before a measured value is compared."""

import json
from dataclasses import replace

import numpy as np
import pytest

from drivers.errors import ConfigError
from rover_hil.gap import StateModel, effects
from rover_hil.gap.model_checks.linter import LintReport, lint, require_changes
from sim_backends.models.interface import Run
from sim_backends.state_model.port_effect import PortEffect
from tests.rover_hil.gap.small_machine import MODEL, small_runs


def _with(*port_effects: PortEffect) -> StateModel:
    return replace(MODEL, port_effects=port_effects)


def _lint(*port_effects: PortEffect, runs: list[Run] | None = None) -> LintReport:
    return lint(_with(*port_effects), runs or small_runs())


def test_effects_that_act_have_a_size_in_sensor_noises() -> None:
    report = lint(MODEL, small_runs())
    assert report.problems == ()
    drag, limit = report.cards
    assert (drag.name, limit.name) == ("quadratic_drag", "saturation")
    assert drag.change > 10.0
    assert drag.standard_errors > 4.0
    assert drag.rms == pytest.approx(drag.standard_errors / np.sqrt(240.0))
    assert drag.absorbed_by == ""
    assert report.run_unknowns[0].sentence() == "first: first value of reading +- 0.5 K in each run"


def test_a_card_that_changes_nothing_is_a_problem() -> None:
    tiny = effects.quadratic_drag("heat", velocity="warmth", size=1e-9)
    report = _lint(tiny)
    assert len(report.problems) == 1
    assert report.problems[0].startswith(
        "effect quadratic_drag at its natural size changes no prediction of any run"
    )
    with pytest.raises(ConfigError, match="model body: effect quadratic_drag at its natural size changes no"):
        require_changes(_with(tiny), small_runs())
    require_changes(MODEL, small_runs())


def test_a_released_parameter_is_drawn_too() -> None:
    report = _lint(effects.wrong_parameter("loss", size=0.2))
    assert report.problems == ()
    assert report.cards[0].change > 10.0
    assert _lint(effects.wrong_parameter("loss", size=1e-9)).problems != ()


def test_a_threshold_out_of_reach_is_a_problem_with_the_range() -> None:
    report = _lint(effects.saturation("power", limits=(8.0, 12.0)))
    (problem,) = report.problems
    assert "power is -1.68 to 1.94 W" in problem
    # Every threshold it proposes works.
    inside = tuple(float(one) for one in problem.partition("limit may be ")[2].split(", "))
    assert _lint(effects.saturation("power", limits=inside)).problems == ()


def test_single_thresholds_out_of_reach_are_reported() -> None:
    report = _lint(effects.saturation("power", limits=(1.0, 8.0)))
    assert report.problems == ()
    (sentence,) = report.thresholds
    assert sentence.startswith("saturation: limit 8 W changes nothing; power is -1.68 to 1.94 W")


def test_the_threshold_of_a_state_is_compared_with_the_state() -> None:
    report = _lint(effects.overflow("heat", level="warmth", limits=(0.5, 50.0)))
    assert report.thresholds[0].startswith("overflow: limit 50 K changes nothing; warmth is")


def test_a_threshold_that_is_crossed_outwards_only_is_no_proposal() -> None:
    cooling = [replace(run, inputs={"power": np.full(60, -1.0)}) for run in small_runs()]
    (problem,) = _lint(effects.overflow("heat", level="warmth", limits=(0.2,)), runs=cooling).problems
    assert problem.endswith("and no threshold inside this range changes a prediction")


def test_a_dead_zone_wider_than_its_signal_is_reported() -> None:
    assert _lint(effects.dead_zone("power", size=0.2)).thresholds == ()
    report = _lint(effects.dead_zone("power", size=5.0))
    assert report.thresholds[0].startswith("dead_zone: half_width 5 W covers all; power is -1.68 to 1.94 W")


def test_effects_that_the_inputs_cannot_separate_are_named() -> None:
    report = _lint(
        effects.offset("heat", size=0.2, name="draught"),
        effects.asymmetric_friction("heat", velocity="warmth", size=0.2, slow=1e-4, name="leak"),
        effects.quadratic_drag("heat", velocity="warmth", size=0.2),
    )
    assert [pair.cards for pair in report.pairs] == [("draught", "leak")]
    assert (
        report.pairs[0].sentence().startswith("these inputs cannot separate draught and leak (cosine 1.00)")
    )


def test_what_base_parameters_absorb_is_taken_out_and_said() -> None:
    wide = replace(MODEL.parameters[0], prior_sd=0.5)
    model = replace(_with(effects.gain_error("power", size=0.05)), parameters=(wide, MODEL.parameters[1]))
    (card,) = lint(model, small_runs()).cards
    assert card.change > 2.0
    assert card.standard_errors < 0.2
    assert card.absorbed_by == "gain"


def test_an_effect_without_solution_is_a_problem() -> None:
    (problem,) = _lint(effects.gain_error("heat", size=1e6)).problems
    assert problem == "effect gain_error at its natural size has no solution: make it smaller"


def test_measured_values_are_used_for_starts_only() -> None:
    runs = small_runs()
    other = [
        replace(run, measured={"reading": np.concatenate((run.measured["reading"][:1], np.full(59, 7.0)))})
        for run in runs
    ]
    assert lint(MODEL, runs) == lint(MODEL, other)


def test_the_report_is_text_and_json() -> None:
    report = _lint(effects.saturation("power", limits=(1.0, 8.0)), effects.gain_error("heat", size=1e6))
    lines = report.lines()
    assert lines[0] == "Error: effect gain_error at its natural size has no solution: make it smaller."
    assert any(line.startswith("Threshold: saturation") for line in lines)
    content = json.loads(report.as_json())
    assert content["cards"][1]["change"] is None
    assert content["run_unknowns"][0]["name"] == "first"
