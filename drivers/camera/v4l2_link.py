"""V4L2 cameras through OpenCV.

Behaviour of OpenCV according to its `modules/videoio/src/cap_v4l.cpp`: `CAP_PROP_POS_MSEC` is the time stamp
that the kernel's driver gave the frame grabbed last, for USB cameras on the host's monotonic clock; `set`
returns True for values that the driver did not accept.
"""

import math
import os
from pathlib import Path

# OpenCV would wait 10 s for a frame of a dead camera. It reads this, in whole seconds, at its first wait.
os.environ.setdefault("OPENCV_VIDEOIO_V4L_SELECT_TIMEOUT", "1")

import cv2
import numpy as np

from drivers.camera.images import FrameFormat, decode_jpeg, format_of, retrieve, retrieve_jpeg
from drivers.camera.parameters import FrameSourceParameters
from drivers.clock import NANOSECONDS_PER_SECOND, Clock, nanoseconds, seconds
from drivers.errors import NotConnectedError
from drivers.link import CameraImage, Received
from drivers.threaded_link import ThreadedLink

NANOSECONDS_PER_MILLISECOND = 1_000_000
BUFFER_COUNT = 2
JPEG_FOURCC = "MJPG"
CONVERTED_FOURCC = "BGR3"
FIRST_GRAB_TRIES = 3
CHECKED_STAMPS = 3
STANDSTILL_PERIODS = 3
SHORTEST_WAIT_NS = NANOSECONDS_PER_SECOND // 2
"""Half of OpenCV's limit: a grab that failed sooner did not wait for a frame."""
# The menu of V4L2_CID_EXPOSURE_AUTO; USB cameras call their automatic mode aperture priority.
MANUAL_EXPOSURE = 1
AUTOMATIC_EXPOSURE = 3


