"""Several wheels that move as one, and what a kernel offers that can balance them by itself."""

from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from sim_backends.arrays import Array
from sim_backends.terramechanics.soil.quadrature import Rule
from sim_backends.terramechanics.soil.wheel_contact import Kernel, WheelContact

LEAST_SLIP = -0.99
MOST_SLIP = 0.995
NEAR = 1e-4
"""Residual below which a search takes the exact nodes instead of the coarse ones."""
TIGHT = 1e-12
"""Residual at which a search stops."""
TILT = 1e-4
"""Relative step for slopes."""
LEAST_SIZE = 1e-3
BOLDEST = 0.5
"""Greatest relative step of a search."""


class Wheels(NamedTuple):
    """Wheels that share slip and slip angle, and what their forces must add up to.

    Attributes:
        load_n: F_z of each kind of wheel, (K,).
        share: Number of wheels of each kind, (K,).
        varied: Of a, b and the sinkages (see `sim_backends.terramechanics.slope.balance`), the positions of
            those to be found; the residuals at the same positions are to vanish.
        edge: The slip ratio stays 0: a follows b.
        weight_n, forward_n, left_n: Scale, sum of F_x, sum of F_y.
        least_m, most_m: Range of the sinkages.
    """

    load_n: Array
    share: Array
    varied: NDArray[np.int64]
    edge: bool
    weight_n: float
    forward_n: float
    left_n: float
    least_m: float
    most_m: float


@runtime_checkable
class BalancingKernel(Kernel, Protocol):
    """A kernel that can search for a balance by itself, faster than from outside."""

    def balance_quickly(
        self, contact: WheelContact, coarse: Rule, rule: Rule, wheels: Wheels, point: Array
    ) -> tuple[Array, Array, bool]:
        """Return the point where the wheels are in balance, the residual there, and whether it is stable.

        Where the search fails the residual is not small.

        Args:
            contact: Wheel and soil.
            coarse: Nodes for most of the way.
            rule: Nodes of the result.
            wheels: Wheels.
            point: Where to begin: a, b, sinkages.
        """
        ...
