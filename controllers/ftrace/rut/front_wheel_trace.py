"""The trace of the front wheel, which lies under that of the observed wheel or close to it.

A rover that drifts by a few degrees leaves two traces that overlap. Together they appear as one wide rut, and
one edge of the observed wheel's trace may be invisible. The path of the front wheel is known: it is the path
of the observed wheel, shifted by the vector from one contact to the other.
"""

import numpy as np

from controllers.ground_motion.ground_patch import Floats
from controllers.ground_motion.rig import RigGeometry

MOST_AHEAD_M = 5.0
"""A wheel further ahead is a wrong entry in the rig."""


class FrontWheelTrace:
    """Places of the front wheel's trace relative to candidate curves of the observed one.

    The heading is assumed constant over the length of the rover, the path beyond the view straight. A rover
    that starts on clean ground leaves this trace in view only after it has driven its own length.

    Args:
        rig: Calibration.
        block_m: Distance between the places of a curve.
        touching_widths: Traces further apart do not touch; in widths of the wheel.

    Attributes:
        exists: Whether there is a wheel ahead of the observed one, along its axis.
    """

    def __init__(self, rig: RigGeometry, block_m: float, touching_widths: float) -> None:
        self._most_m = touching_widths * rig.wheel_width_m
        forward, left = rig.lead_m or (0.0, 0.0)
        cos, sin = np.cos(rig.steer_rad), np.sin(rig.steer_rad)
        self._ahead_blocks = (cos * forward + sin * left) / block_m
        self._left_m = cos * left - sin * forward
        self.exists = bool(1.0 <= self._ahead_blocks < MOST_AHEAD_M / block_m)

    def offsets(self, curves_m: Floats) -> Floats:
        """Return how far left of each curve the front trace lies (curve, block); infinite without one."""
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
        """Return the curves of the right and of the left edge of both traces together.

        They are the curve itself where the traces do not touch.
        """
        offsets = self.offsets(curves_m)
        offsets = np.where(np.abs(offsets) < self._most_m, offsets, 0.0)
        return curves_m + np.minimum(offsets, 0.0), curves_m + np.maximum(offsets, 0.0)
