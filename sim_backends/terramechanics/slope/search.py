"""Search for the slip, slip angle and sinkages that balance a rover (paper 001, IV.B)."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim_backends.arrays import Array
from sim_backends.terramechanics.slope.balance import Balance
from sim_backends.terramechanics.soil.quadrature import Rule, rule_for
from sim_backends.terramechanics.soil.wheel_set import (
    CONVERGED_RESIDUAL,
    DIFFERENCE_STEP,
    FINE_NODES_RESIDUAL,
    LARGEST_STEP,
    SMALLEST_SIZE,
    BalancingKernel,
    Wheels,
)

COARSE = 1e-3
ACCEPTED_RESIDUAL = 1e-9
STEPS = 60
SLOWEST_DECREASE = 0.5


class Mode(NamedTuple):
    """Variables and residuals of a search.

    Attributes:
        varied: Of a, b and the sinkages, those that are free; the residuals of F_x, F_y and F_z at the same
            positions are brought to zero.
        edge: The slip ratio is kept at 0, so that a follows b; F_x is not balanced.
    """

    varied: NDArray[np.int64]
    edge: bool


class State(NamedTuple):
    """Result of a search.

    Attributes:
        point: a, b and the sinkage of each kind of wheel; see `balance`.
        missing: Residual there, (2 + K,).
        found: True when all chosen residuals are zero.
        stable: True when more slip gives more thrust.
    """

    point: Array
    missing: Array
    found: bool
    stable: bool


def mode_of(balance: Balance, *, edge: bool) -> Mode:
    """Return the variables of a search; without side force the slip angle is 0 and is not one of them.

    Args:
        balance: The force balance.
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
        balance: The force balance.
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
    # Extrapolate from one depth: F_z grows with about this power of the depth of the deeper edge.
    depth = 0.2 * balance.contact.radius_m + balance.contact.slip_sinkage_m * abs(slip)
    point[2:] = least + depth
    bears = balance.forces(rule_for(COARSE), point[np.newaxis])[0, :, 2]
    power = 1.0 / (1.0 + 0.5 * balance.contact.exponent)
    growth = (balance.load_n / np.maximum(bears, 1e-9 * balance.load_n)) ** power
    point[2:] = least + np.minimum(np.maximum(depth * growth, 1e-3 * (most - least)), most - least)
    return point


def search(balance: Balance, rule: Rule, point: Array, *, edge: bool = False) -> State:
    """Return the balanced state near a point, or the best state found when the search fails.

    Broyden's method: the Jacobian is computed once, updated from the steps, and computed again where the
    residual does not halve.

    Args:
        balance: The force balance.
        rule: Nodes of the result; most steps use coarser ones.
        point: Start of the search.
        edge: Keep the slip ratio at 0 and do not balance F_x.
    """
    mode = mode_of(balance, edge=edge)
    nodes = rule_for(COARSE)
    point = _constrained(balance, point, mode)
    if isinstance(balance.kernel, BalancingKernel) and balance.effects.soil_flow is None:
        state = _search_in_kernel(balance, balance.kernel, rule, point, mode)
        if state.found:
            return state
    missing, inverse = _linearise(balance, nodes, point, mode)
    size = _size(missing, mode)
    fresh = True
    for _ in range(STEPS):
        if nodes is not rule and size < FINE_NODES_RESIDUAL:
            nodes = rule
            missing = balance.missing(nodes, point)
            size = _size(missing, mode)
        if size < CONVERGED_RESIDUAL or inverse is None:
            break
        moved = _limited_step(balance, point, -(inverse @ missing[mode.varied]), mode)
        after = balance.missing(nodes, moved)
        size_after = _size(after, mode)
        if size_after < SLOWEST_DECREASE * size:
            _update_inverse(inverse, (moved - point)[mode.varied], (after - missing)[mode.varied])
            fresh = False
        elif fresh and size < ACCEPTED_RESIDUAL:
            break
        elif not fresh and size_after >= size:
            # The updated Jacobian is too inaccurate: compute it again here.
            missing, inverse = _linearise(balance, nodes, point, mode)
            fresh = True
            continue
        else:
            if fresh:
                moved = _backtracked(balance, nodes, point, moved, size, mode)
            after, inverse = _linearise(balance, nodes, moved, mode)
            fresh, size_after = True, _size(after, mode)
        point, missing, size = moved, after, size_after
    found = bool(size < ACCEPTED_RESIDUAL) and nodes is rule
    return State(point, missing, found, found and _stable(balance, inverse, mode))


