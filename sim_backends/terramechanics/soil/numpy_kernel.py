"""Forces on many wheels at once, in plain numpy (paper 001, eqs 9 to 13 and 27 to 32)."""

from typing import NamedTuple

import numpy as np

from sim_backends.arrays import Array
from sim_backends.terramechanics.soil.contact import (
    contact_length,
    contact_width,
    deepest_sinkage,
    entry_angle,
    exit_angle,
    exit_share,
    greatest_stress_angle,
)
from sim_backends.terramechanics.soil.normal_stress import front_angle, normal_stress, stress_modulus
from sim_backends.terramechanics.soil.quadrature import WALL_NODES, Rule, gauss_legendre
from sim_backends.terramechanics.soil.shear_stress import displacement, shear_stress, slip_velocity
from sim_backends.terramechanics.soil.wheel_contact import WheelContact

STRIPS_AT_ONCE = 512
"""Number of strips computed together: their arrays fit into the processor's cache."""
NARROWEST = 1e-9
WIDEST = 10.0
BISECTIONS = 40
EDGE_RAD = 1e-9
WALL_NODE, WALL_WEIGHT = gauss_legendre(WALL_NODES)


class Strips(NamedTuple):
    """Slices of wheels, each as a column (R, 1).

    Attributes:
        entry, exit, greatest: Angles theta_f, theta_r, theta_m.
        modulus: K, Pa / m^n.
        excess: 1 - v_x / (r_s omega).
        speed, side_speed: v_x and v_y over r_s omega.
        lost: Depth that bears no load, m.
    """

    entry: Array
    exit: Array
    greatest: Array
    modulus: Array
    excess: Array
    speed: Array
    side_speed: Array
    lost: Array


def numpy_kernel(
    contact: WheelContact, rule: Rule, sinkage_m: Array, slip: Array, side_speed: Array
) -> Array:
    """Return drawbar pull, side force, vertical force (N) and torque (N m) as columns; see `Kernel`."""
    depth, width = _slices(contact, rule, sinkage_m)
    modulus = _modulus(contact, sinkage_m, slip)
    columns = depth.shape[1]
    strips, reach = _strips(
        contact,
        depth.reshape(-1, 1),
        *(np.repeat(values, columns)[:, np.newaxis] for values in (modulus, slip, side_speed)),
    )
    per_width = np.zeros((depth.size, 4))
    tier = np.searchsorted(-rule.reach, -reach)
    tier[strips.excess[:, 0] < 0.0] = -1
    for index in np.unique(tier):
        rows = np.flatnonzero((tier == index) & (strips.entry[:, 0] > 0.0))
        for start in range(0, rows.size, STRIPS_AT_ONCE):
            chosen = rows[start : start + STRIPS_AT_ONCE]
            part = Strips(*(column[chosen] for column in strips))
            per_width[chosen] = _integrate(contact, rule, int(index), part)
    bottom = (per_width.reshape(*depth.shape, 4) * width[:, :, np.newaxis]).sum(axis=1)
    return np.asarray(bottom + _wall_forces(contact, sinkage_m, slip, side_speed))


def _slices(contact: WheelContact, rule: Rule, sinkage_m: Array) -> tuple[Array, Array]:
    """Return sinkage and width of the slices across each wheel (eqs 13, 14).

    Nodes are even in the square root of the sinkage, in which the forces are smooth also where an edge
    leaves the soil.
    """
    touching = contact_width(sinkage_m, contact.width_m, contact.camber_tan)
    deepest = deepest_sinkage(sinkage_m, contact.width_m, contact.camber_tan)
    if contact.camber_tan == 0.0:
        return deepest[:, np.newaxis], touching[:, np.newaxis]
    high = np.sqrt(deepest)
    low = np.sqrt(np.maximum(sinkage_m - 0.5 * contact.width_m * abs(contact.camber_tan), 0.0))
    root = low[:, np.newaxis] + (high - low)[:, np.newaxis] * rule.slice_node
    total = np.where(high > 0.0, high + low, 1.0)
    width = rule.slice_weight * (2.0 * touching / total)[:, np.newaxis] * root
    return root * root, width


def _modulus(contact: WheelContact, sinkage_m: Array, slip: Array) -> Array:
    """Return K at the lesser of width and length (of the deeper edge) of the contact (III.B)."""
    deepest = deepest_sinkage(sinkage_m, contact.width_m, contact.camber_tan)
    share = exit_share(slip, contact.exit_polynomial)
    length = contact_length(
        entry_angle(deepest, contact.radius_m),
        exit_angle(deepest, share, contact.radius_m),
        contact.radius_m,
    )
    width = contact_width(sinkage_m, contact.width_m, contact.camber_tan)
    lesser = np.minimum(length, width)
    return np.where(lesser > 0.0, stress_modulus(np.where(lesser > 0.0, lesser, 1.0), contact.modulus), 0.0)


