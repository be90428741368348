"""Camera settings and codec: what may be configured, and what counts as a frame."""

import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as numpy_strategies
from pydantic import ValidationError

from drivers.camera.codec import CameraCodec
from drivers.camera.settings import CameraSettings
from drivers.driver import Rejection
from drivers.link import CameraImage, Received
from drivers.samples import FrameSample, Image

GREY: Image = np.full((48, 64), 77, np.uint8)


def decode_one(
    codec: CameraCodec, image: Image = GREY, t_capture_ns: int | None = None, t_ns: int = 9
) -> FrameSample | Rejection:
    (result,) = codec.decode(Received(t_ns, CameraImage(image, t_capture_ns)))
    return result


def accept(codec: CameraCodec, image: Image = GREY, t_capture_ns: int | None = None) -> FrameSample:
    result = decode_one(codec, image, t_capture_ns)
    assert isinstance(result, FrameSample)
    return result


@pytest.mark.parametrize("shape", [(48, 64), (48, 64, 3)])
def test_grey_and_bgr_images_of_the_configured_size_are_frames(shape: tuple[int, ...]) -> None:
    image = np.full(shape, 77, np.uint8)
    frame = decode_one(CameraCodec("camera", 64, 48), image, 5)
    assert isinstance(frame, FrameSample)
    assert (frame.device, frame.t_ns, frame.t_capture_ns, frame.index) == ("camera", 9, 5, 0)
    assert frame.image is image


@pytest.mark.parametrize(
    ("image", "reason"),
    [
        (np.zeros((0, 0), np.uint8), "empty"),
        (np.zeros((0, 64, 3), np.uint8), "empty"),
        (np.zeros((64, 48), np.uint8), "size"),
        (np.zeros((48, 64, 4), np.uint8), "size"),
        (np.zeros((48, 64, 1), np.uint8), "size"),
        (np.zeros((48,), np.uint8), "size"),
        (np.zeros((48, 64), np.uint16), "dtype"),
        (np.zeros((48, 64), np.float64), "dtype"),
        (np.zeros((48, 64), np.uint8), "black"),
        (np.full((48, 64, 3), 15, np.uint8), "black"),
    ],
)
def test_wrong_images_are_rejected_by_name(image: Image, reason: str) -> None:
    assert decode_one(CameraCodec("camera", 64, 48), image) == Rejection(reason)


def test_stamps_must_move_forward() -> None:
    codec = CameraCodec("camera", 64, 48)
    results = [decode_one(codec, t_capture_ns=stamp) for stamp in (100, 100, 90, 101)]
    assert [r.reason if isinstance(r, Rejection) else r.t_capture_ns for r in results] == [
        100,
        "stamp_not_moving",
        "stamp_backwards",
        101,
    ]


def test_a_rejected_image_leaves_no_trace_in_numbers_and_stamps() -> None:
    codec = CameraCodec("camera", 64, 48)
    accept(codec, t_capture_ns=100)
    assert isinstance(decode_one(codec, np.zeros((2, 2), np.uint8), t_capture_ns=500), Rejection)
    assert accept(codec, t_capture_ns=200).index == 1


def test_images_without_a_stamp_pass_and_do_not_disturb_those_with_one() -> None:
    codec = CameraCodec("camera", 64, 48)
    accept(codec, t_capture_ns=100)
    assert accept(codec).t_capture_ns is None
    assert decode_one(codec, t_capture_ns=100) == Rejection("stamp_not_moving")


def test_reset_forgets_the_stamp_and_keeps_the_numbering() -> None:
    codec = CameraCodec("camera", 64, 48)
    accept(codec, t_capture_ns=100)
    codec.reset()
    assert accept(codec, t_capture_ns=50).index == 1


