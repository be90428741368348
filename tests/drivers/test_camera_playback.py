"""Frames from folders and video files: timing, order, ends, damage, and the driver contract on each."""

from collections.abc import Callable, Generator
from pathlib import Path

import cv2
import numpy as np
import pytest

from drivers.camera.playback_link import NEWEST_FRAMES, PlaybackLink, RecordedFrame
from drivers.camera.settings import CameraSettings
from drivers.clock import VirtualClock
from drivers.driver import DeviceState, Driver
from drivers.errors import NotConnectedError, StaleSampleError
from drivers.link import CameraImage, LinkChange, Received
from drivers.samples import FrameSample, Image, LinkSample

START_NS = 5_000_000_000
PERIOD_NS = 100_000_000
SIZE = (64, 48)


def image_of(number: int) -> Image:
    """Return a picture that shows its number by its brightness, also after JPEG."""
    return np.full((SIZE[1], SIZE[0], 3), 30 + 18 * (number % 12), np.uint8)


def number_of(image: Image) -> int:
    return round((float(image.mean()) - 30) / 18)


def write_images(folder: Path, names: list[str]) -> Path:
    folder.mkdir(exist_ok=True)
    for number, name in enumerate(names):
        assert cv2.imwrite(str(folder / name), image_of(number))
    return folder


def write_video(path: Path, count: int, rate_hz: float = 10) -> Path:
    writer = cv2.VideoWriter(str(path), int.from_bytes(b"MJPG", "little"), rate_hz, SIZE)
    assert writer.isOpened()
    for number in range(count):
        writer.write(image_of(number))
    writer.release()
    return path


def settings(source: str, path: Path, **changes: object) -> CameraSettings:
    base: dict[str, object] = {
        "type": "camera",
        "source": source,
        "path": str(path),
        "width": SIZE[0],
        "height": SIZE[1],
        "frame_rate_hz": 10,
    }
    return CameraSettings.model_validate(base | changes)


def make_driver(camera: CameraSettings, clock: VirtualClock) -> Driver[CameraImage]:
    return camera.make_driver("camera", camera.make_link(clock), clock)


def frames_of(
    driver: Driver[CameraImage], clock: VirtualClock, steps: int, step_ns: int
) -> list[FrameSample]:
    frames: list[FrameSample] = []
    for _ in range(steps):
        clock.sleep_until(clock.now_ns() + step_ns)
        frames += [sample for sample in driver.poll() if isinstance(sample, FrameSample)]
    return frames


def folder_source(tmp_path: Path) -> tuple[str, Path]:
    return "folder", write_images(tmp_path / "frames", [f"frame_{n:03}.png" for n in range(6)])


def video_source(tmp_path: Path) -> tuple[str, Path]:
    return "video", write_video(tmp_path / "drive.avi", 6)


RECORDINGS = [folder_source, video_source]
Recording = Callable[[Path], tuple[str, Path]]


@pytest.mark.parametrize("recording", RECORDINGS)
def test_each_frame_arrives_at_its_time_with_its_pixels(recording: Recording, tmp_path: Path) -> None:
    clock = VirtualClock(START_NS)
    with make_driver(settings(*recording(tmp_path)), clock) as driver:
        frames = frames_of(driver, clock, 60, 10_000_000)
    assert [number_of(frame.image) for frame in frames] == [0, 1, 2, 3, 4, 5]
    assert [frame.t_ns for frame in frames] == [START_NS + n * PERIOD_NS for n in range(6)]
    assert [frame.t_capture_ns for frame in frames] == [frame.t_ns for frame in frames]
    assert [frame.index for frame in frames] == [0, 1, 2, 3, 4, 5]


@pytest.mark.parametrize("recording", RECORDINGS)
def test_no_frame_is_delivered_before_its_time(recording: Recording, tmp_path: Path) -> None:
    clock = VirtualClock(START_NS)
    with make_driver(settings(*recording(tmp_path)), clock) as driver:
        assert len(driver.poll()) == 1
        clock.sleep_until(START_NS + PERIOD_NS - 1)
        assert driver.poll() == []
        clock.sleep_until(START_NS + PERIOD_NS)
        assert len(driver.poll()) == 1


@pytest.mark.parametrize("recording", RECORDINGS)
def test_the_end_takes_the_link_down_for_good_one_period_after_the_last_frame(
    recording: Recording, tmp_path: Path
) -> None:
    clock = VirtualClock(START_NS)
    source, path = recording(tmp_path)
    with make_driver(settings(source, path), clock) as driver:
        frames_of(driver, clock, 59, 10_000_000)
        assert driver.health().state is DeviceState.STREAMING
        clock.sleep_until(START_NS + 6 * PERIOD_NS)
        (end,) = driver.poll()
        assert isinstance(end, LinkSample)
        assert not end.up
        assert end.reason == f"end of {source} {path}"
        assert driver.health().state is DeviceState.FAILED
        clock.sleep_until(START_NS + 60 * PERIOD_NS)
        assert driver.poll() == []


