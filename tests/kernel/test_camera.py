"""A V4L2 camera of the kernel: frames, stamps, slow and stopped sources, unplugging."""

import itertools
import statistics
from collections.abc import Iterator

import pytest

from drivers.camera.v4l2_link import V4l2Link
from drivers.errors import NotConnectedError
from drivers.link import CameraImage, LinkChange, Received
from tests.kernel.system import run
from tests.kernel.video import HEIGHT, WIDTH, collect, make_link, plug_in, set_control, unplug

PERIOD_NS = 40_000_000
NEVER, ALWAYS = 0, 100


@pytest.fixture(autouse=True)
def _camera() -> Iterator[None]:
    run("modprobe vivid n_devs=1 node_types=0x1 num_inputs=1 input_types=0")
    set_control("Timestamp Source", 1)
    yield
    run("rmmod vivid")


def test_raw_frames_arrive_at_their_rate_with_the_time_of_their_capture() -> None:
    link = make_link()
    link.open(5.0)
    items = collect(link, 20, Received)
    link.close()
    frames = [item for item in items if isinstance(item, Received)]
    assert {frame.payload.image.shape for frame in frames} == {(HEIGHT, WIDTH, 3)}
    assert all(frame.payload.image.std() > 10 for frame in frames)
    captured_ns = [_capture_ns(frame) for frame in frames]
    gaps_ns = [later - earlier for earlier, later in itertools.pairwise(captured_ns)]
    assert statistics.median(gaps_ns) == pytest.approx(PERIOD_NS, abs=2_000_000)
    assert min(gaps_ns) > PERIOD_NS / 2
    assert all(0 < frame.t_ns - _capture_ns(frame) < 5 * PERIOD_NS for frame in frames)


def test_a_pixel_format_that_the_camera_lacks_is_refused() -> None:
    with pytest.raises(NotConnectedError, match="does not offer MJPG"):
        make_link(fourcc="MJPG").open(0.0)


def test_a_camera_at_1_hz_does_not_break() -> None:
    link = make_link(frame_rate_hz=1, max_age_s=3.0)
    link.open(10.0)
    items = collect(link, 5, (LinkChange, Received))
    link.close()
    assert [type(item) for item in items] == [Received] * len(items)


def test_a_camera_that_stops_breaks_and_comes_back() -> None:
    link = make_link()
    link.open(5.0)
    collect(link, 3, Received)
    set_control("Percentage of Dropped Buffers", ALWAYS)
    (down,) = collect(link, 1, LinkChange)
    assert isinstance(down, LinkChange)
    assert (down.up, down.reason) == (False, "camera /dev/video0 sends no more frames: check its cable")
    set_control("Percentage of Dropped Buffers", NEVER)
    _streams_again(link)


def test_an_unplugged_camera_comes_back_under_its_name() -> None:
    link = make_link()
    link.open(5.0)
    collect(link, 3, Received)
    unplug()
    (down,) = collect(link, 1, LinkChange)
    assert isinstance(down, LinkChange)
    assert not down.up
    plug_in()
    _streams_again(link)


def _streams_again(link: V4l2Link) -> None:
    items = collect(link, 1, LinkChange)
    assert [item.up for item in items if isinstance(item, LinkChange)] == [True]
    collect(link, 3, Received)
    link.close()


def _capture_ns(frame: Received[CameraImage]) -> int:
    assert frame.payload.t_capture_ns is not None
    return frame.payload.t_capture_ns
