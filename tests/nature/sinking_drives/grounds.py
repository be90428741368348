"""Procedural grounds: square tiles of relief and reflectance that repeat without a seam."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import fft
from scipy.spatial import cKDTree

F32 = NDArray[Any]  # of float32

CELL = 0.0007  # metres per cell, about the footprint of the nearest pixel
TILE = 4096  # cells per side, so that a tile is 2.87 m wide


@dataclass
class Ground:
    """One tile: height in metres (mean zero), reflectance (mean near one) and colour."""

    name: str
    height: F32
    albedo: F32
    colour: tuple[float, float, float]  # blue, green, red factors
    reflectance: float  # mean reflectance, which sets how dark the ground is


def field(rng: np.random.Generator, hurst: float, shortest: float, longest: float, rms: float) -> F32:
    """Return a self-affine field whose 2-D power falls as k^-(2H+2) between two wavelengths."""
    noise = rng.standard_normal((TILE, TILE), dtype=np.float32)
    spectrum = fft.rfft2(noise)
    ky = fft.fftfreq(TILE, CELL).astype(np.float32)[:, None]
    kx = fft.rfftfreq(TILE, CELL).astype(np.float32)[None, :]
    k = np.sqrt(kx * kx + ky * ky)
    k[0, 0] = 1.0
    low, high = np.float32(1.0 / longest), np.float32(1.0 / shortest)
    gain = np.maximum(k, low) ** np.float32(-(hurst + 1.0)) * np.exp(-((k / high) ** 4))
    gain[0, 0] = 0.0
    out = fft.irfft2(spectrum * gain, s=(TILE, TILE)).astype(np.float32)
    return np.asarray(out * np.float32(rms / out.std()))


def grains(rng: np.random.Generator, fine: float, coarse: float) -> F32:
    """Return reflectance noise: grains of a few cells, and patches with a 1/f^2 power."""
    noise: F32 = cv2.GaussianBlur(rng.standard_normal((TILE, TILE), dtype=np.float32), (0, 0), 0.9)
    noise *= np.float32(fine / noise.std())
    return noise + field(rng, 0.0, 0.004, 0.5, coarse)


def scatter(
    rng: np.random.Generator,
    height: F32,
    albedo: F32,
    diameters: NDArray[np.float64],
    contrast: float,
    burial: tuple[float, float] = (0.1, 0.6),
) -> None:
    """Lay stones of the given diameters on a tile, changing it in place."""
    base = cv2.GaussianBlur(height, (0, 0), 3.0)
    for d in sorted(diameters, reverse=True):
        radius = 0.5 * d / CELL
        n = int(np.ceil(radius * 1.4)) + 1
        row, col = rng.integers(0, TILE, 2)
        rows = np.arange(row - n, row + n + 1) % TILE
        cols = np.arange(col - n, col + n + 1) % TILE
        v, u = np.mgrid[-n : n + 1, -n : n + 1].astype(np.float32) / np.float32(radius)
        turn = rng.uniform(0, np.pi)
        a = u * np.cos(turn) + v * np.sin(turn)
        b = (v * np.cos(turn) - u * np.sin(turn)) / rng.uniform(0.65, 0.95)
        angle = np.arctan2(b, a)
        edge = (
            1.0 + 0.1 * np.cos(2 * angle + rng.uniform(0, 6)) + 0.08 * np.cos(3 * angle + rng.uniform(0, 6))
        )
        r2 = (a * a + b * b) / (edge * edge)
        dome = np.sqrt(np.clip(1.0 - r2, 0.0, None)) ** rng.uniform(0.6, 1.0)
        tall = 0.5 * d * rng.uniform(0.5, 0.9)
        top = base[row, col] + tall * (dome - rng.uniform(*burial))
        window = np.ix_(rows, cols)
        old = height[window]
        win = (top > old) & (r2 < 1.0)
        height[window] = np.where(win, top, old)
        tone = np.exp(contrast * rng.standard_normal())
        albedo[window] = np.where(win, tone * (0.6 + 0.4 * albedo[window]), albedo[window])


def rock_diameters(
    rng: np.random.Generator, cover: float, smallest: float, largest: float
) -> NDArray[np.float64]:
    """Draw rock diameters from F(D) = k exp(-q(k) D), q = 1.79 + 0.152/k (Golombek and Rapp)."""
    q = 1.79 + 0.152 / cover
    grid = np.geomspace(smallest, largest, 200)
    area_density = cover * q * np.exp(-q * grid)
    number_density = area_density / (0.25 * np.pi * grid**2)
    weights = number_density * np.gradient(grid)
    count = rng.poisson(weights.sum() * (TILE * CELL) ** 2)
    return np.asarray(rng.choice(grid, size=min(count, 12000), p=weights / weights.sum()))


def smooth_sand(rng: np.random.Generator) -> Ground:
    """Even, low-contrast sand."""
    height = field(rng, 0.8, 0.01, 0.5, 0.0015) + field(rng, 0.3, 0.002, 0.02, 0.00012)
    return Ground("smooth_sand", height, 1 + grains(rng, 0.05, 0.015), (0.62, 0.85, 1.0), 0.35)


def rippled_sand(rng: np.random.Generator) -> Ground:
    """Wind ripples, with coarser and darker grains on the crests."""
    side = TILE * CELL
    waves_x, waves_y = round(side / 0.085), 9  # wavelength 8 cm, crests a little oblique
    v, u = np.mgrid[0:TILE, 0:TILE].astype(np.float32) / np.float32(TILE)
    phase = 2 * np.pi * (waves_x * u + waves_y * v) + field(rng, 1.0, 0.1, 0.7, 1.3)
    profile = np.sin(phase + 0.45 * np.sin(phase))
    envelope = np.clip(1.0 + field(rng, 0.8, 0.1, 0.6, 0.3), 0.3, 1.6)
    height = np.float32(0.0025) * envelope * profile + field(rng, 0.4, 0.002, 0.05, 0.00025)
    albedo = 1 + grains(rng, 0.06, 0.02) - 0.06 * np.clip(profile, 0, 1)
    return Ground("rippled_sand", height.astype(np.float32), albedo.astype(np.float32), (0.6, 0.82, 1.0), 0.3)


def pea_gravel(rng: np.random.Generator) -> Ground:
    """A bed of rounded gravel, 4 to 16 mm, log-normal in size."""
    height, albedo = field(rng, 0.7, 0.01, 0.5, 0.002), 1 + grains(rng, 0.1, 0.05)
    sizes = np.clip(0.009 * np.exp(0.35 * rng.standard_normal(60000)), 0.004, 0.02)
    scatter(rng, height, albedo, sizes, 0.28, (0.1, 0.45))
    return Ground("pea_gravel", height, albedo, (0.85, 0.93, 1.0), 0.25)


def stony_sand(rng: np.random.Generator) -> Ground:
    """Sand with scattered stones that follow the Martian rock law."""
    height = field(rng, 0.7, 0.01, 0.6, 0.003) + field(rng, 0.3, 0.002, 0.02, 0.0002)
    albedo = 1 + grains(rng, 0.06, 0.03)
    scatter(rng, height, albedo, rock_diameters(rng, 0.06, 0.005, 0.07), 0.25)
    return Ground("stony_sand", height, albedo, (0.55, 0.75, 1.0), 0.28)


def crumbly_soil(rng: np.random.Generator) -> Ground:
    """Tilled and rained-on soil: anti-persistent roughness and clods."""
    height = field(rng, 0.4, 0.003, 0.25, 0.003)
    albedo = 1 + grains(rng, 0.07, 0.05)
    sizes = 0.006 * (1 - rng.random(9000)) ** (-1 / 2.6)  # power-law fragmentation
    scatter(rng, height, albedo, np.clip(sizes, 0.006, 0.04), 0.08, (0.3, 0.8))
    return Ground("crumbly_soil", height, albedo, (0.55, 0.72, 1.0), 0.15)


def cracked_clay(rng: np.random.Generator) -> Ground:
    """Dried mud: polygons of about 7 cm parted by narrow cracks."""
    side, step = TILE * CELL, 4
    seeds = rng.random((int(side * side / 0.07**2), 2)) * side
    tree = cKDTree(seeds, boxsize=side)
    axis = (np.arange(0, TILE, step) + 0.5 * step) * CELL
    cells = np.stack(np.meshgrid(axis, axis), -1).reshape(-1, 2)
    wobble = [cv2.resize(field(rng, 0.5, 0.006, 0.05, 0.0025), (TILE // step,) * 2).ravel() for _ in range(2)]
    near, _ = tree.query((cells + np.stack(wobble, 1)) % side, k=2)
    gap = (near[:, 1] - near[:, 0]).reshape(TILE // step, -1).astype(np.float32)
    gap = cv2.resize(gap, (TILE, TILE), interpolation=cv2.INTER_CUBIC)
    crack = np.exp(-((gap / np.float32(0.0035)) ** 2))
    height = field(rng, 0.8, 0.005, 0.5, 0.0015) - np.float32(0.008) * crack
    height += field(rng, 0.4, 0.002, 0.02, 0.00015)
    albedo = (1 + grains(rng, 0.035, 0.03)) * (1 - np.float32(0.5) * crack)
    return Ground("cracked_clay", height, albedo, (0.75, 0.88, 1.0), 0.3)


def straw_litter(rng: np.random.Generator) -> Ground:
    """Packed earth under straw and small pebbles."""
    height = field(rng, 0.6, 0.005, 0.5, 0.002) + field(rng, 0.3, 0.002, 0.02, 0.0002)
    albedo = 1 + grains(rng, 0.07, 0.04)
    scatter(rng, height, albedo, rock_diameters(rng, 0.02, 0.004, 0.03), 0.2)
    for _ in range(1500):
        mid = rng.uniform(80, TILE - 80, 2)
        reach = rng.uniform(0.005, 0.02) / CELL
        turn = rng.uniform(0, np.pi)
        half = reach * np.array([np.cos(turn), np.sin(turn)])
        a, b = ((mid + s * half).astype(int) for s in (-1, 1))
        thick = int(rng.integers(1, 4))
        corner = np.clip(np.minimum(a, b) - 4, 0, None)
        far = np.maximum(a, b) + 5
        part = np.s_[corner[1] : far[1], corner[0] : far[0]]
        mask = np.zeros(height[part].shape, np.uint8)
        cv2.line(mask, tuple(map(int, a - corner)), tuple(map(int, b - corner)), 255, thick)
        soft = cv2.GaussianBlur(mask, (0, 0), 0.7).astype(np.float32) / 255
        height[part] += soft * np.float32(0.0012)
        albedo[part] += soft * (np.float32(rng.uniform(1.1, 2.2)) - albedo[part])
    return Ground("straw_litter", height, albedo, (0.6, 0.8, 1.0), 0.18)


def grey_dust(rng: np.random.Generator) -> Ground:
    """Fine dark dust with small pits and a few pebbles."""
    height = field(rng, 0.75, 0.003, 0.4, 0.0025)
    albedo = 1 + grains(rng, 0.04, 0.02)
    pits = np.zeros_like(height)
    pit_albedo = np.ones_like(height)
    sizes = np.clip(0.01 * (1 - rng.random(1500)) ** (-1 / 2.0), 0.01, 0.08)
    scatter(rng, pits, pit_albedo, sizes, 0.0, (0.0, 0.01))
    height -= np.float32(0.35) * cv2.GaussianBlur(pits, (0, 0), 2.0)
    scatter(rng, height, albedo, rock_diameters(rng, 0.015, 0.004, 0.03), 0.2)
    return Ground("grey_dust", height, albedo, (0.95, 0.97, 1.0), 0.12)


MAKERS: dict[str, Callable[[np.random.Generator], Ground]] = {
    m.__name__: m
    for m in (
        smooth_sand,
        rippled_sand,
        pea_gravel,
        stony_sand,
        crumbly_soil,
        cracked_clay,
        straw_litter,
        grey_dust,
    )
}


def make_ground(name: str, seed: int) -> Ground:
    """Make one ground by name; the same seed gives the same ground."""
    rng = np.random.default_rng([seed, 1000 + list(MAKERS).index(name)])
    ground = MAKERS[name](rng)
    ground.height -= ground.height.mean()
    np.clip(ground.albedo, 0.08, 3.0, out=ground.albedo)
    ground.albedo /= ground.albedo.mean()
    return ground
