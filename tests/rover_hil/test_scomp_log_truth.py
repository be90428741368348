"""`rover-hil identify scomp` with the true path in the log: the simulated pose, or pose fixes of a camera."""

import json
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from drivers.errors import ConfigError, LogError
from drivers.samples import AttitudeSample, PoseFixSample, RateSample, Sample, WheelSample
from rover_hil.config import Config, load_config
from rover_hil.drives.drive import read_drive
from rover_hil.identify.scomp.command import identify_scomp
from rover_hil.recording.data_files import collect_data_files
from rover_hil.recording.writer import LogWriter
from rover_hil.scomp.files import log_truth
from tests.rover_hil.test_overhead_run import CAMERA

START_NS = 1_000_000_000
PERIOD_S = 0.1
STANDS_S = 2.0
RIM_M_S = 0.1


def slip_at(t_s: float) -> float:
    return 0.2 + 0.1 * math.sin(0.2 * t_s)


def write_drive(
    path: Path,
    *,
    duration_s: float = 40.0,
    has_truth: bool = False,
    is_seen: Callable[[float], bool] = lambda t_s: True,
) -> Path:
    """Write a drive of a four-wheel rover up a slope; a camera sees it in a frame turned by 1 rad."""
    table = load_config("el-dorado").model_dump(by_alias=True)
    table["devices"]["overhead"] = CAMERA
    table["roles"]["fixes"] = ["overhead"]
    config = Config.model_validate(table)
    rng = np.random.default_rng(5)
    distance_m = turned_rad = 0.0
    config_json = config.model_dump_json(by_alias=True).encode()
    with LogWriter(path, START_NS, config_json, collect_data_files(config), "virtual") as log:
        for step in range(round(duration_s / PERIOD_S)):
            t_s = step * PERIOD_S
            t_ns = START_NS + round(t_s * 1e9)
            if t_s >= STANDS_S:
                turned_rad += RIM_M_S * PERIOD_S / 0.092
                distance_m += (1.0 - slip_at(t_s)) * RIM_M_S * PERIOD_S
            samples: list[Sample] = [
                WheelSample(device=config.roles.wheels, t_ns=t_ns, wheel=wheel, position_rad=turned_rad)
                for wheel in range(4)
            ]
            samples.append(RateSample(device=str(config.roles.gyro), t_ns=t_ns, rate_z_rad_s=0.0))
            pitch_rad = -0.1 * slip_at(t_s)
            samples.append(AttitudeSample(device="imu", t_ns=t_ns, pitch_rad=pitch_rad, roll_rad=0.0))
            if is_seen(t_s) and step % 2 == 0:
                x_m, y_m, yaw_rad = rng.normal(0.0, (0.002, 0.002, 0.0035))
                fix = PoseFixSample(
                    device="overhead",
                    t_ns=t_ns + 50_000_000,
                    t_capture_ns=t_ns,
                    x_m=3.0 + distance_m * math.cos(1.0) + x_m,
                    y_m=distance_m * math.sin(1.0) + y_m,
                    yaw_rad=1.0 + yaw_rad,
                    position_std_m=0.002,
                    yaw_std_rad=0.0035,
                )
                samples.append(fix)
            log.samples(t_ns, samples)
            if has_truth:
                log.write_json("/truth", t_ns, {"t_ns": t_ns, "x_m": distance_m, "y_m": 0.0, "yaw_rad": 0.0})
    return path


def identify(log: Path, capsys: pytest.CaptureFixture[str]) -> dict[str, object]:
    assert identify_scomp(log, truth=None, out=None, pictures=None, as_json=True) == 0
    found: dict[str, object] = json.loads(capsys.readouterr().out)
    return found


def test_the_truth_of_a_simulated_drive_is_in_its_log(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    found = identify(write_drive(tmp_path / "run.mcap", has_truth=True), capsys)
    assert found["notes"][0] == "truth: simulated pose in run.mcap"  # type: ignore[index]
    assert found["parameters"]["provenance"]["truth"] == "simulated pose in run.mcap"  # type: ignore[index]


def test_pose_fixes_are_the_truth_of_a_real_drive(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    exact = identify(write_drive(tmp_path / "virtual.mcap", has_truth=True), capsys)
    found = identify(write_drive(tmp_path / "real.mcap"), capsys)
    assert found["notes"][0] == "truth: pose fixes of 'overhead' in real.mcap"  # type: ignore[index]
    resistance = [result["parameters"]["pitch"]["rolling_resistance"] for result in (exact, found)]  # type: ignore[index]
    assert resistance[1] == pytest.approx(resistance[0], abs=0.01)
    assert found["slip_rms"] == pytest.approx(exact["slip_rms"], abs=0.02)
    assert found["final_error_m"] == pytest.approx(exact["final_error_m"], abs=0.05)


def test_fixes_are_turned_into_the_frame_of_the_start(tmp_path: Path) -> None:
    truth = log_truth(read_drive(write_drive(tmp_path / "run.mcap")))
    assert truth.source == "pose fixes of 'overhead'"
    assert (truth.x_m[0], truth.y_m[0], truth.yaw_rad[0]) == pytest.approx((0.0, 0.0, 0.0), abs=0.01)
    assert truth.x_m[-1] > 2.5
    assert abs(truth.y_m[-1]) < 0.02
    assert truth.t_s[0] == 0.0


def test_windows_in_a_gap_of_the_fixes_are_left_out_by_name(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = write_drive(tmp_path / "run.mcap", is_seen=lambda t_s: not 10.1 < t_s < 19.9)
    notes = identify(log, capsys)["notes"]
    assert "6 windows of 2 s left out: no true pose for more than 2.5 s" in notes  # type: ignore[operator]


def test_a_log_without_truth_and_a_table_without_one_are_refused(tmp_path: Path) -> None:
    log = write_drive(tmp_path / "run.mcap", duration_s=3.0, is_seen=lambda t_s: False)
    with pytest.raises(LogError, match="holds no true pose, neither on /truth nor as pose fixes"):
        identify_scomp(log, truth=None, out=None, pictures=None, as_json=True)
    table = tmp_path / "drive.csv"
    table.write_text("t_s,position1_rad\n0,0\n1,1\n", encoding="utf-8")
    with pytest.raises(ConfigError, match="is a CSV file: give its true path with --truth"):
        identify_scomp(table, truth=None, out=None, pictures=None, as_json=True)
