"""A patch of sandy ground, made by calculation."""

import numpy as np

from drivers.samples import Image

MEAN_GREY = 140.0
GREY_DEVIATION = 22.0
SPECTRUM_EXPONENT = 0.7
"""Amplitude falls with spatial frequency to this power: grains, ripples and patches without a scale."""


def sand_texture(size: int, rng: np.random.Generator) -> Image:
    """Return a square grey image of `size` x `size` pixels that continues over its edges (periodic)."""
    spectrum = np.fft.rfft2(rng.standard_normal((size, size)))
    frequency = np.hypot(np.fft.fftfreq(size)[:, None], np.fft.rfftfreq(size)[None, :])
    frequency[0, 0] = np.inf
    ground = np.fft.irfft2(spectrum / frequency**SPECTRUM_EXPONENT, (size, size))
    grey = MEAN_GREY + GREY_DEVIATION * ground / ground.std()
    return np.asarray(np.clip(grey, 0, 255), np.uint8)
