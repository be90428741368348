"""The trace of the wheel ahead, which lies under the watched wheel's own or close beside it.

A rover that drifts by a few degrees leaves two traces that overlap: together they look like one wide rut,
and one edge of the watched wheel's trace may not be seen at all. Where the wheel ahead went is known: its
trace is the path of the watched wheel, shifted by the vector from one contact to the other.
"""

import numpy as np

from controllers.ftrace.rig import RigGeometry
from controllers.ftrace.rig_geometry import Floats

MOST_AHEAD_M = 5.0
"""A wheel further ahead is a wrong entry in the rig."""
MOST_WIDTHS = 1.1
"""Traces further apart than this many widths of a wheel do not touch."""


class LeadTrace:
    """Where the other trace lies beside curves that the watched one may have.

    The heading is taken to be the same over the length of the rover, the path behind the view as straight on.
    A rover that starts on clean ground leaves this trace in view only when it has driven its own length.

    Args:
        rig: Calibration.
        block_m: Distance between the places of a curve.

    Attributes:
        exists: Whether a wheel goes ahead of the watched one, along its axis.
    """

    def __init__(self, rig: RigGeometry, block_m: float) -> None:
        self._most_m = MOST_WIDTHS * rig.wheel_width_m
        forward, left = rig.lead_m or (0.0, 0.0)
        cos, sin = np.cos(rig.steer_rad), np.sin(rig.steer_rad)
        self._ahead_blocks = (cos * forward + sin * left) / block_m
        self._left_m = cos * left - sin * forward
        self.exists = bool(1.0 <= self._ahead_blocks < MOST_AHEAD_M / block_m)

    def beside(self, curves_m: Floats) -> Floats:
        """Return how far left of each curve the other trace lies (curve, block); infinite without one."""
        if not self.exists:
            return np.full_like(curves_m, np.inf)
        whole = int(self._ahead_blocks)
        share = self._ahead_blocks - whole
        slope = curves_m[:, -1:] - curves_m[:, -3:-2]
        further = curves_m[:, -1:] + slope / 2 * np.arange(1, whole + 2)
        longer = np.concatenate([curves_m, further], axis=1)
        count = curves_m.shape[1]
        there = (1 - share) * longer[:, whole : whole + count] + share * longer[
            :, whole + 1 : whole + 1 + count
        ]
        return np.asarray(there + self._left_m - curves_m)

    def edges(self, curves_m: Floats) -> tuple[Floats, Floats]:
        """Return the curves that the right and the left edge of both traces together follow.

        They are the curve itself where the traces do not touch: the other one counts for itself there.
        """
        beside = self.beside(curves_m)
        beside = np.where(np.abs(beside) < self._most_m, beside, 0.0)
        return curves_m + np.minimum(beside, 0.0), curves_m + np.maximum(beside, 0.0)
