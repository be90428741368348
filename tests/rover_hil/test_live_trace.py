"""The four-wheel rover's loop with the rear camera in it."""

import json
import math
from collections import Counter
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from controllers.ground_motion.estimator import GroundMotionEstimator
from controllers.ground_motion.live_ground_motion import LiveGroundMotion
from controllers.ground_motion.motion import GroundMotion, WheelPrior
from controllers.ground_motion.rig_tolerance import RigTolerance
from controllers.ground_motion.settings import GroundMotionSettings
from controllers.slip.scomp.trace_reader import TraceFinder
from drivers.camera.settings import CameraSettings
from drivers.errors import ConfigError
from drivers.samples import FrameSample
from rover_hil.config import Config, describe_validation_error, load_config
from rover_hil.recording.reader import LogReader
from rover_hil.report.read_run import read_run
from rover_hil.report.summary import Summary, summarise
from rover_hil.report.verdict import facts
from rover_hil.report.write import write_report
from rover_hil.run.composition import make_finder
from rover_hil.run.driving import run_virtual
from tests.rover_hil.conftest import EL_DORADO_S
from tests.rover_hil.test_virtual_run import with_changes

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def log(el_dorado_log: Path) -> Path:
    return el_dorado_log


def summary_of(path: Path) -> Summary:
    return summarise(read_run(path))


def finder(**changes: object) -> TraceFinder:
    config = load_config("el-dorado")
    camera = config.devices["camera"].model_copy(update=changes)
    found = make_finder(config.model_copy(update={"devices": {**config.devices, "camera": camera}}))
    assert found is not None
    return found


def picture(t_ns: int, shape: tuple[int, ...] = (480, 640, 3)) -> FrameSample:
    return FrameSample(
        device="camera", t_ns=t_ns + 7, t_capture_ns=t_ns, index=0, image=np.full(shape, 90, np.uint8)
    )


def test_the_trace_is_seen_and_the_slip_counted(log: Path, tmp_path: Path) -> None:
    summary = summary_of(log)
    drift, error, plain = summary.drift, summary.estimate_error, summary.encoders_error
    assert drift is not None
    assert error is not None
    assert plain is not None
    assert 20 < drift.traces <= 5 * EL_DORADO_S
    assert drift.slip_angle_error_rms_deg is not None
    assert drift.slip_angle_error_rms_deg < 1.5
    assert drift.slip_error_rms is not None
    assert drift.slip_error_rms < 0.12
    assert set(drift.unsure_share) == {"no trace"}
    assert error.position_final_m < 0.7 * plain.position_final_m
    assert [fact for fact in facts(summary) if "traces" in fact.detail]
    write_report(log, tmp_path)
    assert "Slip and slip angle" in (tmp_path / "report.html").read_text()
    assert json.loads((tmp_path / "summary.json").read_text())["drift"]["traces"] == drift.traces


def test_every_angle_found_is_in_the_log_once_and_right(log: Path) -> None:
    truth: dict[str, float] = {}
    off_deg, times = [], []
    for message in LogReader(log).messages():
        record = json.loads(message.data) if message.topic in ("/truth", "/estimate") else {}
        if message.topic == "/truth":
            truth = record
        trace = (record.get("drift") or {}).get("trace")
        if trace is None or not trace["detected"]:
            continue
        turned = truth["yaw_rate_rad_s"]
        true_rad = math.atan2(truth["velocity_y_m_s"] - 0.3 * turned, truth["velocity_x_m_s"] - 0.22 * turned)
        off_deg.append(math.degrees(trace["theta_rad"] - true_rad))
        times.append(trace["t_ns"])
    assert times == sorted(set(times))
    assert len(off_deg) > 20
    assert float(np.sqrt(np.mean(np.square(off_deg)))) < 1.5


