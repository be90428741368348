"""Static shading: shadows of the rover, which are fixed in the image while the ground moves through it.

The logarithm of a picture is ground plus light. The same piece of ground seen at two places gives the
difference of the light between these places. From many such differences the field of the light follows, the
smallest one in the least-squares sense (Kaczmarz' iteration). Light that is constant along the motion cannot
be separated from ground. The effect of a shadow on the ground's roughness is estimated in the same way.
"""

from collections import deque
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from controllers.ftrace.parameters import ShadingParameters
from controllers.ground_motion.flow import PatchMotion
from controllers.ground_motion.ground_patch import RESOLUTION_M, Patch

PIXELS = 2
"""Pixels of the light over those of the ground: shadows have soft edges."""
PIXEL_M = PIXELS * RESOLUTION_M
MEDIAN_STRIDE = 3
ROW_STRIDE = 2
"""Medians over every few pixels are as good here, and take less time."""
LEAST_ALONG = 1e-3
"""Least motion along the image, in pixels of the light, that has a direction."""

Matrix = NDArray[np.float64]


class _Past(NamedTuple):
    """A frame to compare with.

    Attributes:
        pose: From pixels (column, row, 1) of the newest frame to the same ground in this one.
        at_m: Travel of the contact until then.
    """

    patch: Patch
    pose: Matrix
    at_m: float


class StaticShading:
    """Estimates the light of one rig while it drives.

    Frames are compared that are some travel apart: what is learned from a piece of ground does not depend on
    the frame rate, and a rover at rest teaches nothing.

    Args:
        visible: Pixels of the rectified ground that the camera sees, 0 or 1.
        centre: Column of the contact.
        lit_share: Share of each line along the motion that may be darker than lit ground.
        parameters: Tuned numbers.

    Attributes:
        field: Logarithm of the light at each pixel of the ground, relative to lit ground.
    """

    def __init__(self, visible: Patch, centre: int, lit_share: float, parameters: ShadingParameters) -> None:
        self._parameters = parameters
        self.field: Patch = np.zeros_like(visible)
        self._visible = _coarse(visible)
        self._coarse_field: Patch = np.zeros_like(self._visible)
        self._centre = centre / PIXELS
        self._past: deque[_Past] = deque()
        self._travelled_m = 0.0
        self._count = 0
        self._lit_row = int(lit_share * len(self._visible[::ROW_STRIDE]))

    def update(self, log_grey: Patch, motion: PatchMotion | None) -> None:
        """Take the logarithm of the next frame and the motion since the last one, None if unknown."""
        now = _coarse(log_grey)
        if motion is None:
            self._past.clear()
        else:
            self._move(_matrix(motion, self._centre))
            if self._past and self._travelled_m - self._past[-1].at_m < self._parameters.step_m:
                return
            self._count += 1
            baselines_m = self._parameters.baselines_m
            baseline = baselines_m[self._count % len(baselines_m)] / PIXEL_M
            for past in reversed(self._past):
                if np.linalg.norm(self._contact_moved(past.pose)) > baseline:
                    self._correct(now, past.patch, past.pose[:2])
                    break
        self._past.append(_Past(now, np.eye(3), self._travelled_m))

    def _move(self, step: Matrix) -> None:
        self._travelled_m += float(np.linalg.norm(self._contact_moved(step))) * PIXEL_M
        while self._past and self._travelled_m - self._past[0].at_m > self._parameters.past_m:
            self._past.popleft()
        for place, past in enumerate(self._past):
            self._past[place] = past._replace(pose=past.pose @ step)

    def _contact_moved(self, pose: Matrix) -> Matrix:
        contact = np.array([self._centre, 0.0, 1.0])
        return np.asarray(pose[:2] @ contact - contact[:2])

    def _correct(self, now: Patch, before: Patch, pose: Matrix) -> None:
        size = (now.shape[1], now.shape[0])
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        ground = cv2.warpAffine(before - self._coarse_field, pose, size, flags=flags)
        both = self._visible * cv2.warpAffine(self._visible, pose, size, flags=flags) > 0.99
        if both.sum() < self._parameters.least_pixels:
            return
        error = now - self._coarse_field - ground
        error -= np.median(error[both][::MEDIAN_STRIDE])
        most = self._parameters.most_difference
        error = np.clip(error, -most, most) * both
        back = cv2.warpAffine(error, pose, size, flags=cv2.INTER_LINEAR)
        step = self._parameters.gain * (error - back)
        field = np.asarray((1 - self._parameters.leak) * self._coarse_field + step, np.float32)
        self._coarse_field = (field - self._level(field, pose)) * self._visible
        rows, columns = self._coarse_field.shape
        smooth = cv2.GaussianBlur(self._coarse_field, (0, 0), 1.0)
        self.field[: PIXELS * rows, : PIXELS * columns] = cv2.resize(smooth, None, fx=PIXELS, fy=PIXELS)

    def _level(self, field: Patch, pose: Matrix) -> Patch:
        """Return the level of each line along the motion, which no difference shows: that of its lit part."""
        aside, along = self._contact_moved(pose)
        moved = abs(along) > LEAST_ALONG
        steepest = self._parameters.steepest
        slope = float(np.clip(aside / along, -steepest, steepest)) if moved else 0.0
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
    """Return a picture with this number of rows; `column` and `row` are the rows of the inverse map."""
    matrix = np.array([[*column, 0.0], [*row, 0.0]])
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    sheared = cv2.warpAffine(
        picture, matrix, (picture.shape[1], rows), flags=flags, borderMode=cv2.BORDER_REPLICATE
    )
    return np.asarray(sheared, np.float32)


def _matrix(motion: PatchMotion, centre: float) -> Matrix:
    """Return the matrix from pixels (column, row, 1) of the later frame to the same ground in the earlier."""
    left, ahead = motion.left_m / PIXEL_M, motion.forward_m / PIXEL_M
    turn = motion.turn_rad
    return np.array([[1.0, -turn, left], [turn, 1.0, -ahead - turn * centre], [0.0, 0.0, 1.0]])
