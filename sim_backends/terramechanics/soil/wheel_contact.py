"""Constants of a wheel on a soil, independent of its motion, as plain numbers for the kernels."""

import math
from typing import NamedTuple, Protocol

from drivers.errors import ModelError
from drivers.units import STANDARD_GRAVITY_M_S2
from sim_backends.arrays import Array
from sim_backends.terramechanics.soil.library import SoilSettings, WheelSettings
from sim_backends.terramechanics.soil.normal_stress import ModulusTerms, modulus_terms
from sim_backends.terramechanics.soil.quadrature import Rule
from sim_backends.terramechanics.soil.quantity import check_range
from sim_backends.terramechanics.soil.sidewall import NO_WALLS, wall_polynomials
from sim_backends.terramechanics.soil.slip import shearing_radius

STEEPEST_RAD = math.radians(45.0)


class WheelContact(NamedTuple):
    """A wheel at one camber on one soil.

    Attributes:
        camber_tan: Tangent of gamma, the angle from the surface's normal to the wheel's plane, towards +y.
        modulus: K_1, e_1, K_2, e_2 of `normal_stress.stress_modulus`.
        friction: tan phi.
        greatest_stress: a_0, a_1.
        exit_polynomial: lambda over the slip ratio.
        slip_sinkage_m: Sinkage per slip ratio that bears no load; 0 in the papers.
        wall_cosine, wall_sine: Cosine and sine of delta.
        walls: P / h of the side walls as polynomials of h / r, Pa, lowest power first; rows: wall at -y
            passive, active, wall at +y passive, active.
    """

    radius_m: float
    shearing_radius_m: float
    width_m: float
    camber_tan: float
    modulus: ModulusTerms
    exponent: float
    cohesion_pa: float
    friction: float
    shear_modulus_m: float
    greatest_stress: tuple[float, float]
    exit_polynomial: tuple[float, float, float]
    slip_sinkage_m: float
    wall_cosine: float
    wall_sine: float
    walls: Array


class Kernel(Protocol):
    """Computes the forces on many wheels at one camber."""

    def __call__(
        self, contact: WheelContact, rule: Rule, sinkage_m: Array, slip: Array, side_speed: Array
    ) -> Array:
        """Return drawbar pull, side force, vertical force (N) and torque (N m) as columns.

        Args:
            contact: Wheel and soil.
            rule: Nodes.
            sinkage_m: Sinkage of the wheel's middle plane, (N,); the deeper edge at most as deep as the axle.
            slip: Slip ratio, negative in skid, (N,).
            side_speed: Sideways speed of the wheel over the soil, over the rim speed r_s omega; positive to
                +y; (1 - s) tan(beta) in slip, (N,).
        """
        ...


def wheel_contact(
    wheel: WheelSettings,
    soil: SoilSettings,
    *,
    camber_rad: float = 0.0,
    cross_slope_rad: float = 0.0,
    gravity_m_s2: float = STANDARD_GRAVITY_M_S2,
    sidewall: bool = True,
    slip_sinkage_m: float = 0.0,
) -> WheelContact:
    """Return the constants for the kernels.

    Args:
        wheel: Wheel.
        soil: Soil.
        camber_rad: gamma, from the surface's normal to the wheel's plane, towards +y; within 45 deg.
        cross_slope_rad: Slope of the surface across the wheel, rising to +y; within 45 deg.
        gravity_m_s2: 0.1 to 100.
        sidewall: False omits the forces on the side walls.
        slip_sinkage_m: Sinkage per slip ratio that bears no load, 0 to 0.2.

    Raises:
        ModelError: A number is outside its range, the slope exceeds the soil's friction angle, or the soil's
            moduli are negative together at the width of the wheel.
    """
    check_range("camber_rad", camber_rad, "rad", -STEEPEST_RAD, STEEPEST_RAD)
    check_range("cross_slope_rad", cross_slope_rad, "rad", -STEEPEST_RAD, STEEPEST_RAD)
    check_range("gravity_m_s2", gravity_m_s2, "m/s^2", 0.1, 100.0)
    check_range("slip_sinkage_m", slip_sinkage_m, "m", 0.0, 0.2)
    if sum(soil.greatest_stress) >= 1.0:
        raise ModelError(f"greatest_stress is {soil.greatest_stress}; a_0 + a_1 must be below 1.")
    modulus = modulus_terms(soil, gravity_m_s2)
    _check_modulus(modulus, wheel.width_m)
    walls = NO_WALLS
    if sidewall:
        walls = wall_polynomials(soil, camber_rad, cross_slope_rad, gravity_m_s2, wheel.radius_m)
    return WheelContact(
        radius_m=wheel.radius_m,
        shearing_radius_m=shearing_radius(wheel.radius_m, wheel.lug_height_m, wheel.shearing_share),
        width_m=wheel.width_m,
        camber_tan=math.tan(camber_rad),
        modulus=modulus,
        exponent=soil.pressure.exponent,
        cohesion_pa=soil.cohesion_pa,
        friction=math.tan(soil.friction_angle_rad),
        shear_modulus_m=soil.shear_modulus_m,
        greatest_stress=soil.greatest_stress,
        exit_polynomial=soil.exit_polynomial,
        slip_sinkage_m=slip_sinkage_m,
        wall_cosine=math.cos(soil.wall_friction_rad),
        wall_sine=math.sin(soil.wall_friction_rad),
        walls=walls,
    )


def _check_modulus(terms: ModulusTerms, width_m: float) -> None:
    """Check that the pressure grows with the sinkage of a contact as wide as the wheel."""
    modulus = terms[0] * width_m ** terms[1] + terms[2] * width_m ** terms[3]
    if modulus < 0.0:
        raise ModelError(
            f"k_c and k_phi of the soil together are {modulus:.3g} Pa/m^n at the width of {width_m:g} m: "
            "they were measured with wider plates; use a wider wheel, or another soil."
        )