def test_without_the_compensation_nothing_is_told(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    config = with_changes("el-dorado", scomp=None, roles__camera=None)
    run_virtual(config, path, 1.5, None)
    assert summary_of(path).drift is None


def test_a_blind_camera_makes_it_unsure_and_does_not_stop_it(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    fault = {"type": "unplug", "device": "camera", "start_s": 0.0, "duration_s": 20.0}
    run_virtual(with_changes("el-dorado", simulation__faults=[fault]), path, 5.0, None)
    summary = summary_of(path)
    assert summary.stops == ()
    assert summary.drift is not None
    assert summary.drift.traces == 0
    assert summary.drift.unsure_share["no trace"] > 0.9


def test_frames_that_do_not_fit_are_not_looked_at() -> None:
    found = finder()
    assert found.find(picture(1_000_000_000), 0.08, None) is not None
    assert found.find(picture(1_000_000_000), 0.08, None) is None
    assert found.find(picture(900_000_000), 0.08, None) is None
    assert found.find(picture(1_200_000_000, (240, 320, 3)), 0.08, None) is None
    reading = found.find(picture(1_200_000_000, (480, 640)), 0.08, (0.0, 0.0, 0.0))
    assert reading is not None
    assert not reading.detected  # nothing but grey
    assert reading.theta_rad is None


def test_the_angle_has_the_tolerance_of_the_configuration() -> None:
    config = load_config("el-dorado")
    assert config.scomp is not None
    assert config.scomp.rig is not None
    ground = GroundMotionSettings(rig=config.scomp.rig, tolerance=RigTolerance(yaw_sd_deg=1.0))
    other = ground.model_copy(update={"rig": ground.rig.model_copy(update={"nominal_speed_mps": 1.0})})
    expected = [(None, 3.0), (ground, 1.0), (other, 3.0)]
    for settings, yaw_sd_deg in expected:
        found = make_finder(config.model_copy(update={"ground_motion": settings}))
        assert found is not None
        reading = found.find(picture(1_000_000_000), 0.08, None)
        assert reading is not None
        assert reading.mounting_sd_rad == pytest.approx(math.radians(yaw_sd_deg))


@pytest.mark.parametrize(("delay_s", "expected"), [(0.0, 3), (-0.05, 6)])
def test_the_motion_over_the_ground_is_measured_once(
    delay_s: float, expected: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With a negative delay the trace comes first: it cannot wait for the other measurement."""
    config = load_config("el-dorado")
    assert config.scomp is not None
    assert config.scomp.rig is not None
    ground = GroundMotionSettings(rig=config.scomp.rig, camera_delay_s=delay_s)
    camera = config.devices["camera"]
    assert isinstance(camera, CameraSettings)
    meter = LiveGroundMotion(ground, camera, rotates_about_origin=False)
    found = make_finder(config.model_copy(update={"ground_motion": ground}), meter)
    assert found is not None
    measured = Counter[str]()
    step = GroundMotionEstimator.step_patch

    def counted(*given: Any) -> GroundMotion | None:
        measured["pairs"] += 1
        return step(*given)

    monkeypatch.setattr(GroundMotionEstimator, "step_patch", counted)
    for number in range(3):
        frame = picture(1_000_000_000 + number * 200_000_000)
        meter.measure(frame, frame.t_capture_ns or 0, WheelPrior(0.016, 0.0, 0.0, (0.0, 0.0, 0.0)))
        assert found.find(frame, 0.08, (0.0, 0.0, 0.0)) is not None

    assert measured["pairs"] == expected


def test_a_rig_of_another_camera_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"frames of \(640, 480\) pixels, the camera gives \(320, 480\)"):
        finder(width=320)


def test_a_rig_in_a_log_is_checked_again() -> None:
    table = load_config("el-dorado").model_dump(by_alias=True)
    del table["scomp"]["rig"]["b_m"]
    with pytest.raises(ValidationError) as caught:
        Config.model_validate(table)
    message = describe_validation_error("run.mcap", caught.value, table)
    assert message == "run.mcap: scomp.rig.b_m: this key is missing; add it"


def changed_config(tmp_path: Path, old: str, new: str) -> str:
    text = (resources.files("rover_hil.config") / "shipped" / "configs" / "el-dorado.toml").read_text("utf-8")
    assert old in text
    path = tmp_path / "rover.toml"
    path.write_text(text.replace(old, new, 1), "utf-8")
    return str(path)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('rig = "el-dorado" ', 'rig = "nowhere" ', "cannot read rig file nowhere"),
        ('rig = "el-dorado" ', "# ", "its calibration is missing: add ground_motion.rig or scomp.rig"),
        ('parameters = "el-dorado" ', 'parameters = "nowhere" ', "cannot read parameters nowhere"),
        (
            'camera = "camera"',
            'camera = "imu"',
            "device 'imu' is not a camera that looks back",
        ),
        ('camera = "camera"', 'camera = "eye"', "has no 'eye': name one of camera"),
        ("steer_against_drift = true", "steer_with_drift = true", "did you mean steer_against_drift"),
    ],
)
def test_wrong_configurations_are_refused(tmp_path: Path, old: str, new: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        load_config(changed_config(tmp_path, old, new))
