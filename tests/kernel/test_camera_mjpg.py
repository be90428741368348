"""A V4L2 camera with compressed frames: sound, damaged, slow and stopped ones, and one that goes away."""

import itertools
import os
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from drivers.camera.v4l2_link import V4l2Link
from drivers.driver import DeviceState
from drivers.link import CameraImage, LinkChange, Received
from drivers.samples import FrameSample
from sim_backends.rear_scene.emulated_scene import EmulatedScene
from sim_backends.rear_scene.settings import CameraEmulatorSettings
from sim_backends.world.plant import Truth
from tests.kernel import loopback_camera
from tests.kernel.loopback_camera import Source, source
from tests.kernel.system import CLOCK, INSIDE, pause, wait_until
from tests.kernel.video import HEIGHT, WIDTH, collect, make_link, make_settings
from tests.sim_backends.test_camera import truth_at

RATE_HZ = 10
PERIOD_NS = 1_000_000_000 // RATE_HZ
DAMAGED = 20
GROUND_CAMERA = CameraEmulatorSettings(
    type="camera", leaves_traces=False, shadow_of="robotino", readout_s=0.015
)


@pytest.fixture(autouse=True)
def _camera() -> Iterator[None]:
    root = Path(os.environ[INSIDE])
    if not loopback_camera.module_is_there(root):
        pytest.skip((root.parent / "camera_module.txt").read_text())
    loopback_camera.plug_in()
    yield
    loopback_camera.unplug()


@pytest.fixture(scope="module")
def frames() -> list[bytes]:
    return loopback_camera.pictures()


def _truth_at(x_m: float, frame: int) -> Truth:
    return replace(truth_at(x_m), t_ns=frame * PERIOD_NS, velocity_x_m_s=0.15)


def _link(**changes: object) -> V4l2Link:
    return make_link(**({"fourcc": "MJPG", "frame_rate_hz": RATE_HZ} | changes))


def test_compressed_frames_arrive_whole_in_order_and_with_the_time_of_their_capture(
    frames: list[bytes],
) -> None:
    link = _link()
    with source(frames, RATE_HZ):
        link.open(5.0)
        items = collect(link, 12, Received)
        link.close()
    received = [item for item in items if isinstance(item, Received)]
    assert {item.payload.image.shape for item in received} == {(HEIGHT, WIDTH, 3)}
    levels = [float(item.payload.image.mean()) for item in received]
    steps = {round((after - before) / 15) % len(frames) for before, after in itertools.pairwise(levels)}
    assert steps == {1}
    assert all(0 < item.t_ns - _capture_ns(item) < PERIOD_NS for item in received)


def test_images_of_the_simulated_ground_camera_arrive_as_they_were_rendered() -> None:
    scene = EmulatedScene(GROUND_CAMERA, WIDTH, HEIGHT, RATE_HZ, np.random.default_rng(1), 0)
    rendered = [scene.render(_truth_at(0.015 * step, step)).copy() for step in range(8)]
    encoded = [cv2.imencode(".jpg", image)[1].tobytes() for image in rendered]
    link = _link()
    with source(encoded, RATE_HZ):
        link.open(5.0)
        items = collect(link, 12, Received)
        link.close()
    shown = []
    for item in items:
        assert isinstance(item, Received)
        errors = [np.abs(item.payload.image.astype(int) - image).mean() for image in rendered]
        shown.append(int(np.argmin(errors)))
        assert min(errors) < 3
    assert {(after - before) % 8 for before, after in itertools.pairwise(shown)} == {1}


