"""The ground's direction on several headings: an angle that is the same on all is that of the mounting."""

import math
from collections.abc import Iterator, Sequence

from controllers.ground_motion.parameters import MountingParameters
from controllers.ground_motion.slope import Slope


class HeadingDrifts:
    """Sums up, by heading, the angle from the direction that the wheels have to that of the ground's motion.

    A rover that drifts on a slope looks like a camera that is turned in yaw: an angle is reported only where
    it is the same on three headings next to each other, and the yaw is confirmed by three without an angle.

    Args:
        yaw_sd_deg: Standard deviation of the camera's yaw, by its rig.
        parameters: Tuned numbers.
    """

    def __init__(self, yaw_sd_deg: float, parameters: MountingParameters) -> None:
        self._yaw_sd_deg, self._numbers = yaw_sd_deg, parameters
        self._drifts = [Slope() for _ in range(round(360.0 / parameters.heading_deg))]
        self._heading_rad = 0.0
        self._is_confirmed = False

    @property
    def sd_rad(self) -> float:
        """Standard deviation of the camera's yaw, after what was seen."""
        confirmed_deg = self._numbers.least_yaw_deg / 2.0 if self._is_confirmed else math.inf
        return math.radians(min(self._yaw_sd_deg, confirmed_deg))

    @property
    def text(self) -> str:
        """The angle of neighbouring headings that all agree; "" where they do not."""
        for degrees in self._neighbours_deg():
            if mean_deg := self._common_deg(degrees):
                return (
                    f"ground moves {mean_deg:+.1f} deg aside on all headings: check the yaw of the camera's "
                    "mounting, and that the pictures are not mirrored"
                )
        return ""

    def rotate(self, turn_rad: float) -> None:
        """Take a rotation by the gyro."""
        self._heading_rad += turn_rad

    def add(self, drift_m: complex) -> None:
        """Take a motion ahead of the ground, from the direction of the wheels: along it, left imaginary."""
        width_rad = math.radians(self._numbers.heading_deg)
        slope = self._drifts[math.floor(self._heading_rad / width_rad) % len(self._drifts)]
        slope.fade(math.exp(-abs(drift_m.real) / self._numbers.memory_m))
        slope.add(drift_m.real, drift_m.imag)
        self._is_confirmed |= any(
            max(map(abs, degrees)) < self._numbers.least_yaw_deg for degrees in self._neighbours_deg()
        )

    def _neighbours_deg(self) -> Iterator[list[float]]:
        """Yield the angles on neighbouring headings, where the rover has driven far enough on each."""
        numbers, count = self._numbers, len(self._drifts)
        for first in range(count):
            near = [self._drifts[(first + step) % count] for step in range(numbers.headings)]
            if min(each.length for each in near) >= numbers.least_travel_m:
                yield [math.degrees(math.atan(each.slope)) for each in near]

    def _common_deg(self, degrees: Sequence[float]) -> float:
        mean_deg = sum(degrees) / len(degrees)
        is_alike = max(degrees) - min(degrees) < self._numbers.alike * abs(mean_deg)
        return mean_deg if is_alike and abs(mean_deg) >= self._numbers.least_yaw_deg else 0.0
