"""`rover-hil gap` on machines: gap check, --cut, --warm-up, mistakes in the model file, progress."""

import io
import json
import threading
from dataclasses import replace
from pathlib import Path

import pytest

from drivers.errors import ConfigError
from rover_hil.console.steps import show_steps
from rover_hil.gap.command.find import Shortening, check_effects, find_gap, named_model
from tests.rover_hil.command import Command, assert_one_sentence
from tests.rover_hil.gap.small_machine import MODEL, small_runs, table_text

MAKE = """from dataclasses import replace
from tests.rover_hil.gap.small_machine import *


def make():
"""


def _model(tmp_path: Path, body: str) -> str:
    path = tmp_path / "machine.py"
    path.write_text(f"{MAKE}    {body}\n")
    return f"{path}:make"


def _data(tmp_path: Path, samples: int = 60, count: int = 4) -> Path:
    path = tmp_path / "runs.csv"
    path.write_text(table_text(small_runs(samples=samples, count=count), time="time [s]"))
    return path


def test_check_needs_no_folder_and_prints_every_effect(command: Command, tmp_path: Path) -> None:
    data = str(_data(tmp_path))
    assert command("gap", "check", _model(tmp_path, "return MODEL"), data) == 0
    assert "quadratic_drag" in command.out
    assert "Unknown of each run: first" in command.out
    assert command("gap", "check", _model(tmp_path, "return MODEL"), data, "--json") == 0
    assert [card["name"] for card in json.loads(command.out)["cards"]] == ["quadratic_drag", "saturation"]


SILENT = 'return replace(MODEL, port_effects=(effects.saturation("power", limits=(8.0,)),))'


