"""Finds the ground behind the wheel again in a frame taken decimetres later, where optical flow is lost."""

import cv2
import numpy as np

from controllers.ftrace.rig_geometry import RESOLUTION_M, GroundPatch
from drivers.samples import Image

LENGTH_M = 0.16
HALF_WIDTH_M = 0.16
LEAST_SEEN = 0.97
SHORTEST, LONGEST = 0.5, 1.15
"""Range of the distance moved, as shares of the wheel's: slip, and errors of scale."""
LEAST_CORRELATION = 0.35
LEAST_LEAD = 0.08
"""By this the best place must beat any other one: grouser prints and bricks repeat."""
SAME_PLACE_PIXELS = 5


class GroundMatch:
    """Normalised correlation of one rig's ground, between frames with little overlap.

    Args:
        ground: The rectified ground.
    """

    def __init__(self, ground: GroundPatch) -> None:
        self._ground = ground
        half = min(round(HALF_WIDTH_M / RESOLUTION_M), ground.centre)
        self._columns = slice(ground.centre - half, ground.centre + half + 1)
        seen = ground.visible[:, self._columns].mean(axis=1) > LEAST_SEEN
        first = int(np.argmax(seen)) if seen.any() else ground.shape[0]
        self._rows = slice(first, first + round(LENGTH_M / RESOLUTION_M))

    def measure(
        self, before: Image, after: Image, distance_m: float, turn_rad: float
    ) -> tuple[float, float] | None:
        """Return motion of the contact forward and left in m, or None where the ground is not found again.

        Args:
            before: Earlier ground, slow light removed.
            after: Later ground.
            distance_m: Distance by the wheel's speed.
            turn_rad: Turn between the two.
        """
        top = self._rows.start + int(SHORTEST * distance_m / RESOLUTION_M)
        bottom = self._rows.stop + int(LONGEST * distance_m / RESOLUTION_M)
        bottom = min(bottom, after.shape[0])
        aside = int(np.tan(self._ground.rig.max_slip_rad) * distance_m / RESOLUTION_M)
        left = max(self._columns.start - aside, 0)
        right = min(self._columns.stop + aside, after.shape[1])
        template, searched = before[self._rows, self._columns], after[top:bottom, left:right]
        if min(template.shape) < SAME_PLACE_PIXELS or (np.array(searched.shape) < template.shape).any():
            return None
        score = np.asarray(cv2.matchTemplate(searched, template, cv2.TM_CCOEFF_NORMED), np.float32)
        row, column = np.unravel_index(int(score.argmax()), score.shape)
        best = float(score[row, column])
        near = np.s_[
            max(row - SAME_PLACE_PIXELS, 0) : row + SAME_PLACE_PIXELS + 1,
            max(column - SAME_PLACE_PIXELS, 0) : column + SAME_PLACE_PIXELS + 1,
        ]
        score[near] = -1.0
        if best < LEAST_CORRELATION or best - float(score.max()) < LEAST_LEAD:
            return None
        middle_m = (self._rows.start + self._rows.stop) / 2 * RESOLUTION_M
        forward = (int(row) + top - self._rows.start) * RESOLUTION_M
        to_left = -(int(column) + left - self._columns.start) * RESOLUTION_M + turn_rad * middle_m
        return forward, to_left
