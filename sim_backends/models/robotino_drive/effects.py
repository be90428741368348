"""Effects that may be missing in the odometry of a Robotino; their cards are in tables.toml."""

import numpy as np

from sim_backends.models.drive_effects import MOST_SLIP
from sim_backends.models.interface import Array, Values


def wheel_slip(values: Values, current_a: Array, idle_current_a: float, surface: float) -> Array:
    """Return the slip of a wheel by `wheel_slip`."""
    gain = values["gain"] if round(values["surface"]) in (0, round(surface)) else 0.0
    return np.minimum(gain * np.maximum(current_a - idle_current_a, 0.0), MOST_SLIP)
