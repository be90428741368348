"""Compiled functions: forces on wheels, and the search for the balance of a rover.

All compiled functions are in this file: numba's cache does not detect changes in another. `compiled` is the
interface. `numpy_kernel` explains the equations, `sim_backends.terramechanics.slope.search` the search.
"""

import math

import numpy as np

from sim_backends.arrays import Array
from sim_backends.jit import compiled
from sim_backends.terramechanics.soil.contact import FLAT
from sim_backends.terramechanics.soil.numpy_kernel import (
    BISECTIONS,
    EDGE_RAD,
    NARROWEST,
    WALL_NODE,
    WALL_WEIGHT,
    WIDEST,
)
from sim_backends.terramechanics.soil.quadrature import Rule
from sim_backends.terramechanics.soil.wheel_contact import WheelContact
from sim_backends.terramechanics.soil.wheel_set import (
    CONVERGED_RESIDUAL,
    DIFFERENCE_STEP,
    FINE_NODES_RESIDUAL,
    LARGEST_STEP,
    LEAST_SLIP,
    MOST_SLIP,
    SMALLEST_SIZE,
    Wheels,
)

Soil = tuple[float, float, float, float, float, float]
"""r, r_s, n, c, tan phi, -1/k."""
Motion = tuple[float, float, float, float, float, float, float]
"""1 - v_x, v_x, v_y (over r_s omega), K, depth that carries no load, lambda, theta_m / theta_f."""
Angles = tuple[float, float, float, float, float]
"""theta_f, its cosine and sine, theta_r, theta_m."""
State = tuple[float, float, float, float]
"""Sinkage at the middle plane and at the deeper edge, slip ratio, side speed."""
Span = tuple[float, float, float]
"""Anchor and end of a part of the contact, width of the turn of the shear stress at the anchor."""
Place = tuple[float, float, float]
"""theta, sin(theta / 2), normal stress there."""
Sums = tuple[float, float, float, float]
QUICK_STEPS = 15
SLOWEST_DECREASE = 0.5
SINE = tuple((-1.0) ** power / math.factorial(2 * power + 1) for power in range(8, -1, -1))

# Sums may be reordered, which saves a third of the time; NaN and infinity keep their meaning.
_compiled = compiled(error_model="numpy", fastmath={"reassoc", "arcp", "contract", "nsz"})


@_compiled
def wheel_rows(
    contact: WheelContact, rule: Rule, sinkage_m: Array, slip: Array, side_speed: Array, forces: Array
) -> None:
    """Add the forces on many wheels to the rows of `forces`; see `Kernel`."""
    for row in range(sinkage_m.size):
        _wheel(contact, rule, sinkage_m[row], slip[row], side_speed[row], forces[row])


@_compiled
def _wheel(
    contact: WheelContact, rule: Rule, sinkage_m: float, slip: float, side_speed: float, forces: Array
) -> None:
    deepest = sinkage_m + 0.5 * contact.width_m * abs(contact.camber_tan)
    if deepest > 0.0:
        _bottom(contact, rule, (sinkage_m, deepest, slip, side_speed), forces)
        _walls(contact, sinkage_m, slip, side_speed, forces)


@_compiled
def _speed(slip: float) -> float:
    return 1.0 - slip if slip >= 0.0 else 1.0 / (1.0 + slip)


