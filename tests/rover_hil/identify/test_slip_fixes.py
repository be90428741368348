"""Slip of a rover whose pose only an overhead camera sees: its late and noisy fixes are the truth."""

import json
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from controllers.motion.kinematics import OmniKinematics
from controllers.slip.effort.motor_model import MotorSettings
from drivers.errors import LogError
from drivers.samples import PoseFixSample, WheelSample
from rover_hil.drives.robotino_csv import ROBOTINO
from rover_hil.identify.slip.command import identify_slip
from rover_hil.identify.slip.form_windows import CONTRADICTION, NO_FIX, TOO_NOISY
from rover_hil.identify.slip.run_data import RunWindows
from rover_hil.identify.slip.runs import read_windows
from rover_hil.recording.data_files import collect_data_files
from rover_hil.recording.writer import LogWriter
from tests.rover_hil.test_overhead_run import config_with

START_NS = 1_000_000_000
PERIOD_S = 0.02
SPEED_M_S = 0.15
LATENCY_S = 0.3
POSITION_SD_M, YAW_SD_RAD = 0.002, math.radians(0.2)


def write_drive(
    path: Path,
    *,
    slip: float = 0.3,
    duration_s: float = 12.0,
    begins_s: float = 0.0,
    ends_s: float = math.inf,
    direction_rad: float = 0.5,
    current_a: float = 0.8,
    fix_period_s: float = 0.5,
    is_seen: Callable[[float], bool] = lambda t_s: True,
    jump_s: float = math.inf,
    has_truth: bool = False,
    seed: int = 1,
) -> Path:
    """Write a straight drive whose pose an overhead camera sees; it begins and ends with a standstill."""
    path.parent.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(seed)
    config = config_with()
    config_json = config.model_dump_json(by_alias=True).encode()
    velocity = (SPEED_M_S * math.cos(direction_rad), SPEED_M_S * math.sin(direction_rad))
    speeds = OmniKinematics(ROBOTINO).wheel_speeds(*velocity, 0.0)
    next_fix_s = 0.0
    fixes: list[PoseFixSample] = []
    with LogWriter(path, START_NS, config_json, collect_data_files(config), "virtual") as log:
        for step in range(round(duration_s / PERIOD_S)):
            t_s = step * PERIOD_S
            t_ns = START_NS + round(t_s * 1e9)
            driven_s = min(max(t_s - begins_s, 0.0), ends_s - begins_s)
            is_driving = begins_s <= t_s < ends_s
            distance_m = (1.0 - slip) * driven_s * SPEED_M_S
            x_m, y_m = distance_m * math.cos(2.0 + direction_rad), distance_m * math.sin(2.0 + direction_rad)
            if t_s >= next_fix_s - 1e-9:
                next_fix_s += fix_period_s
                noise = rng.normal(0.0, (POSITION_SD_M, POSITION_SD_M, YAW_SD_RAD))
                jump_m = 0.5 if abs(t_s - jump_s) < 0.5 * fix_period_s else 0.0
                fix = PoseFixSample(
                    device="overhead",
                    t_ns=t_ns + round(LATENCY_S * 1e9),
                    t_capture_ns=t_ns,
                    x_m=x_m + jump_m + noise[0],
                    y_m=y_m + noise[1],
                    yaw_rad=2.0 + noise[2],
                    position_std_m=POSITION_SD_M,
                    yaw_std_rad=YAW_SD_RAD,
                )
                if is_seen(t_s):
                    fixes.append(fix)
            wheels = [
                WheelSample(
                    device="board",
                    t_ns=t_ns,
                    wheel=wheel,
                    position_rad=speed * driven_s,
                    current_a=current_a * abs(speed) / 3.75 if is_driving else 0.0,
                    current_is_signed=False,
                )
                for wheel, speed in enumerate(speeds)
            ]
            log.samples(t_ns, [*wheels, *(fix for fix in fixes if fix.t_ns <= t_ns)])
            fixes = [fix for fix in fixes if fix.t_ns > t_ns]
            if has_truth:
                log.write_json("/truth", t_ns, {"t_ns": t_ns, "x_m": x_m, "y_m": y_m, "yaw_rad": 2.0})
    return path


