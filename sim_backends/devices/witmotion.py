"""A WitMotion inertial sensor on its serial line.

Not modelled: temperature drift, scale and cross-axis errors, vibration, magnetic disturbances, magnetic
frames, coupling of tilt and turning in the x and y rates, and commands from the host, which are ignored.
"""

import math
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from drivers.clock import nanoseconds
from drivers.errors import ConfigError
from drivers.heading_calibration import Vector
from drivers.settings import Settings
from drivers.units import STANDARD_GRAVITY_M_S2
from drivers.witmotion.codec import (
    FRAME_SIZE,
    Mounting,
    encode_acceleration,
    encode_angle,
    encode_rate,
)
from drivers.witmotion.settings import WitMotionSettings
from sim_backends.world.line import Line, serial_bits
from sim_backends.world.plant import Plant, Truth
from sim_backends.world.sensor_errors import DirectionLag, standard_normals
from sim_backends.world.world import EmulatedDevice

FrameKind = Literal["acceleration", "rate", "angle"]


class ImuEmulatorSettings(Settings):
    """Errors of a low-cost inertial sensor.

    Attributes:
        rate_hz: Sets of frames per second.
        frames: Frames in each set; always sent in the order acceleration, rate, angle.
        gyro_bias_deg_s: Bias of each axis at the start.
        gyro_walk_deg_s: Standard deviation of the bias' random walk after one second.
        gyro_noise_deg_s: Standard deviation of the white noise of each rate.
        acceleration_noise_m_s2: Standard deviation of the white noise of each acceleration.
        angle_lag_s: Time constant of the device's own attitude filter, first order.
        angle_noise_deg: Standard deviation of the white noise of each angle.
        yaw_bias_deg: Constant error of the yaw, counter-clockwise.
    """

    type: Literal["witmotion"] = "witmotion"
    rate_hz: Annotated[float, Field(gt=0, le=200)] = 50.0
    frames: Annotated[tuple[FrameKind, ...], Field(min_length=1)] = ("rate", "angle")
    gyro_bias_deg_s: Annotated[float, Field(ge=-10, le=10)] = 0.15
    gyro_walk_deg_s: Annotated[float, Field(ge=0, le=10)] = 0.003
    gyro_noise_deg_s: Annotated[float, Field(ge=0, le=10)] = 0.08
    acceleration_noise_m_s2: Annotated[float, Field(ge=0, le=10)] = 0.03
    angle_lag_s: Annotated[float, Field(ge=0, le=10)] = 0.03
    angle_noise_deg: Annotated[float, Field(ge=0, le=10)] = 0.05
    yaw_bias_deg: Annotated[float, Field(ge=-90, le=90)] = 0.5


class ImuEmulator:
    """The sensor: measures and starts to send a set of frames every period.

    Args:
        settings: Errors of the sensor.
        mounting: Orientation on the rover.
        plant: Source of the true motion.
        to_host: Line to the host.
        rng: Source of the noise.
        start_ns: Time of power-on; the first set follows one period later.
    """

    def __init__(
        self,
        settings: ImuEmulatorSettings,
        mounting: Mounting,
        plant: Plant,
        to_host: Line[bytes],
        rng: np.random.Generator,
        start_ns: int,
    ) -> None:
        self._settings = settings
        self._to_sensor = Mounting(yaw_rad=-mounting.yaw_rad)
        self._yaw_offset_rad = math.radians(settings.yaw_bias_deg) - mounting.yaw_zero_rad
        self._plant = plant
        self._to_host = to_host
        self._noise = standard_normals(rng)
        self._period_s = 1.0 / settings.rate_hz
        self._period_ns = nanoseconds(self._period_s)
        self._gyro_noise_rad_s = math.radians(settings.gyro_noise_deg_s)
        self._walk_step_rad_s = math.radians(settings.gyro_walk_deg_s) * math.sqrt(self._period_s)
        self._angle_noise_rad = math.radians(settings.angle_noise_deg)
        self._bias_rad_s = [math.radians(settings.gyro_bias_deg_s)] * 3
        self._before = plant.truth()
        self._lags = [DirectionLag(settings.angle_lag_s, self._period_s) for _ in range(3)]
        for lag, angle_rad in zip(self._lags, _angles(self._before), strict=True):
            lag.settle(angle_rad)
        self.next_event_ns = start_ns + self._period_ns

    def act(self, t_ns: int) -> None:
        """Measure and start to send the frames."""
        self.next_event_ns += self._period_ns
        truth = self._plant.truth()
        frames = self._settings.frames
        burst = b""
        if "acceleration" in frames:
            burst += encode_acceleration(*self._acceleration(truth))
        if "rate" in frames:
            burst += encode_rate(*self._rate(truth))
        if "angle" in frames:
            burst += encode_angle(*self._angle(truth))
        self._to_host.put(t_ns, burst)
        self._before = truth

    def receive(self, t_ns: int, payload: bytes) -> None:
        """Ignore the payload."""

    def _acceleration(self, truth: Truth) -> Vector:
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

    def _rate(self, truth: Truth) -> Vector:
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

    def _angle(self, truth: Truth) -> Vector:
        roll, pitch, yaw = (lag.step(angle) for lag, angle in zip(self._lags, _angles(truth), strict=True))
        roll, pitch, yaw = self._to_sensor.attitude_to_rover(roll, pitch, yaw)
        scale, noise = self._angle_noise_rad, self._noise
        yaw += self._yaw_offset_rad
        return roll + scale * next(noise), pitch + scale * next(noise), yaw + scale * next(noise)


def make_imu(
    name: str,
    device: WitMotionSettings,
    emulator: ImuEmulatorSettings,
    plant: Plant,
    rng: np.random.Generator,
    start_ns: int,
) -> EmulatedDevice[bytes]:
    """Build the emulated sensor and its line, mounted as in the device's settings.

    Raises:
        ConfigError: The line is too slow for the rate.
    """
    required_bits_s = 10.0 * FRAME_SIZE * len(emulator.frames) * emulator.rate_hz
    if required_bits_s > device.baud_rate:
        raise ConfigError(
            f"simulated sensor '{name}' needs {required_bits_s:.0f} bit/s, its line has {device.baud_rate}: "
            "raise baud_rate, lower rate_hz or send fewer frames"
        )
    to_host = Line(serial_bits, device.baud_rate)
    to_device = Line(serial_bits, device.baud_rate)
    mounting = Mounting.from_degrees(device.mounting_yaw_deg, device.yaw_zero_deg)
    sensor = ImuEmulator(emulator, mounting, plant, to_host, rng, start_ns)
    return EmulatedDevice(name, sensor, to_host, to_device)


def _angles(truth: Truth) -> Vector:
    return truth.roll_rad, truth.pitch_rad, truth.yaw_rad