@_compiled
def _bottom(contact: WheelContact, rule: Rule, state: State, forces: Array) -> None:
    """Add the forces of all slices (eqs 13, 14)."""
    sinkage_m, deepest, slip, side_speed = state
    soil = (
        contact.radius_m,
        contact.shearing_radius_m,
        contact.exponent,
        contact.cohesion_pa,
        contact.friction,
        -1.0 / contact.shear_modulus_m,
    )
    radius, width, camber = contact.radius_m, contact.width_m, abs(contact.camber_tan)
    positive = max(slip, 0.0)
    first, second, third = contact.exit_polynomial
    share = max(first + positive * (second + positive * third), 0.0)
    rise, fall = deepest / radius, min(share * deepest / radius, 1.0)
    touching = width
    if camber >= FLAT:
        touching = min(sinkage_m / camber + 0.5 * width, width)
    # The sines of entry and exit angle, from their cosines.
    length = radius * (math.sqrt(rise * (2.0 - rise)) + math.sqrt(fall * (2.0 - fall)))
    lesser = min(length, touching)
    modulus = contact.modulus[2] * lesser ** contact.modulus[3]
    if contact.modulus[0] > 0.0:
        modulus += contact.modulus[0] * lesser ** contact.modulus[1]
    speed = _speed(slip)
    motion = (
        slip if slip >= 0.0 else 1.0 - speed,
        speed,
        side_speed,
        modulus,
        contact.slip_sinkage_m * abs(slip),
        share,
        contact.greatest_stress[0] + contact.greatest_stress[1] * positive,
    )
    if camber == 0.0:
        _strip(soil, rule, motion, deepest, touching, forces)
        return
    high = math.sqrt(deepest)
    low = math.sqrt(max(sinkage_m - 0.5 * width * camber, 0.0))
    for index in range(rule.slice_node.size):
        root = low + (high - low) * rule.slice_node[index]
        slice_width = rule.slice_weight[index] * 2.0 * touching / (high + low) * root
        _strip(soil, rule, motion, root * root, slice_width, forces)


@_compiled
def _strip(soil: Soil, rule: Rule, motion: Motion, depth: float, width: float, forces: Array) -> None:
    """Add the forces of one slice (eqs 10 to 12)."""
    excess, speed, side_speed, _, _, share, greatest_share = motion
    rise = depth / soil[0]
    cos_entry = 1.0 - rise
    entry = math.acos(cos_entry)
    exit_angle = -math.acos(max(1.0 - share * depth / soil[0], 0.0))
    greatest = greatest_share * entry
    angles = (entry, cos_entry, math.sqrt(rise * (2.0 - rise)), exit_angle, greatest)
    if excess < 0.0:
        sums = _skid(soil, motion, angles, rule.node[-1], rule.weight[-1])
    else:
        turn = math.sqrt(2.0 * math.sqrt(excess * excess + side_speed * side_speed) / max(speed, 1e-9))
        turn = min(max(turn, NARROWEST), WIDEST)
        tier = 0
        while turn < rule.reach[tier] * entry:
            tier += 1
        count = rule.nodes[tier]
        node, weight = rule.node[tier, :count], rule.weight[tier, :count]
        if tier < rule.plain:
            sums = _plain(soil, motion, angles, node, weight)
        else:
            rear = _segment(soil, motion, angles, (0.0, exit_angle, turn), node, weight)
            middle = _segment(soil, motion, angles, (0.0, greatest, turn), node, weight)
            front = _segment(soil, motion, angles, (greatest, entry, WIDEST), node, weight)
            sums = _sum(_sum(rear, middle), front)
    scale = soil[0] * width
    forces[0] += scale * sums[0]
    forces[1] += scale * sums[1]
    forces[2] += scale * sums[2]
    forces[3] += scale * soil[0] * sums[3]


@_compiled
def _sum(first: Sums, second: Sums) -> Sums:
    return first[0] + second[0], first[1] + second[1], first[2] + second[2], first[3] + second[3]


@_compiled
def _plain(soil: Soil, motion: Motion, angles: Angles, node: Array, weight: Array) -> Sums:
    """Return the sums on both sides of theta_m as two segments: equal nodes have equal normal stress."""
    entry, cos_entry, _, exit_angle, greatest = angles
    sums = (0.0, 0.0, 0.0, 0.0)
    for index in range(node.size):
        front = greatest + (entry - greatest) * node[index]
        half = _half_sine(front)
        normal = _normal(soil, motion, 1.0 - 2.0 * half * half - cos_entry)
        step = (entry - greatest) * weight[index]
        sums = _add(soil, motion, angles, (front, half, normal), step, sums)
        rear = greatest + (exit_angle - greatest) * node[index]
        step = (greatest - exit_angle) * weight[index]
        sums = _add(soil, motion, angles, (rear, _half_sine(rear), normal), step, sums)
    return sums