def read(path: Path) -> RunWindows:
    (run,) = read_windows(path, MotorSettings())
    return run


def slips(run: RunWindows) -> np.ndarray:
    return np.asarray(1.0 - run.camera_distance_m(1.0) / run.encoder_distance_m())


@pytest.mark.parametrize("fix_period_s", [0.1, 0.5, 2.0])
def test_slip_is_measured_with_pose_fixes(tmp_path: Path, fix_period_s: float) -> None:
    run = read(write_drive(tmp_path / "run.mcap", fix_period_s=fix_period_s, duration_s=25.0))
    assert run.truth == "pose fixes of 'overhead'"
    assert run.rejected == {}
    assert len(run.elapsed_s) >= 11
    assert slips(run).mean() == pytest.approx(0.3, abs=0.015)
    assert slips(run).std() < 0.05
    effective = run.camera_wheel_speed_rad_s(1.0)
    assert effective == pytest.approx(0.7 * run.wheel_speed_rad_s, abs=0.4)


def test_a_fix_counts_from_when_its_picture_was_taken(tmp_path: Path) -> None:
    run = read(write_drive(tmp_path / "run.mcap", begins_s=4.0, fix_period_s=0.1))
    moves = run.encoder_distance_m() > 0.02
    # With times of arrival the rover would begin to move 0.3 s, more than half a window, after its wheels.
    assert slips(run)[moves][0] == pytest.approx(0.3, abs=0.12)


def test_windows_without_good_fixes_are_rejected_by_name(tmp_path: Path) -> None:
    run = read(
        write_drive(
            tmp_path / "run.mcap",
            duration_s=30.0,
            ends_s=24.0,
            is_seen=lambda t_s: not 5.2 < t_s < 9.2,
            jump_s=15.0,
        )
    )
    assert run.rejected[NO_FIX] == 1
    assert run.rejected[CONTRADICTION] == 2
    assert run.rejected[TOO_NOISY] >= 2
    assert slips(run) == pytest.approx(np.full(len(run.elapsed_s), 0.3), abs=0.15)


def test_the_simulated_pose_wins_over_fixes(tmp_path: Path) -> None:
    run = read(write_drive(tmp_path / "run.mcap", has_truth=True, jump_s=5.0))
    assert (run.truth, run.rejected) == ("simulated pose", {})
    assert slips(run) == pytest.approx(np.full(len(run.elapsed_s), 0.3), abs=1e-6)


def test_a_log_without_a_usable_window_names_the_reasons(tmp_path: Path) -> None:
    with pytest.raises(LogError, match=r"no window of its pose fixes of 'overhead' can be used: .*\(2\)"):
        read(write_drive(tmp_path / "run.mcap", duration_s=7.0, fix_period_s=3.0))
    with pytest.raises(LogError, match="holds no true pose, neither on /truth nor as pose fixes"):
        read(write_drive(tmp_path / "blind.mcap", duration_s=1.0, is_seen=lambda t_s: False))


def test_the_command_names_its_truth(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for surface, slip, current_a in (("lawn_surface", 0.1, 0.4), ("sand_surface", 0.5, 1.0)):
        for number in range(3):
            write_drive(
                tmp_path / "runs" / surface / f"{number}.mcap",
                slip=slip,
                current_a=current_a,
                direction_rad=2.0 * number,
                duration_s=10.0,
                seed=number,
            )
    assert identify_slip([tmp_path / "runs"], test=[], as_json=True, out=None) == 0
    result = json.loads(capsys.readouterr().out)
    assert "truth of 6 logs: pose fixes of 'overhead'" in result["notes"]
    assert result["cross_validation"]["encoder"]["per_surface"]["sand_surface"]["rms"] == pytest.approx(
        0.5, abs=0.03
    )
