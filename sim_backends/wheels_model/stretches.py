"""Motion over stretches of a drive, integrated from its rates: a small error of a scale adds up there."""

import numpy as np

from sim_backends.models.interface import Array

STRETCH_S = 4.0


def windows_of_stretch(t_s: Array) -> int:
    """Return how many windows with these middles make a stretch: all but one of a short drive."""
    return min(max(round(STRETCH_S / float(t_s[1] - t_s[0])), 1), t_s.size - 1)


def over_stretches(t_s: Array, rates: Array) -> Array:
    """Return the motion over the stretch that ends with each window, as its beginning sees it.

    Args:
        t_s: Middles of windows of equal length, s.
        rates: Forward m/s, left m/s and turn rad/s in each, shape (windows, 3).

    Returns:
        Forward m, left m and turn rad, of the same shape; NaN in the first windows.
    """
    width_s, count = float(t_s[1] - t_s[0]), windows_of_stretch(t_s)
    turned = np.concatenate(([0.0], np.cumsum(rates[:, 2] * width_s)))
    middle = 0.5 * (turned[1:] + turned[:-1])
    along = (rates[:, 0] + 1j * rates[:, 1]) * np.exp(1j * middle) * width_s
    place = np.concatenate(([0.0], np.cumsum(along)))
    found = np.full(rates.shape, np.nan)
    way = (place[count:] - place[:-count]) * np.exp(-1j * turned[:-count])
    found[count - 1 :] = np.stack((way.real, way.imag, turned[count:] - turned[:-count]), axis=1)
    return found