@pytest.mark.parametrize("recording", RECORDINGS)
def test_a_loop_starts_again_without_a_gap(recording: Recording, tmp_path: Path) -> None:
    clock = VirtualClock(START_NS)
    with make_driver(settings(*recording(tmp_path), loop=True), clock) as driver:
        frames = frames_of(driver, clock, 130, 10_000_000)
        assert driver.health().rejected == {}
    assert [number_of(frame.image) for frame in frames] == [n % 6 for n in range(14)]
    assert [frame.t_ns for frame in frames] == [START_NS + n * PERIOD_NS for n in range(14)]


@pytest.mark.parametrize("recording", RECORDINGS)
def test_overdue_frames_are_dropped_and_counted_the_newest_win(recording: Recording, tmp_path: Path) -> None:
    clock = VirtualClock(START_NS)
    link = settings(*recording(tmp_path)).make_link(clock)
    link.open(1.0)
    clock.sleep_until(START_NS + 5 * PERIOD_NS)
    items = link.receive()
    numbers = [number_of(item.payload.image) for item in items if isinstance(item, Received)]
    assert numbers == [2, 3, 4, 5]
    assert len(numbers) == NEWEST_FRAMES
    assert getattr(link, "dropped") == 2  # noqa: B009 - not in the protocol
    link.close()


def test_names_that_are_nanoseconds_give_the_spacing(tmp_path: Path) -> None:
    names = ["999999999999.png", "1000033333333.png", "1000300000000.png"]
    clock = VirtualClock(START_NS)
    with make_driver(settings("folder", write_images(tmp_path / "f", names)), clock) as driver:
        frames = frames_of(driver, clock, 60, 10_000_000)
    assert [number_of(frame.image) for frame in frames] == [0, 1, 2]
    assert [frame.t_capture_ns for frame in frames] == [
        START_NS,
        START_NS + 33_333_334,
        START_NS + 300_000_001,
    ]


def test_names_that_are_running_numbers_do_not_pass_for_nanoseconds(tmp_path: Path) -> None:
    names = ["0000000007.png", "0000000008.png"]
    clock = VirtualClock(START_NS)
    with make_driver(settings("folder", write_images(tmp_path / "f", names)), clock) as driver:
        frames = frames_of(driver, clock, 15, 10_000_000)
    assert [frame.t_ns for frame in frames] == [START_NS, START_NS + PERIOD_NS]


def test_corrupt_and_foreign_images_are_counted_and_the_rest_plays_on(tmp_path: Path) -> None:
    folder = write_images(tmp_path / "frames", ["a.png", "b.png", "c.png", "d.png", "e.png", "f.jpg"])
    (folder / "b.png").write_bytes(b"no image at all")
    (folder / "c.png").write_bytes(b"")
    (folder / "d.png").write_bytes((folder / "a.png").read_bytes()[:60])
    cv2.imwrite(str(folder / "e.png"), np.zeros((10, 10), np.uint8))
    (folder / "readme.txt").write_text("no image")
    clock = VirtualClock(START_NS)
    with make_driver(settings("folder", folder), clock) as driver:
        (folder / "f.jpg").unlink()
        (folder / "g.png").write_bytes(b"too late to be seen")
        frames = frames_of(driver, clock, 60, 10_000_000)
        health = driver.health()
    assert [number_of(frame.image) for frame in frames] == [0]
    assert health.rejected == {"empty": 4, "size": 1}


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".bmp"])
@pytest.mark.parametrize("shape", [(48, 64), (48, 64, 3)])
def test_grey_files_stay_grey_and_colour_stays_bgr(
    suffix: str, shape: tuple[int, ...], tmp_path: Path
) -> None:
    image = np.full(shape, 100, np.uint8)
    if len(shape) == 3:
        image[..., 0] = 30
    cv2.imwrite(str(tmp_path / f"frame{suffix}"), image)
    clock = VirtualClock(START_NS)
    with make_driver(settings("folder", tmp_path), clock) as driver:
        (frame,) = driver.poll()
    assert isinstance(frame, FrameSample)
    assert frame.image.shape == shape or suffix == ".bmp"  # a grey BMP carries a palette of colours
    assert abs(frame.image.astype(int).reshape(48, 64, -1) - image.reshape(48, 64, -1)).max() <= 3


def test_a_truncated_video_plays_what_there_is_and_ends(tmp_path: Path) -> None:
    path = write_video(tmp_path / "whole.avi", 60)
    cut = tmp_path / "cut.avi"
    cut.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    clock = VirtualClock(START_NS)
    with make_driver(settings("video", cut), clock) as driver:
        frames = frames_of(driver, clock, 650, 10_000_000)
        assert driver.health().state is DeviceState.FAILED
    assert 5 < len(frames) < 55


def test_a_recording_without_frames_ends_when_it_begins(tmp_path: Path) -> None:
    class EmptyLink(PlaybackLink):
        def _open_frames(self) -> Generator[RecordedFrame]:
            yield from ()

    link = EmptyLink(settings("video", tmp_path), VirtualClock(START_NS))
    link.open(1.0)
    (end,) = link.receive()
    assert isinstance(end, LinkChange)
    assert (end.t_ns, end.gave_up) == (START_NS, True)


