"""`rover-hil tune logs` as a user meets it."""

import json
import math
import shutil
import tomllib
from collections.abc import Callable, Generator
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import contextmanager, nullcontext
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drivers.errors import ConfigError, LogError
from rover_hil.config import load_config
from rover_hil.drives.channels import Channels, Readings
from rover_hil.drives.drive import Drive
from rover_hil.drives.ground_truth import TruePoses
from rover_hil.drives.marks import marks_file
from rover_hil.tune.logs.judged_log import JudgedLog, read_judged_logs, split
from rover_hil.tune.logs.replayed_log import ReplayErrors
from rover_hil.tune.logs.study import LogStudy
from rover_hil.tune.objective import Evaluation
from rover_hil.tune.parameters import check_log_parameters
from tests.rover_hil.command import Command, assert_one_sentence
from tests.rover_hil.tune.logs.drives import COMPASS_RAD, GUESSED_RAD, PARAMETERS, write_config, write_drives

HEADING = "filter.heading_noise_rad"


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("recorded")
    write_drives(folder, range(20, 23))
    return folder


@pytest.fixture(autouse=True)
def in_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """Replay in this process; tests/rover_hil/parallel has the others."""

    @contextmanager
    def open_executor(cluster: str | None) -> Generator[Executor, None, None]:
        assert cluster is None
        with ThreadPoolExecutor(1) as executor:
            yield executor

    monkeypatch.setattr("rover_hil.tune.logs.command.open_executor", open_executor)


@pytest.fixture
def logs(recorded: Path, tmp_path: Path) -> list[str]:
    """The names of three logs in the current folder, with the configuration beside them."""
    shutil.copytree(recorded, tmp_path, dirs_exist_ok=True)
    return [f"{seed}.mcap" for seed in (20, 21, 22)]


@pytest.mark.usefixtures("unrendered")
@pytest.mark.nightly
def test_the_true_noise_is_found_and_better_on_the_held_out_log(
    command: Command, logs: list[str], tmp_path: Path
) -> None:
    assert command("tune", "logs", "rover.toml", *logs, "--study", "noise", "--trials", "9") == 0, (
        command.error
    )
    assert "on 1 held-out log after 9 trials; better in 1 of 1" in command.out
    folder = tmp_path / "tuning" / "noise"
    result = json.loads((folder / "tuning.json").read_text())
    assert result["train_logs"] == ["20.mcap", "21.mcap"]
    assert result["held_out_logs"] == ["22.mcap"]
    assert result["cost_after"] < 0.8 * result["cost_before"]
    found = result["values"][HEADING]
    assert found["before"] == GUESSED_RAD
    assert 0.75 * COMPASS_RAD < found["after"] < 1.33 * COMPASS_RAD
    tuned = tomllib.loads((folder / "tuned.toml").read_text())
    assert tuned["filter"]["heading_noise_rad"] == found["after"]
    assert tuned["tune"]["provenance"]["held_out_logs"] == ["22.mcap"]
    assert load_config(str(folder / "tuned.toml")).filter.heading_noise_rad == found["after"]
    # The study goes on, and is not searched again.
    journal = (folder / "study.jsonl").read_bytes()
    again = ("tune", "logs", "rover.toml", "20.mcap", "21.mcap", "--held-out", "22.mcap")
    assert command(*again, "--study", "noise", "--trials", "9") == 0
    assert (folder / "study.jsonl").read_bytes() == journal