def test_an_effect_without_consequence_fails_the_check_and_the_analysis(
    command: Command, tmp_path: Path
) -> None:
    data, model = str(_data(tmp_path)), _model(tmp_path, SILENT)
    assert command("gap", "check", model, data) == 1
    assert "Error: effect saturation at its natural size changes no prediction of any run" in command.out
    assert command("gap", model, data, "--out", str(tmp_path / "out")) == 2
    assert_one_sentence(
        command.error, "effect saturation at its natural size changes no prediction", "limit may be"
    )
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("name", ["rover", "check"])
def test_a_model_called_like_a_command_is_given_as_a_path(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    """The model without a visible effect is refused by name, so that it was read in both forms."""
    data = str(_data(tmp_path))
    (tmp_path / f"{name}.py").write_text(f"{MAKE}    {SILENT}\n")
    monkeypatch.chdir(tmp_path)
    assert command("gap", f"{name}.py:make", data, "--out", "out") == 2
    assert_one_sentence(command.error, "effect saturation at its natural size changes no prediction")
    assert command("gap", "check", f"{name}.py:make", data) == 1
    assert "Error: effect saturation at its natural size" in command.out


def test_check_names_data_that_cannot_be_used(command: Command, tmp_path: Path) -> None:
    data = _data(tmp_path)
    data.write_text(data.read_text().replace("power [W]", "power [kW]"))
    assert command("gap", "check", _model(tmp_path, "return MODEL"), str(data)) == 1
    assert "column 'power' is in kW, the model has W" in command.out


def test_check_is_for_machines(command: Command, tmp_path: Path) -> None:
    assert command("gap", "check", "side-slope", str(_data(tmp_path))) == 2
    assert_one_sentence(command.error, "gap check: side-slope is no StateModel")


def test_the_old_spelling_of_check_works_and_names_the_new_one(command: Command, tmp_path: Path) -> None:
    data, model = str(_data(tmp_path)), _model(tmp_path, "return MODEL")
    assert command("gap", "check", model, data, "--json") == 0
    new, silence = command.out, command.error
    assert command("gap", model, data, "--check", "--json") == 0
    assert command.out == new
    assert "rover-hil gap check MODEL DATA" in command.error
    assert not silence


@pytest.mark.parametrize("name", ["rover", "check"])
def test_a_model_that_is_called_like_a_command_is_given_as_a_path(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    data = str(_data(tmp_path))
    Path(_model(tmp_path, "return MODEL").partition(":")[0]).rename(tmp_path / f"{name}.py")
    monkeypatch.chdir(tmp_path)
    assert command("gap", f"./{name}.py:make", data, "--out", "out") == 0
    assert (tmp_path / "out" / "verdict.json").exists()
    assert command("gap", name, data, "--out", "again") == 2
    assert not (tmp_path / "again").exists()


def test_results_need_a_folder(command: Command, tmp_path: Path) -> None:
    assert command("gap", "side-slope", str(_data(tmp_path))) == 2
    assert_one_sentence(command.error, "--out is missing")


@pytest.mark.parametrize(
    ("body", "words"),
    [
        (
            "return replace(MODEL, derivative=lambda x, u, p, port: 1 / 0)",
            "machine.py, line 6: derivative raises Zero",
        ),
        (
            "return replace(MODEL, start=lambda p, u: {})",
            "machine.py, line 6: start returns nothing for state warmth",
        ),
        ("return replace(MODEL, ports=())", "is no port, input, channel"),
        (
            "return replace(MODEL, ports=(replace(MODEL.ports[0], force_sd=-1.0),))",
            "force_sd is -1, must be > 0",
        ),
    ],
)
def test_a_mistake_in_the_model_is_one_sentence_and_nothing_is_written(
    command: Command, tmp_path: Path, body: str, words: str
) -> None:
    out = tmp_path / "out"
    assert command("gap", _model(tmp_path, body), str(_data(tmp_path)), "--out", str(out)) == 2
    assert_one_sentence(command.error, words)
    assert not out.exists()


def test_a_channel_without_a_scale_of_noise_is_refused_by_name(command: Command, tmp_path: Path) -> None:
    body = 'return replace(MODEL, channels=(Channel(name="reading", unit="K"),))'
    out = tmp_path / "out"
    assert command("gap", "check", _model(tmp_path, body), str(_data(tmp_path))) == 1
    assert "channel reading: sensor noise and model error are not separable" in command.out
    assert not out.exists()


def test_a_gap_in_an_input_is_bad_data(command: Command, tmp_path: Path) -> None:
    data, out = _data(tmp_path), tmp_path / "out"
    lines = data.read_text().splitlines()
    cells = lines[20].split(",")
    lines[20] = ",".join([*cells[:2], "", *cells[3:]])
    data.write_text("\n".join(lines))
    assert command("gap", _model(tmp_path, "return MODEL"), str(data), "--out", str(out)) == 1
    assert command.out.startswith("BAD_DATA")
    assert "1 of 60 values of power are missing" in command.out
    assert not out.exists()


def test_one_record_is_cut_into_runs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    data, model = _data(tmp_path, samples=200, count=1), _model(tmp_path, "return MODEL")
    short = Shortening(cut_s=5.0)
    assert (
        find_gap(
            named_model(model, data), out=tmp_path / "whole", extended=None, confirm="", seed=0, as_json=True
        )
        == 1
    )
    assert "1 runs are too few" in capsys.readouterr().out
    out = tmp_path / "out"
    code = find_gap(
        named_model(model, data), out=out, extended=None, confirm="", seed=0, as_json=True, shortening=short
    )
    assert code == 0
    plan = json.loads((out / "plan.json").read_text())
    assert any("run0 part" in name for name in plan["confirm"])


def test_the_warm_up_is_not_missing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    data, model = _data(tmp_path), _model(tmp_path, "return MODEL")
    assert check_effects(model, data, as_json=True, shortening=Shortening(warm_up_s=2.0)) == 0
    content = json.loads(capsys.readouterr().out)
    assert check_effects(model, data, as_json=True) == 0
    whole = json.loads(capsys.readouterr().out)
    assert content["cards"][0]["standard_errors"] != whole["cards"][0]["standard_errors"]


def test_a_record_is_cut_after_its_warm_up_is_left_out() -> None:
    runs = small_runs(samples=150, count=1)
    parts = Shortening(cut_s=5.0, warm_up_s=1.0).apply(MODEL, runs)
    assert [part.overlap for part in parts] == [(10, 0), (0, 0), (0, 0)]
    late = Shortening(cut_s=5.0, warm_up_s=6.0).apply(MODEL, runs)
    assert [(part.name, part.overlap) for part in late] == [("run0 part 2", (10, 0)), ("run0 part 3", (0, 0))]


def test_the_model_must_be_able_to_begin_in_the_middle() -> None:
    model = replace(MODEL, start=lambda p, u: {"warmth": 0.0 * p.first})
    with pytest.raises(ConfigError, match="state warmth of model body begins with the same value"):
        Shortening(cut_s=5.0).apply(model, small_runs(samples=150, count=1))


def test_long_steps_are_lines_where_there_is_no_terminal() -> None:
    class Watched(io.StringIO):
        written = threading.Event()

        def flush(self) -> None:
            self.written.set()

    stream = Watched()
    with show_steps("reading", stream, line_s=0.01) as advance:
        assert stream.written.wait(2.0)
        stream.written.clear()
        advance("fitting")
        assert stream.written.wait(2.0)
        # A step that goes on has no second line.
        threading.Event().wait(0.1)
    first, second = stream.getvalue().splitlines()
    assert first.endswith(" s  reading")
    assert second.endswith(" s  fitting")


def test_short_steps_have_no_line() -> None:
    stream = io.StringIO()
    with show_steps("reading", stream, line_s=60.0) as advance:
        advance("fitting")
    assert stream.getvalue() == ""


def test_help_says_that_the_model_file_is_run(command: Command) -> None:
    assert command("gap", "find", "--help") == 0
    assert "Python code, and it is run" in " ".join(command.out.split())
