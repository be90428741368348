"""Changes of the look of rendered frames: dirt on the lens, dark, blur, low contrast."""

from collections.abc import Mapping

import cv2
import numpy as np

from benchmarks.ground_motion.measured import Look
from drivers.samples import Image

SPECKS, FAINT_SPECKS = 45, 30


def dirt(seed: int, strength: tuple[float, float], count: int) -> Look:
    """Return a look with specks that are fixed in the picture; `strength` is the light they take."""
    rng = np.random.default_rng(seed)
    specks = [
        (rng.integers(0, 640), rng.integers(0, 480), rng.integers(3, 13), rng.uniform(*strength))
        for _ in range(count)
    ]

    def change(image: Image, frame: int) -> Image:
        del frame
        light = np.ones(image.shape, np.float32)
        for x, y, radius, share in specks:
            cv2.circle(light, (int(x), int(y)), int(radius), 1.0 - float(share), -1, cv2.LINE_AA)
        return _grey(image * cv2.GaussianBlur(light, (0, 0), 1.0))

    return change


def dark(seed: int) -> Look:
    """Return a look with an eighth of the light, and noise of 2 grey levels."""
    return lambda image, frame: _noisy(image / 8.0, seed, frame)


def contrast(seed: int) -> Look:
    """Return a look with a quarter of the contrast, and noise of 2 grey levels."""
    return lambda image, frame: _noisy(image.mean() + (image - image.mean()) / 4.0, seed, frame)


def motion_blur(pixels: int) -> Look:
    """Return a look of a long exposure: the ground smears along the columns."""
    return lambda image, frame: _grey(cv2.blur(image, (1, pixels)))


def defocus(sigma: float) -> Look:
    """Return a look out of focus."""
    return lambda image, frame: _grey(cv2.GaussianBlur(image, (0, 0), sigma))


LOOKS: Mapping[str, Look | None] = {
    "clean": None,
    "dirt": dirt(1, (0.2, 0.7), SPECKS),
    "faint dirt": dirt(2, (0.1, 0.4), FAINT_SPECKS),
    "dark": dark(3),
    "contrast": contrast(4),
    "blur 17": motion_blur(17),
    "blur 33": motion_blur(33),
    "defocus 5": defocus(5.0),
}


def _noisy(picture: np.ndarray, seed: int, frame: int) -> Image:
    rng = np.random.default_rng((seed, frame))
    return _grey(picture + rng.normal(0.0, 2.0, picture.shape))


def _grey(picture: np.ndarray) -> Image:
    return np.asarray(np.clip(np.round(picture), 0, 255), np.uint8)
