"""How an inertial sensor is mounted on the rover: its axes and angles turned into the rover's."""

import math
from dataclasses import dataclass

from drivers.angles import wrap_rad
from drivers.heading_calibration import Vector


@dataclass(frozen=True, slots=True)
class Mounting:
    """Mounting of the sensor: turned by roll about x, then by pitch about y, then by yaw about z.

    Its yaw counts from `yaw_zero_rad`. Its yaw rate is scaled by `gyro_scale`, and less `gyro_bias_rad_s`.
    """

    yaw_rad: float = 0.0
    yaw_zero_rad: float = 0.0
    roll_rad: float = 0.0
    pitch_rad: float = 0.0
    gyro_scale: float = 1.0
    gyro_bias_rad_s: float = 0.0

    def vector_to_rover(self, vector: Vector) -> Vector:
        """Turn a vector from sensor axes to rover axes."""
        x, y, z = self._levelled(vector)
        cosine, sine = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        return cosine * x - sine * y, sine * x + cosine * y, z

    def correct_rate(self, rate_rad_s: Vector) -> Vector:
        """Return angular rates in rover axes without scale and bias of the gyro."""
        x, y, z = rate_rad_s
        return self.gyro_scale * x, self.gyro_scale * y, self.gyro_scale * z - self.gyro_bias_rad_s

    def attitude_to_rover(self, roll_rad: float, pitch_rad: float, yaw_rad: float) -> Vector:
        """Turn the sensor's roll, pitch and yaw into the rover's, its yaw counted from magnetic east."""
        cos_roll, sin_roll = math.cos(roll_rad), math.sin(roll_rad)
        cos_pitch, sin_pitch = math.cos(pitch_rad), math.sin(pitch_rad)
        up = self.vector_to_rover((-sin_pitch, cos_pitch * sin_roll, cos_pitch * cos_roll))
        # The rover's forward axis in sensor axes, tilted to the horizontal plane that yaw turns in.
        ahead, left, above = self._forward()
        across = ahead * cos_pitch + (left * sin_roll + above * cos_roll) * sin_pitch
        yaw_shift_rad = math.atan2(left * cos_roll - above * sin_roll, across)
        return (
            math.atan2(up[1], up[2]),
            -math.asin(max(-1.0, min(1.0, up[0]))),
            wrap_rad(yaw_rad + yaw_shift_rad + self.yaw_zero_rad),
        )

    def _levelled(self, vector: Vector) -> Vector:
        if not self.roll_rad and not self.pitch_rad:
            return vector
        x, y, z = vector
        cosine, sine = math.cos(self.roll_rad), math.sin(self.roll_rad)
        y, z = cosine * y - sine * z, sine * y + cosine * z
        cosine, sine = math.cos(self.pitch_rad), math.sin(self.pitch_rad)
        return cosine * x + sine * z, y, cosine * z - sine * x

    def _forward(self) -> Vector:
        """Return the rover's forward axis in sensor axes."""
        ahead, left = math.cos(self.yaw_rad), -math.sin(self.yaw_rad)
        if not self.roll_rad and not self.pitch_rad:
            return ahead, left, 0.0
        cos_roll, sin_roll = math.cos(self.roll_rad), math.sin(self.roll_rad)
        x, z = math.cos(self.pitch_rad) * ahead, math.sin(self.pitch_rad) * ahead
        return x, cos_roll * left + sin_roll * z, cos_roll * z - sin_roll * left
