"""The how-to on functional mock-up units, step by step as written."""

import json
import re
import runpy
import shlex
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from rover_hil.app.app import main
from sim_backends.fmu.example import __main__ as example
from tests.fmu_unit import needs_a_unit

pytestmark = [*needs_a_unit, pytest.mark.slow, pytest.mark.timeout(600)]
ROOT = Path(__file__).resolve().parents[3]
PAGE = ROOT / "docs/how-to/gap_fmu.md"
TUTORIAL = ROOT / "docs/tutorials/gap.md"
EXAMPLE = ROOT / "docs/examples/gap/axis.toml"
TEXT = PAGE.read_text("utf-8")
MEASURE = re.compile(r"```python\n# measure.py\n(.*?)```", re.DOTALL)
OUTPUT = re.compile(r"```text\n(.*?)```", re.DOTALL)
COMMAND = re.compile(r"^(python|rover-hil) .*$", re.MULTILINE)


def run(line: str) -> None:
    words = shlex.split(line)
    if words[:3] == ["python", "-m", "sim_backends.fmu.example"]:
        assert example.main(words[3:]) == ""
    elif words[0] == "python":
        runpy.run_path(words[1])
    else:
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(sys, "argv", words)
            with pytest.raises(SystemExit) as ended:
                main()
        assert not ended.value.code


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Do what the page says, in its order."""
    folder = tmp_path_factory.mktemp("unit")
    shutil.copy(EXAMPLE, folder)
    (folder / "measure.py").write_text(MEASURE.findall(TUTORIAL.read_text("utf-8"))[0], "utf-8")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        for match in COMMAND.finditer(TEXT):
            run(match[0])
        yield folder


def verdict_in(folder: Path, name: str) -> str:
    return (folder / name / "verdict.json").read_text("utf-8")


def test_the_friction_is_named_with_its_size(folder: Path) -> None:
    verdict = json.loads(verdict_in(folder, "first"))
    assert (verdict["verdict"], verdict["confidence_set"]) == ("NAMED", [["coulomb_friction"]])
    level = verdict["effects"][0]["parameters"]["level"]
    assert level["ci95"][0] < 0.0125 < level["ci95"][1]
    assert level["value"] == pytest.approx(0.0125, rel=0.05)
    assert verdict["gap"]["encoder"]["closure"] == pytest.approx(1.0, abs=0.02)
    assert verdict["warnings"] == []


def test_the_sentence_is_that_of_the_page(folder: Path) -> None:
    (shown,) = OUTPUT.findall(TEXT)
    assert " ".join(shown.split()) == f"NAMED: {json.loads(verdict_in(folder, 'first'))['sentence']}"


def test_keys_of_the_page_are_in_the_example() -> None:
    (block,) = re.findall(r"```toml\n(.*?)```", TEXT, re.DOTALL)
    example = EXAMPLE.read_text("utf-8")
    assert [line for line in block.splitlines() if line not in example] == []


def test_the_page_has_what_a_unit_can_show(folder: Path) -> None:
    page = (folder / "first" / "report.html").read_text("utf-8")
    assert "coulomb_friction" in page
    assert "Dry friction opposes the motion with a constant torque." in page
    assert "encoder in run run" in page
    assert "speed" in page
    assert "Unknown force at" not in page
    assert "other weighting" not in page


def test_with_the_friction_in_the_model_nothing_is_left(folder: Path) -> None:
    assert json.loads(verdict_in(folder, "second"))["verdict"] == "NO_GAP"


@pytest.mark.nightly
def test_without_the_effect_there_is_no_wrong_name(folder: Path) -> None:
    text = EXAMPLE.read_text("utf-8")
    first = text.index("[effects.coulomb_friction]")
    (folder / "less.toml").write_text(text[:first] + text[text.index("[effects.quadratic_drag]") :])
    run("rover-hil gap less.toml axis.csv --out third")
    verdict = json.loads(verdict_in(folder, "third"))
    assert (verdict["verdict"], verdict["draft"]) == ("UNNAMED", [])
    page = (folder / "third" / "report.html").read_text("utf-8")
    assert "Look at what the error follows below" in page
    assert "Look at the unknown force" not in page
