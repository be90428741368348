"""`rover-hil commission` on drives whose odometry, estimate and marks are known."""

import cmath
import io
import json
import math
import os
import pty
import re
import select
import shutil
import sys
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from rich.text import Text

from drivers.errors import LogError
from rover_hil.config import Config, load_config, read_config_text
from rover_hil.console.key_presses import enter_was_pressed
from rover_hil.drives.drive import read_drive
from rover_hil.drives.marks import marks_file, read_marks
from rover_hil.ready import procedure
from rover_hil.ready.commission.drive import read_poses
from rover_hil.ready.commission.procedure import Plan
from rover_hil.recording.schema import ESTIMATE
from rover_hil.recording.writer import LogWriter
from rover_hil.run.excitation import for_real_rover
from rover_hil.run.executive import End, RunResult
from tests.rover_hil.command import Command, assert_one_sentence

START_NS = 1_000_000_000
STEP_S = 0.1
SCALE = 1.25
"""The wheels count this much more than the rover moves: a slip of 20 %."""
SD_M = 0.02
PLAN = Plan(side_m=1.0, laps=2, tape_sd_m=0.005)


@pytest.fixture(scope="module")
def config() -> Config:
    return load_config("robotino")


def write_drive(
    path: Path,
    config: Config,
    name: str,
    *,
    estimate_scale: float = 1.0,
    reason: str = "",
    sd_m: float = SD_M,
    origin: str = "real",
    has_slip: bool = True,
) -> None:
    """Write a drive along its mission, true at every corner, with stops of 4 s."""
    corners = PLAN.mission(name, 0.2).corners()
    path.parent.mkdir(exist_ok=True)
    config_json = config.model_dump_json(by_alias=True).encode()
    with LogWriter(path, START_NS, config_json, {}, origin) as log:
        t_ns = START_NS
        for begin, end in pairwise(corners):
            yaw = math.atan2(end[1] - begin[1], end[0] - begin[0])
            for step in range(100):
                share = min(1.0, step / 49)
                x, y = (a + share * (b - a) for a, b in zip(begin, end, strict=True))
                record = _record(t_ns, x, y, yaw, estimate_scale, sd_m, reason, moves=step < 50)
                if not has_slip:
                    del record["slip"]
                log.write_json(ESTIMATE, t_ns, record)
                t_ns += round(1e9 * STEP_S)


def _record(
    t_ns: int, x: float, y: float, yaw: float, scale: float, sd_m: float, reason: str, *, moves: bool
) -> dict[str, object]:
    velocity = {"velocity_x_m_s": 0.0, "velocity_y_m_s": 0.0, "yaw_rate_rad_s": 0.0, "gyro_bias_rad_s": 0.0}
    covariance = [sd_m**2, 0.0, 0.0, sd_m**2, 0.0, 0.01**2]
    rover = {"slip": 0.2, "sd": 0.01, "source": "excitation", "reason": reason, "unsure": ""}
    return {
        "t_ns": t_ns, "mode": "running", "reason": "",
        "odometry": {"x_m": SCALE * x, "y_m": SCALE * y, "yaw_rad": yaw}, "odometry_rebases": 0,
        "estimate": {
            "t_ns": t_ns, "x_m": scale * x, "y_m": scale * y, "yaw_rad": yaw, **velocity,
            "covariance": covariance, "yaw_source": "gyro",
        },
        "innovations": [], "limit": "", "cross_track_m": None,
        "command": {"t_ns": t_ns, "expires_ns": t_ns, "speed_rad_s": [1.0 if moves else 0.0] * 3},
        "slip": {"map": "probe", "surface": None, "drift_rad": 0.0, "wheels": [], "rover": rover},
    }  # fmt: skip


def write_marks(path: Path, name: str, sigma_m: float = 0.005) -> None:
    """Write the true corners as marks."""
    corners = PLAN.mission(name, 0.2).corners()
    stops_s = read_poses(path).stops_s
    assert len(stops_s) == len(corners) - 1
    lines = ["t_s,x_m,y_m,yaw_deg,sigma_m"]
    for t_s, (begin, (x, y)) in zip(stops_s, pairwise(corners), strict=True):
        yaw = math.degrees(math.atan2(y - begin[1], x - begin[0]))
        lines.append(f"{t_s:.3f},{x},{y},{yaw},{sigma_m}")
    marks_file(path).write_text("\n".join(lines) + "\n", "utf-8")


def write_all(config: Config, **options: object) -> None:
    for name in PLAN.names():
        path = Path("runs") / f"{name}.mcap"
        write_drive(path, config, name, **options)  # type: ignore[arg-type]
        write_marks(path, name)


