"""The array types of measured data, and plane geometry on arrays."""

import math
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Array: TypeAlias = NDArray[np.float64]
Flags: TypeAlias = NDArray[np.bool_]
Times: TypeAlias = NDArray[np.int64]


def rms(values: Array) -> float:
    """Return the root mean square."""
    return float(np.sqrt(np.mean(values**2)))


def wrap_angles(angle_rad: Array) -> Array:
    """Return the same directions within [-pi, pi)."""
    return (angle_rad + math.pi) % math.tau - math.pi


def in_body_frame(x: Array, y: Array, heading_rad: Array) -> tuple[Array, Array]:
    """Return the components forward and to the left of vectors given in a fixed frame."""
    cosine, sine = np.cos(heading_rad), np.sin(heading_rad)
    return cosine * x + sine * y, cosine * y - sine * x
