"""Settings that all inertial sensors share: how they are mounted, and the errors of their gyro."""

import math
from typing import TYPE_CHECKING, Annotated

from pydantic import Field

from drivers.device_settings import SerialDeviceSettings

if TYPE_CHECKING:
    from drivers.mounting import Mounting


class InertialSettings(SerialDeviceSettings):
    """An inertial sensor on a serial port.

    The sensor is turned into the rover's axes first by roll, then by pitch, then by yaw. `rover-hil calibrate
    mounting` finds roll, pitch, scale and bias.

    Attributes:
        rate_hz: Yaw rates per second that the sensor is set to send. The rover stops where it sends others
            (`gyro_rate_s` of `[safety]`). None: they are not counted.
        mounting_yaw_deg: Direction of the sensor's x axis, counter-clockwise from the rover's forward axis,
            once roll and pitch have levelled it: 0 where x points forward.
        mounting_roll_deg: Turn about the sensor's x axis that levels it: 0 where its z axis points up (of a
            VectorNav, down), 180 where the sensor is upside down.
        mounting_pitch_deg: Turn about the y axis after that: 90 for a sensor whose x axis points down.
        gyro_scale: True yaw rate over the reading.
        gyro_bias_deg_s: Reading of the yaw rate at rest, after scaling; it is subtracted. The filter finds
            what is left at each start.
    """

    rate_hz: Annotated[float, Field(gt=0, le=2000)] | None = None
    mounting_yaw_deg: Annotated[float, Field(ge=-180, le=180)] = 0.0
    mounting_roll_deg: Annotated[float, Field(ge=-180, le=180)] = 0.0
    mounting_pitch_deg: Annotated[float, Field(ge=-90, le=90)] = 0.0
    gyro_scale: Annotated[float, Field(ge=0.5, le=2.0)] = 1.0
    gyro_bias_deg_s: Annotated[float, Field(ge=-20, le=20)] = 0.0

    def make_mounting(self, yaw_zero_deg: float = 0.0) -> "Mounting":
        """Return the mounting and the errors of the gyro, in rad."""
        from drivers.mounting import Mounting

        return Mounting(
            yaw_rad=math.radians(self.mounting_yaw_deg),
            yaw_zero_rad=math.radians(yaw_zero_deg),
            roll_rad=math.radians(self.mounting_roll_deg),
            pitch_rad=math.radians(self.mounting_pitch_deg),
            gyro_scale=self.gyro_scale,
            gyro_bias_rad_s=math.radians(self.gyro_bias_deg_s),
        )
