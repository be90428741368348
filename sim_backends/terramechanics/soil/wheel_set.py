"""Wheels that share slip and slip angle, and the interface of kernels that can balance them."""

from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from sim_backends.arrays import Array
from sim_backends.terramechanics.soil.quadrature import Rule
from sim_backends.terramechanics.soil.wheel_contact import Kernel, WheelContact

LEAST_SLIP = -0.99
MOST_SLIP = 0.995
FINE_NODES_RESIDUAL = 1e-4
"""Residual below which a search uses the exact nodes instead of the coarse ones."""
CONVERGED_RESIDUAL = 1e-12
"""Residual at which a search stops."""
DIFFERENCE_STEP = 1e-4
"""Relative step for differences."""
SMALLEST_SIZE = 1e-3
LARGEST_STEP = 0.5
"""Greatest relative step of a search."""


class Wheels(NamedTuple):
    """Wheels that share slip and slip angle, and the required sums of their forces.

    Attributes:
        load_n: F_z of each kind of wheel, (K,).
        share: Number of wheels of each kind, (K,).
        varied: Of a, b and the sinkages (see `sim_backends.terramechanics.slope.balance`), the positions of
            the unknowns; the residuals at the same positions must be zero.
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
    """A kernel with a search for the balance of its own, faster than one outside the kernel."""

    def balance_quickly(
        self, contact: WheelContact, coarse: Rule, rule: Rule, wheels: Wheels, point: Array
    ) -> tuple[Array, Array, bool]:
        """Return the point where the wheels are in balance, the residual there, and whether it is stable.

        Where the search fails, the residual is not small.

        Args:
            contact: Wheel and soil.
            coarse: Nodes for most steps.
            rule: Nodes of the result.
            wheels: Wheels.
            point: Start of the search: a, b, sinkages.
        """
        ...
