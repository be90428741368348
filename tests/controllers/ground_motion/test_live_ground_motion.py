"""Frames of a running rover become motions over the ground; odd frames never raise."""

from collections import Counter

import numpy as np
import pytest

from controllers.ground_motion.ground_patch import GroundPatch
from controllers.ground_motion.live_ground_motion import LiveGroundMotion
from controllers.ground_motion.motion import WheelPrior
from controllers.ground_motion.settings import GroundMotionSettings
from drivers.camera.settings import CameraSettings
from drivers.clock import VirtualClock
from drivers.errors import ConfigError
from drivers.link import NoTap
from drivers.samples import FrameSample, Image, Sample, WheelSample
from rover_hil.config import Config, load_config
from rover_hil.run.composition import build_virtual_rig

MS = 1_000_000
AHEAD = WheelPrior(forward_m=0.02, left_m=0.0, turn_rad=0.0, rates_rad_s=(0.0, 0.0, 0.0))


def meter(**changes: object) -> LiveGroundMotion:
    config = load_config("el-dorado")
    camera = config.devices["camera"].model_copy(update=changes)
    assert isinstance(camera, CameraSettings)
    assert config.scomp is not None
    assert config.scomp.rig is not None
    settings = GroundMotionSettings(rig=config.scomp.rig)
    return LiveGroundMotion(settings, camera, rotates_about_origin=False)


def frame(t_ns: int, image: np.ndarray[tuple[int, ...], np.dtype[np.uint8]]) -> FrameSample:
    return FrameSample(device="camera", t_ns=t_ns, t_capture_ns=t_ns, index=0, image=image)


def test_ground_without_structure_is_not_valid_and_has_a_reason() -> None:
    live = meter()
    grey = np.full((480, 640, 3), 90, np.uint8)
    assert live.measure(frame(0, grey), 0, AHEAD) is None
    found = live.measure(frame(200 * MS, np.where(grey, grey - 9, 0).astype(np.uint8)), 200 * MS, AHEAD)
    assert found is not None
    assert not found.is_valid
    assert (found.from_ns, found.to_ns, found.forward_m) == (0, 200 * MS, 0.0)


def test_ground_that_stands_is_measured_as_such() -> None:
    live = meter()
    sand = np.random.default_rng(0).integers(40, 200, (480, 640), np.uint8)
    shaken = np.random.default_rng(1).integers(0, 9, (480, 640), np.uint8)
    for number in range(6):
        image = sand + (shaken if number % 2 else 0)
        found = live.measure(frame(number * 200 * MS, image), number * 200 * MS, AHEAD)
    assert found is not None
    assert abs(found.forward_m) < 0.001


@pytest.mark.parametrize("shape", [(240, 320), (480, 640, 3)])
def test_frames_of_another_size_and_old_ones_are_left_out(shape: tuple[int, ...]) -> None:
    live = meter()
    image = np.full((480, 640), 90, np.uint8)
    assert live.measure(frame(5, image), 5, AHEAD) is None
    assert live.measure(frame(5, np.full(shape, 90, np.uint8)), 5, AHEAD) is None


def test_a_rig_of_another_camera_is_a_mistake() -> None:
    with pytest.raises(ConfigError, match="640"):
        meter(width=320, height=240)


def test_trace_and_ground_motion_of_one_camera_make_a_frame_ready_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    table = load_config("el-dorado").model_dump(by_alias=True)
    table["ground_motion"] = {"rig": table["scomp"]["rig"]}
    loop = build_virtual_rig(Config.model_validate(table), VirtualClock(), NoTap())[0].loop
    rectify, rectified = GroundPatch.rectify, Counter[str]()

    def counted(ground: GroundPatch, image: Image) -> Image:
        rectified["frames"] += 1
        return rectify(ground, image)

    monkeypatch.setattr(GroundPatch, "rectify", counted)
    sand, count = np.random.default_rng(0).integers(40, 200, (500, 640, 3), np.uint8), 4
    traces = 0
    for cycle in range(10 * count):
        t_ns = (1000 + 20 * cycle) * MS
        samples: list[Sample] = [
            WheelSample(device="wheels", t_ns=t_ns, wheel=wheel, position_rad=0.002 * cycle)
            for wheel in range(4)
        ]
        if cycle % 10 == 5:
            row = cycle // 10
            image = np.ascontiguousarray(sand[row : row + 480])
            samples.append(
                FrameSample(device="camera", t_ns=t_ns, t_capture_ns=t_ns - 5 * MS, index=row, image=image)
            )
        output = loop.step(t_ns, samples)
        traces += output.scomp is not None and output.scomp.trace is not None
    assert traces == count
    assert output.ground is not None
    assert output.ground.t_ns > 0
    assert rectified["frames"] == count
