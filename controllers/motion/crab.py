"""The slip angle against which a rover that crabs turns its wheels."""

import math

from drivers.clock import seconds

DRIFT_TIME_S = 1.0
"""Time constant; chosen by hand: shorter, and the wheels follow the noise of the trace."""


class CrabDrift:
    """A first-order low-pass on the slip angle of the wheels.

    It begins with the first value: on a side slope the wheels are turned before the rover moves.

    Attributes:
        drift_rad: Smoothed slip angle.
    """

    def __init__(self) -> None:
        self.drift_rad = 0.0
        self._t_ns: int | None = None

    def take(self, now_ns: int, drift_rad: float) -> float:
        """Take a slip angle; return the smoothed one."""
        share = 1.0
        if self._t_ns is not None:
            share = -math.expm1(-seconds(now_ns - self._t_ns) / DRIFT_TIME_S)
        self._t_ns = now_ns
        self.drift_rad += share * (drift_rad - self.drift_rad)
        return self.drift_rad
