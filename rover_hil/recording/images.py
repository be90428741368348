"""Camera images as bytes in a log: the capture stamp, then an uncompressed BMP file.

Uncompressed, because the loop itself writes them: a PNG of 640 x 480 takes longer than a control period.
"""

import struct

from drivers.errors import LogError
from drivers.link import CameraImage

_STAMP = struct.Struct("<q")
_NO_STAMP = -1


def encode_image(image: CameraImage) -> bytes:
    """Return the bytes of an image; nothing is lost, so that a replay sees the same pixels."""
    import cv2

    ok, bitmap = cv2.imencode(".bmp", image.image)
    if not ok:
        msg = f"camera image of shape {image.image.shape} cannot be logged"
        raise LogError(msg)
    stamp = _NO_STAMP if image.t_capture_ns is None else image.t_capture_ns
    return _STAMP.pack(stamp) + bitmap.tobytes()


def decode_image(data: bytes) -> CameraImage:
    """Return the image in bytes made by `encode_image`.

    Raises:
        LogError: The bytes are not such an image.
    """
    import cv2
    import numpy as np

    pixels = None
    if len(data) > _STAMP.size:
        pixels = cv2.imdecode(np.frombuffer(data, np.uint8, offset=_STAMP.size), cv2.IMREAD_UNCHANGED)
    if pixels is None:
        msg = "a camera image in the log cannot be decoded: the log is damaged"
        raise LogError(msg)
    (stamp,) = _STAMP.unpack_from(data)
    return CameraImage(np.asarray(pixels, np.uint8), None if stamp == _NO_STAMP else stamp)
