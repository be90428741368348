"""Thrust of a plane wedge of dry soil on a smooth wall."""

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
GRAVITY = 9.80665
DENSITY = 1490.0


def wedge_thrust(surface: Array, lean: float, rise: float, friction_deg: float, *, pushed: bool) -> float:
    """Return the extreme thrust of a plane wedge of dry soil on a smooth wall, over h^2, by its forces."""
    friction = math.radians(friction_deg) * (1.0 if pushed else -1.0)
    inside = (surface > rise + 1e-3) & (surface + friction > 1e-3)
    inside &= surface + friction - lean < 0.5 * math.pi - 1e-3
    mu = surface[inside]
    length = math.cos(lean - rise) / (math.cos(lean) ** 2 * np.sin(mu - rise))
    wedge = 0.5 * length * np.cos(mu - lean)
    if pushed:
        heap = np.cos(mu - lean) * math.sin(friction + rise) / (math.cos(lean + friction) * np.sin(mu - rise))
        wedge = wedge * (1.0 + heap)
    thrust = DENSITY * GRAVITY * wedge * np.sin(mu + friction) / np.cos(mu + friction - lean)
    return float(thrust.min() if pushed else max(thrust.max(), 0.0))