def again(command: Command, *options: str) -> int:
    return command(
        "commission", "robotino", "--again", "--out", "runs", "--side", "1", "--laps", "2", *options
    )


@pytest.mark.usefixtures("unrendered")
def test_errors_slip_and_covariance_are_those_of_the_drives(command: Command, config: Config) -> None:
    write_all(config)
    assert again(command, "--json") == 0, command.error
    found = json.loads(command.out)
    # The line has marks at 1/3, 2/3 and 1 m, each of four squares at (1, 0), (1, 1), (0, 1) and (0, 0).
    distances = [1 / 3, 2 / 3, 1.0, *[1.0, math.sqrt(2.0), 1.0, 0.0] * 4]
    assert found["odometry_rms_m"] == pytest.approx(0.25 * math.sqrt(np.mean(np.square(distances))), rel=1e-6)
    assert found["estimate_rms_m"] == pytest.approx(0.0, abs=1e-9)
    assert found["umbmark_systematic_m"] == pytest.approx(0.0, abs=1e-9)
    assert found["slip"] == pytest.approx(0.2)
    assert found["estimated_slip"] == pytest.approx(0.2)
    assert found["marks_inside_95"] == 1.0
    assert found["doubts"] == []
    assert again(command) == 0
    assert "passed on this ground" in command.out
    assert "it passed here: set excite_real_rover = true in [slip]" in command.out
    Path("runs/line.mcap").unlink()
    write_drive(Path("runs/line.mcap"), config, "line", origin="virtual")
    assert again(command) == 0
    assert "it passed on the simulated ground. On a real rover it stays off" in command.out


@pytest.mark.usefixtures("unrendered")
def test_the_excitation_is_entered_where_it_has_passed(command: Command, config: Config) -> None:
    write_all(config)
    Path("rover.toml").write_text(read_config_text("robotino"), "utf-8")
    options = ("--again", "--enter", "--out", "runs", "--side", "1", "--laps", "2")
    assert for_real_rover(load_config("rover.toml"))[0].slip is None
    assert command("commission", "rover.toml", *options) == 0, command.error
    assert "excite_real_rover = true is now in [slip]" in command.out
    allowed = load_config("rover.toml")
    assert (allowed.ground.slip, allowed.ground.source) == ("learned", "runs")
    assert allowed.ground.slip_mean == pytest.approx(0.2, abs=0.02)
    assert allowed.ground.prior().sd < 0.05
    assert for_real_rover(allowed) == (allowed, "")
    assert command("commission", "robotino", *options) == 2
    assert_one_sentence(command.error, "robotino cannot be edited")
    # Where it has not passed the configuration stays as it is.
    Path("rover.toml").write_text(read_config_text("robotino"), "utf-8")
    shutil.rmtree("runs")
    write_all(config, reason="gyro in doubt")
    assert command("commission", "rover.toml", *options) == 1
    assert Path("rover.toml").read_text("utf-8") == read_config_text("robotino")


@pytest.mark.usefixtures("unrendered")
def test_only_the_excitation_that_was_driven_is_entered(command: Command, config: Config) -> None:
    """Drives with known surfaces pass, and say nothing about the excitation."""
    text = read_config_text("robotino")
    assert config.slip is not None
    write_all(config.model_copy(update={"slip": config.slip.model_copy(update={"use": "surfaces"})}))
    options = ("--again", "--enter", "--out", "runs", "--side", "1", "--laps", "2")
    Path("rover.toml").write_text(text, "utf-8")
    assert command("commission", "rover.toml", *options) == 2
    assert_one_sentence(command.error, "was driven with another [rover] or [slip] than that of rover.toml")
    assert Path("rover.toml").read_text("utf-8") == text
    Path("rover.toml").write_text(text.replace('use = "yaw_probe"', 'use = "surfaces"'), "utf-8")
    assert command("commission", "rover.toml", *options) == 0, command.error
    assert load_config("rover.toml").ground.slip == "learned"


@pytest.mark.usefixtures("unrendered")
@pytest.mark.parametrize("t_s", ["-3", "1e6"])
def test_a_mark_outside_its_drive_is_refused(command: Command, config: Config, t_s: str) -> None:
    write_all(config)
    path = marks_file(Path("runs/line.mcap"))
    path.write_text(f"t_s,x_m,y_m,yaw_deg,sigma_m\n{t_s},1,0,0,0.005\n", "utf-8")
    assert again(command) == 2
    assert_one_sentence(command.error, "t_s must be within the drive, 0 to")


