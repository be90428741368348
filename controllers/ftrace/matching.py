"""Matches ground between frames that are decimetres apart, where optical flow fails."""

import cv2
import numpy as np

from controllers.ftrace.parameters import MatchingParameters
from controllers.ground_motion.ground_patch import RESOLUTION_M, GroundPatch
from drivers.samples import Image


class GroundMatch:
    """Normalised correlation of one rig's ground, between frames with little overlap.

    Args:
        ground: The rectified ground.
        parameters: Tuned numbers.
    """

    def __init__(self, ground: GroundPatch, parameters: MatchingParameters) -> None:
        self._ground = ground
        self._parameters = parameters
        self._same_place = round(parameters.same_place_m / RESOLUTION_M)
        half = min(round(self._parameters.half_width_m / RESOLUTION_M), ground.centre)
        self._columns = slice(ground.centre - half, ground.centre + half + 1)
        seen = ground.visible[:, self._columns].mean(axis=1) > self._parameters.least_seen
        first = int(np.argmax(seen)) if seen.any() else ground.shape[0]
        self._rows = slice(first, first + round(self._parameters.length_m / RESOLUTION_M))

    def measure(
        self, before: Image, after: Image, distance_m: float, turn_rad: float
    ) -> tuple[float, float] | None:
        """Return motion of the contact forward and left in m, or None where no place matches.

        Args:
            before: Fine structure of the earlier ground, in grey levels.
            after: That of the later ground.
            distance_m: Distance by the wheel's speed.
            turn_rad: Turn between the two.
        """
        top = self._rows.start + int(self._parameters.shortest * distance_m / RESOLUTION_M)
        bottom = self._rows.stop + int(self._parameters.longest * distance_m / RESOLUTION_M)
        bottom = min(bottom, after.shape[0])
        aside = int(np.tan(self._ground.rig.max_slip_rad) * distance_m / RESOLUTION_M)
        left = max(self._columns.start - aside, 0)
        right = min(self._columns.stop + aside, after.shape[1])
        template, searched = before[self._rows, self._columns], after[top:bottom, left:right]
        if min(template.shape) < self._same_place or (np.array(searched.shape) < template.shape).any():
            return None
        score = np.asarray(cv2.matchTemplate(searched, template, cv2.TM_CCOEFF_NORMED), np.float32)
        row, column = np.unravel_index(int(score.argmax()), score.shape)
        best = float(score[row, column])
        near = np.s_[
            max(row - self._same_place, 0) : row + self._same_place + 1,
            max(column - self._same_place, 0) : column + self._same_place + 1,
        ]
        score[near] = -1.0
        if (
            best < self._parameters.least_correlation
            or best - float(score.max()) < self._parameters.least_lead
        ):
            return None
        middle_m = (self._rows.start + self._rows.stop) / 2 * RESOLUTION_M
        forward = (int(row) + top - self._rows.start) * RESOLUTION_M
        to_left = -(int(column) + left - self._columns.start) * RESOLUTION_M + turn_rad * middle_m
        return forward, to_left
