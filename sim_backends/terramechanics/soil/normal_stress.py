"""Normal stress under a wheel: Reece's law over sinkage, Wong's shape over the angle (paper 001, eq 17)."""

import numpy as np

from sim_backends.arrays import Array
from sim_backends.terramechanics.soil.library import BekkerLaw, SoilSettings

ModulusTerms = tuple[float, float, float, float]
"""Coefficient and power of the contact's lesser dimension, twice."""


def modulus_terms(soil: SoilSettings, gravity_m_s2: float) -> ModulusTerms:
    """Return K_1, e_1, K_2, e_2 of a soil whose pressure at depth z is (K_1 l^e_1 + K_2 l^e_2) z^n.

    Args:
        soil: Soil with either pressure law.
        gravity_m_s2: Acceleration of gravity, more than 0.
    """
    law = soil.pressure
    if isinstance(law, BekkerLaw):
        return law.k_c_pa_m, -1.0, law.k_phi_pa, 0.0
    weight_pa_m = soil.density_kg_m3 * gravity_m_s2
    return soil.cohesion_pa * law.k_c, -law.exponent, weight_pa_m * law.k_phi, 1.0 - law.exponent


def stress_modulus(dimension_m: Array, terms: ModulusTerms) -> Array:
    """Return K(l) = K_1 l^e_1 + K_2 l^e_2, Pa / m^n.

    Args:
        dimension_m: l_w, the lesser of length and width of the contact, more than 0; any shape.
        terms: From `modulus_terms`.
    """
    return terms[0] * dimension_m ** terms[1] + terms[2] * dimension_m ** terms[3]


def front_angle(theta_rad: Array, entry_rad: Array, greatest_rad: Array, exit_rad: Array) -> Array:
    """Return the angle in front of theta_m at which the normal stress is as great as at theta, rad.

    Args:
        theta_rad: theta_r to theta_f; any shape, the others broadcast with it.
        entry_rad: theta_f.
        greatest_rad: theta_m.
        exit_rad: theta_r.
    """
    rear = entry_rad - (theta_rad - exit_rad) * (entry_rad - greatest_rad) / (greatest_rad - exit_rad)
    return np.where(theta_rad < greatest_rad, rear, theta_rad)


def normal_stress(depth_m: Array, modulus: Array, exponent: float) -> Array:
    """Return sigma = K z^n, Pa, and 0 where the depth is negative.

    Args:
        depth_m: z = r (cos theta' - cos theta_f) with theta' from `front_angle`; any shape.
        modulus: K, Pa / m^n, broadcast with it.
        exponent: n.
    """
    return modulus * np.maximum(depth_m, 0.0) ** exponent
