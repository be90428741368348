"""Soil against the side walls of a wheel: Reece's plane wedge, passive and active (paper 001, eqs 25 to 28).

Of a wall, `lean` is the angle gamma' by which its top leans away from the soil, `slope` the angle by which
the surface rises away from it. For a wheel at camber gamma (towards +y) on a slope alpha (rising to +y) the
wall at -y has gamma' = gamma - alpha and slope -alpha, the wall at +y both with the other sign; the paper
prints one sign for both. N_c and N_ca follow from the balance of the wedge; the printed ones do not.
"""

import math
from collections.abc import Callable
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from drivers.errors import ModelError
from sim_backends.arrays import Array
from sim_backends.terramechanics.soil.library import SoilSettings

NO_WALLS = np.zeros((4, 2))
NO_WALLS.flags.writeable = False  # like `wall_polynomials`: for another type of array numba compiles anew
DEGREE = 16
INSIDE = 1e-6
Law = Callable[[float, "Wall", SoilSettings, float], float]
GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)
SECTIONS = 20


class Wall(NamedTuple):
    """One side wall and the soil at it; angles in rad.

    Attributes:
        lean: gamma', by which the wall's top leans away from the soil; |gamma'| < 90 deg - phi - delta.
        slope: By which the surface rises away from the wall; |slope| < phi.
        soil_friction: phi.
        wall_friction: delta.
    """

    lean: float
    slope: float
    soil_friction: float
    wall_friction: float


class Factors(NamedTuple):
    """N_rho, N_c and N_ca of eq 25."""

    weight: float
    cohesion: float
    adhesion: float


def passive_factors(surface_rad: float, wall: Wall, *, heap: bool = True) -> Factors:
    """Return the factors of the resistance to a wall that is pushed into the soil (eq 26).

    Args:
        surface_rad: mu_p, angle of the slip surface: `wall.slope` < mu_p < 90 deg + gamma' - delta - phi.
        wall: Wall.
        heap: The displaced soil rests in front of the wall at its angle of friction, as in the paper.
    """
    lean, slope, phi, delta = wall
    cot = 1.0 / math.tan(surface_rad + phi)
    scale = math.cos(lean) * (math.sin(lean - delta) + math.cos(lean - delta) * cot)
    rise = math.sin(surface_rad - slope)
    side = math.cos(surface_rad - lean)
    top = math.cos(lean - slope)
    weight = side * top / (2.0 * scale * rise * math.cos(lean))
    if heap:
        weight *= 1.0 + side * math.sin(phi + slope) / (math.cos(lean + phi) * rise)
    cohesion = (math.sin(surface_rad) + math.cos(surface_rad) * cot) * top / (scale * rise)
    return Factors(weight, cohesion, (math.cos(lean) - math.sin(lean) * cot) / scale)


def active_factors(surface_rad: float, wall: Wall) -> Factors:
    """Return the factors of the push of the soil on a wall that moves away from it (eq 28).

    Args:
        surface_rad: mu_a, angle of the slip surface: phi < mu_a < 90 deg + gamma'.
        wall: Wall.
    """
    lean, slope, phi, delta = wall
    cot = 1.0 / math.tan(surface_rad - phi)
    scale = math.cos(lean) * (math.sin(lean + delta) + math.cos(lean + delta) * cot)
    rise = math.sin(surface_rad - slope)
    top = math.cos(lean - slope)
    weight = math.cos(surface_rad - lean) * top / (2.0 * scale * rise * math.cos(lean))
    cohesion = -(math.sin(surface_rad) + math.cos(surface_rad) * cot) * top / (scale * rise)
    return Factors(weight, cohesion, -(math.cos(lean) - math.sin(lean) * cot) / scale)


def passive_resistance(height_m: float, wall: Wall, soil: SoilSettings, gravity_m_s2: float) -> float:
    """Return P_p, N/m: the least over all slip surfaces (eq 26).

    Args:
        height_m: h, height of the wall in the soil, more than 0.
        wall: Wall.
        soil: Gives density, cohesion and adhesion.
        gravity_m_s2: g.
    """
    return height_m * _minimum(
        lambda mu: _pressure(height_m, passive_factors(mu, wall), soil, gravity_m_s2),
        wall.slope,
        0.5 * math.pi + wall.lean - wall.wall_friction - wall.soil_friction,
    )


def active_resistance(height_m: float, wall: Wall, soil: SoilSettings, gravity_m_s2: float) -> float:
    """Return P_a, N/m: the greatest over all slip surfaces, and 0 where the soil holds unsupported (eq 28).

    Args:
        height_m: h, height of the wall in the soil, more than 0.
        wall: Wall.
        soil: Gives density, cohesion and adhesion.
        gravity_m_s2: g.
    """
    least = _minimum(
        lambda mu: -_pressure(height_m, active_factors(mu, wall), soil, gravity_m_s2),
        wall.soil_friction,
        0.5 * math.pi + wall.lean,
    )
    return height_m * max(-least, 0.0)


