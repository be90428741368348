"""Source of frames: a folder of pictures, or a video."""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from drivers.camera.images import read_image, retrieve
from drivers.errors import ConfigError
from drivers.files import is_file
from drivers.samples import Image

PICTURES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".pgm", ".ppm", ".webp")
BGR = 3


@dataclass(frozen=True, slots=True)
class FrameFile:
    """A frame's number and pixels, grey or BGR; no pixels when it could not be decoded."""

    number: int
    image: Image


class FrameSource:
    """The frames at a path, in order.

    Args:
        path: A folder of pictures, ordered by the last number in their names, or a video file.

    Attributes:
        count: Number of frames; for a video as stated in the file.

    Raises:
        ConfigError: There are no frames.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        if not path.exists():
            raise ConfigError(f"{path} does not exist: give a folder of pictures or a video")
        self._pictures: list[tuple[int, Path]] = []
        self.count = 0
        if path.is_dir():
            self._pictures = _numbered(path)
            self.count = len(self._pictures)
        elif is_file(path):
            capture = cv2.VideoCapture(str(path))
            self.count = int(capture.get(cv2.CAP_PROP_FRAME_COUNT)) if capture.isOpened() else 0
            capture.release()
        if self.count <= 0:
            raise ConfigError(
                f"{path} has no frames: give a folder of pictures ({', '.join(PICTURES)}) or a video"
            )

    def __iter__(self) -> Iterator[FrameFile]:
        """Yield the frames."""
        if self._pictures:
            for number, path in self._pictures:
                yield FrameFile(number, read_image(path))
            return
        capture = cv2.VideoCapture(str(self._path))
        try:
            number = 0
            while capture.grab():
                yield FrameFile(number, retrieve(capture))
                number += 1
        finally:
            capture.release()


def to_grey(frame: FrameFile, width: int, height: int) -> Image:
    """Return a frame as grey pixels; black where it could not be decoded.

    Raises:
        ConfigError: The frame has another size than the rig's.
    """
    image = frame.image
    if image.size == 0:
        return np.zeros((height, width), np.uint8)
    if image.shape[:2] != (height, width):
        raise ConfigError(
            f"frame {frame.number} has {image.shape[1]} x {image.shape[0]} pixels, the rig "
            f"{width} x {height}: use the rig file of this camera"
        )
    if image.ndim == BGR and image.shape[2] == BGR:
        return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), np.uint8)
    return image.reshape(height, width)


def _numbered(folder: Path) -> list[tuple[int, Path]]:
    """Return the pictures with their numbers; numbered in order of name where not all names end in one."""
    files = sorted(path for path in folder.iterdir() if path.suffix.lower() in PICTURES)
    numbers = [re.findall(r"\d+", path.stem)[-1:] for path in files]
    if all(numbers):
        pairs = sorted((int(number[0]), path) for number, path in zip(numbers, files, strict=True))
        if len({number for number, _ in pairs}) == len(pairs):
            return pairs
    return list(enumerate(files))
