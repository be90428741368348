"""A pendulum as nature makes it: semi-implicit steps of a millisecond; each run begins a little off."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SAMPLE_S = 0.02
SAMPLES = 250
SUBSTEPS = 20
G_M_S2 = 9.81


@dataclass(frozen=True, kw_only=True)
class TruePendulum:
    """Length in m; friction per inertia.

    Attributes:
        length_m: From the pivot to the centre of swing.
        viscous_per_s: Brakes in proportion to the rate.
        dry_rad_s2: Brakes whatever the rate.
        drag_per_rad: Brakes with the square of the rate.
        tilt_rad: Of the base.
        stiffening_per_s2: Out of every catalogue: a spring that pulls with the cube of the angle.
        start_error_rad: How far a run begins from where it was set, standard deviation.
    """

    length_m: float = 0.5
    viscous_per_s: float = 0.05
    dry_rad_s2: float = 0.0
    drag_per_rad: float = 0.0
    tilt_rad: float = 0.0
    stiffening_per_s2: float = 0.0
    start_error_rad: float = 0.0


def swing(pendulum: TruePendulum, start_rad: float) -> Array:
    """Return the angle at each sample, rad, let go at rest."""
    step = SAMPLE_S / SUBSTEPS
    angle, rate = start_rad, 0.0
    seen = np.zeros(SAMPLES)
    for index in range(SAMPLES):
        seen[index] = angle
        for _ in range(SUBSTEPS):
            push = -G_M_S2 / pendulum.length_m * math.sin(angle + pendulum.tilt_rad)
            push -= (pendulum.viscous_per_s + pendulum.drag_per_rad * abs(rate)) * rate
            push -= pendulum.stiffening_per_s2 * angle**3
            sense = math.copysign(1.0, rate if rate != 0.0 else push)
            after = rate + step * (push - sense * pendulum.dry_rad_s2)
            # Dry friction stops it, and never turns it round.
            rate = 0.0 if after * sense < 0.0 and abs(push) < pendulum.dry_rad_s2 else after
            angle += step * rate
    return seen


def measure_swings(
    pendulum: TruePendulum, starts_rad: Array, noise_rad: float, rng: np.random.Generator
) -> list[Array]:
    """Return the measured angles of one run per start."""
    swings = []
    for start_rad in starts_rad:
        begun = float(start_rad) + pendulum.start_error_rad * float(rng.standard_normal())
        swings.append(swing(pendulum, begun) + noise_rad * rng.standard_normal(SAMPLES))
    return swings