@pytest.mark.parametrize(
    "damage",
    [
        lambda data: data[: len(data) // 2],
        lambda data: data[:300],
        lambda data: bytes(len(data)),
        lambda data: data[:-200] + bytes(198) + data[-2:],
    ],
    ids=["half", "300 bytes", "zeros", "zeros inside"],
)
def test_damaged_frames_are_counted_and_never_used(
    frames: list[bytes], damage: Callable[[bytes], bytes]
) -> None:
    settings = make_settings(fourcc="MJPG", frame_rate_hz=RATE_HZ)
    driver = settings.make_driver("camera", settings.make_link(CLOCK), CLOCK)
    with source(frames, RATE_HZ) as writer, driver:
        driver.wait_next(FrameSample, 5.0)
        _damage_from_now_on(writer, damage)
        driver.poll()
        found = []

        def is_done() -> bool:
            found.extend(driver.poll())
            return driver.health().rejected.get("empty", 0) >= 5

        wait_until(is_done)
        assert found == []
        writer.damage = bytes
        driver.wait_next(FrameSample, 5.0)
        assert driver.health().state is DeviceState.STREAMING
        assert driver.health().breaks == 0


def test_flipped_bytes_are_noticed_in_most_frames(frames: list[bytes]) -> None:
    rng = np.random.default_rng(5)

    def flip(data: bytes) -> bytes:
        flipped = bytearray(data)
        for place in rng.integers(700, len(data) - 2, 30):
            flipped[place] ^= int(rng.integers(1, 256))
        return bytes(flipped)

    link = _link()
    with source(frames, RATE_HZ) as writer:
        link.open(5.0)
        _damage_from_now_on(writer, flip)
        link.receive()
        items = collect(link, DAMAGED, Received)
        link.close()
    noticed = [item for item in items if isinstance(item, Received) and item.payload.image.size == 0]
    assert len(noticed) >= 0.8 * len(items)


def test_a_camera_at_1_hz_does_not_break(frames: list[bytes]) -> None:
    link = _link(frame_rate_hz=1, max_age_s=3.0)
    with source(frames, 1):
        link.open(10.0)
        items = collect(link, 4, (LinkChange, Received))
        link.close()
    assert [type(item) for item in items] == [Received] * len(items)


def test_a_source_that_pauses_breaks_the_link_and_restores_it(frames: list[bytes]) -> None:
    link = _link()
    with source(frames, RATE_HZ) as writer:
        link.open(5.0)
        collect(link, 3, Received)
        writer.is_paused = True
        (down,) = collect(link, 1, LinkChange)
        assert isinstance(down, LinkChange)
        assert (down.up, down.reason) == (False, "camera /dev/video0 sends no more frames: check its cable")
        writer.is_paused = False
        _streams_again(link)


def test_a_source_that_ends_and_starts_again_is_followed(frames: list[bytes]) -> None:
    link = _link()
    with source(frames, RATE_HZ):
        link.open(5.0)
        collect(link, 3, Received)
    assert [item.up for item in collect(link, 1, LinkChange) if isinstance(item, LinkChange)] == [False]
    pause(0.5)
    with source(frames, RATE_HZ):
        _streams_again(link)


def test_a_camera_that_vanishes_comes_back_under_its_name(frames: list[bytes]) -> None:
    link = _link()
    with source(frames, RATE_HZ):
        link.open(5.0)
        collect(link, 3, Received)
    loopback_camera.unplug()
    assert [item.up for item in collect(link, 1, LinkChange) if isinstance(item, LinkChange)] == [False]
    pause(0.5)
    loopback_camera.plug_in()
    with source(frames, RATE_HZ):
        _streams_again(link)


def _damage_from_now_on(writer: Source, damage: Callable[[bytes], bytes]) -> None:
    """Damage frames, and wait until sound ones that are on their way have arrived."""
    writer.damage = damage
    pause(0.3)


def _streams_again(link: V4l2Link) -> None:
    items = collect(link, 1, LinkChange)
    assert [item.up for item in items if isinstance(item, LinkChange)] == [True]
    collect(link, 3, Received)
    link.close()


def _capture_ns(frame: Received[CameraImage]) -> int:
    assert frame.payload.t_capture_ns is not None
    return frame.payload.t_capture_ns
