"""Which device plays which part for the controller."""

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class DeviceRoles:
    """Names of devices by what the controller takes from them; samples of others do not move the estimate.

    Attributes:
        wheels: Its wheel positions make the odometry.
        required: Devices without which the rover must not move, and the greatest age in s of their newest
            sample. The wheel device must give a position of every wheel, the gyro a rate, a heading device
            a heading, any other device anything.
        gyro: Its yaw rate turns the estimate.
        headings: Their headings correct the yaw.
    """

    wheels: str
    required: Mapping[str, float]
    gyro: str | None = None
    headings: tuple[str, ...] = ()