def _search_in_kernel(
    balance: Balance, kernel: BalancingKernel, rule: Rule, point: Array, mode: Mode
) -> State:
    """Return the result of the kernel's own search."""
    demand = balance.demand
    wheels = Wheels(
        balance.load_n,
        balance.share,
        mode.varied,
        mode.edge,
        demand.weight_n,
        demand.forward_n,
        demand.left_n,
        *balance.depth_range,
    )
    moved, missing, stable = kernel.balance_quickly(balance.contact, rule_for(COARSE), rule, wheels, point)
    return State(moved, missing, _size(missing, mode) < ACCEPTED_RESIDUAL, stable)


def _constrained(balance: Balance, point: Array, mode: Mode) -> Array:
    """Return the point moved onto the mode's constraint: slip ratio 0 at the same side speed, or straight."""
    moved = point.copy()
    if balance.straight:
        moved[1] = 0.0
    if mode.edge:
        side = math.sqrt(abs(point[0] * point[1]))
        moved[0] = 0.0 if balance.straight else side
        moved[1] = 0.0 if balance.straight else math.copysign(side, point[1])
    return moved


def _limited_step(balance: Balance, point: Array, step: Array, mode: Mode) -> Array:
    """Return the point after a step, limited to the range in which the linearisation is valid."""
    full = np.zeros(point.size)
    full[mode.varied] = step
    length = math.hypot(full[0], full[1])
    largest = LARGEST_STEP * max(math.hypot(point[0], point[1]), 0.1)
    if length > largest:
        full *= largest / length
    moved = point + full
    least, most = balance.depth_range
    for kind in range(2, point.size):
        depth = point[kind] - least
        moved[kind] = least + min(max(moved[kind] - least, 0.5 * depth), 2.0 * depth, most - least)
    if mode.edge and not balance.straight:
        moved[0] = abs(moved[1])
    return moved


def _backtracked(balance: Balance, nodes: Rule, point: Array, moved: Array, size: float, mode: Mode) -> Array:
    """Return a point towards `moved` with a residual less than `size`, or one close to `point`."""
    trial = moved
    for _ in range(3):
        if _size(balance.missing(nodes, trial), mode) < size:
            break
        trial = _constrained(balance, point + 0.3 * (trial - point), mode)
    return trial


def _size(missing: Array, mode: Mode) -> float:
    size = max(map(abs, missing[mode.varied].tolist()))
    return size if math.isfinite(size) else math.inf


def _update_inverse(inverse: Array, step: Array, change: Array) -> None:
    """Update the inverse Jacobian in place with the last step (Sherman and Morrison)."""
    explained = inverse @ change
    along = step @ inverse
    scale = float(along @ change)
    if scale != 0.0:
        inverse += ((step - explained) / scale)[:, np.newaxis] * along


def _linearise(balance: Balance, rule: Rule, point: Array, mode: Mode) -> tuple[Array, Array | None]:
    """Return the residual and the inverse of its Jacobian, None where that is singular."""
    missing, slopes = _slopes(balance, rule, point, mode)
    chosen = slopes[np.ix_(mode.varied, mode.varied)]
    try:
        inverse = np.asarray(np.linalg.inv(chosen), dtype=np.float64)
    except np.linalg.LinAlgError:
        return missing, None
    return missing, inverse if np.isfinite(inverse).all() else None


def _slopes(balance: Balance, rule: Rule, point: Array, mode: Mode) -> tuple[Array, Array]:
    """Return residual and its Jacobian by a, b and sinkages; at the edge a follows b."""
    least, _ = balance.depth_range
    step = DIFFERENCE_STEP * max(math.hypot(point[0], point[1]), SMALLEST_SIZE)
    deeper = DIFFERENCE_STEP * (point[2:] - least)
    points = np.array([point, point, point, point])
    points[1, 0] += step
    points[2, 1] += step
    if mode.edge:
        points[2, 0] = abs(points[2, 1])
    points[3, 2:] += deeper
    forces = balance.forces(rule, points)
    missing = balance.residual(forces)
    slopes = np.zeros((point.size, point.size))
    slopes[:, 0] = (missing[1] - missing[0]) / step
    slopes[:, 1] = (missing[2] - missing[0]) / step
    more = (forces[3] - forces[0]) / deeper[:, np.newaxis]
    slopes[:2, 2:] = (more[:, :2] * (balance.share / balance.demand.weight_n)[:, np.newaxis]).T
    for kind in range(deeper.size):
        slopes[2 + kind, 2 + kind] = more[kind, 2] / balance.load_n[kind]
    return missing[0], slopes


def _stable(balance: Balance, inverse: Array | None, mode: Mode) -> bool:
    """Return whether thrust grows with slip while side and vertical forces stay balanced.

    The upper left block of the inverse is the inverse Jacobian of F_x and F_y with F_z kept in balance.
    """
    if inverse is None:
        return False
    if mode.edge:
        return True
    if balance.straight:
        return bool(inverse[0, 0] > 0.0)
    return bool(inverse[0, 0] * inverse[1, 1] < inverse[0, 1] * inverse[1, 0])
