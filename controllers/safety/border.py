"""The border of the rover's area in the control loop: how far over it the rover is, and what leads back."""

import cmath
import math

from controllers.estimation.pose_estimate import PoseEstimate
from controllers.motion.missions.mission import Guidance
from controllers.safety.area import Area, Excess
from controllers.safety.position_region import Region

INSIDE = Excess(-math.inf, 0j)
LEAST_INWARD = 0.05
"""A motion leads back inside where it approaches the inside by this share of its speed: 3 deg."""


class Border:
    """Measures how far the rover's region is over the border, and judges motions there.

    Args:
        area: What the rover must not leave; None for no limit.
        body_m: Radius of its body about its origin.
    """

    def __init__(self, area: Area | None, body_m: float) -> None:
        self._area, self._body_m = area, body_m
        self._excess = INSIDE
        self._yaw_rad = 0.0

    @property
    def over_m(self) -> float:
        """Greatest excess of the region at the last `measure` in m, negative inside."""
        return self._excess.over_m

    def measure(self, estimate: PoseEstimate) -> None:
        """Take the estimate of a cycle."""
        if self._area is not None:
            self._excess = self._area.excess(Region.of(estimate, self._body_m))
            self._yaw_rad = estimate.yaw_rad

    def is_crossed_by(self, guidance: Guidance) -> bool:
        """Return whether the region is over the border and a motion does not lead back inside.

        Rotation on the spot leads nowhere, and may be needed to drive back. Where the region is over several
        parts of the border, no motion may lead farther out over the others.
        """
        velocity = complex(guidance.velocity_x_m_s, guidance.velocity_y_m_s) * cmath.rect(1.0, self._yaw_rad)
        if self.over_m <= 0.0 or not velocity:
            return False
        greatest_m_s = _dot(velocity, self._excess.outward)
        return greatest_m_s > -LEAST_INWARD * abs(velocity) or any(
            _dot(velocity, outward) > 0.0 for outward in self._excess.others
        )


def _dot(one: complex, other: complex) -> float:
    return one.real * other.real + one.imag * other.imag
