"""What an inertial sensor measures on a simulated rover, with the errors that all of them share.

Not modelled: temperature drift, scale and cross-axis errors, vibration, magnetic disturbances, and coupling
of tilt and turning in the x and y rates.
"""

import math
from typing import Annotated

import numpy as np
from pydantic import Field

from drivers.heading_calibration import Vector
from drivers.mounting import Mounting
from drivers.settings import Settings
from drivers.units import STANDARD_GRAVITY_M_S2
from sim_backends.world.plant import Plant, Truth
from sim_backends.world.sensor_errors import DirectionLag, standard_normals


class InertialErrorSettings(Settings):
    """Errors of an inertial sensor.

    Attributes:
        rate_hz: Sets of measurements per second.
        gyro_bias_deg_s: Bias of each axis at the start.
        gyro_walk_deg_s: Standard deviation of the bias' random walk after one second.
        gyro_noise_deg_s: Standard deviation of the white noise of each rate.
        acceleration_noise_m_s2: Standard deviation of the white noise of each acceleration.
        angle_lag_s: Time constant of the device's own attitude filter, first order.
        angle_noise_deg: Standard deviation of the white noise of each angle.
        yaw_bias_deg: Constant error of the yaw, counter-clockwise.
    """

    rate_hz: Annotated[float, Field(gt=0, le=200)] = 50.0
    gyro_bias_deg_s: Annotated[float, Field(ge=-10, le=10)] = 0.15
    gyro_walk_deg_s: Annotated[float, Field(ge=0, le=10)] = 0.003
    gyro_noise_deg_s: Annotated[float, Field(ge=0, le=10)] = 0.08
    acceleration_noise_m_s2: Annotated[float, Field(ge=0, le=10)] = 0.03
    angle_lag_s: Annotated[float, Field(ge=0, le=10)] = 0.03
    angle_noise_deg: Annotated[float, Field(ge=0, le=10)] = 0.05
    yaw_bias_deg: Annotated[float, Field(ge=-90, le=90)] = 0.5


class InertialSensor:
    """Measures in the axes of its case: x forward, y left, z up; yaw counter-clockwise from its own zero.

    Args:
        settings: Errors of the sensor.
        mounting: Orientation on the rover.
        plant: Source of the true motion.
        rng: Source of the noise.
    """

    def __init__(
        self, settings: InertialErrorSettings, mounting: Mounting, plant: Plant, rng: np.random.Generator
    ) -> None:
        self._settings = settings
        self._to_sensor = Mounting(yaw_rad=-mounting.yaw_rad)
        self._yaw_offset_rad = math.radians(settings.yaw_bias_deg) - mounting.yaw_zero_rad
        self._noise = standard_normals(rng)
        self._period_s = 1.0 / settings.rate_hz
        self._gyro_noise_rad_s = math.radians(settings.gyro_noise_deg_s)
        self._walk_step_rad_s = math.radians(settings.gyro_walk_deg_s) * math.sqrt(self._period_s)
        self._angle_noise_rad = math.radians(settings.angle_noise_deg)
        self._bias_rad_s = [math.radians(settings.gyro_bias_deg_s)] * 3
        self._before = plant.truth()
        self._lags = [DirectionLag(settings.angle_lag_s, self._period_s) for _ in range(3)]
        for lag, angle_rad in zip(self._lags, _angles(self._before), strict=True):
            lag.settle(angle_rad)

    def remember(self, truth: Truth) -> None:
        """End the period at `truth`; call it once after the measurements of each period."""
        self._before = truth

    def acceleration(self, truth: Truth) -> Vector:
        """Return the specific force in m/s2 at the end of the period."""
        before = self._before
        change_x_m_s2 = (truth.velocity_x_m_s - before.velocity_x_m_s) / self._period_s
        change_y_m_s2 = (truth.velocity_y_m_s - before.velocity_y_m_s) / self._period_s
        cos_pitch = math.cos(truth.pitch_rad)
        x, y, z = self._to_sensor.vector_to_rover(
            (
                change_x_m_s2
                - truth.yaw_rate_rad_s * truth.velocity_y_m_s
                - STANDARD_GRAVITY_M_S2 * math.sin(truth.pitch_rad),
                change_y_m_s2
                + truth.yaw_rate_rad_s * truth.velocity_x_m_s
                + STANDARD_GRAVITY_M_S2 * cos_pitch * math.sin(truth.roll_rad),
                STANDARD_GRAVITY_M_S2 * cos_pitch * math.cos(truth.roll_rad),
            )
        )
        scale, noise = self._settings.acceleration_noise_m_s2, self._noise
        return x + scale * next(noise), y + scale * next(noise), z + scale * next(noise)

    def rate(self, truth: Truth) -> Vector:
        """Return the angular rates in rad/s; the bias walks by one period."""
        noise, bias = self._noise, self._bias_rad_s
        for axis in range(3):
            bias[axis] += self._walk_step_rad_s * next(noise)
        x, y, z = self._to_sensor.vector_to_rover(
            (
                (truth.roll_rad - self._before.roll_rad) / self._period_s,
                (truth.pitch_rad - self._before.pitch_rad) / self._period_s,
                truth.yaw_rate_rad_s,
            )
        )
        scale = self._gyro_noise_rad_s
        return (
            x + bias[0] + scale * next(noise),
            y + bias[1] + scale * next(noise),
            z + bias[2] + scale * next(noise),
        )

    def direction(self, truth: Truth, vector: Vector) -> Vector:
        """Return a vector of the world, z up, in the axes of the sensor; without noise."""
        x, y, z = vector
        cosine, sine = math.cos(truth.yaw_rad), math.sin(truth.yaw_rad)
        x, y = cosine * x + sine * y, cosine * y - sine * x
        cosine, sine = math.cos(truth.pitch_rad), math.sin(truth.pitch_rad)
        x, z = cosine * x - sine * z, cosine * z + sine * x
        cosine, sine = math.cos(truth.roll_rad), math.sin(truth.roll_rad)
        y, z = cosine * y + sine * z, cosine * z - sine * y
        return self._to_sensor.vector_to_rover((x, y, z))

    def angle(self, truth: Truth) -> Vector:
        """Return roll, pitch (nose down positive) and yaw in rad; the lag moves on by one period."""
        roll, pitch, yaw = (lag.step(angle) for lag, angle in zip(self._lags, _angles(truth), strict=True))
        roll, pitch, yaw = self._to_sensor.attitude_to_rover(roll, pitch, yaw)
        scale, noise = self._angle_noise_rad, self._noise
        yaw += self._yaw_offset_rad
        return roll + scale * next(noise), pitch + scale * next(noise), yaw + scale * next(noise)


def _angles(truth: Truth) -> Vector:
    return truth.roll_rad, truth.pitch_rad, truth.yaw_rad
