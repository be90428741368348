"""The how-to on simulators of your own, step by step as written, with the examples that it names."""

import json
import re
import runpy
import shlex
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from rover_hil.app.app import main
from tests.rover_hil.command import PROGRAM
from tests.rover_hil.gap.gap_data import EXAMPLES

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]

PAGE = Path(__file__).resolve().parents[3] / "docs/how-to/gap_own_simulator.md"
COMMAND = re.compile(r"^(python|rover-hil) .*$", re.MULTILINE)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Do what the page says, in its order."""
    folder = tmp_path_factory.mktemp("simulator")
    shutil.copytree(EXAMPLES, folder, dirs_exist_ok=True)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        for match in COMMAND.finditer(PAGE.read_text("utf-8")):
            words = shlex.split(match[0])
            if words[0] == "python":
                runpy.run_path(words[1])
                continue
            patch.setattr(sys, "argv", words)
            with pytest.raises(SystemExit) as ended:
                main()
            assert not ended.value.code
    return folder


def verdict_in(folder: Path) -> dict[str, object]:
    verdict = json.loads((folder / "verdict.json").read_text())
    assert isinstance(verdict, dict)
    return verdict


def test_the_friction_is_named_with_its_size(folder: Path) -> None:
    verdict = verdict_in(folder / "first")
    assert verdict["verdict"] == "NAMED"
    assert verdict["confidence_set"] == [["dry_friction"]]
    level = json.loads((folder / "first" / "verdict.json").read_text())["effects"][0]["parameters"]["level"]
    damping = 0.051**2 / 0.6 + 0.0166667
    assert level["ci95"][0] < 0.0125 / damping < level["ci95"][1]
    assert level["value"] == pytest.approx(0.6, abs=0.05)
    plan = json.loads((folder / "first" / "plan.json").read_text())
    assert (len(plan["discover"]), len(plan["confirm"])) == (9, 3)


def test_the_model_file_has_the_interval_of_the_verdict(folder: Path) -> None:
    level = json.loads((folder / "first" / "verdict.json").read_text())["effects"][0]["parameters"]["level"]
    model = tomllib.loads((folder / "first" / "model.toml").read_text())
    assert model["effects"]["dry_friction"]["level"]["ci95"] == level["ci95"]


def test_with_the_friction_nothing_is_left(folder: Path) -> None:
    assert verdict_in(folder / "second")["verdict"] == "NO_GAP"


def test_without_the_effect_it_is_an_equation(folder: Path) -> None:
    text = (folder / "my_axis.py").read_text()
    start, end = (
        text.index(f'        EffectCard(\n            name="{name}"') for name in ("dry_friction", "delay")
    )
    (folder / "less.py").write_text(text[:start] + text[end:])
    done = subprocess.run(
        [*PROGRAM, "gap", "less.py:make", "axis.csv", "--out", "third"],
        cwd=folder,
        check=True,
        capture_output=True,
        text=True,
    )
    verdict = json.loads((folder / "third" / "verdict.json").read_text())
    assert verdict["verdict"] in ("UNNAMED", "PARTLY_NAMED")
    assert "sign(speed)" in verdict["unnamed"][0]["equation"]
    assert 0.3 < verdict["unnamed"][0]["closure"] < 0.5, "dry friction adds up in the speed"
    assert not verdict["unnamed"][0]["is_confirmed"]
    assert "A term that is in no list may be missing" in verdict["sentence"]
    assert "which the test runs do not confirm" in verdict["sentence"]
    assert f"Unexplained: {verdict['unnamed'][0]['equation']}" in done.stdout


def test_the_loss_of_steady_experiments_is_named_with_its_size(folder: Path) -> None:
    """Each prediction is a number; the truth loses a fifth at 100 turns a second."""
    assert verdict_in(folder / "thrust")["confidence_set"] == [["tip_loss"]]
    share = json.loads((folder / "thrust" / "verdict.json").read_text())["effects"][0]["parameters"]["share"]
    assert share["ci95"][0] < 0.002 < share["ci95"][1]