def test_a_real_run_without_a_passed_commissioning_does_not_excite_the_yaw(
    command: Command, config: Config, monkeypatch: pytest.MonkeyPatch
) -> None:
    driven = []

    def drive(
        config: Config,
        log: Path,
        limit_s: float,
        show: Callable[[object, object], None],
        *rest: object,
        **options: object,
    ) -> object:
        driven.append(config)
        output = SimpleNamespace(t_ns=0, reason="", checks=None)
        show(output, ())
        show(output, ())
        raise LogError("enough")

    monkeypatch.setattr("rover_hil.drive.run_surroundings._status_line", lambda output: Text())
    monkeypatch.setattr("rover_hil.run.driving.run_real", drive)
    monkeypatch.setattr("rover_hil.run.driving.run_virtual", drive)
    command("run", "robotino", "--out", "a")
    assert command.error.count("the yaw excitation is off, and slip is not compensated") == 1
    assert "excite_real_rover = true in [slip]" in command.error
    # Without it nothing compares the turns of the gyro with others.
    assert command.error.count("yaw unwatched: nothing in this mission would notice that imu") == 1
    command("run", "robotino", "--virtual", "--out", "a")
    assert "excitation" not in command.error
    assert "unwatched" not in command.error
    assert [each.slip is None for each in driven] == [True, False]


@pytest.mark.usefixtures("unrendered")
@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"estimate_scale": 1.2}, "estimated slip is wrong by -16.0 %"),
        ({"estimate_scale": 1.04, "sd_m": 0.002}, "covariance is too small"),
        ({"reason": "gyro in doubt"}, "valid for 0 % of the driven time"),
        ({"estimate_scale": 1.3}, "farther off than the wheels alone"),
    ],
)
def test_an_estimator_that_does_not_pass_is_named_with_its_reason(
    command: Command, config: Config, options: dict[str, object], words: str
) -> None:
    write_all(config, **options)
    assert again(command) == 1
    assert words in command.out
    assert 'yaw excitation: it must not be used on this ground: set use = "surfaces"' in command.out


@pytest.mark.usefixtures("unrendered")
def test_a_rover_without_slip_compensation_passes_by_its_estimate_and_covariance(
    command: Command, config: Config
) -> None:
    plain = config.model_copy(update={"slip": None})
    write_all(plain, has_slip=False)
    Path("plain.toml").write_text(without_section(read_config_text("robotino"), "slip"), "utf-8")
    line = ("commission", "plain.toml", "--again", "--out", "runs", "--side", "1", "--laps", "2")
    assert command(*line) == 0, command.out + command.error
    assert "slip estimator: none\n" in command.out
    assert "commissioning: passed on this ground" in command.out
    shutil.rmtree("runs")
    write_all(plain, has_slip=False, estimate_scale=1.04, sd_m=0.002)
    assert command(*line) == 1
    assert "commissioning: not passed: the covariance is too small" in command.out


def without_section(text: str, section: str) -> str:
    """Return the text of a configuration without a section and those within it."""
    return re.sub(rf"(?ms)^\[{section}[.\]].*?(?=^\[(?!{section}\.))", "", text)


@pytest.mark.usefixtures("unrendered")
@pytest.mark.parametrize(
    ("sd_m", "words"),
    [(0.2, "too large by a factor of "), (0.012, "holds: "), (0.002, "too small by a factor of ")],
)
def test_a_covariance_holds_only_if_the_errors_are_as_large_as_it_says(
    command: Command, config: Config, sd_m: float, words: str
) -> None:
    """The estimate is off by 2 % of each distance, 14 mm rms."""
    write_all(config, estimate_scale=1.02, sd_m=sd_m)
    again(command)
    assert f"covariance: {words}" in command.out


@pytest.mark.usefixtures("unrendered")
def test_umbmark_is_the_centre_of_the_ends_of_each_sense(command: Command, config: Config) -> None:
    write_all(config)
    for name, (x, y) in {"square-left-1": (0.03, 0.0), "square-left-2": (0.05, 0.0)}.items():
        path = marks_file(Path("runs") / f"{name}.mcap")
        lines = path.read_text("utf-8").splitlines()
        cells = lines[-1].split(",")
        lines[-1] = ",".join([cells[0], str(x), str(y), *cells[3:]])
        path.write_text("\n".join(lines) + "\n", "utf-8")
    again(command, "--json")
    assert json.loads(command.out)["umbmark_systematic_m"] == pytest.approx(0.04)


