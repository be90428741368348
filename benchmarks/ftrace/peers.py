"""Plain ways to get the angle of a wheel's velocity from a rear camera, written from OpenCV's functions.

They share nothing with `controllers.ftrace`: the ground is rectified here by casting a grid of ground points
into the picture.
"""

from typing import Protocol, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.samples import Image
from tests.rear_scene.rig_file import CalibratedRig

Floats = NDArray[np.float64]

PIXEL_M = 0.004
LENGTH_M = 0.6
HALF_WIDTH_M = 0.3
CANNY = (60, 140)
LEAST_VOTES = 45
LARGEST_DEG = 35.0
MOST_FEATURES = 300
LEAST_FEATURES = 12
RANSAC_M = 0.002
LEAST_SPREAD = 3.0
"""Darker and emptier frames have no corners worth following."""
LEAST_DARKER = 2.0
"""Grey levels by which the band must differ from its sides."""

Line = tuple[float, float] | None
"""Angle of the wheel's velocity in rad, and the trace's place left of the contact in m; None: nothing."""

Found = TypeVar("Found")


class Peer(Protocol):
    """Looks at one frame after the other."""

    def look(self, image: Image, turn_rad: float) -> Line:
        """Return the line in the next grey frame; `turn_rad` by the gyro since the one before."""
        ...


