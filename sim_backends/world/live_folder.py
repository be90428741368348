"""A folder through which the frames of a simulated camera reach another process."""

import contextlib
from collections import deque
from pathlib import Path

import cv2

from drivers.samples import Image


class LiveFolderWriter:
    """Writes frames for a camera with `source = "live_folder"`; keeps the newest.

    Each is a JPEG, as USB cameras send them, named after its capture time in nanoseconds of the host's
    monotonic clock, and renamed into place when it is complete. Only files of this writer are removed.

    Args:
        folder: Folder of the frames; created when it is missing.
        keep: Number of frames kept.
    """

    def __init__(self, folder: Path, keep: int = 50) -> None:
        self._folder = folder
        self._keep = keep
        self._written: deque[Path] = deque()
        folder.mkdir(parents=True, exist_ok=True)

    def write(self, image: Image, t_capture_ns: int) -> None:
        """Write one frame, and remove the oldest when there are more than `keep`.

        Raises:
            OSError: The folder is not writable, or the disk is full.
        """
        _, jpeg = cv2.imencode(".jpg", image)
        unfinished = self._folder / f"{t_capture_ns}.part"
        unfinished.write_bytes(jpeg.tobytes())
        self._written.append(unfinished.rename(unfinished.with_suffix(".jpg")))
        if len(self._written) > self._keep:
            self._written.popleft().unlink(missing_ok=True)

    def close(self) -> None:
        """Remove the frames, and the folder when nothing else is in it."""
        while self._written:
            self._written.popleft().unlink(missing_ok=True)
        with contextlib.suppress(OSError):
            self._folder.rmdir()
