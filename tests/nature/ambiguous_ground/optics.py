"""What the lens and the sensor do to a picture."""

from dataclasses import dataclass

import cv2
import numpy as np

from tests.nature.ambiguous_ground.camera import HEIGHT, WIDTH
from tests.nature.ambiguous_ground.picture import Frame, Numbers, Picture, soften, uniform


@dataclass(frozen=True)
class Defocus:
    """Blur by a disc, as that of a lens out of focus."""

    radius: float

    def __call__(self, picture: Picture, frame: int) -> Picture:
        reach = int(np.ceil(self.radius)) + 1
        y, x = np.mgrid[-reach : reach + 1, -reach : reach + 1]
        disc = np.clip(self.radius + 0.5 - np.hypot(x, y), 0.0, 1.0)
        kernel = (disc / disc.sum()).astype(np.float32)
        return np.asarray(cv2.filter2D(picture, -1, kernel, borderType=cv2.BORDER_REFLECT), dtype=np.float32)


class Specks:
    """Specks on the lens, dark and bright, fixed in the picture from a frame on."""

    def __init__(self, rng: np.random.Generator, count: int, since: int = 0) -> None:
        self.since = since
        self.cover = np.zeros((HEIGHT, WIDTH), dtype=np.float32)
        self._grey = np.zeros((HEIGHT, WIDTH), dtype=np.float32)
        bright_share = rng.uniform(0.1, 0.5)
        for _ in range(count):
            at = (round(16 * rng.uniform(0, WIDTH)), round(16 * rng.uniform(0, HEIGHT)))
            axes = (round(16 * rng.uniform(1.0, 3.5)), round(16 * rng.uniform(1.0, 3.5)))
            bright = rng.random() < bright_share
            grey = rng.uniform(190.0, 245.0) if bright else rng.uniform(10.0, 60.0)
            strength, turn = rng.uniform(0.35, 0.95), rng.uniform(0, 180)
            for layer, value in ((self.cover, strength), (self._grey, grey)):
                points = np.asarray(cv2.ellipse2Poly(at, axes, int(turn), 0, 360, 20), dtype=np.int32)
                cv2.fillPoly(layer, [points], (float(value),), cv2.LINE_8, 4)
        grey_weighted = soften(self._grey * self.cover, 0.7)
        self.cover = soften(self.cover, 0.7)
        self._grey = np.asarray(grey_weighted / np.maximum(self.cover, 1e-3), dtype=np.float32)

    def __call__(self, picture: Picture, frame: int) -> Picture:
        if frame < self.since:
            return picture
        return picture + self.cover * (self._grey - picture)


class Dust:
    """A thin film on the lens: less contrast, and a smear that is fixed in the picture."""

    def __init__(self, rng: np.random.Generator, smear: float, kept: float) -> None:
        noise = soften(rng.standard_normal((HEIGHT, WIDTH), dtype=np.float32), uniform(rng, 8.0, 25.0))
        self._veil = noise * np.float32(smear / noise.std()) + np.float32((1.0 - kept) * 140.0)
        self._kept = np.float32(kept)

    def __call__(self, picture: Picture, frame: int) -> Picture:
        return np.asarray(picture * self._kept + self._veil, dtype=np.float32)


class Vignette:
    """The lens is darker towards the corners."""

    def __init__(self, loss: float) -> None:
        y, x = np.mgrid[0:HEIGHT, 0:WIDTH]
        r2 = ((x - WIDTH / 2) ** 2 + (y - HEIGHT / 2) ** 2) / ((WIDTH / 2) ** 2 + (HEIGHT / 2) ** 2)
        self._gain = (1.0 - loss * r2).astype(np.float32)

    def __call__(self, picture: Picture, frame: int) -> Picture:
        return np.asarray(picture * self._gain, dtype=np.float32)


@dataclass(frozen=True)
class Exposure:
    """A gain for every frame."""

    gains: Numbers

    def __call__(self, picture: Picture, frame: int) -> Picture:
        return picture * np.float32(self.gains[frame])


class FixedPattern:
    """Every pixel and every column of the sensor has an offset of its own."""

    def __init__(self, rng: np.random.Generator, grey: float, columns: float) -> None:
        pixels = rng.standard_normal((HEIGHT, WIDTH), dtype=np.float32)
        stripes = rng.standard_normal((1, WIDTH), dtype=np.float32)
        self._offset = np.float32(grey) * (pixels * np.sqrt(1.0 - columns) + stripes * np.sqrt(columns))

    def __call__(self, picture: Picture, frame: int) -> Picture:
        return np.asarray(picture + self._offset, dtype=np.float32)


def digitise(picture: Picture, noise: float, rng: np.random.Generator) -> Frame:
    noisy = picture + np.float32(noise) * rng.standard_normal(picture.shape, dtype=np.float32)
    return np.clip(np.rint(noisy), 0, 255).astype(np.uint8)