@pytest.mark.usefixtures("unrendered")
def test_marks_at_the_start_alone_measure_no_slip(command: Command, config: Config) -> None:
    """The ends of the squares are enough marks, but no distance."""
    write_all(config)
    for path in [marks_file(log) for log in Path("runs").glob("*.mcap")]:
        head, *rows = path.read_text("utf-8").splitlines()
        kept = rows[-1:] if path.name.startswith("square") else []
        path.write_text("\n".join([head, "0.1,0,0,,0.005", *kept]) + "\n", "utf-8")
    assert again(command) == 1
    assert "no slip was measured: two marks in succession must be 0.2 m apart" in command.out


@pytest.mark.usefixtures("unrendered")
def test_measured_positions_are_asked_for_and_kept(
    command: Command, config: Config, monkeypatch: pytest.MonkeyPatch
) -> None:
    def drive(driven: Config, log: Path, *rest: object, **options: object) -> object:
        write_drive(log, config, log.stem)
        return RunResult(End.FINISHED)

    monkeypatch.setattr(procedure, "run_real", drive)
    monkeypatch.setattr("rover_hil.ready.commission.procedure.LINE_STOPS", 2)
    line = "\nyes\n0.33\n0.01\n1.5\nno\nyes\n1.0\n0.02\n\n"
    square = "\n" + "no\n" * 3 + "yes\n0.01\n0.02\n-88\n"
    monkeypatch.setattr(sys, "stdin", io.StringIO(line + square * 2))
    assert command("commission", "robotino", "--laps", "1", "--side", "1", "--drive", "--out", "runs") == 1
    assert "5 marks" not in command.out
    assert "4 marks were measured, 6 are needed" in command.out
    marks = read_marks(Path("runs/line.positions.csv"))
    assert marks.x_m == pytest.approx([0.33, 1.0])
    assert marks.yaw_deg[0] == 1.5
    assert math.isnan(marks.yaw_deg[1])
    assert marks.t_s == pytest.approx(read_poses(Path("runs/line.mcap")).stops_s[[0, 2]], abs=1e-3)
    assert command("commission", "robotino", "--laps", "1", "--out", "runs") == 2
    assert_one_sentence(command.error, "--force")


