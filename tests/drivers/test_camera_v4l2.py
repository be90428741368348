"""The V4L2 link against a camera that has the faults that OpenCV and kernel drivers are known for."""

import os
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np
import pytest
from cv2.typing import MatLike

from drivers.camera.images import decode_jpeg, retrieve_jpeg
from drivers.camera.settings import CameraSettings
from drivers.camera.v4l2_link import V4l2Link
from drivers.clock import NANOSECONDS_PER_SECOND, Clock, SystemClock, VirtualClock, nanoseconds
from drivers.driver import DeviceState, Driver
from drivers.errors import NotConnectedError
from drivers.link import CameraImage, Received
from drivers.samples import FrameSample, LinkSample, Sample

PERIOD_NS = 10_000_000
MJPG = float(int.from_bytes(b"MJPG", "little"))
YUYV = float(int.from_bytes(b"YUYV", "little"))
BGR3 = float(int.from_bytes(b"BGR3", "little"))
DEADLINE_S = 60.0


@dataclass
class FakeCamera:
    """A camera as seen through `cv2.VideoCapture`: it says True to every setting, and takes some.

    Attributes:
        fixed: Properties that the driver does not change, with their values.
        latency_ns: From the time stamp to the moment when `grab` returns.
        stamps_at_all: False for drivers that always say 0.
        stamps_stand: The driver gives the stamp of the frame before again.
        changes: The brightness grows from frame to frame.
        unplugged: `grab` fails at once while `isOpened` stays True.
        frozen: `grab` succeeds at once with the frame before.
        corrupt: `retrieve` succeeds without pixels.
        damage: What happens on the way to the bytes of a compressed frame.
        slow_start: How many grabs time out after opening.
        timeouts: How many grabs time out, each after a second, before the next frame.
        calls: What was done, in order.
    """

    clock: Clock
    fixed: dict[int, float] = field(default_factory=dict)
    latency_ns: int = 4_000_000
    stamps_at_all: bool = True
    stamps_stand: bool = False
    changes: bool = False
    brightness: int = 90
    unplugged: bool = False
    frozen: bool = False
    corrupt: bool = False
    damage: Callable[[bytes], bytes] = bytes
    slow_start: int = 0
    timeouts: int = 0
    calls: list[str] = field(default_factory=list)

    def open(self, path: str, backend: int) -> "FakeCapture":
        assert backend == cv2.CAP_V4L2
        self.calls.append("open")
        return FakeCapture(self)


class FakeCapture:
    def __init__(self, camera: FakeCamera) -> None:
        self.camera = camera
        self.properties: dict[int, float] = {cv2.CAP_PROP_FOURCC: YUYV, cv2.CAP_PROP_FPS: 30.0}
        self.stamp_ms = 0.0
        self.is_open = True
        self.slow_start = camera.slow_start

    def isOpened(self) -> bool:  # noqa: N802 - OpenCV's name
        return self.is_open

    def release(self) -> None:
        self.is_open = False
        self.camera.calls.append("release")

    def set(self, key: int, value: float) -> bool:
        self.camera.calls.append(f"set {key}")
        self.properties[key] = value
        return True

    def get(self, key: int) -> float:
        if key == cv2.CAP_PROP_POS_MSEC:
            return self.stamp_ms
        return self.camera.fixed.get(key, self.properties.get(key, -1.0))

    def grab(self) -> bool:
        camera = self.camera
        assert self.is_open
        if self.slow_start:
            self.slow_start -= 1
            return False
        if camera.unplugged:
            return False
        if camera.timeouts:
            camera.timeouts -= 1
            camera.clock.sleep_until(camera.clock.now_ns() + NANOSECONDS_PER_SECOND)
            return False
        if not camera.frozen:
            camera.clock.sleep_until(camera.clock.now_ns() + PERIOD_NS)
            camera.brightness += camera.changes
            if camera.stamps_at_all and not (camera.stamps_stand and self.stamp_ms):
                self.stamp_ms = (camera.clock.now_ns() - camera.latency_ns) // 1000 / 1000
        return True

    def retrieve(self) -> tuple[bool, MatLike | None]:
        if self.camera.corrupt:
            return True, None
        pixels = np.full((48, 64, 3), self.camera.brightness, np.uint8)
        if self.properties.get(cv2.CAP_PROP_CONVERT_RGB, 1.0):
            return True, pixels
        data = bytearray(cv2.imencode(".jpg", pixels)[1].tobytes())
        return True, np.frombuffer(self.camera.damage(bytes(data)), np.uint8)[None]


