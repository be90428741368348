"""Camera images as bytes in a log: the capture stamp, then an uncompressed BMP file.

Uncompressed, because the loop itself writes them: a PNG of 640 x 480 takes longer than a control period.
"""

import struct

from drivers.errors import LogError
from drivers.link import CameraImage

_STAMP = struct.Struct("<q")
_NO_STAMP = -1
_BITMAP = struct.Struct("<2s8xI4xiiHHI")
"""Of a bitmap file: mark, offset of the pixels, width, height, planes, bits per pixel, packing."""
_DAMAGED = "a camera image in the log cannot be decoded: the log is damaged"


def encode_image(image: CameraImage) -> bytes:
    """Return the bytes of an image; nothing is lost, so that a replay sees the same pixels.

    An image without pixels, which represents a frame that could not be decoded, becomes the stamp alone.
    """
    import cv2

    stamp = _STAMP.pack(_NO_STAMP if image.t_capture_ns is None else image.t_capture_ns)
    if image.image.size == 0:
        return stamp
    _, bitmap = cv2.imencode(".bmp", image.image)
    return stamp + bitmap.tobytes()


def decode_image(data: bytes) -> CameraImage:
    """Return the image in bytes made by `encode_image`.

    Raises:
        LogError: The bytes are not such an image.
    """
    import cv2
    import numpy as np

    if len(data) < _STAMP.size:
        raise LogError(_DAMAGED)
    (stamp,) = _STAMP.unpack_from(data)
    t_capture_ns = None if stamp == _NO_STAMP else stamp
    if len(data) == _STAMP.size:
        return CameraImage(np.zeros((0, 0), np.uint8), t_capture_ns)
    # Any other picture, or a packed bitmap, may unpack to much more than the log holds.
    if not _is_plain_bitmap(data[_STAMP.size : _STAMP.size + _BITMAP.size], len(data) - _STAMP.size):
        raise LogError(_DAMAGED)
    pixels = cv2.imdecode(np.frombuffer(data, np.uint8, offset=_STAMP.size), cv2.IMREAD_UNCHANGED)
    if pixels is None:
        raise LogError(_DAMAGED)
    return CameraImage(np.asarray(pixels, np.uint8), t_capture_ns)


def _is_plain_bitmap(head: bytes, size_bytes: int) -> bool:
    """Return whether a bitmap file holds all of its pixels, unpacked."""
    if len(head) < _BITMAP.size:
        return False
    mark, offset, width, height, _, bits, packing = _BITMAP.unpack(head)
    needed = offset + abs(height) * ((width * bits + 31) // 32 * 4)
    return mark == b"BM" and width > 0 and bits in (8, 24) and packing == 0 and needed <= size_bytes
