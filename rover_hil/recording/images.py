"""Camera images in a log: the picture file as the camera sent it, or a PNG.

A PNG of 640 x 480 pixels takes longer than a control period; the log's own thread makes it. Both give the
same pixels again, bit for bit.
"""

import base64
import binascii
import math
import struct

from drivers.errors import LogError
from drivers.files import IMAGE_PIXELS
from drivers.link import CameraImage
from rover_hil.recording.schema import PictureRecord
from rover_hil.recording.views import timestamp

PNG_LEVEL = 1
"""Of zlib: higher ones take several times as long and save a few percent."""

_STAMP = struct.Struct("<q")
_NO_STAMP = -1
_PNG = struct.Struct(">8s4x4sII")
"""Of a PNG file: mark, kind of the first part, width, height."""
_PNG_MARK = b"\x89PNG\r\n\x1a\n"
_JPEG_MARK = b"\xff\xd8"
_DAMAGED = "a camera image in the log cannot be decoded: the log is damaged"


def picture_record(device: str, time_ns: int, image: CameraImage) -> PictureRecord:
    """Return the record of an image; nothing is lost, so that a replay sees the same pixels.

    An image without pixels, which represents a frame that could not be decoded, has no data.

    Args:
        device: The camera.
        time_ns: When it arrived, ns since 1970.
        image: The image.
    """
    data, name = b"", ""
    if image.jpeg is not None:
        data, name = image.jpeg, "jpeg"
    elif image.image.size:
        import cv2

        _, picture = cv2.imencode(".png", image.image, (cv2.IMWRITE_PNG_COMPRESSION, PNG_LEVEL))
        data, name = picture.tobytes(), "png"
    stamp = timestamp(time_ns)
    return {
        "timestamp": {"sec": stamp["sec"], "nsec": stamp["nsec"]},
        "frame_id": device,
        "data": base64.b64encode(data).decode("ascii"),
        "format": name,
        "t_capture_ns": image.t_capture_ns,
    }


def picture_payload(record: PictureRecord) -> bytes:
    """Return the bytes that `decode_image` takes, stamp and picture file.

    Raises:
        LogError: The record holds no picture in base64.
    """
    stamp_ns = _NO_STAMP if record["t_capture_ns"] is None else record["t_capture_ns"]
    try:
        return _STAMP.pack(stamp_ns) + base64.b64decode(record["data"], validate=True)
    except (binascii.Error, ValueError, struct.error) as error:
        raise LogError(_DAMAGED) from error


def pixels_of(image: CameraImage) -> int:
    """Return how many pixels a reader of the image's record counts; see `pixels_in`."""
    if image.jpeg is None:
        return math.prod(image.image.shape[:2])
    from drivers.camera.images import jpeg_pixels

    return jpeg_pixels(image.jpeg)


def pixels_in(data: bytes) -> int:
    """Return how many pixels a payload of `decode_image` unpacks to; 0 for what is no JPEG or PNG file.

    A JPEG frame that was damaged on its way is kept as it came, and has no pixels.

    Raises:
        LogError: It is a PNG file that holds more than `IMAGE_PIXELS`, or is damaged.
    """
    picture = data[_STAMP.size :]
    if picture.startswith(_PNG_MARK) and len(picture) >= _PNG.size:
        _, kind, width, height = _PNG.unpack_from(picture)
        if kind != b"IHDR" or width * height > IMAGE_PIXELS:
            raise LogError(_DAMAGED)
        return int(width * height)
    if picture.startswith(_JPEG_MARK):
        from drivers.camera.images import jpeg_pixels

        return jpeg_pixels(picture)
    return 0


def capture_time_ns(data: bytes) -> int | None:
    """Return when the image that `decode_image` takes was taken; None where that is not known.

    Raises:
        LogError: The bytes are not such an image.
    """
    if len(data) < _STAMP.size:
        raise LogError(_DAMAGED)
    (stamp,) = _STAMP.unpack_from(data)
    return None if stamp == _NO_STAMP else int(stamp)


def decode_image(data: bytes) -> CameraImage:
    """Return the image in the data of a message on `/raw/CAMERA`.

    Raises:
        LogError: The bytes are not such an image.
    """
    import numpy as np

    t_capture_ns = capture_time_ns(data)
    picture = data[_STAMP.size :]
    if not picture:
        return CameraImage(np.zeros((0, 0), np.uint8), t_capture_ns)
    pixels_in(data)
    if picture.startswith(_JPEG_MARK):
        from drivers.camera.images import decode_jpeg

        return CameraImage(decode_jpeg(picture), t_capture_ns, picture)
    if not picture.startswith(_PNG_MARK):
        raise LogError(_DAMAGED)
    import cv2

    pixels = cv2.imdecode(np.frombuffer(picture, np.uint8), cv2.IMREAD_UNCHANGED)
    if pixels is None:
        raise LogError(_DAMAGED)
    return CameraImage(np.asarray(pixels, np.uint8), t_capture_ns)


def decode_picture(t_capture_ns: int | None, picture: bytes) -> CameraImage:
    """Return the image in a picture file of another program; one without pixels where it cannot be decoded.

    Args:
        t_capture_ns: When it was taken, monotonic time; None where that is not known.
        picture: A JPEG or PNG file.
    """
    import numpy as np

    is_stamp = t_capture_ns is not None and 0 <= t_capture_ns < 2**62
    stamp_ns = t_capture_ns if is_stamp else None
    try:
        return decode_image(_STAMP.pack(_NO_STAMP if stamp_ns is None else stamp_ns) + picture)
    except LogError:
        return CameraImage(np.zeros((0, 0), np.uint8), stamp_ns)
