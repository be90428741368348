"""Shadows fixed to the rover: what stands still in the image while the ground moves through it.

The logarithm of a picture is ground plus light. The same piece of ground seen from two places gives the
difference of the light at these two places; from many such differences the field of the light follows,
smallest in the least-squares sense (Kaczmarz' iteration). Light that is constant along the way cannot be
told from ground. How much a shadow takes from the ground's roughness is learned in the same way.
"""

from collections import deque

import cv2
import numpy as np
from numpy.typing import NDArray

from controllers.ftrace.ground.flow import Motion
from controllers.ftrace.rig_geometry import RESOLUTION_M, Patch

PIXELS = 2
"""The light is kept in pixels this many times as large as the ground's: shadows have soft edges."""
PIXEL_M = PIXELS * RESOLUTION_M
GAIN = 0.3
LEAK = 0.998
BASELINES_M = (0.04, 0.09)
"""Distances between the two places, in turn: short ones for sharp edges, long ones for wide shadows."""
PAST_FRAMES = 12
MOST_DIFFERENCE = 0.6
"""Larger differences (of logarithms) are mismatched edges, not light."""
LEAST_PIXELS = 250
MEDIAN_STRIDE = 3
ROW_STRIDE = 2
"""Medians and the like of every few pixels are as good here, and take less time."""
STEEPEST, LEAST_ALONG = 1.0, 1e-3

Matrix = NDArray[np.float64]


class StandingLight:
    """The light of one rig, learned while it drives.

    Args:
        visible: Pixels of the rectified ground that the camera sees, 0 or 1.
        centre: Column of the contact.
        lit_share: Share of each line along the way that is darker than what counts as lit.

    Attributes:
        field: Logarithm of the light at each pixel of the ground, relative to lit ground.
    """

    def __init__(self, visible: Patch, centre: int, lit_share: float) -> None:
        self.field: Patch = np.zeros_like(visible)
        self._visible = _coarse(visible)
        self._coarse_field: Patch = np.zeros_like(self._visible)
        self._centre = centre / PIXELS
        self._past: deque[tuple[Patch, Matrix]] = deque(maxlen=PAST_FRAMES)
        self._count = 0
        self._lit_row = int(lit_share * len(self._visible[::ROW_STRIDE]))

    def update(self, log_grey: Patch, motion: Motion | None) -> None:
        """Take in the logarithm of the next frame and the motion since the last, None if unknown."""
        now = _coarse(log_grey)
        if motion is None:
            self._past.clear()
        else:
            step = _matrix(motion, self._centre)
            for place, (patch, pose) in enumerate(self._past):
                self._past[place] = (patch, pose @ step)
            self._count += 1
            baseline = BASELINES_M[self._count % len(BASELINES_M)] / PIXEL_M
            for patch, pose in reversed(self._past):
                if np.linalg.norm(self._contact_moved(pose)) > baseline:
                    self._correct(now, patch, pose[:2])
                    break
        self._past.append((now, np.eye(3)))

    def _contact_moved(self, pose: Matrix) -> Matrix:
        contact = np.array([self._centre, 0.0, 1.0])
        return np.asarray(pose[:2] @ contact - contact[:2])

    def _correct(self, now: Patch, before: Patch, pose: Matrix) -> None:
        size = (now.shape[1], now.shape[0])
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        ground = cv2.warpAffine(before - self._coarse_field, pose, size, flags=flags)
        both = self._visible * cv2.warpAffine(self._visible, pose, size, flags=flags) > 0.99
        if both.sum() < LEAST_PIXELS:
            return
        error = now - self._coarse_field - ground
        error -= np.median(error[both][::MEDIAN_STRIDE])
        error = np.clip(error, -MOST_DIFFERENCE, MOST_DIFFERENCE) * both
        back = cv2.warpAffine(error, pose, size, flags=cv2.INTER_LINEAR)
        field = np.asarray(LEAK * self._coarse_field + GAIN * (error - back), np.float32)
        self._coarse_field = (field - self._level(field, pose)) * self._visible
        rows, columns = self._coarse_field.shape
        smooth = cv2.GaussianBlur(self._coarse_field, (0, 0), 1.0)
        self.field[: PIXELS * rows, : PIXELS * columns] = cv2.resize(smooth, None, fx=PIXELS, fy=PIXELS)

    def _level(self, field: Patch, pose: Matrix) -> Patch:
        """Return the level of each line along the way, which no difference tells: that of its lit part."""
        aside, along = self._contact_moved(pose)
        moved = abs(along) > LEAST_ALONG
        slope = float(np.clip(aside / along, -STEEPEST, STEEPEST)) if moved else 0.0
        few = np.ascontiguousarray(field[::ROW_STRIDE])
        upright = _sheared(few, (1.0, slope * ROW_STRIDE), (0.0, 1.0), len(few))
        lit = np.partition(upright, self._lit_row, axis=0)[self._lit_row : self._lit_row + 1]
        return _sheared(lit, (1.0, -slope), (0.0, 0.0), len(field))


def _coarse(picture: Patch) -> Patch:
    rows, columns = (PIXELS * (count // PIXELS) for count in picture.shape)
    scale = 1 / PIXELS
    even = picture[:rows, :columns]
    return np.asarray(cv2.resize(even, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA), np.float32)


def _sheared(picture: Patch, column: tuple[float, float], row: tuple[float, float], rows: int) -> Patch:
    """Return a picture of so many rows that takes the pixel at (column, row) from these multiples of both."""
    matrix = np.array([[*column, 0.0], [*row, 0.0]])
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    sheared = cv2.warpAffine(
        picture, matrix, (picture.shape[1], rows), flags=flags, borderMode=cv2.BORDER_REPLICATE
    )
    return np.asarray(sheared, np.float32)


def _matrix(motion: Motion, centre: float) -> Matrix:
    """Return what takes pixels (column, row, 1) of the later frame to the same ground in the earlier."""
    left, ahead = motion.left_m / PIXEL_M, motion.forward_m / PIXEL_M
    turn = motion.turn_rad
    return np.array([[1.0, -turn, left], [turn, 1.0, -ahead - turn * centre], [0.0, 0.0, 1.0]])
