"""`rover-hil ftrace` on a log of a rover with a rear camera."""

import json
from pathlib import Path

import numpy as np
import pytest

from controllers.ground_motion.rig import RigFile
from drivers.errors import ConfigError, LogError
from rover_hil.drives.drive import read_drive
from rover_hil.ftrace.command import trace_angles
from rover_hil.ftrace.log_frames import LogFrames
from rover_hil.run.driving import run_virtual
from tests.rover_hil.conftest import EL_DORADO_S
from tests.rover_hil.ftrace_files import read_rows
from tests.rover_hil.test_virtual_run import with_changes

FRAME_RATE_HZ = 5.0


def measure(log: Path, out: Path, rig: Path | None = None, telemetry: Path | None = None) -> int:
    return trace_angles(
        log, rig_path=rig, telemetry_path=telemetry, out=out, overlay=None, method="fused", as_json=True
    )


def test_the_angles_are_those_that_the_run_found(
    el_dorado_log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "angles.csv"
    assert measure(el_dorado_log, out) == 0
    rows = read_rows(out)
    assert len(rows) == pytest.approx(FRAME_RATE_HZ * EL_DORADO_S, abs=2)
    assert json.loads(capsys.readouterr().out)["frames"] == len(rows)
    drive = read_drive(el_dorado_log, with_traces=True)
    recorded = drive.channels["trace_rad"]
    recorded_s = drive.seconds(recorded.t_ns)
    found = {round(float(row["t"]), 3): float(row["theta_t_deg"]) for row in rows if row["detected"] == "1"}
    pairs = [
        (found[round(t_s, 3)], np.degrees(value))
        for t_s, value in zip(recorded_s.tolist(), recorded.value.tolist(), strict=True)
        if round(t_s, 3) in found
    ]
    assert len(pairs) >= 0.9 * len(recorded)
    measured, online = np.array(pairs).T
    # Speed and turn rates at a frame are not taken in the same way.
    assert measured == pytest.approx(online, abs=1.0)
    assert float(np.median(np.abs(measured - online))) < 0.1


def test_each_frame_has_the_speed_and_the_rates_of_its_time(el_dorado_log: Path) -> None:
    frames = LogFrames(el_dorado_log)
    assert isinstance(frames.rig, RigFile)
    assert set(frames.telemetry) == set(range(frames.count))
    times = [row.t_s for row in frames.telemetry.values()]
    assert np.diff(times) == pytest.approx(1.0 / FRAME_RATE_HZ, abs=0.01)
    drive = read_drive(el_dorado_log)
    true = [drive.channels[f"true_speed{number}_rad_s"] for number in (1, 2, 3, 4)]
    rate = drive.channels["gyro_z_rad_s"]
    last = frames.telemetry[frames.count - 1]
    at_ns = round(last.t_s * 1e9) + drive.log.start_ns
    rim_m_s = 0.092 * np.mean([np.interp(at_ns - 5e7, speed.t_ns, speed.value) for speed in true])
    assert last.wheel_speed_m_s == pytest.approx(rim_m_s, abs=0.004)
    assert last.rates_rad_s is not None
    assert last.rates_rad_s[2] == pytest.approx(rate.value[rate.t_ns <= at_ns][-1])
    assert [frame.number for frame in frames] == list(range(frames.count))


def test_a_log_without_a_camera_is_refused_in_one_sentence(robotino_log: Path, tmp_path: Path) -> None:
    with pytest.raises(LogError, match="holds no frames of a rear camera: give the log of a rover"):
        measure(robotino_log, tmp_path / "angles.csv")
    assert not (tmp_path / "angles.csv").exists()


def test_a_log_without_calibration_needs_a_rig_file(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    run_virtual(with_changes("el-dorado", scomp=None, roles__camera=None), path, 1.0, None)
    with pytest.raises(ConfigError, match="holds no calibration of its camera: give its rig file with --rig"):
        measure(path, tmp_path / "angles.csv")
    rig = Path(__file__).parents[2] / "rover_hil" / "config" / "shipped" / "rigs" / "el-dorado.json"
    assert measure(path, tmp_path / "angles.csv", rig) == 0


def test_options_that_do_not_fit_are_refused(el_dorado_log: Path, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="holds its own, leave the option out"):
        measure(el_dorado_log, tmp_path / "a.csv", telemetry=tmp_path / "telemetry.csv")
    with pytest.raises(ConfigError, match="--rig is missing: give the rig file of the camera"):
        measure(tmp_path, tmp_path / "a.csv")