@pytest.mark.usefixtures("unrendered")
def test_one_trial_alone_is_compared_on_the_held_out_logs(
    command: Command, logs: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of five trials that are no better than the start, one would nearly always have the luck to seem so."""
    train_costs, held_out_costs = iter([5.0, 4.0, 3.0]), iter([5.0, 5.1, 4.9])

    def result(cost: float) -> Evaluation[ReplayErrors]:
        return Evaluation(cost=cost, at_least=cost, refused="", runs=(), case_costs={}, terms={})

    monkeypatch.setattr("rover_hil.tune.logs.study.evaluate_logs", lambda *_: result(next(train_costs)))
    monkeypatch.setattr("rover_hil.tune.logs.command.evaluate_logs", lambda *_: result(next(held_out_costs)))
    no_runs: list[ReplayErrors] = []
    monkeypatch.setattr(
        "rover_hil.tune.logs.command.replays_on", lambda *_: lambda *_: (run for run in no_runs)
    )
    assert command("tune", "logs", "rover.toml", *logs, "--study", "noise", "--trials", "3") == 0
    sentence = "Nothing better than the old values on 1 held-out log after 3 trials: they are kept, cost 5"
    assert command.out.splitlines()[0] == sentence
    assert list(held_out_costs) == [4.9]


def test_a_study_of_other_logs_is_refused(command: Command, logs: list[str]) -> None:
    arguments = ("tune", "logs", "rover.toml", "--study", "noise", "--trials", "1")
    assert command(*arguments, *logs) == 0
    assert command(*arguments, *reversed(logs)) == 2
    assert_one_sentence(command.error, "another configuration", "--study")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("20.mcap",), ("one log", "--held-out")),
        (("20.mcap", "20.mcap"), ("the same log",)),
        (("20.mcap", "--held-out", "20.mcap"), ("the same log",)),
        (("none.mcap", "20.mcap"), ("none.mcap", "No such file")),
    ],
)
def test_bad_logs_are_one_sentence(
    command: Command, logs: list[str], tmp_path: Path, arguments: tuple[str, ...], words: tuple[str, ...]
) -> None:
    assert command("tune", "logs", "rover.toml", "--study", "noise", *arguments) == 2
    assert_one_sentence(command.error, *words)
    assert not (tmp_path / "tuning").exists()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            ("y_m = 0.15", "y_m = 0.25"),
            ("another rover", "rover.wheels[0].y_m is 0.15 m there and 0.25 m here"),
        ),
        ((PARAMETERS, ""), ("[tune.logs.parameters]",)),
        (
            ('"filter.heading_noise_rad"', '"mission.speed_m_s"'),
            ("tune.logs.parameters.mission.speed_m_s", "replay"),
        ),
        (('"filter.heading_noise_rad"', '"filter.heading_noise"'), ("unknown key",)),
        (('"filter.heading_noise_rad"', '"filter.standstill_s"'), ("which readings", "remove it")),
        (("low = 0.03, high = 0.4", "low = 0.4, high = 0.03"), ("swap",)),
    ],
)
def test_a_bad_configuration_is_one_sentence(
    command: Command, logs: list[str], tmp_path: Path, change: tuple[str, str], words: tuple[str, ...]
) -> None:
    path = write_config(tmp_path)
    text = path.read_text()
    assert change[0] in text
    path.write_text(text.replace(*change))
    assert command("tune", "logs", "rover.toml", "--study", "noise", *logs) == 2
    assert_one_sentence(command.error, *words)


def test_a_log_of_the_shipped_robotino_is_of_another_rover(command: Command, logs: list[str]) -> None:
    assert command("tune", "logs", "robotino", "--study", "noise", *logs) == 2
    assert_one_sentence(command.error, "another rover", "rover.kinematics is 'wheels' there and 'omni3' here")


def test_a_log_without_truth_is_one_sentence_and_marks_make_up_for_it(
    command: Command, logs: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rover_hil.recording.schema.TRUTH", "/nothing")
    assert command("tune", "logs", "rover.toml", "--study", "noise", *logs) == 2
    assert_one_sentence(command.error, "20.mcap", "holds no true pose")
    for name in logs:
        marks = "t_s,x_m,y_m,yaw_deg,sigma_m\n0,2,1,90,0.003\n9.5,1.8,1.8,180,0.004\n"
        marks_file(tmp_path / name).write_text(marks)
    config = load_config(str(tmp_path / "rover.toml"))
    (log,) = read_judged_logs([tmp_path / logs[0]], config, 5.0)
    assert "by hand" in log.source
    assert log.poses is not None
    assert log.poses.x_m == pytest.approx([0.8])
    assert log.poses.y_m == pytest.approx([0.2])
    assert log.poses.yaw_rad == pytest.approx([math.pi / 2])
    # Of both positions, and of the first yaw (3 mm at both ends of 0.3 m) at this distance.
    away_m = math.hypot(0.8, 0.2) * math.sqrt(2.0) * 0.003 / 0.3
    assert log.poses.position_sd_m == pytest.approx([math.hypot(0.003, 0.004, away_m)])
    marks_file(tmp_path / logs[0]).write_text(marks.replace("0,2,1,90", "7,2,1,90"))
    with pytest.raises(LogError, match="where the rover starts"):
        read_judged_logs([tmp_path / logs[0]], config, 5.0)


def test_a_truth_that_begins_after_the_first_motion_is_no_judge(
    logs: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also where the wheels report speeds alone, and where only another wheel than the first has turned."""
    config = load_config(str(tmp_path / "rover.toml"))
    true_poses, readings = Drive.true_poses, Channels.__getitem__
    begin_s = 0.0

    def late(self: Drive) -> TruePoses:
        poses = true_poses(self)
        use = poses.t_ns >= self.log.start_ns + 1e9 * begin_s
        values: dict[str, Any] = {key.name: getattr(poses, key.name) for key in fields(poses)}
        used: dict[str, Any] = {
            name: value[use] for name, value in values.items() if isinstance(value, np.ndarray)
        }
        return replace(poses, **used)

    def without(hidden: tuple[str, ...]) -> Callable[[Channels, str], Readings]:
        return lambda self, name: readings(self, "none" if name in hidden else name)

    monkeypatch.setattr(Drive, "true_poses", late)
    for hidden in ((), ("position1_rad", "position2_rad"), ("position1_rad", "speed1_rad_s")):
        monkeypatch.setattr(Channels, "__getitem__", without(hidden))
        begin_s = 2.0  # the rover stands for three seconds
        read_judged_logs([tmp_path / logs[0]], config, 5.0)
        begin_s = 7.0
        with pytest.raises(LogError, match="after the first motion"):
            read_judged_logs([tmp_path / logs[0]], config, 5.0)


def test_a_study_does_not_go_on_with_other_positions_measured_by_hand(
    logs: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rover_hil.recording.schema.TRUTH", "/nothing")
    config = load_config(str(tmp_path / "rover.toml"))
    tune = check_log_parameters(config)
    assert tune.logs is not None
    marks = "t_s,x_m,y_m,yaw_deg\n0,0,0,0\n9.5,0.8,0.2,90\n"
    path = tmp_path / "study.jsonl"
    for text in (marks, marks, marks.replace("0.8", "0.9")):
        marks_file(tmp_path / logs[0]).write_text(text)
        judged = read_judged_logs([tmp_path / logs[0]], config, 5.0)
        with pytest.raises(ConfigError, match="another configuration") if text != marks else nullcontext():
            LogStudy(path, "noise", config, tune, tune.logs.objective, judged)


def test_every_third_log_is_held_out() -> None:
    def named(count: int) -> list[JudgedLog]:
        return [
            JudgedLog(name=str(number), content=bytes([number]), source="", poses=None, withheld_s=1.0)
            for number in range(count)
        ]

    def names(part: list[JudgedLog]) -> str:
        return "".join(log.name for log in part)

    def split_names(count: int) -> tuple[str, str]:
        train, held_out = split(named(count))
        return names(train), names(held_out)

    assert split_names(2) == ("0", "1")
    assert split_names(3) == ("01", "2")
    assert split_names(7) == ("01346", "25")
