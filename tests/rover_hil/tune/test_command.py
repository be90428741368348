"""`rover-hil tune` as a user meets it: files, exit codes, ctrl-C, and one small tuning for real."""

import json
import os
import re
import signal
import tomllib
from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path

import pytest

from drivers.errors import ConfigError
from rover_hil.config import load_config
from rover_hil.config.entry import with_entry
from rover_hil.tune import command, results
from rover_hil.tune.command import tune
from rover_hil.tune.objective import MissionRunner
from tests.rover_hil.tune.tuning import MISSION, TUNE, FakeRuns, write_config

SMALL = TUNE.replace("train = 4", "train = 2").replace("held_out = 6", "held_out = 2")
POOR = MISSION + "heading_gain_per_s = 0.5\n"


@pytest.fixture
def parallel_runs(monkeypatch: pytest.MonkeyPatch) -> FakeRuns:
    fake = FakeRuns()

    @contextmanager
    def open_missions(cluster: str | None, *, has_camera: bool) -> Generator[MissionRunner, None, None]:
        assert cluster is None
        assert not has_camera
        yield fake.drive

    monkeypatch.setattr(command, "open_missions", open_missions)
    return fake


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., int]:
    monkeypatch.chdir(tmp_path)

    def call(
        trials: int = 12, minutes: float | None = None, study: str = "first", as_json: bool = False
    ) -> int:
        return tune("rover.toml", study=study, trials=trials, minutes=minutes, out=None, as_json=as_json)

    return call


def result_in(tmp_path: Path) -> dict[str, object]:
    result = json.loads((tmp_path / "tuning" / "first" / "tuning.json").read_text())
    assert isinstance(result, dict)
    return result