def wall_polynomials(
    soil: SoilSettings, camber_rad: float, cross_slope_rad: float, gravity_m_s2: float, radius_m: float
) -> Array:
    """Return P / h of both walls of a wheel as polynomials of x = h / r.

    Args:
        soil: Soil.
        camber_rad: gamma, from the surface's normal to the wheel's plane, towards +y.
        cross_slope_rad: alpha, slope of the surface across the wheel, rising to +y.
        gravity_m_s2: g.
        radius_m: r.

    Returns:
        Rows: wall at -y passive, active, wall at +y passive, active. Columns: x below which there is no
        force, then coefficients, lowest power first, Pa. Exact without cohesion, else fitted to 1e-5 of the
        greatest force.

    Raises:
        ModelError: The walls lean too far, or the slope exceeds the soil's friction angle.
    """
    phi = soil.friction_angle_rad
    if abs(cross_slope_rad) >= phi:
        raise ModelError(
            f"cross_slope_rad is {cross_slope_rad:g} rad, outside +-{phi:.4g} rad, the soil's friction angle."
        )
    limit_rad = 0.5 * math.pi - phi - soil.wall_friction_rad
    if abs(camber_rad - cross_slope_rad) >= limit_rad:
        raise ModelError(
            f"camber_rad - cross_slope_rad is {camber_rad - cross_slope_rad:g} rad, outside "
            f"+-{limit_rad:.4g} rad, 90 deg less the angles of friction of soil and wall."
        )
    return _polynomials(soil, camber_rad, cross_slope_rad, gravity_m_s2, radius_m)


@lru_cache(maxsize=4096)
def _polynomials(
    soil: SoilSettings, camber_rad: float, cross_slope_rad: float, gravity_m_s2: float, radius_m: float
) -> Array:
    rows = []
    for side in (1.0, -1.0):
        wall = Wall(
            side * (camber_rad - cross_slope_rad),
            -side * cross_slope_rad,
            soil.friction_angle_rad,
            soil.wall_friction_rad,
        )
        start = _standing_height(wall, soil, gravity_m_s2) / radius_m
        for law, least in ((passive_resistance, 0.0), (active_resistance, start)):

            def pressure(x: float, law: Law = law, wall: Wall = wall) -> float:
                return law(x * radius_m, wall, soil, gravity_m_s2) / (x * radius_m)

            rows.append(_fit(pressure, least, linear=_cohesionless(soil)))
    table = np.array(rows)
    table.flags.writeable = False
    return table


def _fit(pressure: Callable[[float], float], start: float, *, linear: bool) -> list[float]:
    """Return `start` and the coefficients of a polynomial for the pressure between `start` and 1."""
    if linear:
        return [0.0, 0.0, pressure(1.0)]
    if start >= 1.0:
        return [1.0] + [0.0] * (DEGREE + 1)
    x = start + (1.0 - start) * (0.5 * np.polynomial.chebyshev.chebpts1(2 * DEGREE) + 0.5)
    values = [pressure(float(share)) for share in x]
    series = np.polynomial.Chebyshev.fit(x, values, DEGREE, domain=[start, 1.0])
    return [start, *series.convert(kind=np.polynomial.Polynomial).coef.tolist()]


def _cohesionless(soil: SoilSettings) -> bool:
    return soil.cohesion_pa == 0.0 and soil.wall_adhesion_pa == 0.0


def _standing_height(wall: Wall, soil: SoilSettings, gravity_m_s2: float) -> float:
    """Return the height up to which a cohesive soil holds without support, m."""
    if _cohesionless(soil):
        return 0.0

    def height(mu: float) -> float:
        factors = active_factors(mu, wall)
        holding = soil.cohesion_pa * factors.cohesion + soil.wall_adhesion_pa * factors.adhesion
        return -holding / (soil.density_kg_m3 * gravity_m_s2 * factors.weight)

    return _minimum(height, wall.soil_friction, 0.5 * math.pi + wall.lean)


def _pressure(height_m: float, factors: Factors, soil: SoilSettings, gravity_m_s2: float) -> float:
    """Return P / h of eq 25, Pa."""
    return (
        soil.density_kg_m3 * gravity_m_s2 * height_m * factors.weight
        + soil.cohesion_pa * factors.cohesion
        + soil.wall_adhesion_pa * factors.adhesion
    )


def _minimum(values: Callable[[float], float], lower: float, upper: float) -> float:
    """Return the least value of a function with one minimum inside `lower` .. `upper`.

    Golden sections, then the vertex of a parabola: near its minimum the value depends weakly on the position.
    """
    edge = INSIDE * (upper - lower)
    start, end = lower + edge, upper - edge
    left, right = end - GOLDEN * (end - start), start + GOLDEN * (end - start)
    at_left, at_right = values(left), values(right)
    for _ in range(SECTIONS):
        if at_left < at_right:
            end, right, at_right = right, left, at_left
            left = end - GOLDEN * (end - start)
            at_left = values(left)
        else:
            start, left, at_left = left, right, at_right
            right = start + GOLDEN * (end - start)
            at_right = values(right)
    middle = 0.5 * (start + end)
    half = 0.5 * (end - start)
    before, at_middle, after = values(start), values(middle), values(end)
    curvature = before - 2.0 * at_middle + after
    if curvature <= 0.0 or half == 0.0:
        return min(before, at_middle, after)
    return at_middle - 0.125 * (after - before) ** 2 / curvature