@pytest.mark.usefixtures("unrendered")
def test_enter_pressed_while_it_drives_marks_a_place(
    command: Command, config: Config, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The second press is in the middle of a stop, which is then not asked for; the first while it drives."""
    presses_s = (2.0, 7.0)

    def drive(
        driven: Config, log: Path, limit_s: float, show: Callable[[object, object], None], **rest: object
    ) -> object:
        write_drive(log, config, log.stem)
        pose = SimpleNamespace(x_m=0.0, y_m=0.0)
        for step in range(300):
            t_s = STEP_S * step
            monkeypatch.setattr(
                "rover_hil.ready.commission.procedure.enter_was_pressed", lambda t_s=t_s: t_s in presses_s
            )
            show(SimpleNamespace(t_ns=START_NS + round(1e9 * t_s), estimate=pose, reason=""), ())
        return RunResult(End.FINISHED)

    monkeypatch.setattr(procedure, "run_real", drive)
    monkeypatch.setattr(Plan, "names", lambda plan: ["line"])
    answers = "\nyes\n0.1\n0\n\nyes\n0.33\n0\n0\nno\nyes\n1.0\n0\n0\n"
    monkeypatch.setattr(sys, "stdin", io.StringIO(answers))
    assert command("commission", "robotino", "--side", "1", "--drive", "--out", "runs") == 1
    assert "line, Enter at 2.0 s: was it measured?" in command.error
    marks = read_marks(Path("runs/line.positions.csv"))
    assert marks.t_s[:2] == pytest.approx(presses_s)
    assert len(marks.t_s) == 3
    # A third of a metre in 4.9 s, 25 % more by the wheels, and a fifth of a second to press a key.
    moving_m_s = SCALE / 3.0 / 4.9
    assert marks.sigma_m[:2] == pytest.approx([math.hypot(0.005, 0.2 * moving_m_s), 0.005], rel=0.05)


def test_enter_is_read_from_a_terminal_only(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stdin", io.StringIO("\n"))
    assert not enter_was_pressed()
    assert sys.stdin.readline() == "\n"
    ours, theirs = pty.openpty()
    with os.fdopen(theirs, "r", encoding="utf-8") as terminal, os.fdopen(ours, "wb", buffering=0) as keys:
        monkeypatch.setattr(sys, "stdin", terminal)
        assert not enter_was_pressed()
        keys.write(b"\n")
        assert select.select([terminal], [], [], 5.0)[0]
        assert enter_was_pressed()
        assert not enter_was_pressed()


@pytest.mark.usefixtures("unrendered")
@pytest.mark.parametrize(("turned_deg", "inside"), [(1.5, 1.0), (8.0, 0.5)])
def test_a_rover_put_askew_on_its_start_does_not_blame_the_covariance(
    command: Command, config: Config, turned_deg: float, inside: float
) -> None:
    """5 mm at both ends of 0.3 m are 1.4 deg: 24 mm after a metre, where the estimate claims 2 mm."""
    write_all(config, sd_m=0.002)
    turn = cmath.rect(1.0, math.radians(turned_deg))
    for path in [marks_file(log) for log in Path("runs").glob("*.mcap")]:
        head, *rows = path.read_text("utf-8").splitlines()
        lines = [head]
        for row in rows:
            t_s, x, y, yaw_deg, sigma_m = map(float, row.split(","))
            place = complex(x, y) * turn
            lines.append(f"{t_s},{place.real},{place.imag},{yaw_deg + turned_deg},{sigma_m}")
        path.write_text("\n".join(lines) + "\n", "utf-8")
    again(command, "--json")
    found = json.loads(command.out)["marks_inside_95"]
    assert found == 1.0 if inside == 1.0 else found < inside


def test_marks_beside_a_log_are_its_pose_fixes(command: Command, config: Config) -> None:
    path = Path("runs/line.mcap")
    write_drive(path, config, "line")
    write_marks(path, "line", sigma_m=0.01)
    true = read_drive(path).true_poses()
    assert true.source == "marks measured by hand in line.positions.csv"
    assert true.x_m == pytest.approx([1 / 3, 2 / 3, 1.0])
    assert true.position_sd_m == pytest.approx(0.01)
    assert not true.is_exact


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("t_s,x_m,y_m\n1,0,0\n", "yaw_deg"),
        ("t_s,x_m,y_m,yaw_deg,sigma_m\n1,0,0,0,0\n", "above 0"),
        ("t_s,x_m,y_m,yaw_deg,sigma_m\n2,0,0,0,0.01\n1,0,0,0,0.01\n", "do not rise"),
        ("t_s,x_m,y_m,yaw_deg,sigma_m\n1,,0,0,0.01\n", "x_m"),
    ],
)
def test_wrong_marks_are_one_sentence(command: Command, config: Config, text: str, words: str) -> None:
    write_drive(Path("runs/line.mcap"), config, "line")
    marks_file(Path("runs/line.mcap")).write_text(text, "utf-8")
    assert again(command) == 2
    assert_one_sentence(command.error, "line.positions.csv", words)


def test_nothing_to_look_at_again_is_one_sentence(command: Command, config: Config) -> None:
    assert again(command) == 2
    assert_one_sentence(command.error, "--again")
    write_drive(Path("runs/line.mcap"), config, "line")
    assert again(command) == 2
    assert_one_sentence(command.error, "line.positions.csv", "t_s,x_m,y_m,yaw_deg,sigma_m")


@pytest.mark.usefixtures("unrendered")
def test_a_simulated_drive_is_measured_with_the_error_of_the_tape(
    command: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Plan, "names", lambda plan: ["line"])
    assert command("commission", "robotino", "--virtual", "--side", "0.75", "--out", "try", "--json") == 1
    found = json.loads(command.out)
    # Its gyro is not calibrated: that the slip is estimated too small on short legs may be another doubt.
    assert found["doubts"][0] == "3 marks were measured, 6 are needed"
    assert found["odometry_rms_m"] > found["estimate_rms_m"]
    # The marks are the truth with the error of the tape.
    true = read_drive(Path("try/line.mcap"))
    marks = read_marks(Path("try/line.positions.csv"))
    poses = true.true_poses()
    at_marks = np.interp(marks.t_s, true.seconds(poses.t_ns), poses.x_m)
    assert 0.0 < np.abs(at_marks - marks.x_m).max() < 0.02


def test_nothing_is_driven_outside_the_free_place(command: Command) -> None:
    area = "points_m = [[-1, -1], [3, -1], [3, 3], [-1, 3]]"
    text = read_config_text("robotino") + f'\n[safety.area]\ntype = "polygon"\n{area}\n'
    Path("rover.toml").write_text(text, "utf-8")
    assert command("commission", "rover.toml", "--virtual", "--side", "2", "--out", "runs") == 2
    assert_one_sentence(command.error, "x 0 to 2 m and y -2 to 2 m", "safety.area", "--side")
