"""The commands as a user meets them: exit codes, one-sentence errors, nothing half-done left behind."""

import json
import os
import resource
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from drivers.can_wheels.mapping_file import SHIPPED_FOLDER
from drivers.clock import SystemClock, nanoseconds
from rover_hil.app.arguments import spread, understood
from rover_hil.recording.reader import LogReader
from tests.rover_hil.command import Command, assert_one_sentence

SHIPPED = Path(__file__).parents[2] / "rover_hil" / "config" / "shipped" / "configs"
RUN_LIMIT_S = 60.0


@pytest.mark.parametrize("name", ["run", "simulate", "replay", "doctor", "import"])
def test_every_command_has_help_with_an_example(command: Command, name: str) -> None:
    arguments = ("import", "robotino") if name == "import" else (name,)
    assert command(*arguments, "--help") == 0
    assert "Example:" in command.out
    assert "rover-hil" in command.out


def test_virtual_run_writes_log_summary_and_report(command: Command, tmp_path: Path) -> None:
    assert command("run", "robotino", "--virtual", "--duration", "4", "--out", "a", "--json") == 0
    assert json.loads(command.out) == json.loads((tmp_path / "a" / "summary.json").read_text())
    assert sorted(path.name for path in (tmp_path / "a").iterdir()) == [
        "report.html", "run.mcap", "summary.json",
    ]  # fmt: skip
    assert command("replay", "a/run.mcap", "--json") == 0
    assert json.loads(command.out)["identical"] is True


@pytest.mark.usefixtures("unrendered")
def test_a_run_that_ends_in_a_safe_stop_says_no(command: Command, tmp_path: Path) -> None:
    text = (SHIPPED / "robotino.toml").read_text()
    fault = '[[simulation.faults]]\ntype = "unplug"\ndevice = "imu"\nstart_s = 4\nduration_s = 100\n'
    (tmp_path / "broken.toml").write_text(f"{text}\n{fault}")
    assert command("run", "broken.toml", "--virtual", "--duration", "6", "--out", "a") == 1
    assert "imu" in command.out


@pytest.mark.usefixtures("unrendered")
def test_a_log_is_not_overwritten(command: Command) -> None:
    assert command("run", "robotino", "--virtual", "--duration", "4", "--out", "a") == 0
    before = Path("a/run.mcap").read_bytes()
    assert command("run", "robotino", "--virtual", "--duration", "1", "--out", "a") == 2
    assert_one_sentence(command.error, "a/run.mcap", "never overwritten")
    assert Path("a/run.mcap").read_bytes() == before


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("run", "nothing.toml"), ("nothing.toml", "el-dorado, el-dorado-camera, el-dorado-crab, robotino")),
        (("run", "robotino", "--out", "a"), ("ports/board",)),
        (("run", "robotino", "--virtual", "--odometry-to", "5005"), ("--realtime",)),
        (("run", "robotino", "--virtual", "--out", "taken"), ("taken",)),
        (("run", "robotino", "--virtual", "--out", "/proc/1"), ("/proc/1/run.mcap", "choose another --out")),
        (("bench", "robotino", "--port", "99999"), ("--port is 99999, outside 0 .. 65535: correct it",)),
        (("replay", "nothing.mcap"), ("nothing.mcap",)),
        (("replay", "taken"), ("taken",)),
        (("replay", "."), (".",)),
        (("doctor", "nothing.toml"), ("nothing.toml",)),
        (("simulate", "nothing.toml"), ("nothing.toml",)),
        (("import", "robotino", "nothing.csv", "-o", "a.mcap"), ("nothing.csv",)),
        (("import", "robotino", "taken", "-o", "a.mcap"), ("taken",)),
        (("import", "robotino", "taken", "-o", "a.mcap", "--millimetres-per-pixel", "-1"), ("positive",)),
    ],
)
def test_bad_input_is_one_sentence_and_leaves_nothing(
    command: Command, tmp_path: Path, arguments: tuple[str, ...], words: tuple[str, ...]
) -> None:
    (tmp_path / "taken").write_text("a file of somebody else")
    assert command(*arguments) == 2
    assert_one_sentence(command.error, *words)
    assert [path.name for path in tmp_path.iterdir()] == ["taken"]
    assert (tmp_path / "taken").read_text() == "a file of somebody else"


