"""The types and the few random helpers that every part of the scenes shares."""

from collections.abc import Callable
from typing import Any, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

Picture = NDArray[np.float32]
"""A grey picture in grey levels, before it is rounded."""
Frame = NDArray[np.uint8]
"""A grey picture as a camera hands it out."""
Numbers = NDArray[np.float64]
Params = dict[str, Any]


class Layer(Protocol):
    """Something between the ground and the sensor that changes the picture of a frame."""

    def __call__(self, picture: Picture, frame: int) -> Picture: ...


Stream = Callable[[list[Frame]], list[Frame]]
"""What happens to the pictures of a drive after the sensor."""


def soften(picture: Picture, sigma: float) -> Picture:
    return np.asarray(cv2.GaussianBlur(picture, (0, 0), sigma), dtype=np.float32)


def uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return float(rng.uniform(low, high))


def sign(rng: np.random.Generator) -> float:
    return 1.0 if rng.random() < 0.5 else -1.0


def slow(rng: np.random.Generator, frames: int) -> Numbers:
    """A smooth curve within -1 and 1 that changes over tens of frames."""
    i = np.arange(frames)
    first, second = rng.uniform(25.0, 60.0), rng.uniform(50.0, 120.0)
    a, b = rng.uniform(0.0, 2 * np.pi, 2)
    curve: Numbers = 0.5 * np.sin(2 * np.pi * i / first + a) + 0.5 * np.sin(2 * np.pi * i / second + b)
    return curve
