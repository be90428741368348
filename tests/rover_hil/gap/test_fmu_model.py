"""A functional mock-up unit in the analysis of machines: what is checked before, and how it is reported."""

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from drivers.errors import ConfigError
from rover_hil.gap.data.cut import cut_runs, without_warm_up
from rover_hil.gap.decision.analysis import analyse_machine
from rover_hil.gap.decision.verdict import decide_machine
from rover_hil.gap.model_checks.linter import lint
from rover_hil.gap.model_checks.model_trial import try_model
from rover_hil.gap.output.extended_machine import extend_model
from rover_hil.gap.output.model_file import ModelFile, Number, Provenance
from rover_hil.gap.verdict import Answer
from sim_backends.fmu.example.build import HERE
from sim_backends.fmu.model import UnitModel
from sim_backends.fmu.read import read_unit_model
from sim_backends.models.interface import Machine, Model, Run
from sim_backends.state_model.model import has_ports
from tests.fmu_unit import TOML, needs_a_unit, unit_folder
from tests.rover_hil.command import Command, assert_one_sentence

pytestmark = needs_a_unit
CODE = (HERE / "axis.c").read_text("utf-8")
COUNT = 60


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Iterator[UnitModel]:
    found = read_unit_model(unit_folder(tmp_path_factory.mktemp("unit")))
    yield found
    found.workers.close()


def runs_of(model: Model, *, count: int = 6, sigma: float = 0.005) -> list[Run]:
    """Return runs of the unit itself, with another damping and the noise of the sensor."""
    rng = np.random.default_rng(4)
    found = []
    for index in range(count):
        voltage = np.repeat(rng.uniform(-6.0, 6.0, 6), 10)
        run = Run(
            name=f"run.{index}",
            conditions={},
            inputs={"voltage": voltage},
            measured={"encoder": np.zeros(COUNT)},
        )
        start = {f"first_speed@{run.name}": rng.normal(0.0, 2.0)}
        (table,) = model.predict([run], {"damping": 0.022, **start}, {})
        run.measured["encoder"][:] = table["encoder"] + rng.normal(0.0, sigma, COUNT)
        found.append(run)
    return found


def test_a_unit_is_a_machine_without_ports(model: UnitModel) -> None:
    assert isinstance(model, Machine)
    assert not has_ports(model)


def test_without_a_gap_nothing_is_named(model: UnitModel) -> None:
    runs = runs_of(model)
    found = analyse_machine(model, runs[:4], runs[4:], 0, lambda _: None)
    verdict = decide_machine(found)
    assert verdict.verdict is Answer.NO_GAP
    assert (found.tracked, found.drafts) == (None, ())
    damping = found.size("", "damping")
    assert damping.low < 0.022 < damping.high


def test_the_linter_shows_what_the_inputs_can_show(model: UnitModel) -> None:
    report = lint(model, runs_of(model))
    assert report.problems == ()
    assert [one.name for one in report.cards] == ["coulomb_friction", "push", "wrong_inertia"]
    assert [one.name for one in report.run_unknowns] == ["first_angle", "first_speed"]


def test_the_time_of_a_simulation_is_reported(model: UnitModel) -> None:
    (note,) = try_model(model, runs_of(model))
    assert note.startswith("one simulation of all 6 runs takes ")
    assert "an analysis needs about 500: about " in note


def test_an_effect_becomes_a_part_of_the_model(model: UnitModel) -> None:
    numbers = {
        "coulomb_friction": {"level": Number(value=0.012, unit="N.m", sd=0.001)},
        "wrong_inertia": {"error": Number(value=0.001, unit="kg.m2", sd=0.0001)},
    }
    origin = Provenance(date="", verdict="NAMED", data_sha256="", plan_sha256="", seed=0)
    file = ModelFile(base="axis.toml", provenance=origin, parameters={}, effects=numbers)
    extended = extend_model(model, file)
    assert isinstance(extended, Machine)
    assert [card.name for card in extended.effects] == ["push"]
    runs = runs_of(model)[:1]
    effects = {"coulomb_friction": {"level": 0.012}, "wrong_inertia": {"error": 0.001}}
    (expected,) = model.predict(runs, {}, effects)
    (found,) = extended.predict(runs, {}, {})
    assert np.array_equal(found["encoder"], expected["encoder"])
    (other,) = extended.predict(runs, {"coulomb_friction.level": 0.0, "wrong_inertia.error": 0.0}, {})
    assert np.array_equal(other["encoder"], model.predict(runs, {}, {})[0]["encoder"])


def test_a_unit_cannot_begin_in_the_middle_but_may_warm_up(model: UnitModel) -> None:
    runs = runs_of(model)
    with pytest.raises(ConfigError, match="--cut: only a StateModel"):
        cut_runs(model, runs, 1.2)
    warm = without_warm_up(model, runs, 0.4)
    assert np.isnan(warm[0].measured["encoder"][1:10]).all()
    assert np.isfinite(warm[0].measured["encoder"][10:]).all()


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (
            "return advance(axis, duration) ? fmi2OK : fmi2Discard;",
            "return now > 0.5 ? fmi2Error : advance(axis, duration) ? fmi2OK : fmi2Discard;",
            "from sample 15 of 60 on, at nominal parameters: at 0.52 s fmi2DoStep failed with status 3",
        ),
        (
            "axis->value[SPEED] = axis->value[FIRST_SPEED];",
            "axis->value[SPEED] = 0.1 * (rand() % 100);",
            "is not deterministic",
        ),
        (
            "value[TIME] += h;",
            "value[TIME] += h; value[ANGLE] = NAN;",
            "at 0.04 s it returns values that are not finite",
        ),
    ],
)
def test_a_unit_that_fails_at_nominal_parameters(
    model: UnitModel, tmp_path: Path, old: str, new: str, words: str
) -> None:
    assert old in CODE
    bad = read_unit_model(unit_folder(tmp_path, code=CODE.replace(old, new)))
    with pytest.raises(ConfigError) as raised:
        try_model(bad, runs_of(model))
    assert words in str(raised.value)
    bad.workers.close()


def write_data(path: Path, runs: list[Run]) -> Path:
    lines = ["run,voltage [V],encoder [rad]"]
    for run in runs:
        pairs = zip(run.inputs["voltage"], run.measured["encoder"], strict=True)
        lines += [f"{run.name},{volts:.4f},{angle:.5f}" for volts, angle in pairs]
    path.write_text("\n".join(lines))
    return path


def test_the_command_takes_the_file_of_a_unit(model: UnitModel, command: Command, tmp_path: Path) -> None:
    unit, data = unit_folder(tmp_path), write_data(tmp_path / "axis.csv", runs_of(model))
    assert command("gap", "check", str(unit), str(data), "--json") == 0
    assert len(json.loads(command.out)["cards"]) == 3
    unit.write_text(TOML.replace("[signals]", "[signal]"), "utf-8")
    assert command("gap", "check", str(unit), str(data)) == 2
    assert_one_sentence(command.error, "signal is no key of this file")


def test_one_input_is_missing_in_the_data(model: UnitModel, command: Command, tmp_path: Path) -> None:
    unit, data = unit_folder(tmp_path), write_data(tmp_path / "axis.csv", runs_of(model))
    data.write_text(data.read_text().replace("voltage [V]", "volts [V]", 1))
    out = tmp_path / "out"
    assert command("gap", str(unit), str(data), "--out", str(out)) == 1
    assert "has no column 'voltage' [V]; it has " in command.out
    assert not out.exists()
