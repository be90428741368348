"""Turns camera images into frames, or rejects them."""

from collections.abc import Sequence

import numpy as np

from drivers.clock import NANOSECONDS_PER_SECOND
from drivers.driver import Rejection
from drivers.link import CameraImage, Received
from drivers.samples import FrameSample

BLACK = 16
"""A frame that is darker everywhere shows nothing: a covered lens, or a camera that sends empty frames."""
OLDEST_NS = NANOSECONDS_PER_SECOND
LARGEST_LEAD_NS = 1_000_000
"""Stamps further ahead of their arrival are of another clock; a host's clocks differ by less."""


class CameraCodec:
    """Turns the images of one camera into numbered frames.

    An image is rejected when it is "empty" (it could not be decoded whole), has another "size" or "dtype"
    than 8-bit grey or BGR of the configured size, is "black", or when its stamp is that of the frame before
    ("stamp_not_moving"), older ("stamp_backwards"), a second old on arrival ("stamp_old"), or more than 1 ms
    later than its arrival ("stamp_future"). Images without a stamp pass.

    Args:
        name: Name of the device.
        width: Width in pixels.
        height: Height in pixels.
    """

    def __init__(self, name: str, width: int, height: int) -> None:
        self._name = name
        self._shapes = ((height, width), (height, width, 3))
        self._index = 0
        self._newest_stamp_ns: int | None = None

    def decode(self, item: Received[CameraImage]) -> Sequence[FrameSample | Rejection]:
        """Return the frame, or the reason for its rejection."""
        reason = self._find_fault(item.payload) or self._find_stamp_fault(item)
        if reason is not None:
            return (Rejection(reason),)
        stamp_ns = item.payload.t_capture_ns
        if stamp_ns is not None:
            self._newest_stamp_ns = stamp_ns
        frame = FrameSample(
            device=self._name,
            t_ns=item.t_ns,
            image=item.payload.image,
            t_capture_ns=stamp_ns,
            index=self._index,
        )
        self._index += 1
        return (frame,)

    def reset(self) -> None:
        """Forget the newest stamp; the numbering continues."""
        self._newest_stamp_ns = None

    def _find_fault(self, payload: CameraImage) -> str | None:
        if payload.image.size == 0:
            return "empty"
        if payload.image.dtype != np.uint8:
            return "dtype"
        if payload.image.shape not in self._shapes:
            return "size"
        return "black" if payload.image.max() < BLACK else None

    def _find_stamp_fault(self, item: Received[CameraImage]) -> str | None:
        stamp_ns = item.payload.t_capture_ns
        if stamp_ns is None:
            return None
        if item.t_ns - stamp_ns > OLDEST_NS:
            return "stamp_old"
        if stamp_ns - item.t_ns > LARGEST_LEAD_NS:
            return "stamp_future"
        if self._newest_stamp_ns is None or stamp_ns > self._newest_stamp_ns:
            return None
        return "stamp_not_moving" if stamp_ns == self._newest_stamp_ns else "stamp_backwards"
