"""Runs side by side: figures, differences of the configuration, one page."""

import json
from pathlib import Path

import pytest

from rover_hil.config import Config, load_config
from rover_hil.report.compare.comparison import compare_runs, render_comparison
from rover_hil.run.driving import run_virtual
from tests.rover_hil.command import Command, assert_one_sentence


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    folder = tmp_path_factory.mktemp("compare")
    paths = folder / "slow" / "run.mcap", folder / "fast" / "run.mcap"
    for path, speed_m_s in zip(paths, (0.05, 0.15), strict=True):
        table = load_config("robotino").model_dump(by_alias=True)
        table["mission"]["speed_m_s"] = speed_m_s
        table["safety"]["settle_s"] = 0.2
        run_virtual(Config.model_validate(table), path, 1.0, None)
    return paths


def test_figures_and_differences_stand_next_to_each_other(command: Command, runs: tuple[Path, Path]) -> None:
    out = runs[0].parent.parent / "compare.html"
    folders = [str(path.parent) for path in runs]
    assert command("compare", *folders, "--out", str(out), "--json") == 0
    record = json.loads(command.out)
    assert record["runs"] == ["slow/run", "fast/run"]
    assert record["settings"] == {"mission.speed_m_s": ["0.05", "0.15"]}
    assert record["figures"]["duration"] == ["1.0 s", "1.0 s"]
    page = out.read_text()
    assert "mission.speed_m_s" in page
    assert page.count("data:image/svg+xml;base64,") >= 3
    assert "http:" not in page
    assert "https:" not in page
    assert '"name": "fast/run"' in page


@pytest.mark.usefixtures("unrendered")
def test_a_log_that_was_cut_off_is_said_so(command: Command, runs: tuple[Path, Path], tmp_path: Path) -> None:
    whole = runs[0].read_bytes()
    cut = tmp_path / "cut.mcap"
    data_end = b"\x0f" + (4).to_bytes(8, "little")  # opcode and length of the record that ends the data
    cut.write_bytes(whole[: whole.rindex(data_end)])
    page = str(tmp_path / "page.html")
    assert command("compare", str(runs[0]), str(cut), "--out", page) == 0
    assert command.out.count("was cut off") == 1
    assert "the log of cut was cut off" in command.out
    assert command("compare", str(runs[0]), str(cut), "--out", page, "--force", "--json") == 0
    assert json.loads(command.out)["cut_off"] == ["cut"]


def test_runs_of_one_configuration_have_no_differences(runs: tuple[Path, Path]) -> None:
    comparison = compare_runs([runs[0], runs[0]])
    assert comparison.settings == ()
    assert len({run.name for run in comparison.runs}) == 2
    assert "The configurations are the same" in render_comparison(comparison)


@pytest.mark.parametrize("count", [1, 7])
def test_two_to_six_runs_are_wanted(command: Command, runs: tuple[Path, Path], count: int) -> None:
    assert command("compare", *[str(runs[0])] * count) == 2
    assert_one_sentence(command.error, "give two to 6")


def test_a_missing_log_and_an_earlier_page_are_said_so(
    command: Command, runs: tuple[Path, Path], tmp_path: Path
) -> None:
    assert command("compare", str(runs[0]), str(tmp_path / "none.mcap")) == 2
    assert_one_sentence(command.error, "no file or folder")
    page = tmp_path / "page.html"
    page.write_text("mine")
    assert command("compare", *map(str, runs), "--out", str(page)) == 2
    assert_one_sentence(command.error, "--force")
    assert page.read_text() == "mine"
