"""Effects that may be missing in a gear motor behind a speed loop; their cards are in tables.toml."""

import math

import numpy as np
from numba import njit

from sim_backends.models.interface import Array, Values

SECONDS_PER_HOUR = 3600.0
COPPER_PER_K = 0.0039
"""Rise of the resistance of copper with temperature."""


@njit(cache=True)
def dry_friction_nm(
    speed: float, direction: float, torque: float, excess: float, fall: float, forward: float
) -> float:
    """Return the friction torque that does not vanish at rest, a magnitude.

    Args:
        speed: Of the motor, rad/s.
        direction: +1 or -1, of the motion or of what pushes.
        torque: By `coulomb_friction`.
        excess: By `stribeck_friction`.
        fall: Speed at which the excess has fallen to 1/e, rad/s.
        forward: By `asymmetric_friction`.
    """
    dry = float(torque + excess * math.exp(-abs(speed) / fall))
    return dry + max(0.0, direction * float(forward))


def supply_share(values: Values, t_s: Array, others_current_a: Array, supply_v: float) -> Array:
    """Return the share of its nominal voltage that the supply gives, by `battery_sag`."""
    charge_ah = np.concatenate(([0.0], np.cumsum(others_current_a[:-1] * np.diff(t_s)))) / SECONDS_PER_HOUR
    share: Array = 1.0 - (values["per_amp"] * others_current_a + values["per_charge"] * charge_ah) / supply_v
    return np.maximum(share, 0.0)


@njit(cache=True)
def bridge_voltage_v(output: float, share: float, dropped: float) -> float:
    """Return the voltage at the motor: an output, times the share of the supply, less that of `dead_zone`."""
    return math.copysign(max(abs(output) * share - dropped, 0.0), output)
