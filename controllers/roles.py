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
        fixes: Their fixes correct the pose. They may be sparse, so they need not be required.
        camera: Looks back at the trace of the rear left wheel. Without it the estimate is less sure, not
            wrong, so it need not be required.
    """

    wheels: str
    required: Mapping[str, float]
    gyro: str | None = None
    headings: tuple[str, ...] = ()
    fixes: tuple[str, ...] = ()
    camera: str | None = None

    @property
    def motion_age_s(self) -> float:
        """How long the motion may be unknown: twice the wheels' age limit, as they report one by one."""
        return 2.0 * self.max_age_s(self.wheels)

    def max_age_s(self, device: str | None) -> float:
        """Return how old the newest sample of a device may be; for one that is not required, 0.15 s."""
        return self.required.get(device or "", 0.15)