@_compiled
def _segment(soil: Soil, motion: Motion, angles: Angles, span: Span, node: Array, weight: Array) -> Sums:
    """Return the sums over a part of the contact, with nodes spaced about its anchor."""
    anchor, end, turn = span
    entry, cos_entry, _, exit_angle, greatest = angles
    sums = (0.0, 0.0, 0.0, 0.0)
    length = end - anchor
    if length == 0.0:
        return sums
    reach = math.asinh(abs(length) / turn)
    half = math.copysign(0.5 * turn, length)
    for index in range(node.size):
        growth = math.exp(reach * node[index])
        theta = anchor + half * (growth - 1.0 / growth)
        step = abs(half) * reach * (growth + 1.0 / growth) * weight[index]
        half_sine = _half_sine(theta)
        front = 1.0 - 2.0 * half_sine * half_sine
        if theta < greatest:
            front = math.cos(entry - (theta - exit_angle) * (entry - greatest) / (greatest - exit_angle))
        normal = _normal(soil, motion, front - cos_entry)
        sums = _add(soil, motion, angles, (theta, half_sine, normal), step, sums)
    return sums


@_compiled
def _half_sine(angle: float) -> float:
    """Return sin(angle / 2) within +-pi/2, exact to rounding; faster than the library's for all angles."""
    angle *= 0.5
    square = angle * angle
    series = SINE[0]
    for index in range(1, len(SINE)):
        series = series * square + SINE[index]
    return angle * series


@_compiled
def _normal(soil: Soil, motion: Motion, share: float) -> float:
    depth = soil[0] * share - motion[4]
    return motion[3] * math.exp(soil[2] * math.log(depth)) if depth > 0.0 else 0.0


@_compiled
def _add(soil: Soil, motion: Motion, angles: Angles, place: Place, step: float, sums: Sums) -> Sums:
    """Return the sums with one more node (eqs 10 to 12, 19 to 24)."""
    theta, half_sine, normal = place
    excess, speed, side_speed = motion[0], motion[1], motion[2]
    drop = 2.0 * half_sine * half_sine
    cosine = 1.0 - drop
    sine = 2.0 * half_sine * math.sqrt(1.0 - half_sine * half_sine)
    gap = angles[0] - theta
    along = gap - speed * (angles[2] - sine)
    across = side_speed * gap
    moved = soil[1] * math.sqrt(along * along + across * across)
    shear = (soil[3] + normal * soil[4]) * (1.0 - math.exp(moved * soil[5])) * step
    forward = excess + speed * drop
    size = math.sqrt(forward * forward + side_speed * side_speed)
    scale = shear / size if size > 0.0 else 0.0
    traction = forward * scale
    normal *= step
    return (
        sums[0] + traction * cosine - normal * sine,
        sums[1] - side_speed * scale,
        sums[2] + traction * sine + normal * cosine,
        sums[3] + traction,
    )


