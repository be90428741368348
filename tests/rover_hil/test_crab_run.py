"""The shipped rover that crabs: steering setpoints over the CAN bus, on the simulated slope."""

import json
from pathlib import Path

import numpy as np
import pytest

from drivers.errors import ConfigError
from rover_hil.config import Config, load_config
from rover_hil.drives.drive import read_drive
from rover_hil.recording.reader import LogReader
from rover_hil.report.read_run import read_run
from rover_hil.report.summary import Summary, summarise
from rover_hil.report.verdict import facts
from rover_hil.report.write import write_report
from rover_hil.run.checks import VIRTUAL_RUN_CHECKS
from rover_hil.run.driving import run_virtual
from rover_hil.run.executive import End
from rover_hil.scomp.files import log_rows
from rover_hil.scomp.odometry import estimate_track
from tests.rover_hil.test_virtual_run import records, replay_file

pytestmark = pytest.mark.slow

LENGTH_M = 1.0


def config_with(*, has_camera: bool, **mission: object) -> Config:
    """Return the shipped configuration on a steeper slope, and a shorter line."""
    table = load_config("el-dorado-crab", VIRTUAL_RUN_CHECKS).model_dump(by_alias=True)
    table["mission"].update({"length_m": LENGTH_M, **mission})
    table["simulation"]["plant"]["ground"].update(inclination_deg=10.0, mounds=[])
    if not has_camera:
        table["roles"]["camera"] = table["scomp"]["rig"] = None
        del table["devices"]["camera"]
    if table["mission"]["heading"] != "crab":
        table["scomp"]["steer_against_drift"] = False
    return Config.model_validate(table)


def drive(config: Config, path: Path, limit_s: float = 60.0) -> tuple[End | None, Summary, float]:
    """Return how a run ended, its summary, and the rms of the true distance from the line in m."""
    end = run_virtual(config, path, limit_s, None).end
    run = read_run(path)
    assert run.truth is not None
    driven = run.truth.x_m > 0.3
    return end, summarise(run), float(np.sqrt(np.mean(run.truth.y_m[driven] ** 2)))


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A drive along the contour by the tilt alone: without pictures it takes few seconds."""
    path = tmp_path_factory.mktemp("crab") / "run.mcap"
    assert run_virtual(config_with(has_camera=False), path, 60.0, None).end is End.FINISHED
    return path


def test_the_rover_keeps_its_line_by_turning_all_wheels_and_not_its_body(log: Path, tmp_path: Path) -> None:
    run = read_run(log)
    summary = summarise(run)
    assert run.truth is not None
    assert summary.stops == ()
    driven = run.truth.x_m > 0.3
    crab_m = float(np.sqrt(np.mean(run.truth.y_m[driven] ** 2)))
    assert crab_m < 0.012
    assert np.abs(run.truth.yaw_rad).max() < 0.02
    end, _, straight_m = drive(config_with(has_camera=False, heading="along_path"), tmp_path / "straight")
    assert end is End.FINISHED
    assert straight_m > 0.025 > 2.0 * crab_m


def test_the_steering_angles_go_over_the_bus_and_come_back(log: Path) -> None:
    angles_deg = [
        np.degrees(np.array([record[key] for record in records(log, topic) if record.get(key)], np.float64))
        for topic, key in (("/command", "steering_rad"), ("/truth", "steering_rad"))
    ]
    commanded, true = angles_deg
    assert 4.0 < commanded[-1].mean() < 12.0  # against the drift to the right
    assert true[-1] == pytest.approx(commanded[-1], abs=1.0)
    samples = [record for record in records(log, "/samples") if "WheelSample" in record]
    measured = [
        sample["steering_rad"]
        for record in samples
        for sample in record["WheelSample"]  # type: ignore[attr-defined]
        if sample["steering_rad"] is not None
    ]
    assert np.degrees(measured[-1]) == pytest.approx(true[-1].mean(), abs=1.0)


def test_what_it_steers_against_is_in_log_report_and_summary(log: Path, tmp_path: Path) -> None:
    summary = summarise(read_run(log))
    assert summary.crab is not None
    assert summary.crab.source_share == {"tilt": 1.0}
    assert summary.crab.true_left_of_line_rms_m is not None
    assert summary.crab.true_left_of_line_rms_m < 0.015
    assert 4.0 < summary.crab.greatest_steering_deg < 15.0
    assert any(fact.detail == "against the slip angle by tilt 100.0 %" for fact in facts(summary))
    write_report(log, tmp_path)
    assert "Crabbing" in (tmp_path / "report.html").read_text()
    assert json.loads((tmp_path / "summary.json").read_text())["crab"]["source_share"] == {"tilt": 1.0}


def test_a_replay_is_exact(log: Path) -> None:
    assert replay_file(log).differences == []


def test_with_the_camera_the_trace_gives_the_slip_angle(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    _, summary, _ = drive(config_with(has_camera=True), path, 7.0)
    assert summary.stops == ()
    assert summary.crab is not None
    assert summary.crab.source_share["trace"] > 0.7
    assert summary.drift is not None
    assert summary.drift.slip_angle_error_rms_deg is not None
    assert summary.drift.slip_angle_error_rms_deg < 2.0


def test_the_recorded_drive_is_corrected_with_its_steering(log: Path) -> None:
    rows, _ = log_rows(read_drive(log, with_traces=True))
    assert rows.steering_rad is not None
    config = load_config("el-dorado-crab")
    assert config.scomp is not None
    track = estimate_track(rows, config.scomp.parameters).track
    truth = read_run(log).truth
    assert truth is not None
    end_m = np.hypot(track.x_m[-1] - truth.x_m[-1], track.y_m[-1] - truth.y_m[-1])
    assert end_m < 0.03
    assert LogReader(log).origin == "virtual"


def test_a_mapping_without_steering_cannot_crab(tmp_path: Path) -> None:
    text = (Path(__file__).parents[2] / "rover_hil/config/shipped/configs/el-dorado-crab.toml").read_text()
    path = tmp_path / "rover.toml"
    path.write_text(text.replace('"steered_wheel"', '"generic_wheel"'), "utf-8")
    with pytest.raises(ConfigError, match="has no steering setpoints for them"):
        load_config(str(path), VIRTUAL_RUN_CHECKS)


def test_a_rover_that_does_not_steer_is_told_so(tmp_path: Path) -> None:
    text = (Path(__file__).parents[2] / "rover_hil/config/shipped/configs/el-dorado.toml").read_text()
    path = tmp_path / "rover.toml"
    path.write_text(text.replace('heading = "along_path"', 'heading = "crab"'), "utf-8")
    with pytest.raises(ConfigError, match="heading: this rover cannot crab"):
        load_config(str(path), VIRTUAL_RUN_CHECKS)
