"""How an inertial sensor is mounted on the rover: its axes and angles turned into the rover's."""

import math
from dataclasses import dataclass
from typing import Self

from drivers.angles import wrap_rad
from drivers.heading_calibration import Vector


@dataclass(frozen=True, slots=True)
class Mounting:
    """Mounting of the sensor: turned by `yaw_rad` about z; its yaw counts from `yaw_zero_rad`."""

    yaw_rad: float = 0.0
    yaw_zero_rad: float = 0.0

    @classmethod
    def from_degrees(cls, yaw_deg: float, yaw_zero_deg: float) -> Self:
        """Convert from the units of the configuration."""
        return cls(math.radians(yaw_deg), math.radians(yaw_zero_deg))

    def vector_to_rover(self, vector: Vector) -> Vector:
        """Turn a vector from sensor axes to rover axes."""
        x, y, z = vector
        cosine, sine = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        return cosine * x - sine * y, sine * x + cosine * y, z

    def attitude_to_rover(self, roll_rad: float, pitch_rad: float, yaw_rad: float) -> Vector:
        """Turn the sensor's roll, pitch and yaw into the rover's, its yaw counted from magnetic east."""
        cos_roll, sin_roll = math.cos(roll_rad), math.sin(roll_rad)
        cos_pitch, sin_pitch = math.cos(pitch_rad), math.sin(pitch_rad)
        up = self.vector_to_rover((-sin_pitch, cos_pitch * sin_roll, cos_pitch * cos_roll))
        # The rover's forward axis in sensor axes, tilted to the horizontal plane that yaw turns in.
        ahead, left = math.cos(self.yaw_rad), -math.sin(self.yaw_rad)
        yaw_shift_rad = math.atan2(left * cos_roll, ahead * cos_pitch + left * sin_roll * sin_pitch)
        return (
            math.atan2(up[1], up[2]),
            -math.asin(max(-1.0, min(1.0, up[0]))),
            wrap_rad(yaw_rad + yaw_shift_rad + self.yaw_zero_rad),
        )
