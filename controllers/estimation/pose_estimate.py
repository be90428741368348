"""The estimated motion, and where its yaw comes from."""

import math
from enum import StrEnum

from drivers.record import record


class YawSource(StrEnum):
    """Source of the yaw: the gyro, or the wheels at standstill and while there is no fresh gyro."""

    GYRO = "gyro"
    WHEELS = "wheels"


@record(frozen=True, slots=True, kw_only=True)
class PoseEstimate:
    """The estimated motion in the local frame: origin and x axis are the pose at start, y to the left.

    Attributes:
        t_ns: Time of the wheel positions that the position is based on. The yaw is that of the newest reading
            of gyro or wheels.
        velocity_x_m_s: In the body frame, as are `velocity_y_m_s` and `yaw_rate_rad_s`.
        gyro_bias_rad_s: Reading of the gyro at standstill.
        covariance: Upper triangle over (x, y, yaw) by rows: xx, xy, x yaw, yy, y yaw, yaw yaw. Of the pose in
            the cycle: it contains the travel since `t_ns`.
        yaw_source: Source of the last turn.
    """

    t_ns: int
    x_m: float
    y_m: float
    yaw_rad: float
    velocity_x_m_s: float
    velocity_y_m_s: float
    yaw_rate_rad_s: float
    gyro_bias_rad_s: float
    covariance: tuple[float, float, float, float, float, float]
    yaw_source: YawSource

    @property
    def is_finite(self) -> bool:
        """Return whether every number is finite."""
        return math.isfinite(
            self.x_m
            + self.y_m
            + self.yaw_rad
            + self.velocity_x_m_s
            + self.velocity_y_m_s
            + self.yaw_rate_rad_s
            + self.gyro_bias_rad_s
            + sum(self.covariance)
        )
