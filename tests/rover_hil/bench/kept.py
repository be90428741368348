"""A queue for notices with a limit."""

import queue

from rover_hil.bench.camera_frames import CameraFrame
from rover_hil.bench.views import Notice


class Kept:
    """Keeps notices, up to a number."""

    def __init__(self, most: int) -> None:
        self.items: list[Notice | CameraFrame] = []
        self.most = most

    def put_nowait(self, item: Notice | CameraFrame, /) -> None:
        if len(self.items) >= self.most:
            raise queue.Full
        self.items.append(item)
