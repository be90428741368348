"""Motion of the rover between two frames, from the optical flow of the rectified ground.

Points of the ground are followed from patch to patch (pyramidal Lucas-Kanade), in pictures of the fine
structure of the ground. The densest group of similar motions starts a robust fit with the gyro's angles as
prior, which gives the motion of the contact, the turn, and the change of roll and pitch. Points on passing
shadows, and on shadows of the rover, are not in this group.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from controllers.ftrace.ground.frame import Frame
from controllers.ftrace.parameters import FlowParameters
from controllers.ftrace.rig_geometry import RESOLUTION_M, Floats, GroundPatch, Mask
from drivers.samples import Image


@dataclass(frozen=True, slots=True, kw_only=True)
class Motion:
    """Motion of the wheel's contact in the wheel's axes of the later frame.

    Attributes:
        forward_m: Along the wheel's axis.
        left_m: Across it.
        turn_rad: Counter-clockwise.
        left_sd_m: Standard deviation of `left_m`.
        turn_sd_rad: Standard deviation of `turn_rad`.
        share: Share of the points in both views that move with the ground.
    """

    forward_m: float
    left_m: float
    turn_rad: float
    left_sd_m: float
    turn_sd_rad: float
    share: float


class GroundFlow:
    """Measures motion between patches of one rig.

    Args:
        ground: The rectified ground.
        parameters: Tuned numbers.
    """

    def __init__(self, ground: GroundPatch, parameters: FlowParameters) -> None:
        self._parameters = parameters
        window = round(parameters.window_m / RESOLUTION_M)
        self._window = (window, window)
        step = round(self._parameters.spacing_m / RESOLUTION_M)
        rows, columns = np.mgrid[step // 2 : ground.shape[0] : step, step // 2 : ground.shape[1] : step]
        margin = cv2.erode(ground.visible.astype(np.uint8), np.ones(self._window, np.uint8), borderValue=0)
        keep = margin[rows, columns] > 0
        self._pixels = np.stack([columns[keep], rows[keep]], axis=1).astype(np.float32)
        self._seen = ground.visible
        self._ground = ground
        self._design = self._design_for(self._pixels)

    def measure(
        self,
        before: Image,
        after: Image,
        expected_m: tuple[float, float],
        frame: Frame,
    ) -> Motion | None:
        """Return the motion between two patches, or None where too few points can be followed.

        Args:
            before: Fine structure of the earlier ground, in grey levels.
            after: That of the later ground.
            expected_m: Expected motion, forward and left.
            frame: The later frame, for the angles by the gyro.
        """
        roll, pitch, yaw = frame.turn_rad
        roll_sd, pitch_sd, yaw_sd = frame.turn_sd_rad
        prior = np.array([*expected_m, yaw, roll, pitch])
        guess = (self._design @ prior).reshape(2, -1).T
        first = (self._pixels + guess / RESOLUTION_M).astype(np.float32)
        found, status, _ = cv2.calcOpticalFlowPyrLK(
            before, after, self._pixels, first, winSize=self._window, maxLevel=1,
            criteria=(cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 12, 0.02),
            flags=cv2.OPTFLOW_USE_INITIAL_FLOW, minEigThreshold=2e-4,
        )  # fmt: skip
        moved = (np.asarray(found, np.float64) - self._pixels) * RESOLUTION_M
        overlapping = int(self._is_visible(np.asarray(first, np.float64)).sum())
        usable = (status.ravel() > 0) & self._is_visible(np.asarray(found, np.float64))
        length = float(np.linalg.norm(guess, axis=1).mean())
        if length > self._parameters.standing_m:
            usable &= np.linalg.norm(moved, axis=1) > self._parameters.standing_share * length
        if usable.sum() < self._parameters.least_points:
            return None
        free = 0.5 * max(length, RESOLUTION_M)
        start = self._densest(moved, usable, prior, free)
        if start is None:
            return None
        return self._solve(
            moved, usable, overlapping, start, prior, np.array([free, free, yaw_sd, roll_sd, pitch_sd])
        )

    def _densest(self, moved: Floats, usable: Mask, prior: Floats, reach_m: float) -> Floats | None:
        """Return the motion that most points share, with the turns of the prior; None if too few do.

        Only motions within `reach_m` of the expected one count.
        """
        numbers = self._parameters
        turned = (self._design @ np.r_[0.0, 0.0, prior[2:]]).reshape(2, -1)
        to_left, backwards = (moved.T - turned)[:, usable]
        shifts = np.stack([backwards, -to_left], axis=1)
        shifts = shifts[np.hypot(*(shifts - prior[:2]).T) < max(reach_m, numbers.group_m)]
        if len(shifts) < numbers.least_points:
            return None
        apart = np.hypot(*(shifts[:, None] - shifts[None, :: numbers.group_stride]).transpose(2, 0, 1))
        near = apart < numbers.group_m
        middle = shifts[near[:, near.sum(axis=0).argmax()]].mean(axis=0)
        return np.asarray(np.r_[middle, prior[2:]], np.float64)

    def _solve(
        self,
        moved: Floats,
        usable: Mask,
        overlapping: int,
        start: Floats,
        prior: Floats,
        prior_sd: Floats,
    ) -> Motion | None:
        """Fit the motion to the points with Tukey weights, from a start near it."""
        numbers = self._parameters
        target = moved.T.reshape(-1)
        information = np.diag(1 / prior_sd**2)
        x, scale = start, numbers.group_m
        normal: Floats = information
        weight: Floats = usable.astype(np.float64)
        for _ in range(numbers.rounds):
            error = np.hypot(*np.asarray(target - self._design @ x, np.float64).reshape(2, -1))
            group = error[usable & (error < numbers.cut * scale)]
            if len(group) < numbers.least_points:
                return None
            scale = max(numbers.point_sd_m, 1.2 * float(np.median(group)))
            bent = np.clip(1 - (error / (numbers.cut * scale)) ** 2, 0.0, 1.0) ** 2
            weight = np.asarray(np.where(usable, bent, 0.0), np.float64)
            both = np.asarray(np.concatenate([weight, weight]) / scale**2, np.float64)
            normal = np.asarray(self._design.T @ (both[:, None] * self._design) + information, np.float64)
            pulled = self._design.T @ (both * target) + information @ prior
            x = np.asarray(np.linalg.solve(normal, pulled), np.float64)
        inliers = int((weight > numbers.inlier_weight).sum())
        if inliers < numbers.least_points or scale > numbers.most_scale_m:
            return None
        sd = np.sqrt(numbers.covariance_factor * np.diag(np.linalg.inv(normal)))
        return Motion(
            forward_m=float(x[0]),
            left_m=float(x[1]),
            turn_rad=float(x[2]),
            left_sd_m=float(sd[1]),
            turn_sd_rad=float(sd[2]),
            share=min(inliers / max(overlapping, 1), 1.0),
        )

    def _design_for(self, pixels: NDArray[np.float32]) -> Floats:
        """Return displacements of ground points (left of all, then behind) for unit motions."""
        rig = self._ground.rig
        (back, left), (origin_back, origin_left) = self._ground.to_patch(
            np.stack([rig.position_m, np.zeros(3)])
        )
        camera_x, camera_y, height = -back, left, rig.position_m[2]
        y = (pixels[:, 0] - self._ground.centre) * RESOLUTION_M
        x = -(pixels[:, 1] + 0.5) * RESOLUTION_M
        one, none = np.ones_like(y), np.zeros_like(y)
        # After small turns about the vehicle's origin a ground point (x, y) is pitch x - roll y above the
        # plane, and appears further away from the camera's foot by that share of the camera's height.
        roll, pitch = -(y - origin_left) / height, (x + origin_back) / height
        to_left = [none, -one, -x, (y - camera_y) * roll, (y - camera_y) * pitch]
        ahead = [-one, none, y, (x - camera_x) * roll, (x - camera_x) * pitch]
        return np.concatenate([np.stack(to_left, axis=1), -np.stack(ahead, axis=1)]).astype(np.float64)

    def _is_visible(self, pixels: Floats) -> Mask:
        place = np.round(pixels).astype(np.intp)
        rows, columns = self._seen.shape
        inside = (place >= 0).all(axis=1) & (place < (columns, rows)).all(axis=1)
        place = np.clip(place, 0, (columns - 1, rows - 1))
        return np.asarray(inside & self._seen[place[:, 1], place[:, 0]], np.bool_)
