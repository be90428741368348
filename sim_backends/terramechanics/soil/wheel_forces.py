"""Sinkage of wheels at given loads, and the forces on them (paper 001, eqs 9 to 32)."""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from drivers.units import STANDARD_GRAVITY_M_S2
from sim_backends.arrays import Array
from sim_backends.terramechanics.soil.contact import deepest_sinkage
from sim_backends.terramechanics.soil.library import SoilSettings, WheelSettings
from sim_backends.terramechanics.soil.numpy_kernel import numpy_kernel
from sim_backends.terramechanics.soil.quadrature import Rule, rule_for
from sim_backends.terramechanics.soil.quantity import check_range
from sim_backends.terramechanics.soil.slip import speed_ratio
from sim_backends.terramechanics.soil.wheel_contact import Kernel, WheelContact, wheel_contact
from sim_backends.terramechanics.soil.wheel_set import LEAST_SLIP

WIDEST_SLIP_ANGLE_RAD = 1.55
HEAVIEST_N = 1e6
ITERATIONS = 60
VERTICAL = 2


class WheelForces(NamedTuple):
    """Forces of the soil on wheels, in the wheel's frame; arrays of one shape.

    Attributes:
        drawbar_n: F_x, forward.
        side_n: F_y, to the left.
        vertical_n: F_z, up along the wheel's plane.
        torque_nm: T, driving torque.
    """

    drawbar_n: Array
    side_n: Array
    vertical_n: Array
    torque_nm: Array


def wheel_at_load(
    wheel: WheelSettings,
    soil: SoilSettings,
    *,
    load_n: ArrayLike,
    slip: ArrayLike,
    slip_angle_rad: ArrayLike = 0.0,
    camber_rad: float = 0.0,
    cross_slope_rad: float = 0.0,
    gravity_m_s2: float = STANDARD_GRAVITY_M_S2,
    slip_sinkage_m: float = 0.0,
    bound: float = 1e-8,
    kernel: Kernel = numpy_kernel,
) -> tuple[Array, WheelForces]:
    """Return the sinkages at which wheels bear given loads, and the forces there.

    Args:
        wheel: Wheel.
        soil: Soil.
        load_n: F_z, more than 0 to 1e6; any shape.
        slip: Slip ratio at the shearing radius, -0.99 (skid) to 1; broadcast with it.
        slip_angle_rad: beta, within 1.55 rad, positive to the left; broadcast with it.
        camber_rad: From the surface's normal to the wheel's plane, positive to the left; within 45 deg.
        cross_slope_rad: Slope of the surface across the wheel, rising to the left; within 45 deg.
        gravity_m_s2: 0.1 to 100.
        slip_sinkage_m: Sinkage per slip ratio that bears no load; 0 in the paper.
        bound: Bound on the error relative to F_z: 1e-5 or 1e-8.
        kernel: Computes the forces.

    Returns:
        h'_c, m, and the forces; NaN where the soil does not bear the load before the axle touches it.

    Raises:
        ModelError: A number is outside its range; names parameter, value, unit and range.
    """
    contact = wheel_contact(
        wheel,
        soil,
        camber_rad=camber_rad,
        cross_slope_rad=cross_slope_rad,
        gravity_m_s2=gravity_m_s2,
        slip_sinkage_m=slip_sinkage_m,
    )
    ratio, side_speed = _motion(slip, slip_angle_rad)
    check_range("load_n", load_n, "N", np.finfo(float).tiny, HEAVIEST_N)
    load, ratio, side_speed = np.broadcast_arrays(np.asarray(load_n, float), ratio, side_speed)
    flat = (np.array(values).ravel() for values in (load, ratio, side_speed))
    sinkage, columns = sink(contact, rule_for(bound), kernel, *flat)
    return sinkage.reshape(load.shape), _shaped(columns, load.shape)


def sink(
    contact: WheelContact, rule: Rule, kernel: Kernel, load_n: Array, slip: Array, side_speed: Array
) -> tuple[Array, Array]:
    """Return sinkage, and forces there, of wheels at given loads, all as (N,) and (N, 4).

    The vertical force grows with sinkage, so a secant step within a shrinking bracket finds the only root.

    Args:
        contact: Wheel and soil.
        rule: Nodes.
        kernel: Computes the forces.
        load_n: F_z, more than 0.
        slip: Slip ratio.
        side_speed: As for `Kernel`.
    """
    low = np.full(load_n.shape, least_allowed(contact))
    high = np.full(load_n.shape, deepest_allowed(contact))
    columns = kernel(contact, rule, high, slip, side_speed)
    is_borne = columns[:, VERTICAL] >= load_n
    low_gap, high_gap = -np.ones(load_n.shape), _gap(columns, load_n)
    depth = high.copy()
    for _ in range(ITERATIONS):
        depth = _next_depth(low, high, low_gap, high_gap)
        columns = kernel(contact, rule, depth, slip, side_speed)
        gap = _gap(columns, load_n)
        below = gap < 0.0
        # Illinois: halve the value of the end that is kept, so that both ends move.
        high_gap = np.where(below, 0.5 * high_gap, gap)
        low_gap = np.where(below, gap, 0.5 * low_gap)
        low, high = np.where(below, depth, low), np.where(below, high, depth)
        if np.all((np.abs(gap) < 1e-13) | (high - low < 1e-15) | ~is_borne):
            break
    return np.where(is_borne, depth, np.nan), np.where(is_borne[:, np.newaxis], columns, np.nan)


def least_allowed(contact: WheelContact) -> float:
    """Return the sinkage at the middle plane with which the deeper edge just touches, m."""
    return -0.5 * contact.width_m * abs(contact.camber_tan)


def deepest_allowed(contact: WheelContact) -> float:
    """Return the sinkage at the middle plane with which the deeper edge is as deep as the axle, m."""
    return contact.radius_m - float(deepest_sinkage(np.zeros(1), contact.width_m, contact.camber_tan)[0])


def _shaped(columns: Array, shape: tuple[int, ...]) -> WheelForces:
    return WheelForces(*(columns[:, index].reshape(shape) for index in range(4)))


def _motion(slip: ArrayLike, slip_angle_rad: ArrayLike) -> tuple[Array, Array]:
    check_range("slip", slip, "1", LEAST_SLIP, 1.0)
    check_range("slip_angle_rad", slip_angle_rad, "rad", -WIDEST_SLIP_ANGLE_RAD, WIDEST_SLIP_ANGLE_RAD)
    return np.asarray(slip, float), speed_ratio(slip) * np.tan(slip_angle_rad)


def _gap(columns: Array, load_n: Array) -> Array:
    """Return a measure of F_z that is nearly linear in the sinkage: sqrt(F_z / load) - 1."""
    return np.sqrt(np.maximum(columns[:, VERTICAL] / load_n, 0.0)) - 1.0


def _next_depth(low: Array, high: Array, low_gap: Array, high_gap: Array) -> Array:
    span = high_gap - low_gap
    share = np.where(span > 0.0, -low_gap / np.where(span > 0.0, span, 1.0), 0.5)
    return np.asarray(low + (high - low) * np.clip(share, 0.0, 1.0))
