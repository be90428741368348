"""Search for the slip, slip angle and sinkages that balance a rover (paper 001, IV.B)."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim_backends.arrays import Array
from sim_backends.terramechanics.slope.balance import Balance
from sim_backends.terramechanics.soil.quadrature import Rule, rule_for
from sim_backends.terramechanics.soil.wheel_set import (
    BOLDEST,
    LEAST_SIZE,
    NEAR,
    TIGHT,
    TILT,
    BalancingKernel,
    Wheels,
)

COARSE = 1e-3
ENOUGH = 1e-9
STEPS = 60
SLOW = 0.5


class Mode(NamedTuple):
    """What a search varies and brings to zero.

    Attributes:
        varied: Of a, b and the sinkages, those that are free; the residuals of F_x, F_y and F_z at the same
            positions are brought to zero.
        edge: The slip ratio is kept at 0, so that a follows b; F_x is what it is.
    """

    varied: NDArray[np.int64]
    edge: bool


class State(NamedTuple):
    """Where a search ended.

    Attributes:
        point: a, b and the sinkage of each kind of wheel; see `balance`.
        missing: Residual there, (2 + K,).
        found: True when what was to be balanced is.
        stable: True when more slip gives more thrust.
    """

    point: Array
    missing: Array
    found: bool
    stable: bool


def mode_of(balance: Balance, *, edge: bool) -> Mode:
    """Return what to vary: without any force to the side the slip angle is 0 and stays out of the search.

    Args:
        balance: What is to be balanced.
        edge: Keep the slip ratio at 0.
    """
    every = np.arange(2 + balance.load_n.size)
    wanted = every >= 2
    wanted[0] = not edge
    wanted[1] = not balance.straight
    return Mode(every[wanted], edge)


def first_guess(balance: Balance) -> Array:
    """Return a point from which the search usually succeeds.

    Args:
        balance: What is to be balanced.
    """
    vertical = float(balance.share @ balance.load_n)
    forward, left = balance.demand.forward_n / vertical, balance.demand.left_n / vertical
    slip = 0.005 + 0.36 * abs(left) + (2.2 if forward > 0.0 else 0.7) * forward
    slip = max(min(slip, 0.6), -0.6 if forward < 0.0 else 0.005)
    side = 0.0 if balance.straight else -math.copysign(1.4 * abs(left) ** 1.5, left)
    point = np.empty(2 + balance.load_n.size)
    root = complex(slip, side) ** 0.5
    point[0], point[1] = (root.real, root.imag) if side else (math.copysign(abs(slip) ** 0.5, slip), 0.0)
    least, most = balance.depth_range
    # Forces at one depth tell the others': F_z grows with about this power of the depth of the deeper edge.
    depth = 0.2 * balance.contact.radius_m + balance.contact.slip_sinkage_m * abs(slip)
    point[2:] = least + depth
    bears = balance.forces(rule_for(COARSE), point[np.newaxis])[0, :, 2]
    power = 1.0 / (1.0 + 0.5 * balance.contact.exponent)
    growth = (balance.load_n / np.maximum(bears, 1e-9 * balance.load_n)) ** power
    point[2:] = least + np.minimum(np.maximum(depth * growth, 1e-3 * (most - least)), most - least)
    return point


def search(balance: Balance, rule: Rule, point: Array, *, edge: bool = False) -> State:
    """Return the balanced state near a point, or the best state when the search gave up.

    Broyden's method: slopes are computed once and then learned from the steps, and computed again where the
    residual does not halve.

    Args:
        balance: What is to be balanced.
        rule: Nodes of the result; most of the way is done with coarser ones.
        point: Where to begin.
        edge: Keep the slip ratio at 0 and let F_x be what it is.
    """
    mode = mode_of(balance, edge=edge)
    nodes = rule_for(COARSE)
    point = _placed(balance, point, mode)
    if isinstance(balance.kernel, BalancingKernel) and balance.effects.soil_flow is None:
        quick = _quick(balance, balance.kernel, rule, point, mode)
        if quick.found:
            return quick
    missing, inverse = _linearise(balance, nodes, point, mode)
    size = _size(missing, mode)
    fresh = True
    for _ in range(STEPS):
        if nodes is not rule and size < NEAR:
            nodes = rule
            missing = balance.missing(nodes, point)
            size = _size(missing, mode)
        if size < TIGHT or inverse is None:
            break
        moved = _moved(balance, point, -(inverse @ missing[mode.varied]), mode)
        after = balance.missing(nodes, moved)
        size_after = _size(after, mode)
        if size_after < SLOW * size:
            _learn(inverse, (moved - point)[mode.varied], (after - missing)[mode.varied])
            fresh = False
        elif fresh and size < ENOUGH:
            break
        elif not fresh and size_after >= size:
            # Learned slopes led astray: look again from here.
            missing, inverse = _linearise(balance, nodes, point, mode)
            fresh = True
            continue
        else:
            if fresh:
                moved = _shortened(balance, nodes, point, moved, size, mode)
            after, inverse = _linearise(balance, nodes, moved, mode)
            fresh, size_after = True, _size(after, mode)
        point, missing, size = moved, after, size_after
    found = bool(size < ENOUGH) and nodes is rule
    return State(point, missing, found, found and _stable(balance, inverse, mode))


def _quick(balance: Balance, kernel: BalancingKernel, rule: Rule, point: Array, mode: Mode) -> State:
    """Return the state that the kernel finds by itself."""
    asked = balance.demand
    wheels = Wheels(
        balance.load_n,
        balance.share,
        mode.varied,
        mode.edge,
        asked.weight_n,
        asked.forward_n,
        asked.left_n,
        *balance.depth_range,
    )
    moved, missing, stable = kernel.balance_quickly(balance.contact, rule_for(COARSE), rule, wheels, point)
    return State(moved, missing, _size(missing, mode) < ENOUGH, stable)


def _placed(balance: Balance, point: Array, mode: Mode) -> Array:
    """Return the point moved onto what the mode keeps: slip ratio 0 with the same side speed, or straight."""
    moved = point.copy()
    if balance.straight:
        moved[1] = 0.0
    if mode.edge:
        side = math.sqrt(abs(point[0] * point[1]))
        moved[0] = 0.0 if balance.straight else side
        moved[1] = 0.0 if balance.straight else math.copysign(side, point[1])
    return moved


def _moved(balance: Balance, point: Array, step: Array, mode: Mode) -> Array:
    """Return the point after a step that is kept within what the slopes can be trusted for."""
    full = np.zeros(point.size)
    full[mode.varied] = step
    length = math.hypot(full[0], full[1])
    bold = BOLDEST * max(math.hypot(point[0], point[1]), 0.1)
    if length > bold:
        full *= bold / length
    moved = point + full
    least, most = balance.depth_range
    for kind in range(2, point.size):
        depth = point[kind] - least
        moved[kind] = least + min(max(moved[kind] - least, 0.5 * depth), 2.0 * depth, most - least)
    if mode.edge and not balance.straight:
        moved[0] = abs(moved[1])
    return moved


def _shortened(balance: Balance, nodes: Rule, point: Array, moved: Array, size: float, mode: Mode) -> Array:
    """Return a point on the way to `moved` where the residual is less than `size`, or one close by."""
    trial = moved
    for _ in range(3):
        if _size(balance.missing(nodes, trial), mode) < size:
            break
        trial = _placed(balance, point + 0.3 * (trial - point), mode)
    return trial


def _size(missing: Array, mode: Mode) -> float:
    size = max(map(abs, missing[mode.varied].tolist()))
    return size if math.isfinite(size) else math.inf


def _learn(inverse: Array, step: Array, change: Array) -> None:
    """Mend the inverse slopes in place, so that they explain the last step (Sherman and Morrison)."""
    explained = inverse @ change
    along = step @ inverse
    scale = float(along @ change)
    if scale != 0.0:
        inverse += ((step - explained) / scale)[:, np.newaxis] * along


def _linearise(balance: Balance, rule: Rule, point: Array, mode: Mode) -> tuple[Array, Array | None]:
    """Return the residual, and the inverse of its slopes (None where there is none)."""
    missing, slopes = _slopes(balance, rule, point, mode)
    chosen = slopes[np.ix_(mode.varied, mode.varied)]
    try:
        inverse = np.asarray(np.linalg.inv(chosen), dtype=np.float64)
    except np.linalg.LinAlgError:
        return missing, None
    return missing, inverse if np.isfinite(inverse).all() else None


def _slopes(balance: Balance, rule: Rule, point: Array, mode: Mode) -> tuple[Array, Array]:
    """Return residual and its slopes by a, b and sinkages; at the edge a follows b."""
    least, _ = balance.depth_range
    tilt = TILT * max(math.hypot(point[0], point[1]), LEAST_SIZE)
    deeper = TILT * (point[2:] - least)
    points = np.array([point, point, point, point])
    points[1, 0] += tilt
    points[2, 1] += tilt
    if mode.edge:
        points[2, 0] = abs(points[2, 1])
    points[3, 2:] += deeper
    forces = balance.forces(rule, points)
    missing = balance.residual(forces)
    slopes = np.zeros((point.size, point.size))
    slopes[:, 0] = (missing[1] - missing[0]) / tilt
    slopes[:, 1] = (missing[2] - missing[0]) / tilt
    more = (forces[3] - forces[0]) / deeper[:, np.newaxis]
    slopes[:2, 2:] = (more[:, :2] * (balance.share / balance.demand.weight_n)[:, np.newaxis]).T
    for kind in range(deeper.size):
        slopes[2 + kind, 2 + kind] = more[kind, 2] / balance.load_n[kind]
    return missing[0], slopes


def _stable(balance: Balance, inverse: Array | None, mode: Mode) -> bool:
    """Tell whether thrust grows with slip while side and vertical forces stay balanced.

    The upper left block of the inverse is that of the slopes of F_x and F_y with F_z kept in balance.
    """
    if inverse is None:
        return False
    if mode.edge:
        return True
    if balance.straight:
        return bool(inverse[0, 0] > 0.0)
    return bool(inverse[0, 0] * inverse[1, 1] < inverse[0, 1] * inverse[1, 0])
