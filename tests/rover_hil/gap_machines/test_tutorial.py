"""The tutorial of machines, step by step as written: its commands, and every block of code."""

import json
import re
import runpy
import shlex
import sys
import types
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

import rover_hil.gap as gap
from rover_hil.app.app import main
from rover_hil.gap import Run, StateModel, effects
from rover_hil.gap.machines.model_checks.linter import lint
from rover_hil.gap.machines.model_checks.model_trial import try_model
from rover_hil.gap.output import results
from rover_hil.gap.workflow import analyse

pytestmark = pytest.mark.slow

ROOT = Path(__file__).resolve().parents[3]
TUTORIAL = ROOT / "docs/tutorials/gap_machine.md"
EFFECTS = ROOT / "docs/reference/gap_effects.md"
BLOCK = re.compile(r"```python\n# (?P<title>[^\n]+)\n(?P<text>.*?)```", re.DOTALL)
COMMAND = re.compile(r"^(python|rover-hil) .*$", re.MULTILINE)
FRICTION = re.compile(r"^ *effects\.coulomb_friction\(.*\n", re.MULTILINE)


def blocks() -> dict[str, str]:
    """Return the text of every block of Python by its first line: the name of a file, or a title."""
    return {match["title"]: match["text"] for match in BLOCK.finditer(TUTORIAL.read_text("utf-8"))}


FILES = {title: text for title, text in blocks().items() if title.endswith(".py")}
ARGUMENTS = {title: text for title, text in blocks().items() if title not in FILES}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Do what the tutorial says, in its order."""
    folder = tmp_path_factory.mktemp("machine")
    for name, text in FILES.items():
        (folder / name).write_text(text)
    (folder / "less.py").write_text(FRICTION.sub("", FILES["my_machine.py"]))
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        for match in COMMAND.finditer(TUTORIAL.read_text("utf-8")):
            words = shlex.split(match[0])
            if words[0] == "python":
                runpy.run_path(words[1])
                continue
            patch.setattr(sys, "argv", words)
            with pytest.raises(SystemExit) as ended:
                main()
            assert not ended.value.code
            if "first" in words:
                # One page with its pictures is enough, they take longer than the analysis.
                patch.setattr(results, "report_text", lambda *_: "")
    return folder


def text_of(folder: Path, name: str) -> str:
    return (folder / name / "verdict.json").read_text()


def test_the_friction_is_named_with_its_size(folder: Path) -> None:
    verdict = json.loads(text_of(folder, "first"))
    assert (verdict["verdict"], verdict["confidence_set"]) == ("NAMED", [["coulomb_friction"]])
    level = verdict["effects"][0]["parameters"]["level"]
    assert level["ci95"][0] < 0.0125 < level["ci95"][1]
    assert verdict["gap"]["encoder"]["closure"] == pytest.approx(1.0, abs=0.02)
    plan = json.loads((folder / "first" / "plan.json").read_text())
    assert len(plan["confirm"]) == 2
    assert "coulomb_friction" in (folder / "first" / "report.html").read_text("utf-8")


def test_the_sentence_is_the_one_that_the_page_shows(folder: Path) -> None:
    shown = " ".join(TUTORIAL.read_text("utf-8").split())
    assert f"NAMED: {json.loads(text_of(folder, 'first'))['sentence']}" in shown


def test_with_the_friction_in_the_model_nothing_is_left(folder: Path) -> None:
    assert json.loads(text_of(folder, "second"))["verdict"] == "NO_GAP"


def test_without_the_card_there_is_no_wrong_name_and_a_draft_of_a_sign(folder: Path) -> None:
    verdict = json.loads(text_of(folder, "third"))
    assert verdict["verdict"] == "UNNAMED"
    assert verdict["draft"][0]["term"] == "torque += c sign(speed)"
    assert f"Unexplained: {verdict['unnamed'][0]['equation']}" in TUTORIAL.read_text("utf-8")
    line = next(one for one in TUTORIAL.read_text("utf-8").splitlines() if one.startswith("effects.term("))
    assert line in (folder / "third" / "draft_effects.py").read_text()


def test_the_force_of_a_motion_shows_its_friction(folder: Path) -> None:
    verdict = json.loads(text_of(folder, "drive"))
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
    factory = loaded(FILES[name])["make"]
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
    model = replace(make("my_machine.py"), **arguments)  # type: ignore[arg-type]
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


@pytest.mark.slow
def test_the_vehicle_of_the_page_tells_its_curvature() -> None:
    verdict = analyse(make("vehicle.py"), [driven(number, 0.48) for number in range(8)]).verdict
    assert (verdict.verdict, verdict.confidence_set) == ("NAMED", [["curvature"]]), verdict.sentence
    low, high = verdict.base_parameters[0].ci95
    assert low < 0.48 < high


def test_the_reference_lists_every_effect() -> None:
    rows = re.findall(r"^\| `(\w+)\(", EFFECTS.read_text("utf-8"), re.MULTILINE)
    assert sorted(rows) == sorted(effects.__all__)