def _strips(
    contact: WheelContact, depth: Array, modulus: Array, slip: Array, side_speed: Array
) -> tuple[Strips, Array]:
    """Return the slices, and the ratio of the width of the shear stress's turn to the entry angle."""
    entry = entry_angle(depth, contact.radius_m)
    positive = np.maximum(slip, 0.0)
    speed = (1.0 - positive) / (1.0 + np.minimum(slip, 0.0))
    strips = Strips(
        entry,
        exit_angle(depth, exit_share(slip, contact.exit_polynomial), contact.radius_m),
        greatest_stress_angle(entry, slip, contact.greatest_stress),
        modulus,
        np.where(slip >= 0.0, slip, 1.0 - speed),
        speed,
        side_speed,
        contact.slip_sinkage_m * np.abs(slip),
    )
    turn = _turn(strips)
    return strips, (turn / np.where(entry > 0.0, entry, 1.0))[:, 0]


def _turn(strips: Strips) -> Array:
    """Return the angle over which the shear stress turns: sqrt(2 |s + i tan beta|) about theta = 0."""
    size = np.sqrt(strips.excess**2 + strips.side_speed**2)
    return np.clip(np.sqrt(2.0 * size / np.maximum(strips.speed, 1e-9)), NARROWEST, WIDEST)


def _integrate(contact: WheelContact, rule: Rule, tier: int, strips: Strips) -> Array:
    """Return eqs 10 to 12 and the torque, per width, of strips of one tier."""
    count = rule.nodes[tier]
    node, weight = rule.node[tier, :count], rule.weight[tier, :count]
    if 0 <= tier < rule.plain:
        rear, front = strips.exit - strips.greatest, strips.entry - strips.greatest
        theta = strips.greatest + np.concatenate([front * node, rear * node], axis=1)
        step = np.concatenate([front * weight, -rear * weight], axis=1)
        # Nodes at the same relative distance from theta_m to either end have the same stress (eq 17).
        normal = np.tile(_normal(contact, strips, theta[:, :count]), 2)
    else:
        anchor, end, turn = _skid_segments(strips) if tier < 0 else _slip_segments(strips)
        length = end - anchor
        reach = np.arcsinh(np.abs(length) / turn)
        growth = np.exp(reach[:, :, np.newaxis] * node)
        half = (np.sign(length) * 0.5 * turn)[:, :, np.newaxis]
        rows = strips.entry.shape[0]
        theta = (anchor[:, :, np.newaxis] + half * (growth - 1.0 / growth)).reshape(rows, -1)
        step = ((0.5 * turn * reach)[:, :, np.newaxis] * (growth + 1.0 / growth) * weight).reshape(rows, -1)
        normal = _normal(contact, strips, front_angle(theta, strips.entry, strips.greatest, strips.exit))
    return _sum_stresses(contact, strips, theta, step, normal)


def _slip_segments(strips: Strips) -> tuple[Array, Array, Array]:
    """Return anchor, end and width of the turn at the anchor of three segments."""
    zero = np.zeros_like(strips.entry)
    turn = _turn(strips)
    return (
        np.concatenate([zero, zero, strips.greatest], axis=1),
        np.concatenate([strips.exit, strips.greatest, strips.entry], axis=1),
        np.concatenate([turn, turn, np.full_like(turn, WIDEST)], axis=1),
    )


def _skid_segments(strips: Strips) -> tuple[Array, Array, Array]:
    """Return the segments of a skidding wheel, also divided where shear changes sign and where j is 0."""
    still = np.arccos(1.0 / strips.speed)
    side = np.abs(strips.side_speed)
    turn = side / np.sqrt((strips.speed * np.sin(still)) ** 2 + strips.speed * side + NARROWEST**2)
    back = _returning_angle(strips, still)
    slope = np.abs(1.0 - strips.speed * np.cos(back))
    kink = side * (strips.entry - back) / np.maximum(slope, NARROWEST)
    cut = np.concatenate([-still, still, back, strips.greatest], axis=1)
    wide = np.concatenate([turn, turn, kink, np.full_like(turn, WIDEST)], axis=1)
    outside = (cut < strips.exit + EDGE_RAD) | (cut > strips.entry - EDGE_RAD)
    cut = np.clip(cut, strips.exit, strips.entry)
    wide = np.clip(np.where(outside, WIDEST, wide), NARROWEST, WIDEST)
    order = np.argsort(cut, axis=1)
    cut = np.take_along_axis(cut, order, 1)
    wide = np.take_along_axis(wide, order, 1)
    middle = 0.5 * (cut[:, 1:] + cut[:, :-1])
    anchor = np.concatenate([cut[:, :1], cut[:, :-1], cut[:, 1:], cut[:, -1:]], axis=1)
    end = np.concatenate([strips.exit, middle, middle, strips.entry], axis=1)
    return anchor, end, np.concatenate([wide[:, :1], wide[:, :-1], wide[:, 1:], wide[:, -1:]], axis=1)


