"""What a camera sees of a textured ground: every pixel's ray is followed to the ground."""

from dataclasses import dataclass

import cv2
import numpy as np

from tests.nature.ambiguous_ground.camera import HEIGHT, WIDTH, Camera
from tests.nature.ambiguous_ground.motion import Pose
from tests.nature.ambiguous_ground.picture import Numbers, Picture

LEVELS = 6
SUBROWS = 2
"""Rays per pixel, one below the other: a pixel covers more ground along the view than across it."""


@dataclass(frozen=True)
class Cloth:
    """A texture that lies in the world.

    Attributes:
        texture: texels; columns run along the cloth's own first axis.
        texel: size of a texel, m.
        heading: turn of the cloth's first axis from the world's, rad.
        origin: where in the texture the world's origin lies, texels.
    """

    texture: Picture
    texel: float
    heading: float = 0.0
    origin: tuple[float, float] = (0.0, 0.0)


def _pyramid(texture: Picture) -> list[Picture]:
    levels = [texture]
    while len(levels) < LEVELS:
        levels.append(np.asarray(cv2.resize(levels[-1], None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)))
    return levels


def sub_pixels() -> tuple[Numbers, Numbers]:
    """Places of all rays in the picture: SUBROWS of them, evenly spread, in each pixel."""
    rows = (np.arange(HEIGHT * SUBROWS) + 0.5) / SUBROWS - 0.5
    v, u = np.meshgrid(rows, np.arange(WIDTH, dtype=np.float64), indexing="ij")
    return u, v


def to_pixels(rays: Picture) -> Picture:
    return np.asarray(rays.reshape(HEIGHT, SUBROWS, WIDTH).mean(axis=1), dtype=np.float32)


class GroundView:
    """A cloth on a horizontal plane, as a camera sees it.

    Where the rays of the camera spread, coarser copies of the texture are used, blended smoothly.

    Attributes:
        cloth: the cloth.
        points: where the rays meet the plane, in the vehicle frame.
        curvature: of the ground along the vehicle, 1/m; positive where it falls away ahead and behind. The
            cloth lies on it, and the vehicle on its tangent plane.
        twist: change of the ground's slope to the left per metre ahead, 1/m; positive where that rises.
    """

    def __init__(self, camera: Camera, cloth: Cloth, height: float = 0.0) -> None:
        self.cloth = cloth
        self.curvature = self.twist = 0.0
        self._camera = np.array(camera.position, dtype=np.float32)
        self._camera[2] -= np.float32(height)
        self._levels = _pyramid(cloth.texture)
        u, v = sub_pixels()
        self.points = camera.on_plane(u, v, height).astype(np.float32)
        width = np.hypot(*np.moveaxis(np.gradient(self.points, axis=1), -1, 0))
        lod = np.clip(np.log2(width / cloth.texel), 0.0, LEVELS - 1.0)
        self._bands: list[tuple[int, slice, Picture]] = []
        for level in range(LEVELS):
            weight = np.maximum(1.0 - np.abs(lod - level), 0.0).astype(np.float32)
            rows = np.flatnonzero(weight.max(axis=1) > 0.0)
            if len(rows):
                band = slice(int(rows[0]), int(rows[-1]) + 1)
                self._bands.append((level, band, weight[band]))

    def see(self, pose: Pose, seconds: float = 0.0) -> Picture:
        """The cloth's values in the picture that is taken from this pose at this time."""
        return to_pixels(self.look_up(*self.texels(*self.in_world(pose, seconds))))

    def in_world(self, pose: Pose, seconds: float) -> tuple[Picture, Picture]:
        """Where in the world the cloth is that the rays meet."""
        if not self.curvature and not self.twist:
            return self.from_vehicle(self.points, pose)
        x, y = self.points[..., 0], self.points[..., 1]
        rise = x * (np.float32(self.twist) * y - np.float32(0.5 * self.curvature) * x)
        nearer = (rise / self._camera[2])[..., None]
        return self.from_vehicle(self.points + nearer * (self._camera[:2] - self.points), pose)

    @staticmethod
    def from_vehicle(points: Picture, pose: Pose) -> tuple[Picture, Picture]:
        c, s = np.float32(np.cos(pose.psi)), np.float32(np.sin(pose.psi))
        x = c * points[..., 0] - s * points[..., 1] + np.float32(pose.x)
        y = s * points[..., 0] + c * points[..., 1] + np.float32(pose.y)
        return x, y

    def texels(self, x: Picture, y: Picture) -> tuple[Picture, Picture]:
        """Where in the texture points of the world lie."""
        c, s = np.cos(self.cloth.heading), np.sin(self.cloth.heading)
        per = 1.0 / self.cloth.texel
        column = np.float32(c * per) * x + np.float32(s * per) * y + np.float32(self.cloth.origin[0])
        row = np.float32(-s * per) * x + np.float32(c * per) * y + np.float32(self.cloth.origin[1])
        size = len(self.cloth.texture)
        return column - size * np.floor(column.min() / size), row - size * np.floor(row.min() / size)

    def look_up(self, column: Picture, row: Picture) -> Picture:
        seen = np.zeros(column.shape, dtype=np.float32)
        for level, band, weight in self._bands:
            part = np.float32(0.5**level)
            at = (column[band] + 0.5) * part - 0.5, (row[band] + 0.5) * part - 0.5
            seen[band] += weight * cv2.remap(
                self._levels[level], *at, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP
            )
        return seen


class SwayingView(GroundView):
    """Grass in wind: waves move the cloth back and forth within the plane."""

    def __init__(self, camera: Camera, cloth: Cloth, rng: np.random.Generator, reach: float) -> None:
        super().__init__(camera, cloth)
        waves = 3
        self._angles = rng.uniform(0.0, 2 * np.pi, (waves, 2))
        self._numbers = 2 * np.pi / rng.uniform(0.15, 0.7, waves)
        self._rates = 2 * np.pi * rng.uniform(0.3, 1.5, waves)
        self._reach = reach / waves

    def in_world(self, pose: Pose, seconds: float) -> tuple[Picture, Picture]:
        x, y = super().in_world(pose, seconds)
        by_x, by_y = np.zeros_like(x), np.zeros_like(y)
        for (angle, blow), number, rate in zip(self._angles, self._numbers, self._rates, strict=True):
            run = np.float32(number * np.cos(angle)) * x + np.float32(number * np.sin(angle)) * y
            sway = np.sin(run + np.float32(rate * seconds)) * np.float32(self._reach)
            by_x += sway * np.float32(np.cos(blow))
            by_y += sway * np.float32(np.sin(blow))
        return x + by_x, y + by_y
