"""Pose fixes and jammed wheels of the four-wheel rovers, live in the loop."""

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from drivers.link import CameraImage, Received
from drivers.overhead_camera.codec import OverheadCameraCodec
from drivers.samples import PoseFixSample
from rover_hil.config import Config, load_config
from rover_hil.report.read_run import read_run
from rover_hil.report.summary import Summary, summarise
from rover_hil.run.driving import run_virtual
from rover_hil.run.executive import End, RunResult
from sim_backends.plants.el_dorado.plant import ElDoradoPlant
from tests.cases import first_often
from tests.rover_hil.test_overhead_run import CAMERA

ROVERS = ("el-dorado", "el-dorado-crab")
RADIUS_ERROR = 0.1
RUN_S = 9.0


def config_of(name: str, *, has_fixes: bool, **fault: object) -> Config:
    """Return a four-wheel rover without its rear camera, whose wheels are larger than it believes."""
    table = load_config(name).model_dump(by_alias=True)
    table["roles"]["camera"] = table["scomp"]["rig"] = None
    del table["devices"]["camera"]
    table["simulation"]["plant"]["wheel_radius_error"] = RADIUS_ERROR
    table["safety"]["settle_s"] = 2.0
    if has_fixes:
        table["devices"]["overhead"] = {**CAMERA, "frame_rate_hz": 2.0}
        table["roles"]["fixes"] = ["overhead"]
    if fault:
        table["simulation"]["faults"] = [{"device": "overhead", **fault}]
    return Config.model_validate(table)


def drive(config: Config, path: Path, limit_s: float = RUN_S) -> tuple[RunResult, Summary]:
    result = run_virtual(config, path, limit_s, None)
    return result, summarise(read_run(path))


def final_error_m(summary: Summary) -> float:
    assert summary.estimate_error is not None
    return summary.estimate_error.position_final_m


@pytest.mark.parametrize("name", first_often(ROVERS))
@pytest.mark.slow
def test_fixes_correct_the_estimate_and_late_ones_count_from_their_exposure(
    name: str, tmp_path: Path
) -> None:
    _, blind = drive(config_of(name, has_fixes=False), tmp_path / "blind.mcap")
    late = config_of(name, has_fixes=True, type="delay", start_s=0.0, duration_s=60.0, delay_s=0.8)
    _, fixed = drive(late, tmp_path / "late.mcap")
    assert final_error_m(blind) > 0.03
    assert final_error_m(fixed) < 0.5 * final_error_m(blind)
    assert fixed.stops == ()
    assert fixed.uncompared_measurements == {}


@pytest.mark.parametrize("name", first_often(ROVERS))
def test_fixes_that_are_too_late_are_not_used_and_stop_nothing(name: str, tmp_path: Path) -> None:
    late = config_of(name, has_fixes=True, type="delay", start_s=0.0, duration_s=60.0, delay_s=2.6)
    _, summary = drive(late, tmp_path / "late.mcap")
    assert summary.stops == ()
    (camera,) = [device for device in summary.devices if device.device == "overhead"]
    assert sum(camera.rejected.values()) >= 5
    assert camera.accepted == 0


class WrongFixes:
    """Moves the fixes of a camera to the side within a time."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, first_s: float, last_s: float) -> None:
        self._decode = OverheadCameraCodec.decode
        self._from_s, self._to_s = first_s, last_s
        self._start_ns: int | None = None
        decode = self._decode

        def moved(codec: OverheadCameraCodec, item: Received[CameraImage]) -> Sequence[object]:
            return self._moved(item.t_ns, decode(codec, item))

        monkeypatch.setattr(OverheadCameraCodec, "decode", moved)

    def _moved(self, t_ns: int, samples: Sequence[object]) -> Sequence[object]:
        start_ns = self._start_ns = t_ns if self._start_ns is None else self._start_ns
        is_wrong = self._from_s <= (t_ns - start_ns) / 1e9 < self._to_s
        return [
            replace(sample, y_m=sample.y_m + 0.6)
            if is_wrong and isinstance(sample, PoseFixSample)
            else sample
            for sample in samples
        ]


@pytest.mark.parametrize("name", first_often(ROVERS))
def test_a_wrong_fix_is_refused_and_the_rover_drives_on(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    WrongFixes(monkeypatch, 5.0, 5.6)
    _, summary = drive(config_of(name, has_fixes=True), tmp_path / "run.mcap")
    assert summary.stops == ()
    assert sum(summary.refused_innovations.values()) >= 1
    assert final_error_m(summary) < 0.05


@pytest.mark.parametrize("name", first_often(ROVERS))
def test_a_jammed_wheel_stops_the_rover_for_good_after_three_attempts(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    turn = ElDoradoPlant.set_wheel_speeds

    def turn_three(plant: ElDoradoPlant, speed_rad_s: Sequence[float]) -> None:
        turn(plant, (*speed_rad_s[:3], 0.0))

    monkeypatch.setattr(ElDoradoPlant, "set_wheel_speeds", turn_three)
    result, summary = drive(config_of(name, has_fixes=False), tmp_path / "run.mcap", 15.0)
    assert result.end is End.EMERGENCY_STOP
    assert result.reason.startswith("wheel 3: has not followed its setpoint")
    jams = [stop for stop in summary.stops if any(each.startswith("wheel 3:") for each in stop.reasons)]
    assert len(jams) == 3
    truth = read_run(tmp_path / "run.mcap").truth
    assert truth is not None
    assert math.hypot(float(truth.x_m[-1]), float(truth.y_m[-1])) < 0.4
    assert np.isfinite(final_error_m(summary))
