"""Video files through OpenCV."""

from collections.abc import Generator
from functools import partial
from itertools import count
from pathlib import Path

import cv2

from drivers.camera.images import format_of, retrieve
from drivers.camera.playback_link import PlaybackLink, RecordedFrame
from drivers.errors import NotConnectedError


class VideoLink(PlaybackLink):
    """A video file, played at its own rate, which must be the configured one."""

    def _open_frames(self) -> Generator[RecordedFrame]:
        path = self._settings.path
        if not Path(path).is_file():
            raise NotConnectedError(f"video {path} does not exist: correct the camera's `path`")
        capture = cv2.VideoCapture(path)
        if not capture.isOpened():
            raise NotConnectedError(
                f"video {path} cannot be opened: convert it to a format that OpenCV reads"
            )
        granted = format_of(capture)
        if not granted.matches(self._settings):
            capture.release()
            raise NotConnectedError(
                f"video {path} has {granted}: set the camera's width, height and frame_rate_hz to these"
            )
        return self._play(capture)

    def _play(self, capture: cv2.VideoCapture) -> Generator[RecordedFrame]:
        def rewind() -> bool:
            return self._settings.loop and capture.set(cv2.CAP_PROP_POS_FRAMES, 0) and capture.grab()

        try:
            for index in count():
                if not (capture.grab() or rewind()):
                    return
                yield RecordedFrame(index * self._period_ns, partial(retrieve, capture))
        finally:
            capture.release()
