"""What effects do that the drives of several rovers may have."""

import numpy as np

from sim_backends.models.interface import Array, Values

MOST_SLIP = 0.98


def true_wheel_speed(values: Values, wheel: int, counted_rad_s: Array) -> Array:
    """Return the speed of a wheel whose encoder counted `counted_rad_s`, by `encoder_dropouts`."""
    if round(values["wheel"]) != wheel or values["share"] <= 0.0:
        return counted_rad_s
    remaining = 1.0 - values["share"]
    return np.where(np.abs(counted_rad_s) > values["onset"], counted_rad_s / remaining, counted_rad_s)


def of_wheel(values: Values, wheel: int, name: str) -> float:
    """Return a number of a card that concerns one wheel; 0 for the other wheels, and without the card."""
    return values[name] if values and round(values["wheel"]) == wheel else 0.0