@_compiled
def _skid(soil: Soil, motion: Motion, angles: Angles, node: Array, weight: Array) -> Sums:
    """Return the sums over a skidding slice, divided also where shear changes sign and where j is 0."""
    entry, _, sin_entry, exit_angle, greatest = angles
    speed, side = motion[1], abs(motion[2])
    still = math.acos(1.0 / speed)
    turn = side / math.sqrt((speed * math.sin(still)) ** 2 + speed * side + NARROWEST**2)
    low, high = max(-still, exit_angle), min(still, entry)
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        if entry - middle - speed * (sin_entry - math.sin(middle)) < 0.0:
            low = middle
        else:
            high = middle
    back = 0.5 * (low + high)
    kink = side * (entry - back) / max(abs(1.0 - speed * math.cos(back)), NARROWEST)
    cut = np.array([-still, still, back, greatest])
    wide = np.array([turn, turn, kink, WIDEST])
    for index in range(4):
        if cut[index] < exit_angle + EDGE_RAD or cut[index] > entry - EDGE_RAD:
            wide[index] = WIDEST
        cut[index] = min(max(cut[index], exit_angle), entry)
        wide[index] = min(max(wide[index], NARROWEST), WIDEST)
    order = np.argsort(cut)
    first, last = order[0], order[3]
    sums = _segment(soil, motion, angles, (cut[first], exit_angle, wide[first]), node, weight)
    for index in range(3):
        before, after = order[index], order[index + 1]
        middle = 0.5 * (cut[before] + cut[after])
        part = _segment(soil, motion, angles, (cut[before], middle, wide[before]), node, weight)
        sums = _sum(sums, part)
        part = _segment(soil, motion, angles, (cut[after], middle, wide[after]), node, weight)
        sums = _sum(sums, part)
    part = _segment(soil, motion, angles, (cut[last], entry, wide[last]), node, weight)
    return _sum(sums, part)


@_compiled
def _walls(contact: WheelContact, sinkage_m: float, slip: float, side_speed: float, forces: Array) -> None:
    """Add eqs 30 to 32 with F_s = F_sp - F_sa, passive at the wall that moves into the soil."""
    if side_speed == 0.0:
        return
    offset = 0.5 * contact.width_m * contact.camber_tan
    if side_speed > 0.0:
        total = _wall(contact, 2, sinkage_m + offset) - _wall(contact, 1, sinkage_m - offset)
    else:
        total = _wall(contact, 0, sinkage_m - offset) - _wall(contact, 3, sinkage_m + offset)
    speed = _speed(slip)
    sine = side_speed / math.sqrt(speed * speed + side_speed * side_speed)
    forces[0] -= total * contact.wall_sine * abs(sine)
    forces[1] -= total * contact.wall_cosine * sine
    forces[2] += total * contact.wall_sine


@_compiled
def _wall(contact: WheelContact, row: int, sinkage_m: float) -> float:
    """Return the resistance of one wall, N (eq 27)."""
    radius = contact.radius_m
    depth = min(max(sinkage_m / radius, 0.0), 1.0)
    if depth <= contact.walls[row, 0]:
        return 0.0
    reach = math.sqrt(1.0 - contact.walls[row, 0] / depth)
    total = 0.0
    for index in range(WALL_NODE.size):
        drop = depth * (reach * WALL_NODE[index]) ** 2
        share = depth - drop
        pressure = 0.0
        for column in range(contact.walls.shape[1] - 1, 0, -1):
            pressure = pressure * share + contact.walls[row, column]
        total += WALL_WEIGHT[index] * pressure * share * (1.0 - share * (1.0 - drop)) / math.sqrt(2.0 - drop)
    return 4.0 * radius * radius * math.sqrt(depth) * reach * total


@_compiled
def _missing(contact: WheelContact, rule: Rule, wheels: Wheels, point: Array, columns: Array) -> Array:
    """Return the residuals of the balance, and write the forces of each kind of wheel into `columns`."""
    slip = min(max(point[0] * abs(point[0]) - point[1] * point[1], LEAST_SLIP), MOST_SLIP)
    missing = np.zeros(point.size)
    columns[:] = 0.0
    for kind in range(wheels.load_n.size):
        _wheel(contact, rule, point[2 + kind], slip, 2.0 * point[0] * point[1], columns[kind])
        missing[:2] += wheels.share[kind] * columns[kind, :2]
        missing[2 + kind] = columns[kind, 2] / wheels.load_n[kind] - 1.0
    missing[0] = (missing[0] - wheels.forward_n) / wheels.weight_n
    missing[1] = (missing[1] - wheels.left_n) / wheels.weight_n
    return missing


