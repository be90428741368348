"""What happens to pictures between the sensor and the log."""

from dataclasses import dataclass

import cv2
import numpy as np

from tests.nature.ambiguous_ground.picture import Frame


def coded(frame: Frame, quality: int) -> Frame:
    """The picture after JPEG coding."""
    data = cv2.imencode(".jpg", frame, [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
    return np.asarray(cv2.imdecode(data, cv2.IMREAD_GRAYSCALE), dtype=np.uint8)


@dataclass(frozen=True)
class Repeats:
    """Some frames are the previous picture once more, coded again.

    Attributes:
        repeated: whether each frame is a repeat.
        quality: JPEG quality of every frame.
        again: JPEG quality of every repeat.
    """

    repeated: list[bool]
    quality: int
    again: int

    def __call__(self, frames: list[Frame]) -> list[Frame]:
        out: list[Frame] = []
        for frame, repeated in zip(frames, self.repeated, strict=True):
            out.append(coded(out[-1], self.again) if repeated and out else coded(frame, self.quality))
        return out


@dataclass(frozen=True)
class Swapped:
    """The two frames of some pairs have changed places.

    Attributes:
        pairs: whether pair k, frames 2 k and 2 k + 1, is swapped.
    """

    pairs: list[bool]

    def __call__(self, frames: list[Frame]) -> list[Frame]:
        out = list(frames)
        for k, swapped in enumerate(self.pairs):
            if swapped and 2 * k + 1 < len(out):
                out[2 * k], out[2 * k + 1] = out[2 * k + 1], out[2 * k]
        return out


def mirrored(frames: list[Frame]) -> list[Frame]:
    return [np.ascontiguousarray(frame[:, ::-1]) for frame in frames]


def upside_down(frames: list[Frame]) -> list[Frame]:
    return [np.ascontiguousarray(frame[::-1, ::-1]) for frame in frames]
