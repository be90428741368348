"""Wheels on soils at random, from fixed seeds, and forces at given sinkages."""

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sim_backends.terramechanics.soil.library import ReeceLaw, SoilSettings, WheelSettings, load_soil
from sim_backends.terramechanics.soil.numpy_kernel import numpy_kernel
from sim_backends.terramechanics.soil.quadrature import rule_for
from sim_backends.terramechanics.soil.slip import speed_ratio
from sim_backends.terramechanics.soil.wheel_contact import wheel_contact
from sim_backends.terramechanics.soil.wheel_forces import WheelForces

Floats = NDArray[np.float64]
SAND = load_soil("toyoura")


def random_soil(generator: np.random.Generator) -> SoilSettings:
    """Return a soil within the stated domain of the quadrature, for wheels up to 0.1 m in radius."""
    law = ReeceLaw(
        law="reece", k_c=100.0, k_phi=generator.uniform(50.0, 800.0), exponent=generator.uniform(0.7, 2.0)
    )
    return SAND.model_copy(
        update={
            "pressure": law,
            "cohesion_pa": float(generator.choice([0.0, 200.0])),
            "shear_modulus_m": generator.uniform(0.01, 0.05),
            "friction_angle_deg": generator.uniform(28.0, 42.0),
            "greatest_stress": (generator.uniform(0.3, 0.6), generator.uniform(-0.1, 0.3)),
        }
    )


def random_motion(
    generator: np.random.Generator, count: int, camber_rad: float
) -> tuple[Floats, Floats, Floats]:
    """Return sinkages, slip ratios and slip angles; half of them close to where forces are singular."""
    tilt = 0.05 * abs(math.tan(camber_rad))
    deepest = np.exp(generator.uniform(math.log(0.002), math.log(0.06), count))
    sinkage = deepest - tilt * generator.uniform(0.0, 1.9, count)
    sinkage = np.maximum(sinkage, 0.001 - 0.9 * tilt)
    close = generator.random(count) < 0.5
    slip = np.where(close, 10.0 ** generator.uniform(-7.0, -1.0, count), generator.uniform(0.0, 0.9, count))
    angle = np.where(
        close, 10.0 ** generator.uniform(-7.0, -1.0, count), generator.uniform(0.0, 0.785, count)
    )
    return sinkage, slip, angle * generator.choice([-1.0, 1.0], count)


def forces_at_sinkage(
    wheel: WheelSettings,
    soil: SoilSettings,
    *,
    sinkage_m: ArrayLike,
    slip: ArrayLike,
    slip_angle_rad: ArrayLike = 0.0,
    camber_rad: float = 0.0,
    cross_slope_rad: float = 0.0,
    gravity_m_s2: float = 9.80665,
    bound: float = 1e-8,
) -> WheelForces:
    """Return the forces on wheels at given sinkages of their middle planes."""
    contact = wheel_contact(
        wheel, soil, camber_rad=camber_rad, cross_slope_rad=cross_slope_rad, gravity_m_s2=gravity_m_s2
    )
    side_speed = speed_ratio(slip) * np.tan(slip_angle_rad)
    states = np.broadcast_arrays(np.asarray(sinkage_m, float), np.asarray(slip, float), side_speed)
    columns = numpy_kernel(contact, rule_for(bound), *(np.array(values).ravel() for values in states))
    return WheelForces(*(columns[:, index].reshape(states[0].shape) for index in range(4)))
