"""Files of an analysis of a machine: its model file, the model with it, and the draft effects."""

import json
import tomllib
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from rover_hil.gap import StateModel, effects
from rover_hil.gap.findings import Analysis
from rover_hil.gap.output.draft_file import DRAFT_NAME, draft_lines
from rover_hil.gap.output.extended_machine import ExtendedMachine, extend_model
from rover_hil.gap.output.model_file import (
    ExtendedModel,
    ModelFile,
    Number,
    Provenance,
    model_file_text,
    read_model_file,
)
from rover_hil.gap.output.results import RESULT_NAMES, write_results
from rover_hil.gap.verdict import Answer
from rover_hil.gap.workflow import analyse
from tests.rover_hil.gap.gap_models import Cart
from tests.rover_hil.gap.page_motor import make_motor, measure_motor

pytestmark = pytest.mark.nightly

EQUATION = "torque += c sign(speed)"


@pytest.fixture(autouse=True)
def _no_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rover_hil.gap.output.report.draw_pictures", lambda _: [])


@pytest.fixture(scope="module")
def named() -> Analysis:
    return analyse(make_motor(), measure_motor(coulomb_nm=0.2))


@pytest.fixture(scope="module")
def unnamed() -> Analysis:
    model = make_motor()
    return analyse(model.with_effects([model.port_effects[1]]), measure_motor(coulomb_nm=0.2))


def _written(folder: Path, analysis: Analysis) -> ModelFile:
    write_results(folder, analysis, "motor.py:make", "today")
    return read_model_file(folder / "model.toml")


def test_the_model_file_holds_the_numbers_of_the_verdict(named: Analysis, tmp_path: Path) -> None:
    _written(tmp_path, named)
    assert not (tmp_path / DRAFT_NAME).exists()
    verdict = json.loads((tmp_path / "verdict.json").read_text())
    model = tomllib.loads((tmp_path / "model.toml").read_text())
    (effect,) = verdict["effects"]
    level = model["effects"]["coulomb_friction"]["level"]
    assert {name: level[name] for name in ("value", "unit", "ci95")} == effect["parameters"]["level"]
    assert level["sd"] == pytest.approx((level["ci95"][1] - level["ci95"][0]) / 2.0 / 1.96, rel=1e-3)
    assert set(model["parameters"]) == {"inertia", "viscous"}
    assert model["parameters"]["inertia"]["value"] == pytest.approx(0.1, rel=0.02)
    assert 0.0 < model["parameters"]["inertia"]["sd"] < 0.01


def test_an_effect_in_the_model_closes_the_gap(named: Analysis, tmp_path: Path) -> None:
    extended = extend_model(make_motor(), _written(tmp_path, named))
    assert isinstance(extended, ExtendedMachine)
    assert extended.active == ("coulomb_friction",)
    assert [card.name for card in extended.effects] == ["quadratic_drag"]
    assert [item.name for item in extended.parameters] == ["inertia", "viscous", "coulomb_friction.level"]
    again = analyse(extended, measure_motor(coulomb_nm=0.2, seed=7))
    assert again.verdict.verdict is Answer.NO_GAP
    kept = _written(tmp_path / "again", again)
    assert kept.effects["coulomb_friction"]["level"].value == pytest.approx(0.2, abs=0.02)


def test_an_extended_machine_predicts_what_was_fitted(named: Analysis, tmp_path: Path) -> None:
    file = _written(tmp_path, named)
    extended, base, runs = extend_model(make_motor(), file), make_motor(), measure_motor(2)
    assert isinstance(extended, StateModel)
    values = {name: number.value for name, number in file.parameters.items()} | {"first_speed@r1": 0.3}
    level = file.effects["coulomb_friction"]["level"].value
    fitted: dict[str, dict[str, float]] = {"coulomb_friction": {"level": level}}
    start = {"first_speed@r1": 0.3}
    expected = base.predict(runs, values, fitted)
    for found, wanted in zip(extended.predict(runs, start, {}), expected, strict=True):
        np.testing.assert_array_equal(found["speed"], wanted["speed"])
    series = extended.trajectories(runs, start, {})
    np.testing.assert_array_equal(series[1]["speed"], expected[1]["speed"])
    more = extended.predict(
        runs, {"coulomb_friction.level": 2.0 * level}, {"quadratic_drag": {"coefficient": 0.1}}
    )
    both = base.predict(
        runs,
        {**values, "first_speed@r1": runs[1].measured["speed"][0] * 0.0},
        {"coulomb_friction": {"level": 2.0 * level}, "quadratic_drag": {"coefficient": 0.1}},
    )
    np.testing.assert_array_equal(more[1]["speed"], both[1]["speed"])
    force = {"r0": {"torque": np.full(60, 0.1)}}
    np.testing.assert_array_equal(
        extended.forced(force).predict(runs, start, {})[0]["speed"],
        base.forced(force).predict(runs, values, fitted)[0]["speed"],
    )


