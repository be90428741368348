"""Quadrature nodes for the integrals under a wheel, chosen by a bound on the error.

Each integral is divided where the integrand has a corner or a near-singularity: at theta_m, and at theta = 0,
where the direction of the shear stress changes within a width of sqrt(2 |s + i tan beta|). Near that point
nodes are spaced by a sinh map; towards entry and exit, where the stress is a fractional power, by a square.
"""

from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from drivers.errors import ModelError
from sim_backends.arrays import Array


class Rule(NamedTuple):
    """Nodes and weights in 0 .. 1.

    Attributes:
        slice_node, slice_weight: Nodes across a cambered wheel.
        plain: Number of leading tiers divided at theta_m only; the others are divided at theta = 0 as well.
        reach: Least width of the turn, over the entry angle, for which each tier is accurate enough;
            descending, the last is 0.
        nodes: Number of nodes per segment of each tier.
        node, weight: Nodes and weights of each tier, rows padded with zeros.
    """

    slice_node: Array
    slice_weight: Array
    plain: int
    reach: Array
    nodes: NDArray[np.int64]
    node: Array
    weight: Array


WALL_NODES = 6
"""Number of nodes for the smooth integral over a side wall."""


class Tiers(NamedTuple):
    """Numbers of nodes.

    Attributes:
        slices: Number across a cambered wheel.
        plain: (reach, nodes) of tiers divided at theta_m only.
        cut: (reach, nodes) of tiers divided at theta = 0 as well.
    """

    slices: int
    plain: tuple[tuple[float, int], ...]
    cut: tuple[tuple[float, int], ...]


TIERS = {
    1e-3: Tiers(4, ((0.8, 7),), ((0.0, 8),)),
    1e-5: Tiers(6, ((1.2, 8), (0.8, 9)), ((0.3, 10), (0.1, 14), (0.0, 16))),
    1e-8: Tiers(10, ((0.8, 16),), ((0.5, 16), (0.3, 20), (0.1, 24), (0.0, 32))),
}
"""Tiers by the bound on the error relative to the vertical force."""


def rule_for(bound: float) -> Rule:
    """Return the cheapest nodes that keep every force within `bound` times the vertical force.

    Args:
        bound: 1e-8 or more. Valid for slip ratios from 0 to 0.9, slip angles to 45 deg, cambers to 30 deg,
            exponents from 0.7 to 2 and shear moduli from a tenth of the radius; in skid 1e-5 is the best.

    Raises:
        ModelError: No rule is that accurate.
    """
    for known in sorted(TIERS, reverse=True):
        if known <= bound:
            return _rule(known)
    raise ModelError(f"bound is {bound:g}, outside {min(TIERS):g} .. 1 (parts of the vertical force).")


@cache
def _rule(bound: float) -> Rule:
    slices, plain, cut = TIERS[bound]
    tiers = plain + cut
    slice_node, slice_weight = gauss_legendre(slices)
    most = max(count for _, count in tiers)
    node = np.zeros((len(tiers), most))
    weight = np.zeros((len(tiers), most))
    for row, (_, count) in enumerate(tiers):
        x, w = gauss_legendre(count)
        node[row, :count] = 1.0 - (1.0 - x) ** 2
        weight[row, :count] = 2.0 * (1.0 - x) * w
    reach = np.array([least for least, _ in tiers])
    counts = np.array([count for _, count in tiers], dtype=np.int64)
    return Rule(slice_node, slice_weight, len(plain), reach, counts, node, weight)


def gauss_legendre(count: int) -> tuple[Array, Array]:
    """Return nodes and weights of the Gauss-Legendre rule in 0 .. 1."""
    node, weight = np.polynomial.legendre.leggauss(count)
    return 0.5 * (node + 1.0), 0.5 * weight
