"""The ground's direction on several headings: an angle that is the same on all is that of the mounting."""

import math

import numpy as np

from controllers.ground_motion.ground_patch import Floats
from controllers.ground_motion.parameters import MountingParameters

LEAST_DETERMINANT = 1e-12
"""Of the sums over blocks, over the cube of their number: below, the headings are one."""


class HeadingDrifts:
    """Fits the angle from the direction that the wheels have to that of the ground's motion.

        angle = yaw + a cos(heading) + b sin(heading)

    A rover that drifts on a slope looks like a camera that is turned in yaw, but its drift goes with the sine
    of the angle from the line of fall. Least squares over blocks of travel part the two: on one heading, or
    where the rover drifts irregularly, the yaw is uncertain.

    Args:
        yaw_sd_deg: Standard deviation of the camera's yaw, by its rig.
        parameters: Tuned numbers.
    """

    def __init__(self, yaw_sd_deg: float, parameters: MountingParameters) -> None:
        self._yaw_sd_deg, self._numbers = yaw_sd_deg, parameters
        self._heading_rad = self._weighted_rad = 0.0
        self._block_m = 0j
        self._normal: Floats = np.zeros((3, 3))
        self._angles: Floats = np.zeros(3)
        self._squares = 0.0
        self._is_confirmed = False
        self.text = ""

    @property
    def sd_rad(self) -> float:
        """Standard deviation of the camera's yaw, after what was seen."""
        confirmed_deg = self._numbers.least_yaw_deg / 2.0 if self._is_confirmed else math.inf
        return math.radians(min(self._yaw_sd_deg, confirmed_deg))

    def rotate(self, turn_rad: float) -> None:
        """Take a rotation by the gyro."""
        self._heading_rad += turn_rad

    def add(self, drift_m: complex) -> None:
        """Take a motion of the ground ahead, and to the left beyond that of the wheels as imaginary part."""
        self._block_m += drift_m
        self._weighted_rad += self._heading_rad * drift_m.real
        ahead_m = self._block_m.real
        if ahead_m < self._numbers.block_m:
            return
        angle_rad, heading_rad = math.atan2(self._block_m.imag, ahead_m), self._weighted_rad / ahead_m
        row = np.array([1.0, math.cos(heading_rad), math.sin(heading_rad)])
        kept = math.exp(-ahead_m / self._numbers.memory_m)
        self._normal = kept * self._normal + np.outer(row, row)
        self._angles = kept * self._angles + angle_rad * row
        self._squares = kept * self._squares + angle_rad**2
        self._block_m, self._weighted_rad = 0j, 0.0
        self._judge()

    def _judge(self) -> None:
        """Compare the yaw with zero, and with what a slope does."""
        numbers = self._numbers
        yaw_deg, sd_deg = (math.degrees(each) for each in self._yaw())
        self._is_confirmed |= abs(yaw_deg) + CONFIRMS_SD * sd_deg < numbers.least_yaw_deg
        mean_deg = math.degrees(self._angles[0] / self._normal[0, 0])
        is_common = yaw_deg / mean_deg > COMMON_SHARE if mean_deg else False
        self.text = ""
        # On nearly one heading the fit has any yaw: it must be known better than the least that counts.
        is_known = sd_deg < numbers.least_yaw_deg
        is_known &= abs(yaw_deg) > numbers.deviations * sd_deg
        if is_common and is_known and abs(mean_deg) >= numbers.least_yaw_deg:
            self.text = (
                f"ground moves {mean_deg:+.1f} deg aside on all headings: check the yaw of the camera's "
                "mounting, and that the pictures are not mirrored"
            )

    def _yaw(self) -> tuple[float, float]:
        """Return the angle that is the same on all headings, and its standard deviation."""
        first, second, third = self._normal
        inverse = np.stack([np.cross(second, third), np.cross(third, first), np.cross(first, second)], axis=1)
        determinant, count = float((first * inverse[:, 0]).sum()), float(first[0])
        if count < self._numbers.least_blocks or determinant <= LEAST_DETERMINANT * count**3:
            return 0.0, math.inf
        inverse /= determinant
        fitted = (inverse * self._angles).sum(axis=1)
        left = max(self._squares - float((fitted * self._angles).sum()), 0.0) / (count - 3.0)
        return float(fitted[0]), math.sqrt(left * float(inverse[0, 0]))


COMMON_SHARE = 0.5
"""Of the mean angle, that is the same on all headings: the drift on a slope is not quite a sine."""
CONFIRMS_SD = 2.0
"""The yaw is confirmed where it is below the least that counts by so many standard deviations."""
