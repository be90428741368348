"""Parts of the rover that are seen in front of the ground, and what a glossy ground reflects."""

from dataclasses import dataclass

import cv2
import numpy as np

from tests.nature.ambiguous_ground.camera import HEIGHT, WIDTH, Camera
from tests.nature.ambiguous_ground.ground import GroundView, sub_pixels, to_pixels
from tests.nature.ambiguous_ground.motion import Motion
from tests.nature.ambiguous_ground.picture import Numbers, Picture, soften
from tests.nature.ambiguous_ground.textures import octave, standard

BODY = 512
"""Texels along one side of a body's texture."""


def body_texture(rng: np.random.Generator, lugs: int) -> Picture:
    """A worn surface with lugs: bars along the columns that follow each other along the rows."""
    phase = (np.arange(BODY) + 0.5) * lugs / BODY % 1.0
    bars = np.where(phase < 0.4, 1.0, -0.6)[:, None].astype(np.float32)
    worn = soften(octave(rng, 1, BODY), 1.2) * 2.0 + 0.5 * octave(rng, 8, BODY)
    return standard(np.asarray(soften(np.repeat(bars, BODY, axis=1), 1.0) + rng.uniform(0.4, 1.0) * worn))


def edge_mask(inner: float, outer: float, lean: float, softness: float) -> Picture:
    """1 between two columns, whose borders lean by some pixels over the height of the picture."""
    v, u = np.mgrid[0:HEIGHT, 0:WIDTH]
    shifted = u - lean * (v / HEIGHT - 0.5)
    inside = np.clip((shifted - inner) / softness + 0.5, 0.0, 1.0)
    return np.asarray(inside * np.clip((outer - shifted) / softness + 0.5, 0.0, 1.0), dtype=np.float32)


@dataclass(frozen=True)
class MovingPart:
    """A part in front of the ground whose surface runs along the columns of the picture.

    Attributes:
        mask: where it is.
        texture: its surface, in grey levels.
        places: how far the surface has moved down the picture at every frame, px.
    """

    mask: Picture
    texture: Picture
    places: Numbers

    def __call__(self, picture: Picture, frame: int) -> Picture:
        v, u = np.mgrid[0:HEIGHT, 0:WIDTH].astype(np.float32)
        rows = v - np.float32(self.places[frame] % BODY)
        seen = cv2.remap(self.texture, u, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)
        return picture + self.mask * (soften(np.asarray(seen), 0.6) - picture)


@dataclass(frozen=True)
class Reflection:
    """Part of the picture shows what is above the ground, mirrored by it: a plane below the ground.

    Attributes:
        mask: how much of the mirrored structure each pixel shows.
        view: the mirrored structure.
        motion: the drive.
        moves: whether it stands in the world; otherwise it belongs to the rover.
        mean: grey of the structure.
        contrast: its contrast, grey.
    """

    mask: Picture
    view: GroundView
    motion: Motion
    moves: bool
    mean: float
    contrast: float

    def __call__(self, picture: Picture, frame: int) -> Picture:
        seen = self.view.see(self.motion.pose(frame if self.moves else 0))
        mirrored = seen * np.float32(self.contrast) + np.float32(self.mean)
        return picture + self.mask * (mirrored - picture)


class Wheel:
    """A turning wheel, seen from above: every ray is followed to its tread and its inner side."""

    def __init__(self, camera: Camera, radius: float, x: float, inner: float, side: float) -> None:
        """Place a wheel with its axle along Y at this x; it reaches from `inner` out of the picture."""
        self._radius = radius
        u, v = sub_pixels()
        ray = camera.rays(u, v)
        ox, oy, oz = camera.position[0] - x, camera.position[1], camera.position[2] - radius
        a = ray[..., 0] ** 2 + ray[..., 2] ** 2
        b = ox * ray[..., 0] + oz * ray[..., 2]
        under_root = b**2 - a * (ox**2 + oz**2 - radius**2)
        tread = (-b - np.sqrt(np.maximum(under_root, 0.0))) / a
        y = oy + tread * ray[..., 1]
        on_tread = (under_root > 0.0) & ((y - inner) * side > 0.0)
        flank = (inner - oy) / np.where(np.abs(ray[..., 1]) < 1e-9, 1e-9, ray[..., 1])
        at = np.hypot(ox + flank * ray[..., 0], oz + flank * ray[..., 2])
        on_flank = (flank > 0.0) & (at < radius) & ~(on_tread & (tread < flank))
        far = np.where(on_flank, flank, tread)
        self._angle = np.arctan2(ox + far * ray[..., 0], oz + far * ray[..., 2])
        self._across, self._on_flank = y, on_flank
        self._on = on_tread | on_flank

    def share_of_width(self) -> float:
        """Share of the picture's columns in which the wheel is seen."""
        return float(self._on.any(axis=0).mean())

    def paint(self, picture: Picture, turned: float, texture: Picture) -> Picture:
        """The picture with the wheel, whose top has moved forward by the angle `turned`."""
        around = ((self._angle - turned) / (2 * np.pi) % 1.0 * BODY).astype(np.float32)
        across = (self._across * (BODY / (2 * np.pi * self._radius))).astype(np.float32)
        tread = cv2.remap(texture, across, around, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)
        spokes = np.where(np.cos(5.0 * (self._angle - turned)) > 0.3, 80.0, 35.0)
        lit = np.asarray(tread) * (0.6 + 0.4 * np.maximum(np.cos(self._angle), 0.0))
        grey = np.where(self._on_flank, spokes, lit)
        cover = to_pixels(self._on.astype(np.float32))
        painted = to_pixels(np.where(self._on, grey, 0.0).astype(np.float32))
        return picture * (1.0 - cover) + soften(painted, 0.5)


@dataclass(frozen=True)
class TurningWheel:
    """The layer that paints a wheel.

    Attributes:
        wheel: the wheel.
        texture: its tread, in grey levels.
        angles: how far it has turned at every frame, rad.
    """

    wheel: Wheel
    texture: Picture
    angles: Numbers

    def __call__(self, picture: Picture, frame: int) -> Picture:
        return self.wheel.paint(picture, float(self.angles[frame]), self.texture)
