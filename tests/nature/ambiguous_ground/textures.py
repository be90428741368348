"""Procedural textures that continue at their own edges, of mean 0 and standard deviation 1."""

from collections.abc import Callable

import cv2
import numpy as np

from tests.nature.ambiguous_ground.picture import Picture, soften

SIZE = 2048
"""Texels along one side of a texture."""


def standard(texture: Picture) -> Picture:
    centred = texture - texture.mean(dtype=np.float64)
    return np.asarray(np.clip(centred / max(float(centred.std()), 1e-6), -3.5, 3.5), dtype=np.float32)


def octave(rng: np.random.Generator, texels: int, size: int = SIZE) -> Picture:
    """Smooth random values, independent over about `texels` (a power of two)."""
    cells = max(size // texels, 1)
    grid = rng.standard_normal((cells, cells), dtype=np.float32)
    if texels == 1:
        return grid
    padded = np.pad(grid, 2, mode="wrap")
    whole = cv2.resize(padded, None, fx=texels, fy=texels, interpolation=cv2.INTER_CUBIC)
    margin = 2 * texels
    return np.asarray(whole[margin:-margin, margin:-margin], dtype=np.float32)


def grains(rng: np.random.Generator, steepness: float, finest: int = 1, coarsest: int = 128) -> Picture:
    """Noise of every scale, whose amplitude grows with the scale to the power `steepness`."""
    total = np.zeros((SIZE, SIZE), dtype=np.float32)
    texels = finest
    while texels <= coarsest:
        total += octave(rng, texels) * np.float32(texels**steepness)
        texels *= 2
    return total


def sand(rng: np.random.Generator) -> Picture:
    return standard(grains(rng, rng.uniform(-0.3, 0.15), 2))


def asphalt(rng: np.random.Generator) -> Picture:
    """Chips of a few texels, most of them dark and some bright."""
    chips = standard(soften(octave(rng, 1), rng.uniform(0.9, 1.8)))
    bright = np.maximum(standard(soften(octave(rng, 2), 1.0)) - 1.2, 0.0)
    return standard(chips + 2.5 * bright + 0.2 * standard(grains(rng, 0.2, 32)))


def _wrapped(at: tuple[int, int], reach: int) -> list[tuple[int, int]]:
    """The place, and its copies beyond the opposite edges where something of this reach is seen."""
    shifts = [[0] + ([SIZE] if c < reach else []) + ([-SIZE] if c >= SIZE - reach else []) for c in at]
    return [(at[0] + dx, at[1] + dy) for dx in shifts[0] for dy in shifts[1]]


def _stones(rng: np.random.Generator, under: Picture, count: int, least: float, most: float) -> Picture:
    """Stones with a lit side and a shaded side upon a texture."""
    centres = rng.integers(0, SIZE, (count, 2))
    radii = least * (most / least) ** rng.random(count)
    shapes, turns, greys = rng.uniform(0.55, 1.0, count), rng.uniform(0, 180, count), rng.normal(0, 1, count)
    for centre, radius, shape, turn, grey in zip(centres, radii, shapes, turns, greys, strict=True):
        axes = (max(round(radius), 1), max(round(radius * shape), 1))
        top = (max(round(radius * 0.7), 1), max(round(radius * shape * 0.7), 1))
        shift = max(round(0.25 * radius), 1)
        for x, y in _wrapped((int(centre[0]), int(centre[1])), int(radius) + 2 + shift):
            cv2.ellipse(under, (x + shift, y + shift), axes, float(turn), 0, 360, (-2.2,), -1)
            cv2.ellipse(under, (x, y), axes, float(turn), 0, 360, (float(grey) - 0.4,), -1)
            cv2.ellipse(under, (x, y), top, float(turn), 0, 360, (float(grey) + 0.3,), -1)
    return under


def gravel(rng: np.random.Generator) -> Picture:
    largest = rng.uniform(10.0, 20.0)
    under = _stones(rng, standard(grains(rng, 0.0, 1, 32)) - 1.0, 12000, 3.0, largest)
    return standard(under + 0.25 * octave(rng, 2))


def soil(rng: np.random.Generator) -> Picture:
    stones = int(rng.integers(300, 1500))
    return standard(_stones(rng, standard(grains(rng, 0.1)), stones, 4.0, 24.0) + 0.2 * octave(rng, 2))


def grass(rng: np.random.Generator) -> Picture:
    """Blades of grass in every direction, the later ones over the earlier ones."""
    lawn = standard(grains(rng, 0.1, 4)) * 0.5 - 1.0
    count = 30000
    start = rng.integers(0, SIZE, (count, 2))
    turn, length = rng.uniform(0, 2 * np.pi, count), rng.uniform(15.0, 50.0, count)
    tip = start + np.round(np.stack([np.cos(turn), np.sin(turn)], axis=1) * length[:, None]).astype(np.int64)
    greys, widths = rng.normal(0.2, 0.9, count), rng.integers(1, 4, count)
    for a, b, grey, width in zip(start, tip, greys, widths, strict=True):
        for x, y in _wrapped((int(a[0]), int(a[1])), 54):
            to = (x + int(b[0] - a[0]), y + int(b[1] - a[1]))
            cv2.line(lawn, (x, y), to, (float(grey),), int(width))
    return standard(soften(lawn, 0.7))


KINDS: dict[str, Callable[[np.random.Generator], Picture]] = {
    "sand": sand,
    "gravel": gravel,
    "soil": soil,
    "asphalt": asphalt,
    "grass": grass,
}


def ribs(profile: str, periods: int, lanes: int) -> Picture:
    """A pattern that repeats `periods` times along the first texture axis (columns)."""
    phase = (np.arange(SIZE) + 0.5) * periods / SIZE % 1.0
    if profile == "tiles":
        joint = np.minimum(phase, 1.0 - phase) < 0.06
        lane = (np.arange(SIZE) + 0.5) * lanes / SIZE % 1.0
        side = np.minimum(lane, 1.0 - lane) < 0.06
        return standard(soften(-1.0 * (joint[None, :] | side[:, None]).astype(np.float32), 0.6))
    if profile == "furrows":
        line = np.where(phase < 0.7, phase / 0.7, (1.0 - phase) / 0.3)
    else:
        line = np.sin(2 * np.pi * phase)
    return standard(np.repeat(line[None, :], SIZE, axis=0).astype(np.float32))


def furrows_along(rng: np.random.Generator) -> Picture:
    """A pattern that changes only across the first texture axis."""
    line = sum(np.repeat(rng.normal(0, s**0.3, SIZE // s), s) for s in (4, 8, 16, 32, 64))
    column = np.asarray(line, dtype=np.float32)[:, None]
    return standard(soften(np.repeat(column, SIZE, axis=1), 1.5))
