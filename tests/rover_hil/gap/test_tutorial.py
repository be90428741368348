"""The tutorial of `gap`, step by step as written: its commands, and every number that it shows."""

import json
import re
from pathlib import Path

import pytest

from rover_hil.gap.output import results
from tests.rover_hil.pages import Shown, blocks_of, do, read_page, unknown_numbers

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]

TEXT = read_page("docs/tutorials/gap.md")
FRICTION = re.compile(r"^ *effects\.coulomb_friction\(.*\n", re.MULTILINE)
MODEL, PROGRAM = (block for info, block in blocks_of(TEXT) if info == "python" and block.startswith("# m"))


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[Shown]]:
    """Return the folder in which the tutorial was done, and what the page shows."""
    folder = tmp_path_factory.mktemp("machine")
    begin, rest = TEXT.split("## 5.")
    shown = do(begin, folder)
    (folder / "less.py").write_text(FRICTION.sub("", MODEL))
    with pytest.MonkeyPatch.context() as patch:
        # One page with its pictures is enough, they take longer than the analysis.
        patch.setattr(results, "report_text", lambda *_: "")
        return folder, shown + do(rest, folder)


@pytest.fixture
def folder(done: tuple[Path, list[Shown]]) -> Path:
    """Return the folder in which the tutorial was done."""
    return done[0]


def test_commands_print_what_the_page_shows(done: tuple[Path, list[Shown]]) -> None:
    assert len(done[1]) == 5
    assert [(each.name, part) for each in done[1] for part in each.missing()] == []


def test_the_draft_is_the_line_that_the_page_shows(folder: Path) -> None:
    (line,) = re.findall(r"```python\n(effects\.term\(.*)\n```", TEXT)
    assert f"{line}," in (folder / "third" / "draft_effects.py").read_text("utf-8")


def test_numbers_of_the_prose_are_in_the_files_or_in_the_outputs(folder: Path) -> None:
    assert unknown_numbers(TEXT, folder) == set()


def test_the_interval_contains_the_friction_of_the_program(folder: Path) -> None:
    verdict = json.loads((folder / "first" / "verdict.json").read_text())
    assert (verdict["verdict"], verdict["confidence_set"]) == ("NAMED", [["coulomb_friction"]])
    low, high = verdict["effects"][0]["parameters"]["level"]["ci95"]
    assert low < 0.0125 < high
    assert "dry = 0.0867, 0.0212, 0.0051, 0.0125" in PROGRAM
    plan = json.loads((folder / "first" / "plan.json").read_text())
    assert (len(plan["discover"]), len(plan["confirm"])) == (6, 2)


def test_the_folder_has_the_files_that_the_page_lists(folder: Path) -> None:
    listed = re.findall(r"^\| `([\w.]+\.\w+)` \|", TEXT, re.MULTILINE)
    assert sorted(listed) == sorted(path.name for path in (folder / "first").iterdir())
    assert "coulomb_friction" in (folder / "first" / "report.html").read_text("utf-8")
