"""Isotropic noise of many wavelengths, and stamps of stones, on a grid."""

from typing import cast

import cv2
import numpy as np
import numpy.typing as npt

Image = npt.NDArray[np.float32]
"""Grid of values: (rows, columns) or (rows, columns, channels)."""
Points = npt.NDArray[np.float64]
"""Positions or angles, one a row or one an element."""
Bytes = npt.NDArray[np.uint8]


def image(values: object) -> Image:
    """Return values as a float32 grid, without a copy where they are one already."""
    return cast(Image, np.asarray(values, np.float32))


def blur(values: Image, sigma: float) -> Image:
    """Return values after a Gaussian blur of `sigma` cells; below 0.3 cells unchanged."""
    if sigma < 0.3:
        return values
    if sigma > 6.0:  # the same at a fraction of the time on a coarser grid
        scale = 2 ** int(np.log2(sigma / 3.0))
        small = (max(values.shape[1] // scale, 2), max(values.shape[0] // scale, 2))
        coarse = cv2.GaussianBlur(
            cv2.resize(values, small, interpolation=cv2.INTER_AREA), (0, 0), sigma / scale
        )
        return image(cv2.resize(coarse, (values.shape[1], values.shape[0]), interpolation=cv2.INTER_LINEAR))
    return image(cv2.GaussianBlur(values, (0, 0), sigma))


def octave(rng: np.random.Generator, shape: tuple[int, int], wavelength: float, along: float = 1.0) -> Image:
    """Return isotropic noise of mean 0 and rms 1.

    Args:
        rng: source of the numbers.
        shape: rows and columns.
        wavelength: typical distance from crest to crest, cells; 2 or less is white noise.
        along: how many times longer it is along the rows.
    """
    rows, columns = shape
    if wavelength <= 2.0:
        return rng.standard_normal(shape, dtype=np.float32)
    step = max(wavelength / 4.0, 1.0)
    small = (int(np.ceil(rows / step)) + 12, int(np.ceil(columns / (step * along))) + 12)
    white = rng.standard_normal(small, dtype=np.float32)
    smooth = image(cv2.GaussianBlur(white, (0, 0), 0.25 * wavelength / step, borderType=cv2.BORDER_REFLECT))
    smooth *= np.float32(2.0 * np.sqrt(np.pi) * 0.25 * wavelength / step)  # to rms 1
    whole = cv2.resize(smooth, None, fx=step * along, fy=step, interpolation=cv2.INTER_CUBIC)
    top, left = int(4 * step), int(4 * step * along)
    return image(whole[top : top + rows, left : left + columns])


def octaves(
    rng: np.random.Generator, shape: tuple[int, int], cell_m: float, bands: list[tuple[float, float]]
) -> Image:
    """Return a sum of octaves; `bands` gives wavelength in m and rms of each."""
    total = np.zeros(shape, np.float32)
    for wavelength_m, rms in bands:
        total += np.float32(rms) * octave(rng, shape, wavelength_m / cell_m)
    return total


def stone_shapes(rng: np.random.Generator, radius: int, count: int) -> list[Image]:
    """Return domes of irregular outline, height 0 to 1, each `2 radius + 1` cells wide."""
    span = np.arange(-radius, radius + 1) / max(radius, 1)
    x, y = np.meshgrid(span, span)
    angle, distance = np.arctan2(y, x), np.hypot(x, y)
    shapes = []
    for _ in range(count):
        outline = np.full_like(angle, 0.82)
        for order in (2, 3, 4, 5):
            size = rng.normal(0.0, 0.16 / order)
            outline += size * np.cos(order * angle + rng.uniform(0, 2 * np.pi))
        inside = np.clip(1.0 - (distance / np.clip(outline, 0.3, 1.0)) ** 2, 0.0, 1.0)
        shapes.append(image(inside ** rng.uniform(0.3, 0.7)))
    return shapes