class Rectified:
    """The ground behind the wheel from above: rows behind the contact, columns to its right."""

    def __init__(self, rig: CalibratedRig) -> None:
        self._size = (round(2 * HALF_WIDTH_M / PIXEL_M) + 1, round(LENGTH_M / PIXEL_M))
        rows, columns = np.indices(self._size[::-1])
        right, back = (columns - self._size[0] // 2) * PIXEL_M, (rows + 0.5) * PIXEL_M
        steer = np.radians(rig.wheel.steer_deg)
        x = rig.wheel.x_m - np.cos(steer) * back + np.sin(steer) * right
        y = rig.wheel.y_m - np.sin(steer) * back - np.cos(steer) * right
        points = np.stack([x, y, np.zeros_like(x)], axis=-1).reshape(-1, 3)
        pixels = rig.project(points).reshape(*self._size[::-1], 2)
        self.seen = rig.sees(pixels.reshape(-1, 2)).reshape(self._size[::-1])
        self._maps = [
            np.ascontiguousarray(axis, np.float32)
            for axis in np.nan_to_num(pixels, nan=-1.0).transpose(2, 0, 1)
        ]

    def __call__(self, image: Image) -> Image:
        """Return the ground; black where it is out of view."""
        return np.asarray(cv2.remap(image, self._maps[0], self._maps[1], cv2.INTER_LINEAR), np.uint8)


class CannyHough:
    """The strongest Hough line of the edges, half a wheel's width to its inner side."""

    def __init__(self, rig: CalibratedRig) -> None:
        self._ground = Rectified(rig)
        self._inner = cv2.erode(self._ground.seen.astype(np.uint8), np.ones((9, 9), np.uint8))
        self._width_px = rig.wheel.width_m / PIXEL_M

    def look(self, image: Image, turn_rad: float) -> Line:
        """Return the strongest line of this frame alone."""
        del turn_rad
        edges = cv2.Canny(cv2.GaussianBlur(self._ground(image), (5, 5), 1.2), *CANNY) * self._inner
        steepest = np.radians(LARGEST_DEG)
        best: tuple[float, float] | None = None
        most = -1.0
        for low, high in ((0.0, steepest), (np.pi - steepest, np.pi)):
            lines = _or_none(
                cv2.HoughLinesWithAccumulator(
                    edges, 1, np.radians(0.5), LEAST_VOTES, min_theta=low, max_theta=high
                )
            )
            if lines is None:
                continue
            for rho, angle, votes in lines.reshape(-1, 3)[:1]:
                if votes > most:
                    most, best = votes, (rho / np.cos(angle), -np.tan(angle))
        if best is None:
            return None
        right = best[0] - edges.shape[1] // 2
        right -= np.sign(right) * min(self._width_px / 2, abs(right))
        return float(np.arctan(best[1])), float(-right * PIXEL_M)


class PlanarFlow:
    """Motion of the contact from corners followed over the rectified ground, RANSAC similarity.

    Args:
        rig: Camera.
        gyro: Take the turn from the gyro and only the shift from the picture.
    """

    def __init__(self, rig: CalibratedRig, *, gyro: bool) -> None:
        self._ground = Rectified(rig)
        self._mask = cv2.erode(self._ground.seen.astype(np.uint8), np.ones((9, 9), np.uint8))
        self._gyro = gyro
        self._before: Image | None = None

    def look(self, image: Image, turn_rad: float) -> Line:
        """Return the direction moved since the frame before."""
        patch = self._ground(image)
        before, self._before = self._before, patch if patch[self._mask > 0].std() > LEAST_SPREAD else None
        if before is None or self._before is None:
            return None
        corners = _or_none(cv2.goodFeaturesToTrack(before, MOST_FEATURES, 0.01, 5, mask=self._mask))
        if corners is None or len(corners) < LEAST_FEATURES:
            return None
        moved, status, _ = cv2.calcOpticalFlowPyrLK(
            before, patch, corners, np.zeros_like(corners), winSize=(21, 21), maxLevel=3
        )
        good = status.ravel() > 0
        start, end = corners.reshape(-1, 2)[good], moved.reshape(-1, 2)[good]
        if len(start) < LEAST_FEATURES:
            return None
        contact = np.array([patch.shape[1] // 2, 0.0])
        shift = self._shift(start - contact, end - contact, turn_rad)
        if shift is None or np.hypot(*shift) < 0.5:
            return None
        # The ground moves back and to the right when the wheel moves ahead and to the left.
        return float(np.arctan2(shift[0], shift[1])), 0.0

    def _shift(self, start: Floats, end: Floats, turn_rad: float) -> Floats | None:
        if self._gyro:
            # Columns to the right, rows backwards: seen from above, ground turns clockwise under a left turn.
            turned = start @ np.array([[1.0, turn_rad], [-turn_rad, 1.0]])
            return np.asarray(np.median(end - turned, axis=0), np.float64)
        transform, _ = cv2.estimateAffinePartial2D(start, end, ransacReprojThreshold=RANSAC_M / PIXEL_M)
        matrix = _or_none(transform)
        if matrix is None:
            return None
        return np.asarray(matrix, np.float64)[:, 2]


class BandFilter:
    """The straight band of the wheel's width that differs most in grey from the ground beside it."""

    def __init__(self, rig: CalibratedRig) -> None:
        self._ground = Rectified(rig)
        shape = self._ground.seen.shape
        half = round(rig.wheel.width_m / 2 / PIXEL_M)
        ones = np.ones(2 * half + 1)
        self._kernel = np.concatenate([-ones, 2 * ones, -ones])[None, :].astype(np.float32) / (4 * len(ones))
        rows, middle = np.arange(shape[0]), shape[1] // 2
        self._slopes = np.tan(np.radians(np.arange(-LARGEST_DEG, LARGEST_DEG + 0.5, 1.0)))
        places = np.arange(middle - half, middle + half + 1)
        lines = places[None, :, None] + self._slopes[:, None, None] * rows
        self._columns = np.clip(np.round(lines), 0, shape[1] - 1).astype(np.intp)
        self._rows, self._middle = rows, middle

    def look(self, image: Image, turn_rad: float) -> Line:
        """Return the strongest band through the contact in this frame alone."""
        del turn_rad
        patch = self._ground(image).astype(np.float32)
        seen = self._ground.seen.astype(np.float32)
        level = cv2.blur(patch, (125, 125)) / np.maximum(cv2.blur(seen, (125, 125)), 0.01)
        answer = cv2.filter2D((patch - level) * seen, -1, self._kernel)
        strength = np.abs(answer[self._rows, self._columns].mean(axis=2))
        slope, place = np.unravel_index(int(strength.argmax()), strength.shape)
        if strength[slope, place] < LEAST_DARKER:
            return None
        left = -(place - self._columns.shape[1] // 2) * PIXEL_M
        return float(np.arctan(self._slopes[slope])), float(left)


def _or_none(angles: Found) -> Found | None:
    """Return what OpenCV found, which may be None although its type hints deny it."""
    return angles
