"""What disturbs the camera's view: specks on the lens, shadows of leaves and clouds, vibration."""

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.samples import Image
from sim_backends.arrays import Array
from sim_backends.rear_scene.ground_kinds import periodic_noise
from sim_backends.rear_scene.settings import CanopySettings, DirtSettings

CANOPY_SIZE = 1024
CANOPY_TEXEL_M = 0.004
LARGEST_SHADOW = 8.0
"""Width of the largest shadows of a canopy over that of the smallest."""
SUBPIXEL_BITS = 4
LEAST_OPACITY = 1 / 3
"""Of a speck, as a share of the greatest."""


@dataclass(frozen=True, kw_only=True)
class Vibration:
    """A vibration of the body against the wheel-contact plane, seen from one instant.

    Attributes:
        amplitude_rad: About x and about y.
        frequency_hz: Of both.
        phase_rad: Of each, at the instant.
    """

    amplitude_rad: tuple[float, float] = (0.0, 0.0)
    frequency_hz: float = 0.0
    phase_rad: tuple[float, float] = (0.0, 0.0)

    def rock_rad(self, later_s: Array) -> Array:
        """Return the rotation about x and about y at times after the instant, shape (n, 2)."""
        turned = 2 * math.pi * self.frequency_hz * later_s[:, None] + np.array(self.phase_rad)
        return np.asarray(np.array(self.amplitude_rad) * np.sin(turned))


STILL = Vibration()


@dataclass(frozen=True, kw_only=True)
class Canopy:
    """Shadows on the ground, not cast by the rover.

    Attributes:
        tile: Share of the sun that they take: periodic, square, its width a power of 2.
        texel_m: Width of a texel.
    """

    tile: NDArray[np.float32]
    texel_m: float


CLEAR_SKY = Canopy(tile=np.zeros((1, 1), np.float32), texel_m=1.0)


def make_canopy(settings: CanopySettings, rng: np.random.Generator) -> Canopy:
    """Return shadows of random shape."""
    if settings.cover == 0:
        return CLEAR_SKY
    # Half a wavelength of the noise is the width of a shadow.
    shortest = 2 * settings.size_m / CANOPY_TEXEL_M
    noise = periodic_noise(CANOPY_SIZE, shortest, min(LARGEST_SHADOW * shortest, CANOPY_SIZE), rng)
    shadow = np.asarray(noise > np.quantile(noise, 1 - settings.cover), np.float32)
    edge = settings.edge_m / CANOPY_TEXEL_M
    margin = math.ceil(4 * edge)
    soft = cv2.GaussianBlur(np.pad(shadow, margin, mode="wrap"), (0, 0), edge)[margin:-margin, margin:-margin]
    return Canopy(tile=np.asarray(settings.strength * soft, np.float32), texel_m=CANOPY_TEXEL_M)


def make_dirt(settings: DirtSettings, width: int, height: int, rng: np.random.Generator) -> Image | None:
    """Return the share of light that the lens lets pass, BGR, 255 for all of it; None for a clean lens."""
    if settings.specks == 0:
        return None
    taken = np.zeros((height, width), np.float32)
    for _ in range(settings.specks):
        middle = rng.uniform((0, 0), (width, height)) * 2**SUBPIXEL_BITS
        along = settings.radius_px * rng.lognormal(0, 0.5)
        axes = np.array([along, along * rng.uniform(0.4, 1)]) * 2**SUBPIXEL_BITS
        opacity = settings.opacity * rng.uniform(LEAST_OPACITY, 1)
        outline = cv2.ellipse2Poly(
            (round(middle[0]), round(middle[1])),
            (round(axes[0]), round(axes[1])),
            int(rng.integers(180)),
            0,
            360,
            15,
        )
        speck = np.zeros_like(taken)
        cv2.fillConvexPoly(speck, np.array(outline), opacity, cv2.LINE_8, SUBPIXEL_BITS)
        taken = 1 - (1 - taken) * (1 - speck)
    passed = np.round(255 * (1 - cv2.GaussianBlur(taken, (0, 0), settings.edge_px))).astype(np.uint8)
    return np.ascontiguousarray(np.repeat(passed[..., None], 3, axis=2))
