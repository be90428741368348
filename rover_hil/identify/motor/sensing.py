"""What a current sensor reports on average: the magnitude of a rippling current, in steps."""

import numpy as np
from scipy.special import ndtr

from rover_hil.drives.arrays import Array
from rover_hil.identify.motor.record import Scale

FINEST_STEP_A = 0.004
TABLE_LIMIT_A = 8.0
TABLE_SIZE = 1601


class CurrentSensor:
    """Expected reading of a current I that ripples with standard deviation `ripple` * sqrt(|I|).

    A magnitude is larger on average than the magnitude of the average, and cutting to steps takes half a
    step away; at the currents of a small motor both matter. For a sum over thresholds k of a reading in
    steps q: E = q sum P(|I + ripple| >= threshold_k).

    Args:
        scale: The device's steps.
        is_signed: A signed reading is right on average.
        ripple: Standard deviation in A at 1 A.
    """

    def __init__(self, scale: Scale, is_signed: bool, ripple: float) -> None:
        self._is_signed = is_signed
        if is_signed:
            return
        step = max(scale.current_a, FINEST_STEP_A)
        offset = 0.0 if scale.current_is_cut and scale.current_a else 0.5
        thresholds = step * (np.arange(1, int(TABLE_LIMIT_A / step) + 1) - offset)
        self._current_a = np.linspace(0.0, TABLE_LIMIT_A, TABLE_SIZE)
        # A third of a step of ripple at least: without any, the average would be a staircase.
        deviation = np.maximum(ripple * np.sqrt(self._current_a), step / 3.0)[:, None]
        above = ndtr((self._current_a[:, None] - thresholds) / deviation)
        below = ndtr((-self._current_a[:, None] - thresholds) / deviation)
        self._reading_a = step * (above + below).sum(axis=1)

    def expected(self, current_a: Array) -> Array:
        """Return the average reading of each current."""
        if self._is_signed:
            return current_a
        return np.asarray(np.interp(np.abs(current_a), self._current_a, self._reading_a))