def _returning_angle(strips: Strips, still: Array) -> Array:
    """Return the angle at which soil sheared forward has returned: j_t = 0, between -+`still`."""
    low = np.maximum(-still, strips.exit)
    high = np.minimum(still, strips.entry)
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        along = strips.entry - middle - strips.speed * (np.sin(strips.entry) - np.sin(middle))
        low = np.where(along < 0.0, middle, low)
        high = np.where(along < 0.0, high, middle)
    return 0.5 * (low + high)


def _sum_stresses(contact: WheelContact, strips: Strips, theta: Array, step: Array, normal: Array) -> Array:
    half = np.sin(0.5 * theta)
    drop = 2.0 * half * half
    cosine = 1.0 - drop
    sine = 2.0 * half * np.sqrt(1.0 - half * half)
    moved = displacement(
        strips.entry - theta,
        np.sin(strips.entry) - sine,
        strips.speed,
        strips.side_speed,
        contact.shearing_radius_m,
    )
    shear = shear_stress(normal, moved, contact.cohesion_pa, contact.friction, contact.shear_modulus_m) * step
    normal = normal * step
    forward, left = slip_velocity(drop, strips.excess, strips.speed, strips.side_speed)
    along = shear * forward
    radius = contact.radius_m
    return radius * np.stack(
        [
            (along * cosine - normal * sine).sum(axis=1),
            (shear * left).sum(axis=1),
            (along * sine + normal * cosine).sum(axis=1),
            radius * along.sum(axis=1),
        ],
        axis=1,
    )


def _normal(contact: WheelContact, strips: Strips, front: Array) -> Array:
    """Return the normal stress at angles in front of theta_m."""
    depth = contact.radius_m * (np.cos(front) - np.cos(strips.entry)) - strips.lost
    return normal_stress(depth, strips.modulus, contact.exponent)


def _wall_forces(contact: WheelContact, sinkage_m: Array, slip: Array, side_speed: Array) -> Array:
    """Return eqs 30 to 32 with F_s = F_sp - F_sa, passive at the wall that moves into the soil."""
    forces = np.zeros((sinkage_m.size, 4))
    if not contact.walls[:, 1:].any():
        return forces
    to_left = side_speed > 0.0
    offset = np.where(to_left, 0.5, -0.5) * (contact.width_m * contact.camber_tan)
    pushing = np.where(to_left[:, np.newaxis], contact.walls[2], contact.walls[0])
    pushed = np.where(to_left[:, np.newaxis], contact.walls[1], contact.walls[3])
    total = _wall(contact, pushing, sinkage_m + offset) - _wall(contact, pushed, sinkage_m - offset)
    speed = (1.0 - np.maximum(slip, 0.0)) / (1.0 + np.minimum(slip, 0.0))
    size = np.sqrt(speed * speed + side_speed * side_speed)
    sine = side_speed / np.where(size > 0.0, size, 1.0)
    forces[:, 0] = -total * contact.wall_sine * np.abs(sine)
    forces[:, 1] = -total * contact.wall_cosine * sine
    forces[:, 2] = np.where(side_speed == 0.0, 0.0, total * contact.wall_sine)
    return forces


def _wall(contact: WheelContact, polynomial: Array, sinkage_m: Array) -> Array:
    """Return the resistance of one wall, N: the integral of P (r - h cos theta), with h of that wall (eq 27).

    The variable is v with h(theta) = h (1 - v^2), in which the integrand is smooth and free of angles.
    """
    depth = np.clip(sinkage_m / contact.radius_m, 0.0, 1.0)[:, np.newaxis]
    start = polynomial[:, :1]
    reach = np.sqrt(np.maximum(1.0 - start / np.where(depth > start, depth, np.inf), 0.0))
    drop = depth * (reach * WALL_NODE) ** 2
    share = depth - drop
    pressure = np.zeros_like(share)
    for column in range(polynomial.shape[1] - 1, 0, -1):
        pressure = pressure * share + polynomial[:, column : column + 1]
    resistance = pressure * share * (1.0 - share * (1.0 - drop)) / np.sqrt(2.0 - drop)
    total = (resistance * WALL_WEIGHT).sum(axis=1) * np.sqrt(depth[:, 0]) * reach[:, 0]
    return np.where(depth[:, 0] > start[:, 0], 4.0 * contact.radius_m * contact.radius_m * total, 0.0)