def test_an_effect_in_the_model_deviates_in_single_runs_as_it_did_before() -> None:
    base, runs = make_motor(), measure_motor(2)
    extended = extend_model(base, _file("coulomb_friction", level=0.2))
    item = next(one for one in extended.parameters if one.name == "coulomb_friction.level")
    deviation = {item.deviation_in(runs[1]).text: 0.1}
    found = extended.predict(runs, deviation, {})
    for run, one, level in zip(runs, found, (0.2, 0.3), strict=True):
        (wanted,) = base.predict([run], {}, {"coulomb_friction": {"level": level}})
        np.testing.assert_allclose(one["speed"], wanted["speed"], atol=1e-12)


def _file(effect: str, **numbers: float) -> ModelFile:
    source = Provenance(date="", verdict="NAMED", data_sha256="", plan_sha256="", seed=0)
    units = {"coefficient": "N m", "level": "N m", "error": "kg m^2"}
    table = {name: Number(value=value, unit=units[name], sd=0.01) for name, value in numbers.items()}
    return ModelFile(base="m", provenance=source, parameters={}, effects={effect: table})


def test_a_draft_term_in_the_model_may_be_called_by_its_equation(tmp_path: Path) -> None:
    model = make_motor().with_effects(
        [effects.term("torque", source="speed", form="sign", size=0.1, scale=10.0)]
    )
    path = tmp_path / "model.toml"
    path.write_text(model_file_text(_file(EQUATION, coefficient=-0.2)))
    extended = extend_model(model, read_model_file(path))
    assert isinstance(extended, ExtendedMachine)
    assert extended.active == (EQUATION,)
    assert analyse(extended, measure_motor(coulomb_nm=0.2)).verdict.verdict is Answer.NO_GAP
    # The search for missing terms compares with all forms, the active one among them.
    assert analyse(extended, measure_motor(coulomb_nm=0.2, cubic=0.03)).verdict.verdict is Answer.UNNAMED


def test_a_released_parameter_is_no_longer_uncertain() -> None:
    model = make_motor().with_effects([effects.wrong_parameter("inertia", size=0.05)])
    extended = extend_model(model, _file("wrong_inertia", error=0.05))
    assert {item.name: item.prior_sd for item in extended.parameters}["inertia"] == 0.0
    runs = measure_motor(1)
    expected = make_motor().predict(runs, {"inertia": 0.15}, {})
    np.testing.assert_allclose(extended.predict(runs, {}, {})[0]["speed"], expected[0]["speed"])


def test_a_model_without_equations_is_extended_as_before() -> None:
    source = Provenance(date="", verdict="NAMED", data_sha256="", plan_sha256="", seed=0)
    file = ModelFile(base="m", provenance=source, parameters={}, effects={"slope_failure": {}})
    assert isinstance(extend_model(Cart(), file), ExtendedModel)


def test_drafts_can_be_imported_into_the_model(unnamed: Analysis, tmp_path: Path) -> None:
    _written(tmp_path, unnamed)
    assert DRAFT_NAME in RESULT_NAMES
    found = SimpleNamespace()
    exec((tmp_path / DRAFT_NAME).read_text(), found.__dict__)  # noqa: S102 (as a user's model imports it)
    model = make_motor().with_effects(found.DRAFT[:1])
    assert model.effects[0].name == "torque_sign_speed"
    assert len(found.DRAFT) == len(unnamed.verdict.draft)
    again = analyse(model, measure_motor(coulomb_nm=0.2, seed=3))
    assert again.verdict.effects[0].name == "torque_sign_speed"
    assert again.verdict.effects[0].parameters["coefficient"].value == pytest.approx(-0.2, abs=0.03)


def test_names_of_drafts_differ() -> None:
    analysis = SimpleNamespace(
        draft=[{"term": term, "code": "effects.term(1)"} for term in ("a += c x^2", "a += c x (2)")]
    )
    assert draft_lines(analysis) == ['effects.term(1, name="a_x_2")', 'effects.term(1, name="a_x_2_2")']  # type: ignore[arg-type]


def test_drafts_of_an_earlier_analysis_are_removed(
    unnamed: Analysis, named: Analysis, tmp_path: Path
) -> None:
    _written(tmp_path, unnamed)
    assert (tmp_path / DRAFT_NAME).exists()
    _written(tmp_path, named)
    assert not (tmp_path / DRAFT_NAME).exists()
