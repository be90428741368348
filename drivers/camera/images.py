"""Pixels and formats from OpenCV."""

from pathlib import Path
from typing import NamedTuple, Protocol, cast

import cv2
import numpy as np
import simplejpeg
from cv2.typing import MatLike

from drivers.camera.parameters import FrameSourceParameters
from drivers.files import IMAGE_BYTES, IMAGE_PIXELS, read_bytes
from drivers.samples import Image

RATE_TOLERANCE = 0.01

JPEG_PIXELS_PER_BYTE = 512
"""Of a whole frame at most: each block of 8 x 8 pixels takes a bit or more (ITU-T T.81, Huffman coding)."""

NO_PIXELS: Image = np.empty((0, 0), np.uint8)
"""Pixels of a frame that could not be decoded; the codec rejects it as empty."""


class FrameFormat(NamedTuple):
    """Size in pixels and rate in Hz of the frames of a camera or video file."""

    width: float
    height: float
    rate_hz: float

    def __str__(self) -> str:
        return f"{self.width:g} x {self.height:g} pixels at {self.rate_hz:g} Hz"

    def matches(self, settings: FrameSourceParameters) -> bool:
        """Return whether frames are as configured; the rate may differ by 1 % (29.97 for 30)."""
        wrong_by_hz = abs(self.rate_hz - settings.frame_rate_hz)
        return (self.width, self.height) == (settings.width, settings.height) and (
            wrong_by_hz <= RATE_TOLERANCE * settings.frame_rate_hz
        )


def format_of(capture: cv2.VideoCapture) -> FrameFormat:
    """Return the format that an open capture reports."""
    return FrameFormat(
        capture.get(cv2.CAP_PROP_FRAME_WIDTH),
        capture.get(cv2.CAP_PROP_FRAME_HEIGHT),
        capture.get(cv2.CAP_PROP_FPS),
    )


def retrieve(capture: cv2.VideoCapture) -> Image:
    """Return the pixels of the frame grabbed last; `NO_PIXELS` when it is corrupt."""
    ok, decoded = capture.retrieve()
    return _pixels_of(decoded if ok else None)


class Capture(Protocol):
    """The part of `cv2.VideoCapture` that gives a frame."""

    def retrieve(self) -> tuple[bool, MatLike | None]:
        """Return whether there is a frame, and the frame."""
        ...


def retrieve_jpeg(capture: Capture) -> bytes:
    """Return the compressed frame grabbed last as the camera sent it, b"" without one."""
    ok, data = capture.retrieve()
    return _pixels_of(data if ok else None).tobytes()


def jpeg_pixels(compressed: bytes) -> int:
    """Return how many pixels a compressed frame has by its head.

    0 where the head is damaged, or names more pixels than the bytes can hold or a picture may have: such a
    frame was cut off or overwritten, and room for its pixels could be gigabytes.
    """
    try:
        height, width, _, _ = simplejpeg.decode_jpeg_header(compressed)
    except ValueError:
        return 0
    count = int(height * width)
    return count if count <= min(IMAGE_PIXELS, JPEG_PIXELS_PER_BYTE * len(compressed)) else 0


def decode_jpeg(compressed: bytes) -> Image:
    """Return the pixels of a compressed frame; `NO_PIXELS` when any part of it is damaged.

    A frame that was cut off or overwritten on its way still decodes in OpenCV, with old or grey pixels in the
    place of what is missing; libjpeg-turbo reports it. Damage that leaves a valid bit stream is not noticed.
    """
    if not jpeg_pixels(compressed):
        return NO_PIXELS
    try:
        pixels: Image = simplejpeg.decode_jpeg(compressed, colorspace="BGR", strict=True)
    except ValueError:
        return NO_PIXELS
    return pixels


def read_image(path: Path) -> Image:
    """Return the pixels of an image file, grey or BGR in 8 bits; `NO_PIXELS` without a sound file."""
    try:
        data = read_bytes(path, IMAGE_BYTES)
        return _pixels_of(cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_ANYCOLOR))
    except (OSError, cv2.error):
        return NO_PIXELS


def _pixels_of(decoded: MatLike | None) -> Image:
    return NO_PIXELS if decoded is None else cast("Image", decoded)
