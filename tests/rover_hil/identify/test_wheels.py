"""`rover-hil calibrate wheels`: radius and base of a rover whose configuration is wrong about them."""

import io
import json
import math
import re
import tomllib
from pathlib import Path

import numpy as np
import pytest

from controllers.motion.rover_geometry import (
    OmniRoverSettings,
    RoverSettings,
    SkidSteerRoverSettings,
    WheelsRoverSettings,
)
from controllers.motion.settings import LineMission, WholeTurnsMission
from controllers.motion.wheel_settings import WheelSettings
from drivers.errors import ConfigError
from rover_hil.config import Config, load_config, read_config_text
from rover_hil.console.ask import ask_number, ask_yes
from rover_hil.ready import procedure
from rover_hil.ready.wheels import calibration
from rover_hil.ready.wheels.fit import Factor, WheelsFit, fit_factor
from rover_hil.recording.schema import ESTIMATE, TRUTH
from rover_hil.recording.writer import LogWriter
from rover_hil.run.executive import End, RunResult
from tests.rover_hil.command import Command, assert_one_sentence

EXAMPLES = Path(__file__).parents[3] / "docs" / "examples"


TRUE_RADIUS_M, TRUE_BASE_M = 0.040, 0.125
WRONG_RADIUS_M, WRONG_BASE_M = 0.042, 0.120
START_NS = 1_000_000_000


def write_drive(path: Path, config: Config, true_m: float, true_turns: float) -> None:
    """Write the odometry of a rover whose configuration is wrong, and the truth."""
    steps = 60
    with LogWriter(path, START_NS, config.model_dump_json(by_alias=True).encode(), {}, "virtual") as log:
        for step in range(steps + 1):
            t_ns, share = START_NS + step * 100_000_000, step / steps
            x_m, yaw_rad = true_m * share, math.tau * true_turns * share
            turned_rad = yaw_rad * WRONG_RADIUS_M / TRUE_RADIUS_M * TRUE_BASE_M / WRONG_BASE_M
            rolled_m = x_m * WRONG_RADIUS_M / TRUE_RADIUS_M
            pose = {"x_m": rolled_m, "y_m": 0.0, "yaw_rad": math.remainder(turned_rad, math.tau)}
            velocity = {"velocity_x_m_s": 0.0, "velocity_y_m_s": 0.0, "yaw_rate_rad_s": 0.0}
            estimate = {"t_ns": t_ns, **pose, **velocity, "gyro_bias_rad_s": 0.0, "covariance": [0.0] * 6}
            command = {"t_ns": t_ns, "expires_ns": t_ns, "speed_rad_s": [0.0] * 3}
            record = {
                "t_ns": t_ns, "mode": "running", "reason": "", "odometry": pose, "odometry_rebases": 0,
                "estimate": {**estimate, "yaw_source": "gyro"}, "innovations": [], "command": command,
                "limit": "", "cross_track_m": None,
            }  # fmt: skip
            log.write_json(ESTIMATE, t_ns, record)
            log.write_json(TRUTH, t_ns, {"t_ns": t_ns, "x_m": x_m, "y_m": 0.0, "yaw_rad": yaw_rad})


def write_config(folder: Path) -> str:
    text = read_config_text("robotino").replace(
        "wheel_radius_m = 0.040", f"wheel_radius_m = {WRONG_RADIUS_M}"
    )
    text = text.replace("base_radius_m = 0.125", f"base_radius_m = {WRONG_BASE_M}")
    (folder / "rover.toml").write_text(text, "utf-8")
    return "rover.toml"