def make_settings(path: Path, **changes: object) -> CameraSettings:
    base: dict[str, object] = {
        "type": "camera",
        "source": "v4l2",
        "path": str(path),
        "width": 64,
        "height": 48,
        "frame_rate_hz": 100,
    }
    return CameraSettings.model_validate(base | changes)


@pytest.fixture
def camera(monkeypatch: pytest.MonkeyPatch) -> FakeCamera:
    camera = FakeCamera(VirtualClock(100_000_000_000))
    monkeypatch.setattr("drivers.camera.v4l2_link.cv2.VideoCapture", camera.open)
    return camera


@pytest.fixture
def device(tmp_path: Path) -> Path:
    path = tmp_path / "usb-camera-index0"
    path.touch()
    return path


def open_link(camera: FakeCamera, device: Path, **changes: object) -> V4l2Link:
    """Open the handle without starting the thread, so that reads are called one by one."""
    link = V4l2Link(make_settings(device, **changes), camera.clock)
    link._open_handle()
    return link


def read(link: V4l2Link) -> Received[CameraImage]:
    received = link._read()
    assert received is not None
    return received


def test_opencv_is_told_not_to_wait_ten_seconds_for_a_dead_camera() -> None:
    assert os.environ["OPENCV_VIDEOIO_V4L_SELECT_TIMEOUT"] == "1"


def test_the_format_is_set_before_the_size_and_the_size_before_the_rate(
    camera: FakeCamera, device: Path
) -> None:
    open_link(camera, device)
    keys = [cv2.CAP_PROP_FOURCC, cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT, cv2.CAP_PROP_FPS]
    assert [call for call in camera.calls if call in {f"set {key}" for key in keys}] == [
        f"set {key}" for key in keys
    ]


@pytest.mark.parametrize(
    ("fixed", "changes", "complaint"),
    [
        ({cv2.CAP_PROP_FRAME_WIDTH: 80.0}, {}, "gives MJPG 80 x 48 .* instead of MJPG 64 x 48"),
        ({cv2.CAP_PROP_FRAME_HEIGHT: 40.0}, {}, "64 x 40"),
        ({cv2.CAP_PROP_FPS: 30.0}, {}, "at 30 Hz instead of .* at 100 Hz"),
        ({cv2.CAP_PROP_FPS: float("nan")}, {}, "nan Hz"),
        ({cv2.CAP_PROP_FOURCC: YUYV}, {}, "gives YUYV"),
        ({cv2.CAP_PROP_FOURCC: BGR3}, {}, "does not offer MJPG: configure one of"),
        ({cv2.CAP_PROP_EXPOSURE: 100.0}, {"exposure_100us": 80}, "refuses exposure_100us = 80"),
        ({cv2.CAP_PROP_EXPOSURE: -1.0}, {"exposure_100us": 80}, "refuses exposure_100us = 80"),
        ({cv2.CAP_PROP_AUTO_EXPOSURE: 1.0}, {}, "refuses exposure_100us = automatic"),
    ],
)
def test_a_refused_setting_is_an_error_and_leaves_no_handle(
    fixed: dict[int, float], changes: dict[str, object], complaint: str, camera: FakeCamera, device: Path
) -> None:
    camera.fixed = fixed
    link = V4l2Link(make_settings(device, **changes), camera.clock)
    with pytest.raises(NotConnectedError, match=f"cannot open camera {device}: .*{complaint}"):
        link.open(0.2)
    assert camera.calls.count("open") == camera.calls.count("release") > 1


@pytest.mark.parametrize(
    ("fixed", "changes"),
    [
        ({cv2.CAP_PROP_FPS: 99.9}, {}),
        ({cv2.CAP_PROP_FOURCC: YUYV}, {"fourcc": "YUYV"}),
        ({cv2.CAP_PROP_AUTO_EXPOSURE: -1.0}, {}),
        ({}, {"exposure_100us": 80}),
    ],
)
def test_what_the_camera_grants_is_accepted(
    fixed: dict[int, float], changes: dict[str, object], camera: FakeCamera, device: Path
) -> None:
    camera.fixed = fixed
    assert read(open_link(camera, device, **changes)).payload.image.shape == (48, 64, 3)


def test_a_missing_device_says_how_to_find_one(camera: FakeCamera, tmp_path: Path) -> None:
    link = V4l2Link(make_settings(tmp_path / "video7"), camera.clock)
    with pytest.raises(NotConnectedError, match=r"video7: no such device.*/dev/v4l/by-id/"):
        link.open(0.1)
    assert camera.calls == []


