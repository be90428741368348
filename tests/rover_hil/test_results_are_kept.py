"""Results: never overwritten unless forced, and nothing under their names when a command fails."""

import json
from pathlib import Path

import pytest

import rover_hil.drive.run_surroundings as run_command
import rover_hil.gap.command.find as gap_command
from drivers.errors import ConfigError
from rover_hil.pages.atomic_write import unfinished, write_file, write_files
from rover_hil.recording.watchdog_note import note_path
from rover_hil.run import driving
from tests.rover_hil.command import Command, assert_one_sentence
from tests.rover_hil.gap.gap_data import cart_rows, write_cart
from tests.rover_hil.tune.tuning import write_config

CART = f"{Path(__file__).parent / 'gap' / 'gap_models.py'}:make_cart"
CALIBRATE = (
    *("calibrate", "camera", "pictures", "--ground", "g.png", "--rover", "r.json", "--columns", "8"),
    *("--rows", "6", "--square", "0.04", "--ground-x", "-0.7", "--ground-y", "0.1", "--out", "a.json"),
)
COMMANDS = [
    ("run robotino --virtual --out a", ["a/run.mcap", "a/summary.json", "a/report.html"]),
    ("replay run.mcap --out a", ["a/summary.json", "a/report.html"]),
    (
        "gap side-slope measured --out a",
        ["a/verdict.json", "a/plan.json", "a/model.toml", "a/report.html"],
    ),
    ("tune rover.toml --study a --out a", ["a/tuned.toml", "a/tuning.json", "a/report.html"]),
    ("identify slip runs --out a.toml", ["a.toml"]),
    ("identify motor runs --out a.toml", ["a.toml"]),
    ("identify scomp drive.csv --truth truth.csv --out a.toml", ["a.toml"]),
    ("identify scomp drive.csv --truth truth.csv --pictures a", ["a/path.svg"]),
    ("scomp drive.csv --out a.csv", ["a.csv"]),
    ("ftrace frames --rig rig.json --out a.csv", ["a.csv"]),
    ("ftrace frames --rig rig.json --out b.csv --overlay a.mp4", ["a.mp4"]),
    ("terrain wheel --out a", ["a/report.html", "a/wheel.csv"]),
    ("terrain traverse --out a", ["a/report.html", "a/traverse.csv"]),
    ("terrain climb --out a", ["a/report.html", "a/limits.csv", "a/slopes.csv", "a/measured_wheels.csv"]),
    ("terrain papers --out a", ["a/report.html", "a/traverse.csv", "a/limits.csv", "a/measured_wheels.csv"]),
    ("terrain fit data --out a", ["a/report.html", "a/soil.csv", "a/cells.csv", "a/soil.toml"]),
    (" ".join(CALIBRATE), ["a.json"]),
    ("calibrate imu robotino --virtual --out a.toml", ["a.toml"]),
    ("import robotino exp00.csv --out a.mcap", ["a.mcap"]),
]
CASES = [(line, name) for line, names in COMMANDS for name in names]
# `import` makes the folder.
FILES = [
    line
    for line, names in COMMANDS
    if "/" not in names[0] and "--overlay" not in line and not line.startswith("import")
]


@pytest.mark.parametrize(("line", "name"), CASES)
def test_an_earlier_result_is_kept(command: Command, tmp_path: Path, line: str, name: str) -> None:
    write_config(tmp_path)
    path = tmp_path / name
    path.parent.mkdir(exist_ok=True)
    path.write_text("of somebody else")
    before = sorted(tmp_path.rglob("*"))
    assert command(*line.replace("--out", "-o").split()) == 2
    assert_one_sentence(command.error, name, "--force")
    assert sorted(tmp_path.rglob("*")) == before
    assert path.read_text() == "of somebody else"


@pytest.mark.parametrize("line", FILES)
def test_a_missing_folder_is_named_before_anything_is_computed(command: Command, line: str) -> None:
    assert command(*line.replace("--out a", "--out nowhere/a").split()) == 2
    assert_one_sentence(command.error, "no folder nowhere")


def test_force_overwrites(command: Command, tmp_path: Path) -> None:
    line = ("terrain", "wheel", "--slip", "0.1", "--slip-angle-deg", "0", "--out", "a")
    assert command(*line) == 0
    (tmp_path / "a" / "report.html").write_text("old")
    assert command(*line, "--force") == 0
    assert (tmp_path / "a" / "report.html").read_text() != "old"
    assert sorted(path.name for path in (tmp_path / "a").iterdir()) == ["report.html", "wheel.csv"]


def test_tune_continues_its_own_study_only(command: Command, tmp_path: Path) -> None:
    write_config(tmp_path)
    folder = tmp_path / "a"
    folder.mkdir()
    (folder / "study.jsonl").touch()
    (folder / "tuning.json").write_text(json.dumps({"study": "first"}))
    assert command("tune", "rover.toml", "--study", "second", "--out", "a") == 2
    assert_one_sentence(command.error, "a/tuning.json", "--force")


def fail(*_: object, **__: object) -> None:
    raise KeyboardInterrupt


