"""The tutorial of `gap`, step by step as written: its commands, and every number that it shows."""

import contextlib
import io
import json
import re
import runpy
import shlex
import sys
from pathlib import Path

import pytest

from rover_hil.app.app import main
from rover_hil.gap.output import results

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]

TEXT = (Path(__file__).resolve().parents[3] / "docs/tutorials/gap.md").read_text("utf-8")
FILE = re.compile(r"```python\n# (?P<name>\S+\.py)\n(?P<text>.*?)```", re.DOTALL)
STEP = re.compile(
    r"```\n(?P<line>(?:python|rover-hil) [^\n]*)\n```(?:(?!```).)*(?:```text\n(?P<out>.*?)```)?", re.DOTALL
)
FRICTION = re.compile(r"^ *effects\.coulomb_friction\(.*\n", re.MULTILINE)
NUMBER = re.compile(r"\d+\.\d+")
FILES = {match["name"]: match["text"] for match in FILE.finditer(TEXT)}
STEPS = {match["line"]: match["out"] or "" for match in STEP.finditer(TEXT)}


def printed(line: str) -> str:
    """Run a command of the page; returns what it prints."""
    words = shlex.split(line)
    out = io.StringIO()
    with contextlib.redirect_stdout(out), pytest.MonkeyPatch.context() as patch:
        if words[0] == "python":
            runpy.run_path(words[1])
            return Path("axis.csv").read_text("utf-8")
        patch.setattr(sys, "argv", words)
        with pytest.raises(SystemExit) as ended:
            main()
        assert not ended.value.code
    return out.getvalue()


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder in which the tutorial was done."""
    folder = tmp_path_factory.mktemp("machine")
    for name, text in FILES.items():
        (folder / name).write_text(f"# {name}\n{text}")
    (folder / "less.py").write_text(FRICTION.sub("", FILES["my_machine.py"]))
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        for number, line in enumerate(STEPS):
            (folder / f"{number}.txt").write_text(printed(line), "utf-8")
            if "first" in line.split():
                # One page with its pictures is enough, they take longer than the analysis.
                patch.setattr(results, "report_text", lambda *_: "")
    return folder


@pytest.mark.parametrize("number", range(len(STEPS)), ids=list(STEPS))
def test_a_command_prints_what_the_page_shows(folder: Path, number: int) -> None:
    out = " ".join((folder / f"{number}.txt").read_text("utf-8").split())
    shown = list(STEPS.values())[number]
    parts = [" ".join(part.split()) for part in re.split(r"^\.\.\.$", shown, flags=re.MULTILINE)]
    assert shown
    assert [part for part in parts if part not in out] == []


def test_the_draft_is_the_line_that_the_page_shows(folder: Path) -> None:
    (line,) = re.findall(r"```python\n(effects\.term\(.*)\n```", TEXT)
    assert f"{line}," in (folder / "third" / "draft_effects.py").read_text("utf-8")


def test_numbers_of_the_prose_are_in_the_files_or_in_the_outputs() -> None:
    prose = re.sub(r"```.*?```", "", TEXT, flags=re.DOTALL)
    blocks = "".join(re.findall(r"```.*?```", TEXT, flags=re.DOTALL))
    assert set(NUMBER.findall(prose)) <= set(NUMBER.findall(blocks))


def test_the_interval_contains_the_friction_of_the_program(folder: Path) -> None:
    verdict = json.loads((folder / "first" / "verdict.json").read_text())
    assert (verdict["verdict"], verdict["confidence_set"]) == ("NAMED", [["coulomb_friction"]])
    low, high = verdict["effects"][0]["parameters"]["level"]["ci95"]
    assert low < 0.0125 < high
    assert "dry = 0.0867, 0.0212, 0.0051, 0.0125" in FILES["measure.py"]
    plan = json.loads((folder / "first" / "plan.json").read_text())
    assert (len(plan["discover"]), len(plan["confirm"])) == (6, 2)


def test_the_folder_has_the_files_that_the_page_lists(folder: Path) -> None:
    listed = re.findall(r"^\| `([\w.]+\.\w+)` \|", TEXT, re.MULTILINE)
    assert sorted(listed) == sorted(path.name for path in (folder / "first").iterdir())
    assert "coulomb_friction" in (folder / "first" / "report.html").read_text("utf-8")