def test_a_device_without_permission_says_so(
    camera: FakeCamera, device: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("drivers.camera.v4l2_link.os.access", lambda path, mode: False)
    with pytest.raises(NotConnectedError, match="no permission: add the user to the group"):
        V4l2Link(make_settings(device), camera.clock).open(0.1)


def test_a_camera_that_needs_a_second_to_start_is_waited_for(camera: FakeCamera, device: Path) -> None:
    camera.slow_start = 1
    assert read(open_link(camera, device)).payload.t_capture_ns is not None


def test_a_camera_that_sends_nothing_is_an_error(camera: FakeCamera, device: Path) -> None:
    camera.unplugged = True
    with pytest.raises(NotConnectedError, match="sends no frames"):
        V4l2Link(make_settings(device), camera.clock).open(0.1)
    assert camera.calls.count("open") == camera.calls.count("release")


def test_kernel_stamps_become_capture_times_to_the_microsecond(camera: FakeCamera, device: Path) -> None:
    received = read(open_link(camera, device))
    assert received.t_ns == camera.clock.now_ns()
    assert received.payload.t_capture_ns == received.t_ns - camera.latency_ns


@pytest.mark.parametrize(
    ("latency_ns", "stamps_at_all"),
    [(-33_000_000, True), (0, True), (1_500_000_000, True), (-1_700_000_000_000_000_000, True), (0, False)],
    ids=["33 ms in the future", "now", "too old", "wall clock", "always zero"],
)
def test_stamps_that_cannot_be_captures_give_frames_without_one(
    latency_ns: int, stamps_at_all: bool, camera: FakeCamera, device: Path
) -> None:
    camera.latency_ns = latency_ns
    camera.stamps_at_all = stamps_at_all
    link = open_link(camera, device)
    for _ in range(10):
        received = read(link)
        assert received.t_ns == camera.clock.now_ns()
        assert received.payload.t_capture_ns is None


@pytest.mark.parametrize("latency_ns", [4_000_000, -33_000_000])
def test_a_frame_that_repeats_is_never_delivered_and_breaks_the_link_after_three_periods(
    latency_ns: int, camera: FakeCamera, device: Path
) -> None:
    camera.latency_ns = latency_ns
    link = open_link(camera, device)
    newest_ns = read(link).t_ns
    camera.frozen = True
    assert [link._read() for _ in range(3)] == [None, None, None]
    with pytest.raises(NotConnectedError, match="repeats one frame"):
        link._read()
    assert camera.clock.now_ns() - newest_ns == 3 * PERIOD_NS


@pytest.mark.parametrize("fourcc", ["MJPG", "YUYV"])
@pytest.mark.parametrize("latency_ns", [4_000_000, 1_500_000_000, -33_000_000])
def test_pictures_that_change_are_read_although_their_stamps_stand_still(
    fourcc: str, latency_ns: int, camera: FakeCamera, device: Path
) -> None:
    camera.fixed = {cv2.CAP_PROP_FOURCC: float(int.from_bytes(fourcc.encode(), "little"))}
    camera.latency_ns, camera.stamps_stand, camera.changes = latency_ns, True, True
    link = open_link(camera, device, fourcc=fourcc)
    for _ in range(10):
        received = read(link)
        assert received.payload.image.max() == pytest.approx(camera.brightness, abs=2)
        assert (received.t_ns, received.payload.t_capture_ns) == (camera.clock.now_ns(), None)


def test_stamps_that_come_to_stand_are_no_capture_times_any_more(camera: FakeCamera, device: Path) -> None:
    camera.changes = True
    link = open_link(camera, device)
    assert read(link).payload.t_capture_ns is not None
    camera.stamps_stand = True
    assert [read(link).payload.t_capture_ns for _ in range(5)] == [None] * 5
    camera.stamps_stand = False
    assert read(link).payload.t_capture_ns is None


def test_stamps_and_pictures_that_both_stand_still_are_one_frame(camera: FakeCamera, device: Path) -> None:
    camera.stamps_stand = True
    link = open_link(camera, device)
    read(link)
    assert link._read() is None
    with pytest.raises(NotConnectedError, match="repeats one frame"):
        link._read()


def test_one_repeat_is_no_break(camera: FakeCamera, device: Path) -> None:
    link = open_link(camera, device)
    read(link)
    camera.frozen = True
    assert link._read() is None
    camera.frozen = False
    read(link)


def test_a_slow_camera_is_waited_for_three_periods(camera: FakeCamera, device: Path) -> None:
    link = open_link(camera, device, frame_rate_hz=0.5, max_age_s=5.0)
    read(link)
    camera.timeouts = 2
    assert [link._read(), link._read()] == [None, None]
    read(link)
    camera.timeouts = 99
    assert [link._read() for _ in range(5)] == [None] * 5
    with pytest.raises(NotConnectedError, match="sends no more frames"):
        link._read()


def test_a_failing_grab_breaks_the_link_at_once(camera: FakeCamera, device: Path) -> None:
    link = open_link(camera, device)
    read(link)
    camera.unplugged = True
    with pytest.raises(NotConnectedError, match="sends no more frames: check its cable"):
        link._read()


def test_a_corrupt_frame_is_handed_on_to_be_counted(camera: FakeCamera, device: Path) -> None:
    link = open_link(camera, device)
    camera.corrupt = True
    assert read(link).payload.image.size == 0


@pytest.mark.parametrize(
    "damage",
    [
        lambda data: data[: len(data) // 2],
        lambda data: data[:300],
        lambda data: data[:-2],
        lambda data: bytes(len(data)),
        lambda data: data[:-40] + bytes(38) + data[-2:],
        lambda _: b"",
    ],
    ids=["half", "300 bytes", "no end", "zeros", "zeros inside", "nothing"],
)
def test_a_damaged_jpeg_has_no_pixels(
    damage: Callable[[bytes], bytes], camera: FakeCamera, device: Path
) -> None:
    link = open_link(camera, device)
    assert read(link).payload.image.shape == (48, 64, 3)
    camera.damage = damage
    assert read(link).payload.image.size == 0


def test_zeros_after_the_end_of_a_jpeg_are_no_damage(camera: FakeCamera, device: Path) -> None:
    """Drivers hand over whole buffers."""
    link = open_link(camera, device)
    camera.damage = lambda data: data + bytes(500)
    assert read(link).payload.image.shape == (48, 64, 3)


def test_flipped_bytes_are_noticed_in_most_frames() -> None:
    """What leaves a valid bit stream is not: the share is stated in the troubleshooting page."""
    rng = np.random.default_rng(5)
    noisy = np.clip(rng.normal(128.0, 30.0, (240, 320, 3)), 0, 255).astype(np.uint8)
    sound = cv2.imencode(".jpg", cv2.GaussianBlur(noisy, (5, 5), 2.0))[1].tobytes()
    noticed = 0
    for _ in range(60):
        data = bytearray(sound)
        for place in rng.integers(700, len(data) - 2, 30):
            data[place] ^= int(rng.integers(1, 256))
        noticed += decode_jpeg(retrieve_jpeg(Capture(bytes(data)))).size == 0
    assert noticed >= 50


class Capture:
    """What `retrieve_jpeg` needs of a capture."""

    def __init__(self, data: bytes) -> None:
        self.data = data

    def retrieve(self) -> tuple[bool, MatLike]:
        return True, np.frombuffer(self.data, np.uint8)[None]


def test_the_newest_frames_win_and_lost_ones_are_counted(camera: FakeCamera, device: Path) -> None:
    link = open_link(camera, device)
    frames = [read(link) for _ in range(7)]
    for frame in frames:
        link._append(frame)
    assert link.receive() == frames[-4:]
    assert link.dropped == 3


def collect(driver: Driver[CameraImage], wanted: Callable[[Sample], bool]) -> Sample:
    """Return the first sample that is wanted; fails at the deadline."""
    clock = SystemClock()
    deadline_ns = clock.now_ns() + nanoseconds(DEADLINE_S)
    while clock.now_ns() < deadline_ns:
        for sample in driver.poll():
            if wanted(sample):
                return sample
        clock.sleep_until(clock.now_ns() + 1_000_000)
    pytest.fail("the deadline has passed")


def test_an_unplugged_camera_is_closed_reopened_and_streams_again(
    device: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = SystemClock()
    camera = FakeCamera(clock)
    monkeypatch.setattr("drivers.camera.v4l2_link.cv2.VideoCapture", camera.open)
    settings = make_settings(device)
    driver = settings.make_driver("camera", settings.make_link(clock), clock)
    with driver:
        first = driver.wait_next(FrameSample, DEADLINE_S)
        camera.unplugged = True
        down = collect(driver, lambda sample: isinstance(sample, LinkSample))
        assert isinstance(down, LinkSample)
        assert not down.up
        assert "check its cable" in down.reason
        assert driver.health().state is DeviceState.DEGRADED
        camera.unplugged = False
        up = collect(driver, lambda sample: isinstance(sample, LinkSample))
        assert isinstance(up, LinkSample)
        assert up.up
        later = driver.wait_next(FrameSample, DEADLINE_S)
        assert later.index > first.index
        assert driver.health().breaks == 1
        assert driver.health().state is DeviceState.STREAMING
    handles = [call for call in camera.calls if call in {"open", "release"}]
    assert handles == ["open", "release"] * (len(handles) // 2), (
        "two handles would give /dev/video1 on replug"
    )
