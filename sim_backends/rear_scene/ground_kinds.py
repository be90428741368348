"""Kinds of ground: photographs and calculated sand, as periodic tiles.

The photographs (gravel, grass, brick; 512 x 512, grey) come with scikit-image. All three are under CC0 1.0:
 gravel and brick from CC0Textures (Gravel04, Bricks25), grass from DeviantArt (LinolaFett).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from importlib import resources
from typing import TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from sim_backends.rear_scene.kernels import MEAN_REFLECTANCE
from sim_backends.rear_scene.settings import GroundKind

Texels: TypeAlias = NDArray[np.float32]
SIZE = 1024
SEAM = 64
TINTS: Mapping[str, tuple[float, float, float]] = {
    "gravel": (0.95, 1.0, 1.03),
    "grass": (0.78, 1.06, 0.94),
    "brick": (0.80, 0.95, 1.15),
    "sandy_gravel": (0.85, 1.0, 1.08),
}
"""Tint (blue, green, red) of grounds other than sand."""
SAND_TINT = (0.74, 0.97, 1.12)


@dataclass(frozen=True)
class GroundTile:
    """A periodic square of ground, `SIZE` texels wide.

    Attributes:
        reflectance: Share of the light reflected, 0 to 1.
        relief_m: Height about the mean.
        texel_m: Width of a texel.
    """

    reflectance: Texels
    relief_m: Texels
    texel_m: float


def make_ground(kind: GroundKind, rng: np.random.Generator) -> GroundTile:
    """Return a tile of ground of the given kind; calculated sand differs with every draw."""
    if kind == "gravel":
        return _photograph(kind, texel_m=float(rng.uniform(0.0016, 0.0022)), relief_m=0.004)
    if kind == "grass":
        return _photograph(kind, texel_m=float(rng.uniform(0.0014, 0.0020)), relief_m=0.003)
    if kind == "brick":
        return _photograph(kind, texel_m=float(rng.uniform(0.0012, 0.0016)), relief_m=0.002)
    if kind == "sandy_gravel":
        return _buried(make_ground("gravel", rng), _sand("coarse_sand", rng), rng)
    return _sand(kind, rng)


def periodic_noise(
    size: int, shortest_texel: float, longest_texel: float, rng: np.random.Generator
) -> Texels:
    """Return noise of unit variance, amplitude falling as 1 / frequency between two wavelengths."""
    frequency = np.hypot(np.fft.fftfreq(size)[:, None], np.fft.rfftfreq(size)[None, :])
    inside = (frequency >= 1 / longest_texel) & (frequency <= 1 / shortest_texel)
    amplitude = np.where(inside, 1 / np.maximum(frequency, 1 / size), 0.0)
    noise = np.fft.irfft2(np.fft.rfft2(rng.standard_normal((size, size))) * amplitude, (size, size))
    return np.asarray(noise / noise.std(), np.float32)


def _photograph(kind: GroundKind, texel_m: float, relief_m: float) -> GroundTile:
    data = (resources.files("sim_backends.rear_scene") / "photographs" / f"{kind}.png").read_bytes()
    decoded = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_GRAYSCALE)
    grey = _tileable(np.asarray(np.asarray(decoded) / 255, np.float32))
    reflectance = np.clip(grey * (MEAN_REFLECTANCE / grey.mean()), 0.02, 0.95)
    # Stones and blades are brighter than the gaps between them.
    bumps = _blur(grey, 2.0) - _blur(grey, 24.0)
    return GroundTile(reflectance, np.asarray(bumps * (relief_m / bumps.std() / 2), np.float32), texel_m)


def _tileable(photograph: Texels) -> Texels:
    """Return four copies of a photograph, blended at their edges."""
    size = len(photograph) - SEAM
    fade = (np.arange(SEAM, dtype=np.float32) + 0.5) / SEAM
    rows = photograph[:size].copy()
    rows[:SEAM] = fade[:, None] * rows[:SEAM] + (1 - fade[:, None]) * photograph[size:]
    both = rows[:, :size].copy()
    both[:, :SEAM] = fade * both[:, :SEAM] + (1 - fade) * rows[:, size:]
    whole = cv2.resize(both, (SIZE // 2, SIZE // 2), interpolation=cv2.INTER_CUBIC)
    return np.asarray(np.tile(whole, (2, 2)), np.float32)


def _buried(stones: GroundTile, sand: GroundTile, rng: np.random.Generator) -> GroundTile:
    """Return the sand's tile with stones visible where it is thin."""
    thick = 1 / (1 + np.exp(4 * (periodic_noise(SIZE, 30, 400, rng) - 0.2)))
    return GroundTile(
        np.asarray(thick * sand.reflectance + (1 - thick) * stones.reflectance, np.float32),
        np.asarray(thick * sand.relief_m + (1 - thick) * stones.relief_m, np.float32),
        stones.texel_m,
    )


def _blur(image: Texels, sigma: float) -> Texels:
    margin = round(4 * sigma)
    padded = np.pad(image, margin, mode="wrap")
    return np.asarray(cv2.GaussianBlur(padded, (0, 0), sigma)[margin:-margin, margin:-margin], np.float32)


def _sand(kind: GroundKind, rng: np.random.Generator) -> GroundTile:
    texel_m = 0.002
    grains = periodic_noise(SIZE, 2, 8, rng)
    clods = periodic_noise(SIZE, 8, 80, rng)
    patches = periodic_noise(SIZE, 60, SIZE, rng)
    reflectance = 1 + 0.07 * grains + 0.03 * patches
    relief = 0.0003 * grains + 0.0007 * clods
    if kind == "coarse_sand":
        pebbles = np.maximum(periodic_noise(SIZE, 5, 12, rng) - 1.6, 0)
        reflectance = reflectance + 0.10 * grains - 0.35 * pebbles
        relief = relief + 0.0010 * clods + 0.004 * pebbles
    if kind == "rippled_sand":
        relief = relief + 0.0030 * _ripples(rng)
    if kind == "patchy_sand":
        reflectance = reflectance * (1 - 0.22 / (1 + np.exp(-6 * (patches + 0.5 * clods))))
    tone = MEAN_REFLECTANCE * reflectance / reflectance.mean()
    return GroundTile(
        np.asarray(np.clip(tone, 0.05, 0.95), np.float32), np.asarray(relief, np.float32), texel_m
    )


def _ripples(rng: np.random.Generator) -> Texels:
    """Return wind ripples: a band of wavelengths about 8 cm within 20 degrees of one direction."""
    noise = np.fft.rfft2(rng.standard_normal((SIZE, SIZE)))
    f_row, f_column = np.fft.fftfreq(SIZE)[:, None], np.fft.rfftfreq(SIZE)[None, :]
    frequency = np.hypot(f_row, f_column)
    angle = np.arctan2(f_row, f_column)
    towards = rng.uniform(-np.pi / 2, np.pi / 2)
    turned = np.angle(np.exp(2j * (angle - towards))) / 2
    wavelength_texel = 40.0
    band = np.exp(-0.5 * ((frequency * wavelength_texel - 1) / 0.15) ** 2 - 0.5 * (turned / 0.15) ** 2)
    ripples = np.fft.irfft2(noise * band, (SIZE, SIZE))
    return np.asarray(ripples / ripples.std(), np.float32)