@given(
    images=st.lists(
        st.tuples(
            numpy_strategies.arrays(
                st.sampled_from([np.uint8, np.int16]),
                numpy_strategies.array_shapes(max_dims=4, max_side=4, min_side=0),
            ),
            st.none() | st.integers(0, 20),
        ),
        max_size=20,
    )
)
def test_whatever_arrives_frames_are_well_formed_numbered_and_in_order(
    images: list[tuple[Image, int | None]],
) -> None:
    codec = CameraCodec("camera", 3, 2)
    results = [decode_one(codec, image, stamp) for image, stamp in images]
    frames = [result for result in results if isinstance(result, FrameSample)]
    stamps = [frame.t_capture_ns for frame in frames if frame.t_capture_ns is not None]
    assert [frame.index for frame in frames] == list(range(len(frames)))
    assert stamps == sorted(set(stamps))
    assert all(frame.image.dtype == np.uint8 and frame.image.shape[:2] == (2, 3) for frame in frames)


def settings(**changes: object) -> CameraSettings:
    base: dict[str, object] = {
        "type": "camera",
        "source": "v4l2",
        "path": "/dev/video0",
        "width": 640,
        "height": 480,
        "frame_rate_hz": 30,
    }
    return CameraSettings.model_validate(base | changes)


def test_defaults_are_those_of_a_usb_camera() -> None:
    assert settings().fourcc == "MJPG"
    assert settings().exposure_100us is None


@pytest.mark.parametrize(
    ("changes", "complaint"),
    [
        ({"loop": True}, "loop is for source = folder or video"),
        ({"source": "folder", "fourcc": "YUYV"}, "fourcc is for source = v4l2"),
        ({"source": "video", "exposure_100us": 80}, "exposure_100us is for source = v4l2"),
        ({"source": "live_folder", "loop": True}, "loop is for source = folder or video"),
        ({"frame_rate_hz": 5, "max_age_s": 0.15}, "raise max_age_s"),
        ({"fourcc": "mjpg"}, "fourcc"),
        ({"source": "webcam"}, "source"),
        ({"width": 0}, "width"),
        ({"index": 0}, "index"),
    ],
)
def test_settings_that_would_be_ignored_or_never_work_are_errors(
    changes: dict[str, object], complaint: str
) -> None:
    with pytest.raises(ValidationError, match=complaint):
        settings(**changes)


def test_settings_survive_being_written_out_with_their_defaults() -> None:
    folder = settings(source="folder")
    assert CameraSettings.model_validate(folder.model_dump()) == folder


def test_reading_a_configuration_does_not_load_opencv() -> None:
    code = "import sys, drivers.camera.settings, sim_backends.devices.camera; sys.exit('cv2' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_a_frame_whose_stamp_is_a_second_old_on_arrival_is_not_used() -> None:
    codec = CameraCodec("camera", 64, 48)
    late = decode_one(codec, GREY, t_capture_ns=1_000_000_000, t_ns=2_000_000_001)
    assert late == Rejection("stamp_old")
    assert isinstance(decode_one(codec, GREY, t_capture_ns=1_000_000_000, t_ns=2_000_000_000), FrameSample)


def test_a_stamp_from_the_future_is_refused_and_does_not_blind_the_camera() -> None:
    codec = CameraCodec("camera", 64, 48)
    assert decode_one(codec, t_capture_ns=3_000_000_001, t_ns=2_999_000_000) == Rejection("stamp_future")
    frames = [decode_one(codec, t_capture_ns=3_000_000_000 + k, t_ns=2_999_000_000 + k) for k in range(3)]
    assert [frame.index for frame in frames if isinstance(frame, FrameSample)] == [0, 1, 2]


@pytest.mark.parametrize("pixel", [(3, 5), (41, 63)])
def test_a_dark_frame_with_a_small_bright_marker_is_not_black(pixel: tuple[int, int]) -> None:
    image = np.full((48, 64), 3, np.uint8)
    image[pixel] = 200
    assert isinstance(decode_one(CameraCodec("camera", 64, 48), image), FrameSample)
