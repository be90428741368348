"""README and the tutorials, done as written: what they show is what the program prints."""

import re
from pathlib import Path

import pytest

from tests.rover_hil.command import started
from tests.rover_hil.pages import ROOT, do, read_page, unknown_numbers

README = read_page("README.md")


def checked(name: str, folder: Path, answers: dict[str, str] | None = None) -> None:
    """Do a page in a folder, and compare its outputs, files and numbers."""
    text = read_page(name)
    shown = do(text, folder, answers)
    assert shown
    assert [(each.name, part) for each in shown for part in each.missing()] == []
    assert unknown_numbers(text, folder) == set()


@pytest.mark.slow
def test_readme_shows_what_its_commands_print(tmp_path: Path) -> None:
    text = README[README.index("## Three commands") : README.index("## What you can do")]
    shown = do(text, tmp_path)
    assert len(shown) == 2
    assert [(each.name, part) for each in shown for part in each.missing()] == []


def test_readme_has_at_most_ninety_lines() -> None:
    assert len(README.splitlines()) <= 90


def test_figures_of_readme_are_recorded() -> None:
    rows = [line.split("|")[2:4] for line in README.splitlines() if "](benchmarks/results/" in line]
    rows = [row for row in rows if len(row) == 2]
    assert len(rows) == 6
    for result, link in rows:
        (page,) = re.findall(r"\]\((benchmarks/results/\w+\.md)\)", link)
        cells = {cell for line in read_page(page).splitlines() for cell in map(str.strip, line.split("|"))}
        recorded = cells | {cell.removeprefix("of ") for cell in cells} | LIMITS
        assert set(re.findall(r"\d+(?:\.\d+)?", result)) <= recorded, result


LIMITS = {"15"}
"""The cells of the Robotino agree if they are within 15 %."""


@pytest.mark.parametrize("name", ["own_rover", "recorded_drive", "bench_and_tuning", "gap"])
def test_a_tutorial_has_at_most_1800_words(name: str) -> None:
    assert len(read_page(f"docs/tutorials/{name}.md").split()) <= 1800


@pytest.mark.slow
@pytest.mark.timeout(1200)
@pytest.mark.parametrize("name", ["recorded_drive", "bench_and_tuning"])
def test_a_tutorial_shows_what_its_commands_print(name: str, tmp_path: Path) -> None:
    checked(f"docs/tutorials/{name}.md", tmp_path)


ANSWERS = ["yes", "8192", "1", "yes", "0.06", "0.3", "yes", "left", "yes", "right", "yes", "6"]


@pytest.mark.slow
@pytest.mark.timeout(1200)
def test_the_tutorial_of_an_own_rover_shows_what_its_commands_print(tmp_path: Path) -> None:
    """The emulated rover is served as the page describes it; a pipe needs `--drive` to turn the wheels.

    The rate of its sensor is measured on the clock of a machine that may be busy.
    """
    example = ROOT / "docs/examples/differential.toml"
    text = example.read_text("utf-8").replace("docs/examples/can", str(ROOT / "docs/examples/can"))
    (tmp_path / "served.toml").write_text(text, "utf-8")
    page = read_page("docs/tutorials/own_rover.md").replace("--ports ports", "--ports ports --drive")
    page = page.replace("attitude, heading, rate at 50 Hz\n", "attitude, heading, rate at\n...\n")
    (init,) = re.findall(r"^rover-hil init .*$", page, re.MULTILINE)
    with started(tmp_path, "simulate", "served.toml") as process:
        assert process.stdout is not None
        assert "ports/can" in process.stdout.readline()
        before, after = page.split("## 4.")
        shown = do(before, tmp_path, {init: "\n".join(ANSWERS)})
    shown += do(f"## 4.{after}", tmp_path)
    assert len(shown) == 3
    assert [(each.was, part) for each in shown for part in each.missing()] == []
    rates_hz = re.findall(r"attitude, heading, rate at (\d+) Hz", shown[0].was)
    assert rates_hz
    assert all(10 <= int(rate_hz) <= 60 for rate_hz in rates_hz)
    assert unknown_numbers(page, tmp_path) == set()
