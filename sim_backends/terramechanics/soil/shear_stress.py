"""Shear stress under a wheel: one stress, along the slip velocity (paper 001, eqs 19 to 24).

`speed` is v_x / (r_s omega), 1 - s in slip; `side_speed` is v_y / (r_s omega), (1 - s) tan(beta) in slip. So
the equations hold in skid as well. Arguments are numbers or arrays that broadcast.
"""

import numpy as np

from sim_backends.arrays import Array


def displacement(
    gap_rad: Array, sine_gap: Array, speed: Array, side_speed: Array, shearing_radius_m: float
) -> Array:
    """Return the soil's displacement j = sqrt(j_t^2 + j_l^2), m (eqs 20, 21).

    Args:
        gap_rad: theta_f - theta, 0 to pi.
        sine_gap: sin theta_f - sin theta.
        speed: v_x / (r_s omega), at least 0.
        side_speed: v_y / (r_s omega).
        shearing_radius_m: r_s.
    """
    along = gap_rad - speed * sine_gap
    across = side_speed * gap_rad
    return shearing_radius_m * np.sqrt(along * along + across * across)


def slip_velocity(drop: Array, excess: Array, speed: Array, side_speed: Array) -> tuple[Array, Array]:
    """Return the direction (forward, left) of the stress on the wheel: that of slip (eqs 22 to 24).

    Args:
        drop: 1 - cos(theta), without loss of digits near theta = 0.
        excess: 1 - v_x / (r_s omega), s in slip.
        speed: v_x / (r_s omega).
        side_speed: v_y / (r_s omega).

    Returns:
        Two components of a unit vector; 0 where nothing slips.
    """
    along = excess + speed * drop
    size = np.sqrt(along * along + side_speed * side_speed)
    scale = 1.0 / np.where(size > 0.0, size, np.inf)
    return along * scale, -side_speed * scale


def shear_stress(
    normal_pa: Array, displacement_m: Array, cohesion_pa: float, friction: float, shear_modulus_m: float
) -> Array:
    """Return tau = (c + sigma tan phi) (1 - exp(-j / k)), Pa (eq 19).

    Args:
        normal_pa: sigma, at least 0.
        displacement_m: j, at least 0.
        cohesion_pa: c.
        friction: tan phi.
        shear_modulus_m: k.
    """
    return (cohesion_pa + normal_pa * friction) * (1.0 - np.exp(displacement_m * (-1.0 / shear_modulus_m)))