def test_wrong_geometry_is_found_where_the_command_drives(
    command: Command, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def drive(config: Config, path: Path, limit_s: float, *_: object, **options: object) -> RunResult:
        mission = config.mission
        assert limit_s > 20.0
        if isinstance(mission, LineMission):
            write_drive(path, config, mission.length_m, 0.0)
        else:
            assert isinstance(mission, WholeTurnsMission)
            write_drive(path, config, 0.0, mission.turns if mission.senses == "left" else -mission.turns)
        return RunResult(End.FINISHED)

    monkeypatch.setattr(procedure, "run_virtual", drive)
    path = write_config(tmp_path)
    assert command("calibrate", "wheels", path, "--virtual", "--out", "wheels.toml", "--enter") == 0
    found = tomllib.loads((tmp_path / "wheels.toml").read_text("utf-8"))["rover"]
    assert found == {"wheel_radius_m": TRUE_RADIUS_M, "base_radius_m": TRUE_BASE_M}
    assert load_config(path).rover.model_dump(include=set(found)) == found
    assert "# What `rover-hil tune` may change" in (tmp_path / path).read_text("utf-8")
    assert (tmp_path / "wheels.html").is_file()


@pytest.mark.parametrize(
    ("end", "code", "words"),
    [
        (End.STOPPED_BY_USER, 130, "interrupted by ctrl-C"),
        (End.TERMINATED, 143, "the terminal or connection was lost (SIGHUP)"),
    ],
)
@pytest.mark.parametrize("what", ["wheels robotino", "imu robotino", "compass el-dorado"])
def test_a_rover_whose_drive_was_ended_by_the_user_does_not_drive_on(
    command: Command, monkeypatch: pytest.MonkeyPatch, what: str, end: End, code: int, words: str
) -> None:
    drives = []

    def drive(config: Config, path: Path, *arguments: object, **options: object) -> RunResult:
        drives.append(path)
        return RunResult(end, words)

    monkeypatch.setattr(procedure, "run_virtual", drive)
    assert command("calibrate", *what.split(), "--virtual", "--out", "out.toml") == code
    assert_one_sentence(command.error, words)
    assert len(drives) == 1
    assert not Path("out.html").exists()


@pytest.mark.parametrize("end", [End.EMERGENCY_STOP, End.DEVICE_FAILED, End.TIME_OVER])
def test_after_a_drive_that_was_not_completed_nothing_is_asked_and_driven(
    command: Command, monkeypatch: pytest.MonkeyPatch, end: End
) -> None:
    drives = []

    def drive(config: Config, path: Path, *arguments: object, **options: object) -> RunResult:
        drives.append(path)
        return RunResult(end, "wheel 1: stalled")

    monkeypatch.setattr(procedure, "run_real", drive)
    monkeypatch.setattr(calibration, "ask_number", lambda *arguments: pytest.fail("asked"))
    assert command("calibrate", "wheels", "robotino", "--drive", "--out", "out.toml") == 1
    assert_one_sentence(command.error, "line1", "wheel 1: stalled")
    assert len(drives) == 1
    assert not Path("out.html").exists()


@pytest.mark.parametrize("what", ["wheels robotino", "imu robotino", "compass el-dorado"])
def test_a_calibration_that_was_not_sure_can_be_repeated(
    command: Command, monkeypatch: pytest.MonkeyPatch, what: str
) -> None:
    def drive(config: Config, path: Path, *arguments: object, **options: object) -> RunResult:
        return RunResult(End.STOPPED_BY_USER)

    monkeypatch.setattr(procedure, "run_virtual", drive)
    for name in ("out.mcap", "out-line1.mcap"):
        Path(name).write_text("earlier")
    arguments = ("calibrate", *what.split(), "--virtual", "--out", "out.toml")
    assert command(*arguments) == 2  # a log of something else is never replaced
    assert_one_sentence(command.error, ".mcap exists", "--force")
    Path("out.html").write_text("earlier")
    assert command(*arguments) == 130
    Path("out.toml").write_text("earlier")
    assert command(*arguments) == 2
    assert_one_sentence(command.error, "out.toml exists", "--force")


def test_known_distances_and_turns_of_logs(command: Command, tmp_path: Path) -> None:
    path = write_config(tmp_path)
    config = load_config(path)
    for name, metres, turns in (("a", 5.0, 0.0), ("b", 0.0, -3.0), ("c", 0.1, 0.1)):
        write_drive(tmp_path / f"{name}.mcap", config, metres, turns)
    logs = ["--line", "a.mcap=5.01", "--spin", "b.mcap=-2.99"]
    assert command("calibrate", "wheels", path, "--out", "wheels.toml", *logs, "--json") == 0
    found = json.loads(command.out)["rover"]
    assert found["wheel_radius_m"] == pytest.approx(TRUE_RADIUS_M, rel=0.003)
    assert found["base_radius_m"] == pytest.approx(TRUE_BASE_M, rel=0.006)
    assert command("calibrate", "wheels", path, "--out", "double.toml", "--line", "a.mcap=2.5") == 1
    assert "correct ticks, gear ratio, sign or units" in command.out
    assert not (tmp_path / "double.toml").exists()
    for option, words in (("--spin", "half a turn in one sense is needed"), ("--line", "0.3 m are needed")):
        assert command("calibrate", "wheels", path, "--out", "c.toml", option, "c.mcap=1") == 2
        assert_one_sentence(command.error, words)


@pytest.mark.parametrize("seed", range(3))
def test_the_interval_covers_the_truth(seed: int) -> None:
    rng, hits = np.random.default_rng(seed), 0
    for _ in range(200):
        odometry = rng.uniform(2.0, 6.0, 4)
        factor = fit_factor((1.03 * odometry + rng.normal(0.0, 0.01, 4)).tolist(), odometry.tolist(), 0.01)
        hits += abs(factor.value - 1.03) <= factor.half_width
    assert hits >= 186


ROVER = OmniRoverSettings(kinematics="omni3", wheel_radius_m=0.04, base_radius_m=0.125)
SKID = SkidSteerRoverSettings(kinematics="skid_steer_4", wheel_radius_m=0.1, track_m=0.6)


def fit_of(rover: RoverSettings, radius: Factor | None, turn: Factor | None) -> WheelsFit:
    return WheelsFit(rover=rover, radius=radius, turn=turn)


def test_scatter_beyond_the_stated_accuracy_widens_the_interval() -> None:
    close = fit_factor([5.0, 5.01], [5.0, 5.0], 0.005)
    far = fit_factor([5.0, 5.4], [5.0, 5.0], 0.005)
    assert fit_of(ROVER, close, None).problem == ""
    assert far.half_width > 10 * close.half_width
    assert "uncertain" in fit_of(ROVER, far, None).problem


def test_each_kind_of_rover_gets_its_own_keys() -> None:
    radius, turn = fit_factor([5.1], [5.0], 0.001), fit_factor([6.0], [6.3], 0.001)
    assert fit_of(SKID, radius, turn).values == {"wheel_radius_m": 0.102, "track_m": pytest.approx(0.6426)}
    assert fit_of(SKID, None, turn).values == {"track_m": pytest.approx(0.63)}
    # Without turns the base goes with the radius, and turns stay as they are.
    assert fit_of(SKID, radius, None).values == {"wheel_radius_m": 0.102, "track_m": pytest.approx(0.612)}
    rover = load_config(str(EXAMPLES / "differential.toml")).rover
    assert isinstance(rover, WheelsRoverSettings)
    assert not fit_of(rover, radius, turn).skids
    assert fit_of(rover, radius, turn).wheels == [
        {"x_m": 0.0, "y_m": pytest.approx(0.16065), "radius_m": pytest.approx(0.0612)},
        {"x_m": 0.0, "y_m": pytest.approx(-0.16065), "radius_m": pytest.approx(0.0612)},
    ]


def test_the_effective_track_of_wheels_that_skid_is_a_result() -> None:
    turn = fit_factor([6.0], [1.64 * 6.0], 0.001)
    assert fit_of(SKID, None, turn).problem == ""
    assert fit_of(SKID, None, turn).values == {"track_m": pytest.approx(1.64 * 0.6, rel=1e-4)}
    assert "a factor of 1.64" in fit_of(ROVER, None, turn).problem
    assert "a factor of 5" in fit_of(SKID, None, fit_factor([1.0], [5.0], 0.001)).problem
    assert "a factor of 1.64" in fit_of(SKID, turn, None).problem  # a distance does not skid
    wheels = [WheelSettings(x_m=x_m, y_m=y_m, radius_m=0.1) for x_m in (0.3, -0.3) for y_m in (0.25, -0.25)]
    rover = WheelsRoverSettings(kinematics="wheels", wheels=tuple(wheels))
    assert fit_of(rover, None, turn).problem == ""
    assert fit_of(rover, None, turn).wheels[0] == {"x_m": 0.3, "y_m": pytest.approx(0.41), "radius_m": 0.1}


def test_bad_input_is_one_sentence(command: Command) -> None:
    for options, words in (
        ("--out w.toml --line run.mcap", "--line run.mcap: write the log and what is known"),
        ("--out w.toml --spin run.mcap=0", "--spin run.mcap=0: write"),
        ("--out w.toml --line run.mcap=-3", "--line run.mcap=-3: a distance from start to end is above 0 m"),
        ("--out w.toml --line none.mcap=2", "cannot read log none.mcap"),
        ("--out w.html", "name a file that ends with .toml"),
        ("--out w.toml --enter", "--enter: robotino cannot be edited"),
        ("--out w.toml --virtual --line run.mcap=3", "run.mcap is a log: leave --virtual out"),
    ):
        assert command("calibrate", "wheels", "robotino", *options.split()) == 2
        assert_one_sentence(command.error, words)
    write_drive(Path("run.mcap"), load_config("robotino"), 2.0, 0.0)
    for what in ("wheels", "scale"):
        assert command("calibrate", what, "run.mcap", "--out", "w.toml") == 2
        assert_one_sentence(command.error, "run.mcap")


class Lines(io.StringIO):
    """Answers as the standard input.

    Args:
        text: The answers.
        is_terminal: What `isatty` returns.
    """

    def __init__(self, text: str, *, is_terminal: bool) -> None:
        super().__init__(text)
        self._is_terminal = is_terminal

    def isatty(self) -> bool:
        return self._is_terminal


def test_questions_are_asked_again_until_the_answer_is_right(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.stdin", Lines("two\n70\n2.5\nmaybe\n\n", is_terminal=True))
    assert ask_number("Distance, m", 0.1, 50.0) == 2.5
    assert ask_yes("Go on?", default=True)
    assert capsys.readouterr().err.count("Distance, m: ") == 3


@pytest.mark.parametrize("answer", ["two", "70", "", "nan"])
def test_a_wrong_answer_from_a_file_ends_the_command(monkeypatch: pytest.MonkeyPatch, answer: str) -> None:
    """The next line answers another question, such as whether the wheels are lifted."""
    monkeypatch.setattr("sys.stdin", Lines(f"{answer}\nyes\n2.5\n", is_terminal=False))
    with pytest.raises(ConfigError, match="the answer to 'Distance, m' cannot be used: "):
        ask_number("Distance, m", 0.1, 50.0)


@pytest.mark.parametrize(
    ("what", "rover", "words"),
    [
        ("wheels", "robotino", ("x 0 to 2 m", "lower --length")),
        ("compass", "car", ("--by-hand",)),
        ("mounting", "car", ("--by-hand",)),
    ],
)
def test_nothing_is_driven_outside_the_free_place(
    command: Command, monkeypatch: pytest.MonkeyPatch, what: str, rover: str, words: tuple[str, ...]
) -> None:
    """A rover that turns on the spot needs no room for that; one that cannot drives rings."""
    monkeypatch.setattr(procedure, "run_virtual", lambda *arguments: pytest.fail("driven"))
    area = "points_m = [[-1.5, -1.5], [1.5, -1.5], [1.5, 1.5], [-1.5, 1.5]]"
    text = read_config_text("robotino" if rover == "robotino" else "el-dorado-crab")
    text = (
        re.sub(r"length_m = [\d.]+", "length_m = 0.9", text) + f'\n[safety.area]\ntype = "polygon"\n{area}\n'
    )
    if rover == "car":
        text = text.replace("low_deg = -60, high_deg = 60", "low_deg = -20, high_deg = 20")
    Path("rover.toml").write_text(text, "utf-8")
    assert command("calibrate", *what.split(), "rover.toml", "--virtual", "--out", "out.toml") == 2
    assert_one_sentence(command.error, "safety.area", *words)