class V4l2Link(ThreadedLink[CameraImage]):
    """A camera of this machine; the newest frames win.

    A camera that rejects a setting is not opened. Its time stamps are checked at the start: where they are
    not within the last second of the host's clock, or stand still, images carry no capture time. A frame that
    has the stamp of the frame before is not delivered where it is the same again; where its picture differs,
    the stamps stand still, and images carry no capture time from then on.

    Args:
        settings: The camera's settings.
        clock: The host's clock.
    """

    queue_limit = 4

    def __init__(self, settings: FrameSourceParameters, clock: Clock) -> None:
        super().__init__(f"camera {settings.path}", clock, settings.reconnect_limit_s)
        self._settings = settings
        self._period_ns = nanoseconds(1 / settings.frame_rate_hz)
        self._capture: cv2.VideoCapture | None = None
        self._stamps_are_captures = False
        self._stamp_ns = 0
        self._moved_ns = 0
        self._newest: CameraImage | None = None

    def _open_handle(self) -> None:
        path = Path(self._settings.path)
        if not path.exists():
            raise NotConnectedError("no such device: plug it in, or choose one of `ls /dev/v4l/by-id/`")
        if not os.access(path, os.R_OK | os.W_OK):
            raise NotConnectedError(
                "no permission: add the user to the group that owns the device, usually `video`"
            )
        capture = cv2.VideoCapture(self._settings.path, cv2.CAP_V4L2)
        try:
            self._set_up(capture)
            self._check_stamps(capture)
        except BaseException:
            capture.release()
            raise
        self._capture = capture

    def _close_handle(self) -> None:
        if self._capture is not None:
            self._capture.release()
            self._capture = None

    def _set_up(self, capture: cv2.VideoCapture) -> None:
        if not capture.isOpened():
            raise NotConnectedError("it is busy or no V4L2 capture device: close the program that uses it")
        settings = self._settings
        fourcc = int.from_bytes(settings.fourcc.encode("ascii"), "little")
        # The pixel format limits the sizes on offer, the size limits the rates: in this order.
        capture.set(cv2.CAP_PROP_FOURCC, fourcc)
        capture.set(cv2.CAP_PROP_FRAME_WIDTH, settings.width)
        capture.set(cv2.CAP_PROP_FRAME_HEIGHT, settings.height)
        capture.set(cv2.CAP_PROP_FPS, settings.frame_rate_hz)
        capture.set(cv2.CAP_PROP_BUFFERSIZE, BUFFER_COUNT)
        granted = format_of(capture)
        found_fourcc = round(capture.get(cv2.CAP_PROP_FOURCC))
        if found_fourcc != fourcc or not granted.matches(settings):
            wanted = FrameFormat(settings.width, settings.height, settings.frame_rate_hz)
            name = (found_fourcc & 0xFFFF_FFFF).to_bytes(4, "little").decode("ascii", "replace")
            what = (
                f"it does not offer {settings.fourcc}"  # OpenCV converts another format, and names the result
                if name == CONVERTED_FOURCC
                else f"it gives {name} {granted} instead of {settings.fourcc} {wanted}"
            )
            raise NotConnectedError(
                f"{what}: configure one of `v4l2-ctl --list-formats-ext -d {settings.path}`"
            )
        if settings.fourcc == JPEG_FOURCC:
            capture.set(cv2.CAP_PROP_CONVERT_RGB, 0)  # frames as the camera sent them, to check them whole
        self._set_exposure(capture)

    def _set_exposure(self, capture: cv2.VideoCapture) -> None:
        exposure = self._settings.exposure_100us
        if exposure is None:
            capture.set(cv2.CAP_PROP_AUTO_EXPOSURE, AUTOMATIC_EXPOSURE)
            is_refused = capture.get(cv2.CAP_PROP_AUTO_EXPOSURE) == MANUAL_EXPOSURE
        else:
            capture.set(cv2.CAP_PROP_AUTO_EXPOSURE, MANUAL_EXPOSURE)
            capture.set(cv2.CAP_PROP_EXPOSURE, exposure)
            is_refused = capture.get(cv2.CAP_PROP_EXPOSURE) != exposure
        if is_refused:
            raise NotConnectedError(
                f"it refuses exposure_100us = {exposure or 'automatic'}: "
                f"configure one of `v4l2-ctl --list-ctrls -d {self._settings.path}`"
            )

    def _check_stamps(self, capture: cv2.VideoCapture) -> None:
        self._grab_first(capture)
        ages_ns: list[int] = []
        stamps_ns: set[int] = set()
        for _ in range(CHECKED_STAMPS):
            self._grab_first(capture)
            stamp_ns = _read_stamp_ns(capture)
            stamps_ns.add(stamp_ns)
            ages_ns.append(self._clock.now_ns() - stamp_ns)
        is_fresh = all(0 < age_ns < NANOSECONDS_PER_SECOND for age_ns in ages_ns)
        self._stamps_are_captures = is_fresh and len(stamps_ns) > 1
        self._newest = None
        self._stamp_ns = 0
        self._moved_ns = self._clock.now_ns()

    def _grab_first(self, capture: cv2.VideoCapture) -> None:
        """Wait for a frame; OpenCV gives up after a second, which a slow camera may need twice."""
        tries = max(FIRST_GRAB_TRIES, math.ceil(STANDSTILL_PERIODS * seconds(self._period_ns)))
        if not any(capture.grab() for _ in range(tries)):
            raise NotConnectedError("it sends no frames: check its cable and its USB bandwidth")

    def _read(self) -> Received[CameraImage] | None:
        capture = self._capture
        asked_ns = self._clock.now_ns()
        if capture is None or not capture.grab():
            self._require_slow(asked_ns)
            return None
        t_ns = self._clock.now_ns()
        stamp_ns = _read_stamp_ns(capture)
        is_standing = stamp_ns == self._stamp_ns != 0  # a driver that always gives 0 stamps nothing
        image = self._retrieve(capture, None if is_standing or not self._stamps_are_captures else stamp_ns)
        if is_standing and self._newest is not None:
            if _are_same(image, self._newest):
                if t_ns - self._moved_ns >= STANDSTILL_PERIODS * self._period_ns:
                    raise NotConnectedError(f"{self.where} repeats one frame: check its cable")
                self._clock.sleep_until(t_ns + self._period_ns)
                return None
            self._stamps_are_captures = False
        self._newest = image
        self._stamp_ns = stamp_ns
        self._moved_ns = t_ns
        return Received(t_ns, image)

    def _retrieve(self, capture: cv2.VideoCapture, t_capture_ns: int | None) -> CameraImage:
        if self._settings.fourcc != JPEG_FOURCC:
            return CameraImage(retrieve(capture), t_capture_ns)
        compressed = retrieve_jpeg(capture)
        return CameraImage(decode_jpeg(compressed), t_capture_ns, compressed)

    def _require_slow(self, asked_ns: int) -> None:
        """Raise unless a frame that has not come may still be on its way, as with a camera at 1 Hz."""
        now_ns = self._clock.now_ns()
        has_waited = now_ns - asked_ns >= SHORTEST_WAIT_NS  # of an unplugged camera every grab fails at once
        if not has_waited or now_ns - self._moved_ns >= STANDSTILL_PERIODS * self._period_ns:
            raise NotConnectedError(f"{self.where} sends no more frames: check its cable")

    def _write(self, payload: bytes) -> bool:
        return False


def _are_same(image: CameraImage, before: CameraImage) -> bool:
    """Return whether two pictures are equal to the last bit, as no two exposures of a sensor are."""
    return image.jpeg == before.jpeg and np.array_equal(image.image, before.image)


def _read_stamp_ns(capture: cv2.VideoCapture) -> int:
    return round(capture.get(cv2.CAP_PROP_POS_MSEC) * NANOSECONDS_PER_MILLISECOND)
