"""What an inertial sensor measures on a simulated rover, with the errors that all of them share.

Not modelled: temperature drift, cross-axis errors, vibration, magnetic disturbances, and coupling
of tilt and turning in the x and y rates.
"""

import math
from collections import deque
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from drivers.heading_calibration import Vector
from drivers.mounting import Mounting
from drivers.settings import Settings
from drivers.units import STANDARD_GRAVITY_M_S2
from sim_backends.world.plant import Plant, Truth
from sim_backends.world.sensor_errors import DirectionLag, standard_normals

Matrix = NDArray[np.float64]


class InertialErrorSettings(Settings):
    """Errors of an inertial sensor.

    Attributes:
        rate_hz: Sets of measurements per second.
        gyro_bias_deg_s: Bias of each axis at the start.
        gyro_walk_deg_s: Standard deviation of the bias' random walk after one second.
        gyro_noise_deg_s: Standard deviation of the white noise of each rate.
        rate_delay_s: By how much the rates are late.
        acceleration_noise_m_s2: Standard deviation of the white noise of each acceleration.
        angle_lag_s: Time constant of the device's own attitude filter, first order.
        angle_noise_deg: Standard deviation of the white noise of each angle.
        yaw_bias_deg: Constant error of the yaw, counter-clockwise.
        mounting_roll_deg: True roll of the mounting, as of the device's settings; None: as stated there.
        mounting_pitch_deg: True pitch of the mounting, likewise.
        gyro_scale: True yaw rate over the reading; None: as stated there.
    """

    rate_hz: Annotated[float, Field(gt=0, le=200)] = 50.0
    gyro_bias_deg_s: Annotated[float, Field(ge=-10, le=10)] = 0.15
    gyro_walk_deg_s: Annotated[float, Field(ge=0, le=10)] = 0.003
    gyro_noise_deg_s: Annotated[float, Field(ge=0, le=10)] = 0.08
    rate_delay_s: Annotated[float, Field(ge=0, le=1)] = 0.0
    acceleration_noise_m_s2: Annotated[float, Field(ge=0, le=10)] = 0.03
    angle_lag_s: Annotated[float, Field(ge=0, le=10)] = 0.03
    angle_noise_deg: Annotated[float, Field(ge=0, le=10)] = 0.05
    yaw_bias_deg: Annotated[float, Field(ge=-90, le=90)] = 0.5
    mounting_roll_deg: Annotated[float, Field(ge=-180, le=180)] | None = None
    mounting_pitch_deg: Annotated[float, Field(ge=-90, le=90)] | None = None
    gyro_scale: Annotated[float, Field(ge=0.5, le=2.0)] | None = None


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
        roll_deg, pitch_deg = settings.mounting_roll_deg, settings.mounting_pitch_deg
        roll_rad = mounting.roll_rad if roll_deg is None else math.radians(roll_deg)
        pitch_rad = mounting.pitch_rad if pitch_deg is None else math.radians(pitch_deg)
        self._to_sensor = _Turn(mounting.yaw_rad, pitch_rad, roll_rad)
        self._gyro_scale = mounting.gyro_scale if settings.gyro_scale is None else settings.gyro_scale
        self._yaw_offset_rad = math.radians(settings.yaw_bias_deg) - mounting.yaw_zero_rad
        self._noise = standard_normals(rng)
        self._period_s = 1.0 / settings.rate_hz
        self._gyro_noise_rad_s = math.radians(settings.gyro_noise_deg_s)
        self._walk_step_rad_s = math.radians(settings.gyro_walk_deg_s) * math.sqrt(self._period_s)
        self._angle_noise_rad = math.radians(settings.angle_noise_deg)
        self._bias_rad_s = [math.radians(settings.gyro_bias_deg_s)] * 3
        self._late = _Delay(settings.rate_delay_s / self._period_s)
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
        x, y, z = self._to_sensor.vector(
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
        roll_rate, pitch_rate, yaw_rate = (
            (now - before) / self._period_s
            for now, before in zip(_angles(truth), _angles(self._before), strict=True)
        )
        # On an inclined plane roll and pitch change as the rover turns, and it rotates about one axis only.
        cos_pitch, sin_roll = math.cos(truth.pitch_rad), math.sin(truth.roll_rad)
        x, y, z = self._to_sensor.vector(
            (
                roll_rate - yaw_rate * math.sin(truth.pitch_rad),
                pitch_rate * math.cos(truth.roll_rad) + yaw_rate * cos_pitch * sin_roll,
                truth.yaw_rate_rad_s,
            )
        )
        x, y, z = self._late.step((x / self._gyro_scale, y / self._gyro_scale, z / self._gyro_scale))
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
        return self._to_sensor.vector((x, y, z))

    def angle(self, truth: Truth) -> Vector:
        """Return roll, pitch (nose down positive) and yaw in rad; the lag moves on by one period."""
        roll, pitch, yaw = (lag.step(angle) for lag, angle in zip(self._lags, _angles(truth), strict=True))
        roll, pitch, yaw = self._to_sensor.attitude(roll, pitch, yaw)
        scale, noise = self._angle_noise_rad, self._noise
        yaw += self._yaw_offset_rad
        return roll + scale * next(noise), pitch + scale * next(noise), yaw + scale * next(noise)


def _angles(truth: Truth) -> Vector:
    return truth.roll_rad, truth.pitch_rad, truth.yaw_rad


class _Delay:
    """Delays a vector by a number of periods, between two of them in proportion; it was at rest before."""

    def __init__(self, periods: float) -> None:
        whole = math.floor(periods)
        self._share = periods - whole
        self._past: deque[Vector] = deque([(0.0, 0.0, 0.0)] * (whole + 2), maxlen=whole + 2)

    def step(self, vector: Vector) -> Vector:
        """Return the delayed vector, one period after the last step."""
        self._past.append(vector)
        if not self._share:
            return self._past[1]
        earlier, later = self._past[0], self._past[1]
        x, y, z = (b + self._share * (a - b) for a, b in zip(earlier, later, strict=True))
        return x, y, z


class _Turn:
    """Turns what belongs to the rover into the axes of a sensor: back by yaw, then pitch, then roll."""

    def __init__(self, yaw_rad: float, pitch_rad: float, roll_rad: float) -> None:
        self._level = Mounting(yaw_rad=-yaw_rad)
        self._is_tilted = bool(pitch_rad or roll_rad)
        # Rows are the axes of the sensor in the rover's.
        self._to_sensor = (_about_z(yaw_rad) @ _about_y(pitch_rad) @ _about_x(roll_rad)).T

    def vector(self, vector: Vector) -> Vector:
        """Return a vector in the axes of the sensor."""
        if not self._is_tilted:
            return self._level.vector_to_rover(vector)
        x, y, z = (self._to_sensor @ np.array(vector)).tolist()
        return x, y, z

    def attitude(self, roll_rad: float, pitch_rad: float, yaw_rad: float) -> Vector:
        """Return roll, pitch and yaw of the sensor."""
        if not self._is_tilted:
            return self._level.attitude_to_rover(roll_rad, pitch_rad, yaw_rad)
        rover = _about_z(yaw_rad) @ _about_y(pitch_rad) @ _about_x(roll_rad)
        axes = rover @ self._to_sensor.T
        return (
            math.atan2(axes[2, 1], axes[2, 2]),
            -math.asin(max(-1.0, min(1.0, float(axes[2, 0])))),
            math.atan2(axes[1, 0], axes[0, 0]),
        )


def _about_x(angle_rad: float) -> Matrix:
    cosine, sine = math.cos(angle_rad), math.sin(angle_rad)
    return np.array([[1.0, 0.0, 0.0], [0.0, cosine, -sine], [0.0, sine, cosine]])


def _about_y(angle_rad: float) -> Matrix:
    cosine, sine = math.cos(angle_rad), math.sin(angle_rad)
    return np.array([[cosine, 0.0, sine], [0.0, 1.0, 0.0], [-sine, 0.0, cosine]])


def _about_z(angle_rad: float) -> Matrix:
    cosine, sine = math.cos(angle_rad), math.sin(angle_rad)
    return np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
