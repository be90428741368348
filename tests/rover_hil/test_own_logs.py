"""Whatever the writer of a log writes, its reader reads: floods, frozen and damaged frames, all at once."""

import io
from itertools import repeat
from pathlib import Path

import cv2
import numpy as np
import pytest

from drivers.camera.images import JPEG_PIXELS_PER_BYTE, NO_PIXELS, decode_jpeg, jpeg_pixels
from drivers.driver import MOST_BYTES_PER_POLL
from drivers.errors import LogError
from drivers.files import ATTACHMENTS_BYTES, IMAGE_PIXELS, MESSAGE_JSON_BYTES, UNPACKED_BYTES
from drivers.link import CameraImage, Received
from drivers.samples import RateSample, Sample, WheelSample
from rover_hil.recording.chunked_file import ChunkedFile
from rover_hil.recording.images import decode_image
from rover_hil.recording.mcap_records import read_records
from rover_hil.recording.reader import LogReader
from rover_hil.recording.text import samples_text
from rover_hil.recording.writer import LogWriter

SECOND_NS = 1_000_000_000
CAN_FRAME_BYTES = 16
SERIAL_FRAME_BYTES = 11


def test_a_device_that_repeats_itself_for_minutes_makes_no_log_that_is_refused() -> None:
    stream = io.BytesIO()
    file = ChunkedFile(stream, "rover_hil")
    channel = file.add_channel("/bytes", "bytes", b"{}")
    flood = b'{"device":"board","kind":"received","t_ns":1000000000,"hex":"8000000000"},' * 13_000
    ends = []
    for cycle in range(150):
        file.add_message(channel, SECOND_NS + cycle, flood)
        file.flush()
        ends.append(stream.tell())
    content = stream.getvalue()
    unpacked = 150 * len(flood)
    assert unpacked > 2 * UNPACKED_BYTES
    assert unpacked > 95 * len(content), "it is still compressed"
    for end in (ends[100], len(content)):  # also where the program was killed
        assert sum(1 for _ in read_records(io.BytesIO(content[:end]), end)) > 0


def test_a_camera_that_freezes_on_black_makes_no_log_that_is_refused(tmp_path: Path) -> None:
    black = cv2.imencode(".jpg", np.zeros((1080, 1920, 3), np.uint8))[1].tobytes()
    frame = CameraImage(decode_jpeg(black), None, black)
    with LogWriter(tmp_path / "run.mcap", SECOND_NS, b"{}", {}, "real") as log:
        for number in range(120):
            log.received("camera", Received(SECOND_NS + number * 33_000_000, frame))
    assert 120 * jpeg_pixels(black) > 2 * IMAGE_PIXELS
    messages = list(LogReader(tmp_path / "run.mcap").messages())
    assert [decode_image(message.data).jpeg == black for message in messages] == [True] * 120


def head_says(jpeg: bytes, height: int, width: int) -> bytes:
    """Return a frame with another size in its head."""
    place = jpeg.index(b"\xff\xc0") + 5
    return jpeg[:place] + height.to_bytes(2, "big") + width.to_bytes(2, "big") + jpeg[place + 4 :]


@pytest.mark.parametrize("side", [4000, 20_000, 65_500])
def test_a_frame_whose_head_was_damaged_on_its_way_is_a_frame_without_pixels(
    tmp_path: Path, side: int
) -> None:
    grey = cv2.imencode(".jpg", np.full((64, 64), 90, np.uint8))[1].tobytes()
    damaged = head_says(grey, side, side)
    assert side**2 > JPEG_PIXELS_PER_BYTE * len(damaged)
    assert decode_jpeg(grey).shape == (64, 64, 3)
    assert decode_jpeg(damaged) is NO_PIXELS, "gigabytes for its pixels"
    with LogWriter(tmp_path / "run.mcap", SECOND_NS, b"{}", {}, "real") as log:
        log.received("camera", Received(SECOND_NS, CameraImage(decode_jpeg(damaged), None, damaged)))
    (message,) = LogReader(tmp_path / "run.mcap").messages()
    assert decode_image(message.data).image.size == 0


@pytest.mark.parametrize("quality", [1, 95])
def test_a_whole_frame_never_has_more_pixels_than_its_bytes_can_hold(quality: int) -> None:
    for shape in ((2160, 3840, 3), (2160, 3840), (16, 16, 3)):
        frame = cv2.imencode(".jpg", np.zeros(shape, np.uint8), (cv2.IMWRITE_JPEG_QUALITY, quality))[1]
        assert jpeg_pixels(frame.tobytes()) == shape[0] * shape[1]


def test_the_samples_of_a_cycle_in_which_all_devices_flood_are_read() -> None:
    """A bus with the speeds of eight wheels in each frame, and six devices on serial ports."""
    name, t_ns = "w" * 64, 2**62
    speed = WheelSample(device=name, t_ns=t_ns, wheel=7, speed_rad_s=-1234.123456789)
    rate = RateSample(device=name, t_ns=t_ns, rate_x_rad_s=-12.3, rate_y_rad_s=-12.3, rate_z_rad_s=-12.3)
    wheels = 8 * (MOST_BYTES_PER_POLL // CAN_FRAME_BYTES)
    rates = 6 * (MOST_BYTES_PER_POLL // SERIAL_FRAME_BYTES)
    samples: list[Sample] = [*repeat(speed, wheels), *repeat(rate, rates)]
    assert len(samples_text(samples)) < MESSAGE_JSON_BYTES


def test_a_run_whose_data_files_a_log_cannot_hold_does_not_begin(tmp_path: Path) -> None:
    files = {f"data/wheels/mapping/{number}.dbc": bytes(2**20) for number in range(ATTACHMENTS_BYTES >> 20)}
    with pytest.raises(LogError, match=r"data files that it names hold 16\.0 MB, the limit is 16 MB; use"):
        LogWriter(tmp_path / "run.mcap", SECOND_NS, b"{}", files, "real")
    assert list(tmp_path.iterdir()) == []