def test_configuration_without_simulation_leaves_nothing(command: Command, tmp_path: Path) -> None:
    text = (SHIPPED / "robotino.toml").read_text()
    (tmp_path / "real.toml").write_text(text[: text.index("[simulation]")])
    assert command("run", "real.toml", "--virtual", "--out", "a") == 2
    assert_one_sentence(command.error, "[simulation]")
    assert not (tmp_path / "a").exists()


def test_a_missing_data_file_leaves_nothing(command: Command, tmp_path: Path) -> None:
    text = (SHIPPED / "el-dorado.toml").read_text()
    (tmp_path / "lost.toml").write_text(text.replace('"generic_wheel"', '"nothing.toml"'))
    assert command("run", "lost.toml", "--virtual", "--out", "a") == 2
    assert_one_sentence(command.error, "nothing.toml")
    assert not (tmp_path / "a").exists()


@pytest.mark.parametrize(
    ("arguments", "code"),
    [(("check",), 1), (("run", "--virtual", "--out", "a"), 2), (("run", "--out", "a"), 2), (("doctor",), 2)],
)
@pytest.mark.parametrize("signal", ["Position : 0|20@1-", "Current : 40|16@1-", "Speed : 0|16@1-"])
def test_a_signal_with_factor_0_is_one_sentence(
    command: Command, tmp_path: Path, arguments: tuple[str, ...], code: int, signal: str
) -> None:
    mapping = (SHIPPED_FOLDER / "generic_wheel.toml").read_text("utf-8")
    (tmp_path / "mine.toml").write_text(mapping, "utf-8")
    dbc = (SHIPPED_FOLDER / "generic_wheel.dbc").read_text("utf-8")
    factor = "(1,0)" if signal.startswith("Pos") else "(0.001,0)"
    assert f"{signal} {factor}" in dbc
    (tmp_path / "generic_wheel.dbc").write_text(
        dbc.replace(f"{signal} {factor}", f"{signal} (0,0)", 1), "utf-8"
    )
    text = (SHIPPED / "el-dorado.toml").read_text("utf-8")
    (tmp_path / "rover.toml").write_text(text.replace('"generic_wheel"', '"mine.toml"'), "utf-8")
    assert command(arguments[0], "rover.toml", *arguments[1:]) == code
    told = command.out if code == 1 else command.error
    name = signal.partition(" ")[0]
    assert told.count(f"signal '{name}' of message 'Wheel0_") == told.count("has factor 0") == 1
    assert "Traceback" not in command.out + command.error
    assert not (tmp_path / "a").exists()


