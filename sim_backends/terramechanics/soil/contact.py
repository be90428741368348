"""Contact of a wheel with the soil: angles of entry, exit and greatest stress; size of the contact.

Angles are measured at the axle from the wheel's downward direction, positive forward. Arguments are numbers
or arrays that broadcast.
"""

import numpy as np

from sim_backends.arrays import Array

FLAT = 1e-9
"""Tangent of the camber below which a wheel is treated as upright."""


def entry_angle(sinkage_m: Array, radius_m: float) -> Array:
    """Return theta_f = acos(1 - h'/r), rad (paper 001, eq 15).

    Args:
        sinkage_m: h', 0 to `radius_m`.
        radius_m: r.
    """
    return np.arccos(1.0 - sinkage_m / radius_m)


def exit_share(slip: Array, polynomial: tuple[float, float, float]) -> Array:
    """Return lambda, exit depth over entry depth: a polynomial of the slip ratio, not below 0.

    In skid, for which the paper gives no number, it keeps its value at s = 0.

    Args:
        slip: -1 to 1.
        polynomial: Coefficients of powers 0, 1, 2.
    """
    positive = np.maximum(slip, 0.0)
    return np.maximum(polynomial[0] + positive * (polynomial[1] + positive * polynomial[2]), 0.0)


def exit_angle(sinkage_m: Array, share: Array, radius_m: float) -> Array:
    """Return theta_r = -acos(1 - lambda h'/r), rad (paper 001, eq 16, with the sign missing in the paper).

    Args:
        sinkage_m: h', 0 to `radius_m`.
        share: lambda, at least 0; the exit lies at most at the height of the axle.
        radius_m: r.
    """
    return -np.arccos(np.maximum(1.0 - share * sinkage_m / radius_m, 0.0))


def greatest_stress_angle(entry_rad: Array, slip: Array, greatest_stress: tuple[float, float]) -> Array:
    """Return theta_m = (a_0 + a_1 s) theta_f, rad (paper 001, eq 18).

    In skid, for which the paper gives no number, the share keeps its value at s = 0.

    Args:
        entry_rad: theta_f, 0 to pi/2.
        slip: -1 to 1.
        greatest_stress: a_0 and a_1, with a sum below 1.
    """
    return (greatest_stress[0] + greatest_stress[1] * np.maximum(slip, 0.0)) * entry_rad


def deepest_sinkage(sinkage_m: Array, width_m: float, camber_tan: float) -> Array:
    """Return the sinkage at the deeper edge, m (paper 001, eq 14), not below 0.

    Args:
        sinkage_m: h'_c at the middle plane; negative where only an edge touches.
        width_m: b.
        camber_tan: Tangent of gamma.
    """
    return np.maximum(sinkage_m + 0.5 * width_m * abs(camber_tan), 0.0)


def contact_width(sinkage_m: Array, width_m: float, camber_tan: float) -> Array:
    """Return the width in contact b_e = h_c / tan(gamma) + b / 2, between 0 and b, m (paper 001, III.B).

    Args:
        sinkage_m: h'_c at the middle plane.
        width_m: b.
        camber_tan: Tangent of gamma.
    """
    if abs(camber_tan) < FLAT:
        return np.where(sinkage_m > 0.0, width_m, 0.0)
    return np.clip(sinkage_m / abs(camber_tan) + 0.5 * width_m, 0.0, width_m)


def contact_length(entry_rad: Array, exit_rad: Array, radius_m: float) -> Array:
    """Return the contact's length r (sin theta_f - sin theta_r) at the deeper edge, m (paper 001, III.B).

    Args:
        entry_rad: theta_f at the deeper edge.
        exit_rad: theta_r at the deeper edge.
        radius_m: r.
    """
    return radius_m * (np.sin(entry_rad) - np.sin(exit_rad))