@_compiled
def _slopes(contact: WheelContact, rule: Rule, wheels: Wheels, point: Array) -> Array:
    """Return the Jacobian of the residuals by a, b and sinkages; with the slip kept at 0, a follows b."""
    kinds = wheels.load_n.size
    before, after = np.zeros((kinds, 4)), np.zeros((kinds, 4))
    missing = _missing(contact, rule, wheels, point, before)
    slopes = np.zeros((point.size, point.size))
    step_size = DIFFERENCE_STEP * max(math.hypot(point[0], point[1]), SMALLEST_SIZE)
    for index in range(2):
        moved = point.copy()
        moved[index] += step_size
        if wheels.edge and index == 1:
            moved[0] = abs(moved[1])
        slopes[:, index] = (_missing(contact, rule, wheels, moved, after) - missing) / step_size
    moved = point.copy()
    moved[2:] += DIFFERENCE_STEP * (point[2:] - wheels.least_m)
    _missing(contact, rule, wheels, moved, after)
    for kind in range(kinds):
        more = (after[kind] - before[kind]) / (moved[2 + kind] - point[2 + kind])
        slopes[:2, 2 + kind] = wheels.share[kind] * more[:2] / wheels.weight_n
        slopes[2 + kind, 2 + kind] = more[2] / wheels.load_n[kind]
    return slopes


@_compiled
def balance_quickly(contact: WheelContact, coarse: Rule, rule: Rule, wheels: Wheels, point: Array) -> Array:
    """Move `point` to where the wheels are in balance, by Broyden's method without safeguards.

    Returns:
        The residuals there; then a number that is negative where more slip gives more thrust.
    """
    varied, nodes, fine, columns = wheels.varied, coarse, False, np.zeros((wheels.load_n.size, 4))
    missing = _missing(contact, nodes, wheels, point, columns)
    inverse, last = np.zeros((varied.size, varied.size)), 0.0
    for _ in range(QUICK_STEPS):
        size = np.abs(missing[varied]).max()
        if not fine and size < FINE_NODES_RESIDUAL:
            nodes, fine = rule, True
            missing = _missing(contact, nodes, wheels, point, columns)
            size = np.abs(missing[varied]).max()
        if not CONVERGED_RESIDUAL <= size < 10.0:
            break
        if size > SLOWEST_DECREASE * last:
            slopes = np.ascontiguousarray(_slopes(contact, coarse, wheels, point)[varied][:, varied])
            if not abs(np.linalg.det(slopes)) > 0.0:
                break
            inverse[:] = np.linalg.inv(slopes)
        last = size
        moved = point.copy()
        moved[varied] -= inverse @ missing[varied]
        largest = LARGEST_STEP * max(math.hypot(point[0], point[1]), 0.1)
        largest /= max(math.hypot(moved[0] - point[0], moved[1] - point[1]), largest)
        moved[:2] = point[:2] + largest * (moved[:2] - point[:2])
        if wheels.edge:
            moved[0] = abs(moved[1])
        for kind in range(2, point.size):
            depth = point[kind] - wheels.least_m
            deepest = min(2.0 * depth, wheels.most_m - wheels.least_m)
            moved[kind] = wheels.least_m + min(max(moved[kind] - wheels.least_m, 0.5 * depth), deepest)
        after = _missing(contact, nodes, wheels, moved, columns)
        step, change = (moved - point)[varied], (after - missing)[varied]
        along = step @ inverse
        inverse += np.outer((step - inverse @ change) / (along @ change), along)
        point[:], missing = moved, after
    stable = np.array([-1.0])
    if varied[0] == 0:
        stable[0] = -inverse[0, 0]
        if varied[1] == 1:
            stable[0] = inverse[0, 0] * inverse[1, 1] - inverse[0, 1] * inverse[1, 0]
    return np.concatenate((missing, stable))