@pytest.mark.usefixtures("unrendered")
def test_a_better_configuration_is_written_with_its_provenance(
    parallel_runs: FakeRuns, run: Callable[..., int], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_config(tmp_path)
    assert run(as_json=True) == 0
    folder = tmp_path / "tuning" / "first"
    assert sorted(path.name for path in folder.iterdir()) == [
        "report.html", "study.jsonl", "tuned.toml", "tuning.json",
    ]  # fmt: skip
    result = json.loads(capsys.readouterr().out)
    assert result == result_in(tmp_path)
    assert result["verdict"] == "improved"
    assert result["trials"] == 12
    tuned = load_config(str(folder / "tuned.toml"))
    assert tuned.mission is not None
    assert tuned.mission.lookahead_m == result["values"]["mission.lookahead_m"]["after"]
    assert tuned.tune is not None
    record = tuned.tune.provenance
    assert record is not None
    assert (record.study, record.start, record.trials) == ("first", "rover.toml", 12)
    seeds = (record.train_seeds, record.ranking_seeds, record.held_out_seeds)
    assert seeds == ((1, 4), (3001, 3003), (1001, 1006))
    assert record.changes["mission.lookahead_m"].before == 0.5
    assert record.changes["mission.lookahead_m"].after == tuned.mission.lookahead_m
    assert record.objective == "0.9 quantile over the cases of path_rms_m / 0.05 + closure_m / 0.1"
    assert re.fullmatch(r"\d{8}-\d{6}", record.date)
    assert record.held_out_cost_before is not None
    assert record.held_out_cost_after < record.held_out_cost_before


@pytest.mark.usefixtures("parallel_runs")
def test_the_drives_of_a_twin_are_named(
    run: Callable[..., int], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, number = write_config(tmp_path), {"value": 0.04, "low": 0.039, "high": 0.041}
    numbers = {"radius": {**number, "moves": {"plant.wheel_radius_m": 1.0}}}
    found = {"drives": ["straight", "bend"], "found_on": "2026-11-30", "numbers": numbers}
    path.write_text(with_entry(path.read_text("utf-8"), "simulation", "found", found), "utf-8")
    assert run() == 0
    words = "drawn from what these drives show: straight, bend"
    assert words in capsys.readouterr().out
    folder = tmp_path / "tuning" / "first"
    assert result_in(tmp_path)["drives"] == ["straight", "bend"]
    assert words.removeprefix("drawn ") in (folder / "report.html").read_text("utf-8")
    tuned = load_config(str(folder / "tuned.toml")).tune
    assert tuned is not None
    assert tuned.provenance is not None
    assert tuned.provenance.drives == ("straight", "bend")


@pytest.mark.usefixtures("unrendered")
def test_only_what_was_tuned_differs(
    parallel_runs: FakeRuns, run: Callable[..., int], tmp_path: Path
) -> None:
    before = tomllib.loads(write_config(tmp_path).read_text("utf-8"))
    assert run() == 0
    after = tomllib.loads((tmp_path / "tuning" / "first" / "tuned.toml").read_text("utf-8"))
    del after["tune"]["provenance"]
    for key in ("lookahead_m", "heading_gain_per_s"):
        after["mission"].pop(key, None)
        before["mission"].pop(key, None)
    assert after == before


def test_the_page_is_complete_and_needs_nothing_else(
    parallel_runs: FakeRuns, run: Callable[..., int], tmp_path: Path
) -> None:
    write_config(tmp_path)
    assert run(trials=25) == 0
    html = (tmp_path / "tuning" / "first" / "report.html").read_text("utf-8")
    titles = ["Values", "Held-out comparison", "Other rovers", "Held-out scenarios", "True paths", "Search"]
    titles += ["Trade-off", "Parameters"]
    assert re.findall(r"<h2>(.*?)</h2>", html) == titles
    assert html.count('<img class="drawn" src="data:image/svg+xml;base64,') == 5
    assert not re.search(r"""(src|href)=["'](?!data:)""", html)
    assert "6 scenarios that the search did not use: seeds" in html


@pytest.mark.usefixtures("unrendered")
def test_the_count_goes_on_and_a_finished_study_is_not_searched_again(
    parallel_runs: FakeRuns, run: Callable[..., int], tmp_path: Path
) -> None:
    write_config(tmp_path)
    assert run(trials=4) == 0
    assert result_in(tmp_path)["trials"] == 4
    assert run(trials=9) == 0
    assert result_in(tmp_path)["trials"] == 9
    cases = {seed for _, seed in parallel_runs.driven if seed < 1000}
    parallel_runs.driven.clear()
    assert run(trials=9) == 0
    assert cases == {1, 2, 3, 4}
    assert all(seed > 1000 for _, seed in parallel_runs.driven)


@pytest.mark.usefixtures("unrendered")
def test_ctrl_c_ends_the_search_after_the_trial_and_still_writes_everything(
    parallel_runs: FakeRuns, run: Callable[..., int], tmp_path: Path
) -> None:
    write_config(tmp_path, TUNE.replace("low = 0.02", "low = 0.05"))  # rejects nothing

    def interrupt() -> None:
        if len(parallel_runs.driven) == 9:  # in the third trial of four cases each
            os.kill(os.getpid(), signal.SIGINT)

    parallel_runs.before_case = interrupt
    assert run(trials=50) == 0
    assert result_in(tmp_path)["trials"] == 3
    assert (tmp_path / "tuning" / "first" / "tuned.toml").exists()
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    assert run(trials=6) == 0
    assert result_in(tmp_path)["trials"] == 6


def interrupted(*_: object, **__: object) -> None:
    raise KeyboardInterrupt


@pytest.mark.usefixtures("unrendered")
def test_ctrl_c_in_the_comparison_keeps_the_best_trial(
    parallel_runs: FakeRuns,
    run: Callable[..., int],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    write_config(tmp_path)
    folder = tmp_path / "tuning" / "first"
    with monkeypatch.context() as patch:
        patch.setattr(command, "compare", interrupted)
        with pytest.raises(KeyboardInterrupt):
            run()
    assert "the best trial is tuning/first/best_trial.toml" in capsys.readouterr().err
    kept = load_config(str(folder / "best_trial.toml"))
    assert kept.mission != load_config(str(tmp_path / "rover.toml")).mission
    assert not (folder / "tuning.json").exists()
    assert run() == 0  # the same command goes on with the comparison
    assert sorted(path.name for path in folder.iterdir()) == [
        *("report.html", "study.jsonl", "tuned.toml", "tuning.json")
    ]


@pytest.mark.usefixtures("unrendered")
def test_a_result_is_written_before_it_is_tried_on_changed_rovers(
    parallel_runs: FakeRuns, run: Callable[..., int], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_config(tmp_path)
    monkeypatch.setattr(command, "try_changed_rovers", interrupted)
    with pytest.raises(KeyboardInterrupt):
        run()
    assert result_in(tmp_path)["verdict"] == "improved"
    assert (tmp_path / "tuning" / "first" / "tuned.toml").exists()


def test_a_page_that_cannot_be_drawn_leaves_the_result(
    parallel_runs: FakeRuns,
    run: Callable[..., int],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def fail(*_: object) -> None:
        raise ValueError("no axis")

    write_config(tmp_path)
    monkeypatch.setattr(results, "draw_report", fail)
    assert run() == 0
    assert (
        "no page tuning/first/report.html: it cannot be drawn (ValueError: no axis)"
        in capsys.readouterr().err
    )
    assert result_in(tmp_path)["verdict"] == "improved"


@pytest.mark.usefixtures("unrendered")
def test_time_over_ends_the_search_too(
    parallel_runs: FakeRuns, run: Callable[..., int], tmp_path: Path
) -> None:
    write_config(tmp_path)
    assert run(trials=50, minutes=1e-9) == 0
    assert result_in(tmp_path)["trials"] == 0
    assert result_in(tmp_path)["verdict"] == "confirmed"


@pytest.mark.usefixtures("unrendered")
def test_the_best_start_is_confirmed(
    parallel_runs: FakeRuns, run: Callable[..., int], tmp_path: Path
) -> None:
    write_config(tmp_path, mission=MISSION.replace("lookahead_m = 0.5", "lookahead_m = 0.1"))
    assert run() == 0
    assert result_in(tmp_path)["verdict"] == "confirmed"
    tuned = load_config(str(tmp_path / "tuning" / "first" / "tuned.toml"))
    assert tuned.mission is not None
    assert tuned.mission.lookahead_m == 0.1
    assert tuned.tune is not None
    assert tuned.tune.provenance is not None
    assert tuned.tune.provenance.changes == {}


@pytest.mark.usefixtures("unrendered")
def test_trials_that_cost_more_than_the_start_are_not_called_better(
    parallel_runs: FakeRuns, run: Callable[..., int], tmp_path: Path
) -> None:
    write_config(tmp_path, mission=MISSION.replace("lookahead_m = 0.5", "lookahead_m = 0.1"))
    assert run() == 0
    declined = result_in(tmp_path)["declined"]
    assert isinstance(declined, list)
    assert len(declined) == 1
    for line in declined:
        found = re.fullmatch(r"trial \d+: cost (\S+) in the search, start (\S+): not better than .*", line)
        assert found is not None, line
        assert float(found[1]) >= float(found[2])
    page = (tmp_path / "tuning" / "first" / "report.html").read_text("utf-8")
    assert "better in the search" not in page.lower()
    assert "Compared on these, and not taken" in page


@pytest.mark.usefixtures("unrendered")
def test_no_acceptable_values_is_a_no_and_leaves_no_configuration(
    parallel_runs: FakeRuns, run: Callable[..., int], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mission = MISSION.replace("lookahead_m = 0.5", "lookahead_m = 0.03")
    write_config(tmp_path, TUNE.replace("high = 1.0, scale", "high = 0.039, scale"), mission)
    assert run() == 1
    assert "No acceptable values" in capsys.readouterr().out
    assert not (tmp_path / "tuning" / "first" / "tuned.toml").exists()
    assert result_in(tmp_path)["start_refused"] == "scenario 1001: oscillates"


@pytest.mark.parametrize("study", ["", "a/b", "..", "."])
def test_a_study_is_a_name(
    parallel_runs: FakeRuns, run: Callable[..., int], tmp_path: Path, study: str
) -> None:
    write_config(tmp_path)
    with pytest.raises(ConfigError, match="--study"):
        run(study=study)
    assert [path.name for path in tmp_path.iterdir()] == ["rover.toml"]


def test_bad_input_leaves_nothing(run: Callable[..., int], tmp_path: Path) -> None:
    write_config(tmp_path, tune="")
    with pytest.raises(ConfigError, match=r"add \[tune.parameters\].*`tune logs`"):
        run()
    assert [path.name for path in tmp_path.iterdir()] == ["rover.toml"]


@pytest.mark.slow
def test_a_small_tuning_for_real(run: Callable[..., int], tmp_path: Path) -> None:
    tune_table = SMALL.replace("path_rms_m = 0.05\nclosure_m = 0.1", "heading_deg = 3")
    write_config(tmp_path, tune_table, POOR)
    assert run(trials=6) == 0
    result = result_in(tmp_path)
    assert result["trials"] == 6
    assert result["verdict"] == "improved"
    before, after = result["cost_before"], result["cost_after"]
    assert isinstance(before, float)
    assert isinstance(after, float)
    assert after < 0.8 * before