def test_a_run_that_fails_to_start_leaves_nothing(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(driving, "Executive", fail)
    assert command("run", "robotino", "--virtual", "--out", "a/b") == 130
    assert_one_sentence(command.error, "interrupted by ctrl-C")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_a_forced_run_that_fails_to_start_keeps_the_earlier_one(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    line = ("run", "robotino", "--virtual", "--duration", "4", "--out", "a")
    assert command(*line) == 0
    note_path(tmp_path / "a" / "run.mcap").write_text("why an earlier run was cut off")
    before = {path: path.read_bytes() for path in (tmp_path / "a").iterdir()}
    with monkeypatch.context() as patch:
        patch.setattr(driving, "Executive", fail)
        assert command(*line, "--force") == 130
    assert {path: path.read_bytes() for path in (tmp_path / "a").iterdir()} == before
    assert command(*line, "--force") == 0
    assert (tmp_path / "a" / "run.mcap").read_bytes() != before[tmp_path / "a" / "run.mcap"]
    assert not note_path(tmp_path / "a" / "run.mcap").exists()


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("run robotino --virtual --out a --duration 1e300", ("--duration is 1e+300 s", "0.1 .. 1e+06 s")),
        ("run robotino --virtual --out a --duration nan", ("--duration is nan s",)),
        ("run robotino --virtual --out a --duration 0", ("--duration is 0 s",)),
        ("simulate robotino --duration inf", ("--duration is inf s",)),
        ("tune robotino --study a --minutes nan", ("--minutes is nan min",)),
        ("tune robotino --study a --trials 0", ("--trials is 0",)),
        ("gap side-slope runs --out a --seed -1", ("--seed is -1",)),
        (" ".join((*CALIBRATE, "--fps", "inf")), ("--fps is inf Hz",)),
        (" ".join((*CALIBRATE, "--ground-yaw", "nan")), ("--ground-yaw is nan deg",)),
        ("import robotino exp00.csv -o a.mcap --millimetres-per-pixel inf", ("positive",)),
        ("import robotino exp00.csv -o a.mcap --millimetres-per-pixel 1e300", ("millimetres",)),
    ],
)
def test_numbers_out_of_range_leave_nothing(
    command: Command, tmp_path: Path, line: str, words: tuple[str, ...]
) -> None:
    assert command(*line.split()) == 2
    assert_one_sentence(command.error, *words)
    assert list(tmp_path.iterdir()) == []


def test_bad_data_writes_no_result_and_keeps_an_earlier_one(command: Command, tmp_path: Path) -> None:
    data = write_cart(tmp_path / "runs.csv", cart_rows(5))
    data.write_text(data.read_text().replace("roll_deg", "lean_deg", 1))
    assert command("gap", CART, "runs.csv", "--out", "a") == 1
    assert "BAD_DATA" in command.out
    assert not (tmp_path / "a").exists()
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / "verdict.json").write_text("earlier")
    assert command("gap", CART, "runs.csv", "--out", "a", "--force", "--json") == 1
    assert json.loads(command.out)["verdict"] == "BAD_DATA"
    assert [path.name for path in (tmp_path / "a").iterdir()] == ["verdict.json"]
    assert (tmp_path / "a" / "verdict.json").read_text() == "earlier"


def test_an_interrupted_analysis_leaves_nothing(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_cart(tmp_path / "runs.csv", cart_rows(5))
    monkeypatch.setattr(gap_command, "analyse", fail)
    assert command("gap", CART, "runs.csv", "--out", "a/b") == 130
    assert_one_sentence(command.error.lstrip("\n"), "interrupted by ctrl-C")
    assert [path.name for path in tmp_path.iterdir()] == ["runs.csv"]


@pytest.mark.parametrize("failure", [OSError(28, "No space left on device"), KeyboardInterrupt()])
def test_files_are_written_all_or_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, failure: BaseException
) -> None:
    write_files(tmp_path, {"a": "one", "b": "two"})
    write_text = Path.write_text

    def fail_at_b(path: Path, text: str, encoding: str) -> int:
        if path.name == "b":
            raise failure
        return write_text(path, text, encoding)

    monkeypatch.setattr(Path, "write_text", fail_at_b)
    with pytest.raises((ConfigError, KeyboardInterrupt)):
        write_files(tmp_path, {"a": "three", "b": "four"})
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == {"a": "one", "b": "two"}


def test_a_folder_that_was_finished_replaces_an_earlier_one(tmp_path: Path) -> None:
    for name in ("first", "second"):
        with unfinished(tmp_path / "pictures") as part:
            part.mkdir()
            write_file(part / f"{name}.svg", name)
    assert [path.name for path in tmp_path.rglob("*")] == ["pictures", "second.svg"]


@pytest.mark.parametrize("failure", [ValueError("no axis"), KeyboardInterrupt()])
@pytest.mark.parametrize(
    ("line", "drawing", "kept"),
    [
        (
            "run robotino --virtual --duration 0.5 --out a",
            "rover_hil.report.write.run_curves",
            {"run.mcap", "summary.json"},
        ),
        (
            "terrain wheel --slip 0.1 --slip-angle-deg 0 --out a",
            "rover_hil.terrain.pages.render",
            {"wheel.csv"},
        ),
        pytest.param(
            "calibrate imu robotino --virtual --out a/gyro.toml",
            "rover_hil.ready.procedure.draw_pictures",
            {"gyro.toml", "gyro.mcap"},
            marks=pytest.mark.slow,
        ),
    ],
)
def test_a_result_is_written_before_its_page(
    command: Command,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    line: str,
    drawing: str,
    kept: set[str],
    failure: BaseException,
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise failure

    (tmp_path / "a").mkdir()
    monkeypatch.setattr(drawing, fail)
    code = command(*line.split())
    assert code == 130 if isinstance(failure, KeyboardInterrupt) else "it cannot be drawn" in command.error
    assert {path.name for path in (tmp_path / "a").iterdir()} == kept


def test_ctrl_c_while_the_report_is_written_keeps_the_log(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*_: object) -> str:
        raise KeyboardInterrupt

    monkeypatch.setattr(run_command, "write_report", interrupted)
    out = tmp_path / "out"
    assert command("run", "robotino", "--virtual", "--duration", "0.5", "--out", str(out)) == 130
    assert f"rover-hil replay {out / 'run.mcap'} --out {out}" in command.error
    assert [path.name for path in out.iterdir()] == ["run.mcap"]