def test_a_log_that_cannot_be_written_is_one_sentence(command: Command) -> None:
    """A limit on the size of files stands for a full disk."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (40_000, hard))
    try:
        code = command("run", "robotino", "--virtual", "--duration", "5", "--out", "a")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert code == 2
    assert_one_sentence(command.error, "a/run.mcap", "File too large")


@pytest.mark.parametrize(
    ("typed", "repeated"),
    [
        ("a b --test c d --json", "a b --test c --test d --json"),
        ("a --test c --test d", "a --test c --test d"),
        ("a --json --test c d e", "a --json --test c --test d --test e"),
        ("run robotino --virtual", "run robotino --virtual"),
        ("a --test", "a --test"),
    ],
)
def test_one_option_may_take_several_values(typed: str, repeated: str) -> None:
    assert spread(typed.split()) == repeated.split()


def test_an_old_spelling_of_a_tuning_by_logs_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    typed = "tune --study a my.toml --logs b.mcap c.mcap --held-out d.mcap --trials 3"
    meant = "tune logs --study a my.toml --held-out d.mcap --trials 3 b.mcap c.mcap"
    assert understood(typed.split()) == meant.split()
    assert "is now `tune logs CONFIG LOG...`" in capsys.readouterr().err


@pytest.mark.parametrize(("chosen", "used"), [(None, "1"), ("3", "3")])
def test_linear_algebra_has_one_thread_unless_the_user_wants_more(
    command: Command, monkeypatch: pytest.MonkeyPatch, chosen: str | None, used: str
) -> None:
    monkeypatch.delenv("OPENBLAS_NUM_THREADS")
    if chosen is not None:
        monkeypatch.setenv("OPENBLAS_NUM_THREADS", chosen)
    assert command("--help") == 0
    assert os.environ["OPENBLAS_NUM_THREADS"] == used


def test_usage_errors_exit_with_two(command: Command) -> None:
    assert command("run") == 2
    assert command("run", "robotino", "--no-such-option") == 2
    assert command("fly") == 2


def test_measured_run_from_csv_to_report(command: Command, shared_data: Path, tmp_path: Path) -> None:
    file = shared_data / "robotino_2023" / "one_surface_type" / "gray_surface" / "exp00.csv.gz"
    assert command("import", "robotino", str(file), "-o", "a.mcap") == 0
    assert command("import", "robotino", str(file), "-o", "a.mcap") == 2
    assert_one_sentence(command.error, "a.mcap", "never overwritten")
    assert command("replay", "a.mcap", "--out", "report") == 0
    summary = json.loads((tmp_path / "report" / "summary.json").read_text())
    assert summary["origin"].startswith("imported from exp00")
    # Gray textile: the shared data's own check finds a mean slip of 0.30 to 0.33 on it at 1.84 mm per pixel.
    assert summary["distance_encoders_m"] > 1.2 * summary["distance_truth_m"]


@pytest.mark.slow
def test_two_processes_over_pseudo_terminals_and_ctrl_c(command: Command, tmp_path: Path) -> None:
    """Simulator and loop as separate processes, ended by ctrl-C: the run is complete and replays."""
    program = Path(sys.executable).with_name("rover-hil")
    clock = SystemClock()
    simulator = subprocess.Popen([program, "simulate", "robotino"], cwd=tmp_path, stdout=subprocess.DEVNULL)
    runner: subprocess.Popen[bytes] | None = None
    messages = tmp_path / "messages"
    try:
        deadline_ns = clock.now_ns() + nanoseconds(RUN_LIMIT_S)
        while not (tmp_path / "ports" / "imu").exists():
            assert clock.now_ns() < deadline_ns
            assert simulator.poll() is None
            clock.sleep_until(clock.now_ns() + nanoseconds(0.05))
        with messages.open("w") as sink:
            runner = subprocess.Popen(
                [program, "run", "robotino", "--out", "a"],
                cwd=tmp_path,
                stdout=subprocess.DEVNULL,
                stderr=sink,
            )
        log_path = tmp_path / "a" / "run.mcap"
        while not log_path.exists() or log_path.stat().st_size < 100_000:
            assert clock.now_ns() < deadline_ns
            assert runner.poll() is None
            clock.sleep_until(clock.now_ns() + nanoseconds(0.05))
        runner.send_signal(signal.SIGINT)
        assert runner.wait(RUN_LIMIT_S) == 0
        moving = "moving the rover of robotino (board at ports/board, imu at ports/imu)"
        assert messages.read_text("utf-8").startswith(moving)
        runner = None
    finally:
        simulator.send_signal(signal.SIGINT)
        assert simulator.wait(RUN_LIMIT_S) == 0
        if runner is not None:
            runner.kill()
            runner.wait()
    assert not (tmp_path / "ports" / "imu").exists()
    summary = json.loads((tmp_path / "a" / "summary.json").read_text())
    assert summary["end"] == "stopped by user"
    assert summary["stops"] == []
    assert all(device["rejected"] == {} for device in summary["devices"])
    log = LogReader(log_path)
    assert list(log.messages())
    assert log.is_complete
    assert command("replay", str(log_path)) == 0, command.out


def test_help_of_run_loads_nothing_that_drives() -> None:
    """It takes 0.2 s of processor time; with the loop and numpy it took five times as much."""
    code = (
        "import sys; from rover_hil.app.app import main; sys.argv = ['rover-hil', 'run', '--help']\n"
        "try:\n    main()\nfinally:\n    print([name for name in ('numpy', 'cv2', 'controllers') "
        "if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "--odometry-to" in done.stdout
    assert done.stdout.splitlines()[-1] == "[]"
