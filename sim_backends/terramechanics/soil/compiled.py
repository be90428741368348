"""The compiled kernel: same results as `numpy_kernel`, several times as fast.

Importing this module loads numba; import it only where compiled code is required.
"""

from collections.abc import Callable
from hashlib import sha256
from pathlib import Path
from typing import cast

import numba
import numpy as np

from sim_backends.arrays import Array
from sim_backends.terramechanics.soil import compiled_functions
from sim_backends.terramechanics.soil.quadrature import Rule
from sim_backends.terramechanics.soil.wheel_contact import Kernel, WheelContact
from sim_backends.terramechanics.soil.wheel_set import Wheels

COMPILING = "compiling the wheel forces (once, about half a minute) ..."


def load_compiled(announce: Callable[[str], None]) -> Kernel:
    """Return the compiled kernel.

    Args:
        announce: Called with one line when the first use must compile because the cache is empty.
    """
    source = Path(compiled_functions.__file__)
    stamp = sha256(source.read_bytes()).digest()
    for entrance in ("wheel_rows", "balance_quickly"):
        # An index of the cache contains the digest of its source.
        indexes = cache_folder().glob(f"{source.stem}.{entrance}-*.nbi")
        if not any(stamp in index.read_bytes() for index in indexes):
            announce(COMPILING)
            break
    return compiled_kernel


def cache_folder() -> Path:
    """Return the folder of numba's compiled code."""
    dispatcher = cast("numba.core.dispatcher.Dispatcher", compiled_functions.wheel_rows)
    return Path(str(dispatcher.stats.cache_path))


class CompiledKernel:
    """A `BalancingKernel`."""

    def __call__(
        self, contact: WheelContact, rule: Rule, sinkage_m: Array, slip: Array, side_speed: Array
    ) -> Array:
        """Return drawbar pull, side force, vertical force (N) and torque (N m) as columns; see `Kernel`."""
        forces = np.zeros((sinkage_m.size, 4))
        compiled_functions.wheel_rows(contact, rule, sinkage_m, slip, side_speed, forces)
        return forces

    def balance_quickly(
        self, contact: WheelContact, coarse: Rule, rule: Rule, wheels: Wheels, point: Array
    ) -> tuple[Array, Array, bool]:
        """Return point, residual and stability; see `BalancingKernel`."""
        moved = point.copy()
        result = compiled_functions.balance_quickly(contact, coarse, rule, wheels, moved)
        return moved, result[:-1], bool(result[-1] < 0.0)


compiled_kernel = CompiledKernel()