@pytest.mark.parametrize(
    ("source", "prepare", "complaint"),
    [
        ("folder", lambda path: None, "cannot be read.*correct the camera's `path`"),
        ("folder", lambda path: path.mkdir(), "holds no images"),
        ("folder", lambda path: path.write_text("a file"), "cannot be read"),
        ("live_folder", lambda path: None, "start what fills the folder"),
        ("video", lambda path: None, "does not exist"),
        ("video", lambda path: path.write_text("no video"), "cannot be opened"),
        ("video", lambda path: write_video(path, 3, 25), "64 x 48 pixels at 25 Hz: set"),
    ],
)
def test_what_cannot_be_played_is_refused_at_connect(
    source: str, prepare: Callable[[Path], object], complaint: str, tmp_path: Path
) -> None:
    path = tmp_path / "drive.avi"
    prepare(path)
    driver = make_driver(settings(source, path), VirtualClock(START_NS))
    with pytest.raises(NotConnectedError, match=complaint) as caught:
        driver.connect()
    assert str(path) in str(caught.value)
    assert driver.health().state is DeviceState.CLOSED


def live_source(tmp_path: Path) -> tuple[str, Path]:
    return "live_folder", write_images(tmp_path / "live", ["4000000000.png"])


@pytest.mark.parametrize("source", [*RECORDINGS, live_source])
def test_the_driver_contract_holds(source: Recording, tmp_path: Path) -> None:
    clock = VirtualClock(START_NS)
    kind, path = source(tmp_path)
    driver = make_driver(settings(kind, path), clock)
    for method in (driver.poll, lambda: driver.latest(FrameSample, 1.0)):
        with pytest.raises(NotConnectedError, match=r"call connect\(\)"):
            method()
    for _ in range(2):
        driver.connect()
        driver.connect()
        with pytest.raises(StaleSampleError, match=r"no FrameSample yet|s old"):
            driver.latest(FrameSample, 0.5)
        clock.sleep_until(clock.now_ns() + PERIOD_NS // 2)
        if kind == "live_folder":
            write_images(path, [f"{clock.now_ns()}.png"])
        driver.poll()
        assert driver.latest(FrameSample, 0.5).device == "camera"
        assert driver.health().state is DeviceState.STREAMING
        clock.sleep_until(clock.now_ns() + 1_000_000_000)
        with pytest.raises(StaleSampleError, match=r"limit 0\.500 s"):
            driver.latest(FrameSample, 0.5)
        driver.close()
        driver.close()
        assert driver.health().state is DeviceState.CLOSED


def test_a_live_folder_delivers_what_appears_and_never_what_was_there(tmp_path: Path) -> None:
    folder = write_images(tmp_path / "live", ["1000000001.png", "9000000000.png"])
    clock = VirtualClock(START_NS)
    with make_driver(settings("live_folder", folder), clock) as driver:
        assert driver.poll() == []
        write_images(folder, ["4990000000.png", "4980000000.jpg", "latest.png"])
        (folder / "4995000000.part").write_bytes(b"not complete yet")
        frames = driver.poll()
        assert [
            (f.t_ns, f.t_capture_ns, number_of(f.image)) for f in frames if isinstance(f, FrameSample)
        ] == [
            (START_NS, 4_980_000_000, 1),
            (START_NS, 4_990_000_000, 0),
        ]
        assert driver.poll() == []


def test_a_live_folder_drops_all_but_the_newest_after_a_pause(tmp_path: Path) -> None:
    clock = VirtualClock(START_NS)
    link = settings("live_folder", tmp_path).make_link(clock)
    link.open(1.0)
    write_images(tmp_path, [f"{4_000_000_000 + n}.png" for n in range(7)])
    items = link.receive()
    assert [number_of(i.payload.image) for i in items if isinstance(i, Received)] == [3, 4, 5, 6]
    assert getattr(link, "dropped") == 3  # noqa: B009 - not in the protocol
    assert link.receive() == []
    assert not link.send(b"anything")


def test_a_live_folder_lost_and_found_is_reported_once_each(tmp_path: Path) -> None:
    folder = tmp_path / "live"
    folder.mkdir()
    clock = VirtualClock(START_NS)
    link = settings("live_folder", folder).make_link(clock)
    link.open(1.0)
    folder.rmdir()
    down = link.receive()
    assert link.receive() == []
    write_images(folder, ["4000000000.png"])
    up, frame = link.receive()
    assert [type(item) for item in down] == [LinkChange]
    assert isinstance(down[0], LinkChange)
    assert not down[0].up
    assert up == LinkChange(START_NS, up=True, reason="reopened")
    assert isinstance(frame, Received)
    link.close()
    assert link.receive() == []


def test_a_corrupt_live_frame_is_counted(tmp_path: Path) -> None:
    clock = VirtualClock(START_NS)
    with make_driver(settings("live_folder", tmp_path), clock) as driver:
        (tmp_path / "4000000000.jpg").write_bytes(b"half a picture")
        assert driver.poll() == []
        assert driver.health().rejected == {"empty": 1}
