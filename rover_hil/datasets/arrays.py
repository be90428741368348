"""The array types of measured data, and angles in arrays."""

import math
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Array: TypeAlias = NDArray[np.float64]
Flags: TypeAlias = NDArray[np.bool_]
Times: TypeAlias = NDArray[np.int64]


def wrap_angles(angle_rad: Array) -> Array:
    """Return the same directions within [-pi, pi)."""
    return (angle_rad + math.pi) % math.tau - math.pi
