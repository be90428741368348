"""Shadows fixed to the rover: what stands still in the image while the ground moves through it.

The logarithm of a picture is ground plus light. The same piece of ground seen from two places gives the
difference of the light at these two places; from many such differences the field of the light follows,
smallest in the least-squares sense (Kaczmarz' iteration). Light that is constant along the way cannot be
told from ground.
"""

from collections import deque

import cv2
import numpy as np
from numpy.typing import NDArray

from controllers.ftrace.geometry import RESOLUTION_M, GroundPatch, Patch
from controllers.ftrace.ground_flow import Motion

GAIN = 0.3
LEAK = 0.998
BASELINES_M = (0.04, 0.09)
"""Distances between the two places, in turn: short ones for sharp edges, long ones for wide shadows."""
PAST_FRAMES = 12
MOST_DIFFERENCE = 0.6
"""Larger differences (of logarithms) are mismatched edges, not light."""
LEAST_PIXELS = 1000
MEDIAN_STRIDE = 11
"""A median of every 11th pixel is as good here, and takes a tenth of the time."""

Matrix = NDArray[np.float64]


class StandingLight:
    """The light of one rig, learned while it drives.

    Args:
        ground: The rectified ground.

    Attributes:
        field: Logarithm of the light at each pixel of the ground, relative to its surroundings.
    """

    def __init__(self, ground: GroundPatch) -> None:
        self._visible = ground.visible.astype(np.float32)
        self._centre = ground.centre
        self.field: Patch = np.zeros(ground.shape, np.float32)
        self._past: deque[tuple[Patch, Matrix]] = deque(maxlen=PAST_FRAMES)
        self._count = 0

    def update(self, log_grey: Patch, motion: Motion | None) -> None:
        """Take in the logarithm of the next frame and the motion since the last, None if unknown."""
        if motion is None:
            self._past.clear()
        else:
            step = _matrix(motion, self._centre)
            for place, (patch, pose) in enumerate(self._past):
                self._past[place] = (patch, pose @ step)
            self._count += 1
            baseline = BASELINES_M[self._count % len(BASELINES_M)] / RESOLUTION_M
            contact = np.array([self._centre, 0.0, 1.0])
            for patch, pose in reversed(self._past):
                if np.linalg.norm(pose @ contact - contact) > baseline:
                    self._correct(log_grey, patch, pose[:2])
                    break
        self._past.append((log_grey, np.eye(3)))

    def _correct(self, now: Patch, before: Patch, pose: Matrix) -> None:
        size = (now.shape[1], now.shape[0])
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        ground = cv2.warpAffine(before - self.field, pose, size, flags=flags)
        both = self._visible * cv2.warpAffine(self._visible, pose, size, flags=flags) > 0.99
        if both.sum() < LEAST_PIXELS:
            return
        error = now - self.field - ground
        error -= np.median(error[both][::MEDIAN_STRIDE])
        error = np.clip(error, -MOST_DIFFERENCE, MOST_DIFFERENCE) * both
        back = cv2.warpAffine(error, pose, size, flags=cv2.INTER_LINEAR)
        self.field = np.asarray(LEAK * self.field + GAIN * (error - back), np.float32)


def _matrix(motion: Motion, centre: int) -> Matrix:
    """Return what takes pixels (column, row, 1) of the later frame to the same ground in the earlier."""
    left, ahead = motion.left_m / RESOLUTION_M, motion.forward_m / RESOLUTION_M
    turn = motion.turn_rad
    return np.array([[1.0, -turn, left], [turn, 1.0, -ahead - turn * centre], [0.0, 0.0, 1.0]])
