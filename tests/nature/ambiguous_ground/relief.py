"""Ground that is not flat: every pixel's ray is followed to where it meets the mounds."""

from dataclasses import dataclass

import cv2
import numpy as np

from tests.nature.ambiguous_ground.camera import Camera
from tests.nature.ambiguous_ground.ground import Cloth, GroundView, sub_pixels, to_pixels
from tests.nature.ambiguous_ground.motion import Pose
from tests.nature.ambiguous_ground.picture import Numbers, Picture
from tests.nature.ambiguous_ground.textures import octave

CELLS = 512
ROUNDS = 4
"""Secant steps that find where a ray meets the mounds."""


@dataclass(frozen=True)
class Mounds:
    """Heights that continue at their own edges.

    Attributes:
        heights: height of every cell over the plane of the wheels' contact, m; 0 on average.
        cell: size of a cell, m.
    """

    heights: Picture
    cell: float

    def at(self, x: Picture, y: Picture, values: Picture | None = None) -> Picture:
        """Heights (or other values of the cells) at points of the world."""
        of = self.heights if values is None else values
        column, row = x * np.float32(1.0 / self.cell), y * np.float32(1.0 / self.cell)
        column = column - CELLS * np.floor(column.min() / CELLS)
        row = row - CELLS * np.floor(row.min() / CELLS)
        found = cv2.remap(of, column, row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)
        return np.asarray(found, dtype=np.float32)

    def slopes(self) -> tuple[Picture, Picture]:
        around = np.pad(self.heights, 1, mode="wrap")
        by_x = (around[1:-1, 2:] - around[1:-1, :-2]) / np.float32(2.0 * self.cell)
        by_y = (around[2:, 1:-1] - around[:-2, 1:-1]) / np.float32(2.0 * self.cell)
        return by_x, by_y

    def light(self, sun: Numbers) -> Picture:
        """How much brighter than flat ground every cell is, under a sun in this direction (3)."""
        by_x, by_y = self.slopes()
        facing = (sun[2] - by_x * sun[0] - by_y * sun[1]) / np.sqrt(1.0 + by_x**2 + by_y**2)
        return np.asarray(np.maximum(facing / sun[2], 0.2), dtype=np.float32)


def mounds(rng: np.random.Generator, peak_to_peak: float, steepest: float) -> Mounds:
    """Random mounds of a height, m, so wide that no slope is steeper than wished."""
    spots = octave(rng, 32, CELLS) + 0.3 * octave(rng, 16, CELLS)
    around = cv2.GaussianBlur(np.pad(spots, 64, mode="wrap"), (0, 0), 10.0)
    heights = np.asarray(around[64:-64, 64:-64], dtype=np.float32)
    heights *= np.float32(peak_to_peak / float(heights.max() - heights.min()))
    heights -= heights.mean()
    by_x, by_y = Mounds(heights, 1.0).slopes()
    return Mounds(heights, float(np.hypot(by_x, by_y).max()) / steepest)


class ReliefView(GroundView):
    """A cloth upon mounds, lit by a sun from aside.

    Attributes:
        brightness: grey of flat ground over the contrast of the cloth.
    """

    def __init__(self, camera: Camera, cloth: Cloth, ground: Mounds, sun: Numbers, brightness: float) -> None:
        super().__init__(camera, cloth)
        u, v = sub_pixels()
        rays = camera.rays(u, v)
        self._run = (rays[..., :2] / rays[..., 2:]).astype(np.float32)
        self.ground, self._light, self.brightness = ground, ground.light(sun), brightness

    def meets(self, pose: Pose) -> tuple[Picture, Picture, Picture]:
        """The points of the world, x, y, z, that the rays meet."""
        before = np.zeros(self.points.shape[:2], dtype=np.float32)
        x, y = self.from_vehicle(self.points, pose)
        over_before = self.ground.at(x, y)
        z = over_before.copy()
        for _ in range(ROUNDS):
            x, y = self.from_vehicle(self.points + self._run * z[..., None], pose)
            over = self.ground.at(x, y) - z
            change = over - over_before
            secant = (before - z) / np.where(np.abs(change) < 1e-7, np.float32(np.inf), change)
            before, over_before = z, over
            z = z + over * np.where(secant == 0.0, np.float32(1.0), np.clip(secant, 0.3, 5.0))
        return x, y, z

    def see(self, pose: Pose, seconds: float = 0.0) -> Picture:
        x, y, _ = self.meets(pose)
        light = self.ground.at(x, y, self._light)
        own = self.look_up(*self.texels(x, y)) + np.float32(self.brightness)
        return to_pixels(np.asarray(own * light, dtype=np.float32)) - np.float32(self.brightness)
