"""The tutorial of functional mock-up units, step by step as written."""

import json
import re
import runpy
import shlex
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from rover_hil.app.app import main
from sim_backends.fmu.example import __main__ as example
from sim_backends.fmu.unit_file import (
    ChannelEntry,
    EffectEntry,
    ParameterEntry,
    RunParameterEntry,
    UnitFile,
)
from tests.fmu_unit import needs_a_unit

pytestmark = [*needs_a_unit, pytest.mark.slow]
ROOT = Path(__file__).resolve().parents[3]
TUTORIAL = ROOT / "docs/tutorials/gap_fmu.md"
REFERENCE = ROOT / "docs/reference/gap_fmu.md"
TEXT = TUTORIAL.read_text("utf-8")
BLOCK = re.compile(r"```(?:python|toml)\n# (?P<title>[^\n]+)\n(?P<text>.*?)```", re.DOTALL)
COMMAND = re.compile(r"^(python|rover-hil) .*$", re.MULTILINE)
FILES = {match["title"]: match["text"] for match in BLOCK.finditer(TEXT)}


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
    """Do what the tutorial says, in its order."""
    folder = tmp_path_factory.mktemp("unit")
    for name, text in FILES.items():
        (folder / name).write_text(text, "utf-8")
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


def test_the_sentence_is_the_one_that_the_page_shows(folder: Path) -> None:
    assert f"NAMED: {json.loads(verdict_in(folder, 'first'))['sentence']}" in " ".join(TEXT.split())


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
def test_without_the_card_there_is_no_wrong_name(folder: Path) -> None:
    text = FILES["axis.toml"]
    first = text.index("[effects.coulomb_friction]")
    (folder / "less.toml").write_text(text[:first] + text[text.index("[effects.quadratic_drag]") :])
    run("rover-hil gap less.toml axis.csv --out third")
    verdict = json.loads(verdict_in(folder, "third"))
    assert (verdict["verdict"], verdict["draft"]) == ("UNNAMED", [])
    page = (folder / "third" / "report.html").read_text("utf-8")
    assert "Look at what the error follows below" in page
    assert "Look at the unknown force" not in page


def test_every_section_of_the_file_is_in_the_reference() -> None:
    text = REFERENCE.read_text("utf-8")
    assert [
        name for name in UnitFile.model_fields if f"`{name}`" not in text and f"[{name}" not in text
    ] == []
    for entry in (ChannelEntry, ParameterEntry, RunParameterEntry, EffectEntry):
        assert [name for name in entry.model_fields if not re.search(rf"\b{name}\b", text)] == []
