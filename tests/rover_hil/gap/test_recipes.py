"""The how-to on models of machines: its commands, and every block of code; the examples of machines."""

import json
import re
import runpy
import shlex
import shutil
import sys
import types
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

import rover_hil.gap as gap
from rover_hil.app.app import main
from rover_hil.gap import Run, StateModel, effects
from rover_hil.gap.data.load import load_model
from rover_hil.gap.model_checks.linter import lint
from rover_hil.gap.model_checks.model_trial import try_model
from rover_hil.gap.output import results
from rover_hil.gap.workflow import analyse

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]

DOCS = Path(__file__).resolve().parents[3] / "docs"
EXAMPLES = DOCS / "examples/gap"
TEXT = (DOCS / "how-to/write_a_machine_model.md").read_text("utf-8")
TUTORIAL = (DOCS / "tutorials/gap.md").read_text("utf-8")
EFFECTS = DOCS / "reference/gap_effects.md"
BLOCK = re.compile(r"```python\n# (?P<title>[^\n]+)\n(?P<text>.*?)```", re.DOTALL)
COMMAND = re.compile(r"^(python|rover-hil) .*$", re.MULTILINE)
ARGUMENTS = {match["title"]: match["text"] for match in BLOCK.finditer(TEXT)}
MACHINE = next(match["text"] for match in BLOCK.finditer(TUTORIAL) if match["title"] == "my_machine.py")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Do what the page says, in its order, with the examples that it names."""
    folder = tmp_path_factory.mktemp("machine")
    shutil.copytree(EXAMPLES, folder, dirs_exist_ok=True)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        patch.setattr(results, "report_text", lambda *_: "")
        for match in COMMAND.finditer(TEXT):
            words = shlex.split(match[0])
            if words[0] == "python":
                runpy.run_path(words[1])
                continue
            patch.setattr(sys, "argv", words)
            with pytest.raises(SystemExit) as ended:
                main()
            assert not ended.value.code
    return folder


def test_the_force_of_a_motion_shows_its_friction(folder: Path) -> None:
    verdict = json.loads((folder / "drive" / "verdict.json").read_text())
    assert verdict["verdict"] == "NAMED_SET"
    assert sorted(sorted(names) for names in verdict["confidence_set"]) == [
        ["asymmetric_friction", "coulomb_friction"],
        ["coulomb_friction", "offset"],
    ]
    sizes = {one["name"]: one["parameters"] for one in verdict["effects"]}
    low, high = sizes["coulomb_friction"]["level"]["ci95"]
    assert low < 8.0 < high


def loaded(text: str) -> dict[str, object]:
    """Return the names that a block defines, with those of `rover_hil.gap` and numpy at hand."""
    module = types.ModuleType("block")
    module.__dict__.update({name: getattr(gap, name) for name in gap.__all__}, np=np)
    exec(compile(text, "block.py", "exec"), module.__dict__)  # noqa: S102
    return module.__dict__


def make(name: str) -> StateModel:
    model = load_model(f"{EXAMPLES / name}:make")
    assert isinstance(model, StateModel)
    return model


def make_axis() -> StateModel:
    """Return the model of the tutorial."""
    factory = loaded(MACHINE)["make"]
    assert callable(factory)
    model = factory()
    assert isinstance(model, StateModel)
    return model


def some_runs(model: StateModel) -> list[Run]:
    """Return runs with inputs of usual size; only first values and lengths are read of what is measured."""
    rng = np.random.default_rng(1)
    scale = 0.45 if "pump" in model.inputs else 6.0
    runs = []
    for number in range(4):
        inputs = {name: np.repeat(rng.uniform(0.1, scale, 6), 10) for name in model.inputs}
        if model.step_s is None:
            inputs["t_s"] = (4.0 if "pump" in inputs else 0.02) * np.arange(60.0)
        conditions = {name: float(rng.uniform(0.2, 0.4)) for name in model.condition_units}
        measured = {channel.name: np.full(60, 1.0) for channel in model.channels}
        runs.append(Run(name=f"run{number}", conditions=conditions, inputs=inputs, measured=measured))
    return runs


@pytest.mark.parametrize("title", ARGUMENTS)
def test_arguments_of_a_recipe_fit_the_machine(title: str) -> None:
    names = {one.name for one in fields(StateModel)}
    arguments = {name: value for name, value in loaded(ARGUMENTS[title]).items() if name in names}
    assert arguments
    model = replace(make_axis(), **arguments)  # type: ignore[arg-type]
    runs = some_runs(model)
    try_model(model, runs)
    assert lint(model.refined(runs), runs).problems == ()


@pytest.mark.parametrize(
    ("name", "effect"),
    [("tanks.py", "overflow"), ("pendulum.py", "quadratic_drag"), ("vehicle.py", "steering_lag")],
)
def test_the_models_of_recipes_work(name: str, effect: str) -> None:
    model = make(name)
    runs = some_runs(model)
    try_model(model, runs)
    report = lint(model.refined(runs), runs)
    assert report.problems == ()
    assert effect in {one.name for one in report.cards}


def driven(number: int, curvature: float) -> Run:
    """Return a drive along arcs in closed form, turning by `curvature` times the command per metre."""
    rng = np.random.default_rng(number)
    speed = np.repeat(rng.uniform(0.5, 1.8, 6), 20)
    steering = np.repeat(rng.uniform(-0.8, 0.8, 6), 20)
    turn = speed * curvature * steering
    yaw = rng.uniform(-3.0, 3.0) + 0.05 * np.concatenate(([0.0], np.cumsum(turn)))
    chord = speed * 0.05 * np.sinc(turn * 0.05 / (2.0 * np.pi))
    middle = yaw[:-1] + 0.5 * np.diff(yaw)
    x, y = (np.concatenate(([0.0], np.cumsum(chord * along(middle)))) for along in (np.cos, np.sin))
    noisy = {
        name: values[:-1] + rng.normal(0.0, sd, speed.size)
        for name, values, sd in (("x", x, 0.003), ("y", y, 0.003), ("yaw", yaw, 0.005))
    }
    times = 0.05 * np.arange(float(speed.size))
    inputs = {"speed": speed, "steering": steering, "t_s": times}
    return Run(name=f"drive{number}", conditions={}, inputs=inputs, measured=noisy)


def test_the_vehicle_of_the_page_has_another_curvature() -> None:
    verdict = analyse(make("vehicle.py"), [driven(number, 0.48) for number in range(8)]).verdict
    assert (verdict.verdict, verdict.confidence_set) == ("NAMED", [["curvature"]]), verdict.sentence
    low, high = verdict.base_parameters[0].ci95
    assert low < 0.48 < high


def test_the_reference_lists_every_effect() -> None:
    rows = re.findall(r"^\| `(\w+)\(", EFFECTS.read_text("utf-8"), re.MULTILINE)
    assert sorted(rows) == sorted(effects.__all__)
