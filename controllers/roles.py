"""Roles of the devices in the controller."""

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class DeviceRoles:
    """Names of devices by role; samples of other devices have no effect on the estimate.

    Attributes:
        wheels: Measures the wheel positions for the odometry.
        required: Devices without which the rover must not move, and the greatest age in s of their newest
            sample: for the wheel device a position of every wheel, for the gyro a rate, for a heading device
            a heading, for any other device any sample.
        gyro: Measures the yaw rate.
        headings: Measure headings, which correct the yaw.
        fixes: Measure poses. They may be sparse, so they need not be required.
        camera: Looks back at the trace of the rear left wheel. Without it the estimate is less certain, not
            wrong, so it need not be required.
        gyro_rate_hz: Yaw rates per second that the gyro is set to send; None where it is unknown.
        wheel_age_s: Age of the wheels' positions at their time stamp; None where it is unknown.
        wheel_wraps_rad: Angle after which the position of each wheel wraps in its device, inf for never, None
            where it is unknown; empty where all are.
        unmeasured_wheels: Wheels without an encoder.
        undriven_wheels: Wheels that no motor turns.
        supplies: Devices that report their supply voltage.
    """

    wheels: str
    required: Mapping[str, float]
    gyro: str | None = None
    headings: tuple[str, ...] = ()
    fixes: tuple[str, ...] = ()
    camera: str | None = None
    gyro_rate_hz: float | None = None
    wheel_age_s: float | None = None
    wheel_wraps_rad: tuple[float | None, ...] = ()
    unmeasured_wheels: frozenset[int] = frozenset()
    undriven_wheels: frozenset[int] = frozenset()
    supplies: tuple[str, ...] = ()

    @property
    def motion_age_s(self) -> float:
        """Greatest time with unknown motion: twice the wheels' age limit, as they report one by one."""
        return 2.0 * self.max_age_s(self.wheels)

    def max_age_s(self, device: str | None) -> float:
        """Return the greatest age of a device's newest sample; 0.15 s for one that is not required."""
        return self.required.get(device or "", 0.15)
