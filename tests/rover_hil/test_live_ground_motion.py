"""Frames of a running rover become motions over the ground; odd frames never raise."""

import numpy as np
import pytest

from controllers.estimation.ground_settings import GroundMotionSettings
from controllers.estimation.ground_travel import WheelPrior
from drivers.camera.settings import CameraSettings
from drivers.errors import ConfigError
from drivers.samples import FrameSample
from rover_hil.config import load_config
from rover_hil.run.live_ground_motion import LiveGroundMotion

MS = 1_000_000
AHEAD = WheelPrior(forward_m=0.02, left_m=0.0, turn_rad=0.0, rates_rad_s=(0.0, 0.0, 0.0))


def meter(**changes: object) -> LiveGroundMotion:
    config = load_config("el-dorado")
    camera = config.devices["camera"].model_copy(update=changes)
    assert isinstance(camera, CameraSettings)
    assert config.scomp is not None
    assert config.scomp.rig is not None
    return LiveGroundMotion(GroundMotionSettings(rig=config.scomp.rig), camera)


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
