"""A WitMotion inertial sensor on its serial line.

Not modelled: temperature drift, scale and cross-axis errors, vibration, magnetic disturbances of the ground,
coupling of tilt and turning in the x and y rates, and commands from the host, which are ignored.
"""

import math
import struct
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from drivers.angles import wrap_rad
from drivers.clock import nanoseconds
from drivers.errors import ConfigError
from drivers.units import STANDARD_GRAVITY_M_S2
from drivers.witmotion.codec import (
    FRAME_SIZE,
    LONG_FRAME_SIZE,
    encode_acceleration,
    encode_angle,
    encode_magnetic,
    encode_rate,
)
from drivers.witmotion.settings import WitMotionSettings
from sim_backends.world.fit import check_bit_rate
from sim_backends.world.inertial import InertialErrorSettings, InertialSensor
from sim_backends.world.line import Line, serial_bits
from sim_backends.world.plant import Plant, Truth
from sim_backends.world.sensor_errors import standard_normals
from sim_backends.world.world import EmulatedDevice

FrameKind = Literal["acceleration", "rate", "angle", "magnetic", "combined"]
Counts = Annotated[float, Field(ge=-30_000, le=30_000)]
Row = tuple[float, float, float]


class ImuEmulatorSettings(InertialErrorSettings):
    """Errors of a low-cost inertial sensor.

    Attributes:
        frames: Frames in each set; always sent in the order acceleration, rate, angle, magnetic.
            "combined" alone is the one frame of the Bluetooth models.
        field_counts: Horizontal part of the earth's field; the sensor counts about 10 per uT.
        dip_deg: Angle of the earth's field below the horizontal.
        hard_iron_counts: Field of the rover's magnets in the axes of the sensor.
        soft_iron: Rows of the matrix by which the rover's iron bends the earth's field.
        motor_field_counts_per_a: Field of each motor per ampere of its current, in the axes of the sensor.
        magnetic_noise_counts: Standard deviation of the white noise of each axis.
    """

    type: Literal["witmotion"] = "witmotion"
    frames: Annotated[tuple[FrameKind, ...], Field(min_length=1)] = ("rate", "angle")
    field_counts: Annotated[float, Field(gt=0, le=10_000)] = 200.0
    dip_deg: Annotated[float, Field(ge=-85, le=85)] = 65.0
    hard_iron_counts: tuple[Counts, Counts, Counts] = (60.0, -40.0, 20.0)
    soft_iron: tuple[Row, Row, Row] = ((1.05, 0.02, 0.0), (0.02, 0.96, 0.0), (0.0, 0.0, 1.0))
    motor_field_counts_per_a: tuple[tuple[Counts, Counts, Counts], ...] = ()
    magnetic_noise_counts: Annotated[float, Field(ge=0, le=1000)] = 4.0

    @model_validator(mode="after")
    def _check_frames(self) -> Self:
        if "combined" in self.frames and len(self.frames) > 1:
            raise ValueError('frames: "combined" holds acceleration, rate and angle; leave the others out')
        return self


class ImuEmulator:
    """The sensor: measures and starts to send a set of frames every period.

    Args:
        settings: Errors of the sensor.
        sensor: What it measures.
        plant: Source of the true motion.
        to_host: Line to the host.
        rng: Source of the magnetic noise.
        start_ns: Time of power-on; the first set follows one period later.
    """

    def __init__(
        self,
        settings: ImuEmulatorSettings,
        sensor: InertialSensor,
        plant: Plant,
        to_host: Line[bytes],
        rng: np.random.Generator,
        start_ns: int,
    ) -> None:
        self._settings = settings
        self._frames = settings.frames
        down = -settings.field_counts * math.tan(math.radians(settings.dip_deg))
        self._earth = (0.0, settings.field_counts, down)  # the world's y axis points to magnetic north
        self._noise = standard_normals(rng)
        self._sensor = sensor
        self._plant = plant
        self._to_host = to_host
        self._period_ns = nanoseconds(1.0 / settings.rate_hz)
        self.next_event_ns = start_ns + self._period_ns

    def act(self, t_ns: int) -> None:
        """Measure and start to send the frames."""
        self.next_event_ns += self._period_ns
        truth = self._plant.truth()
        sensor, frames = self._sensor, self._frames
        burst = b""
        if "acceleration" in frames:
            burst += encode_acceleration(*sensor.acceleration(truth))
        if "rate" in frames:
            burst += encode_rate(*sensor.rate(truth))
        if "angle" in frames:
            burst += encode_angle(*sensor.angle(truth))
        if "magnetic" in frames:
            burst += encode_magnetic(*self._magnetic(truth))
        if "combined" in frames:
            burst += _combined(sensor.acceleration(truth), sensor.rate(truth), sensor.angle(truth))
        self._to_host.put(t_ns, burst)
        sensor.remember(truth)

    def receive(self, t_ns: int, payload: bytes) -> None:
        """Ignore the payload."""

    def _magnetic(self, truth: Truth) -> Row:
        settings, noise = self._settings, self._noise
        field = self._sensor.direction(truth, self._earth)
        motors = settings.motor_field_counts_per_a
        x, y, z = (
            offset
            + sum(part * value for part, value in zip(row, field, strict=True))
            + sum(
                motor[axis] * current for motor, current in zip(motors, truth.motor_current_a, strict=False)
            )
            + settings.magnetic_noise_counts * next(noise)
            for axis, (row, offset) in enumerate(
                zip(settings.soft_iron, settings.hard_iron_counts, strict=True)
            )
        )
        return x, y, z


def _combined(acceleration: Row, rate: Row, angle: Row) -> bytes:
    """Return a frame of nine words: shares of 16 g, 2000 deg/s and 180 deg in steps of 1/32768."""
    words = [value / (16.0 * STANDARD_GRAVITY_M_S2) for value in acceleration]
    words += [value / math.radians(2000.0) for value in rate]
    words += [wrap_rad(value) / math.pi for value in angle]
    steps = [max(-32768, min(32767, round(32768 * word))) for word in words]
    return struct.pack("<BB9h", 0x55, 0x61, *steps)


def make_emulator(
    name: str,
    device: WitMotionSettings,
    emulator: ImuEmulatorSettings,
    plant: Plant,
    rng: np.random.Generator,
    start_ns: int,
) -> EmulatedDevice[bytes]:
    """Build the emulated sensor and its line, mounted as in the device's settings.

    Raises:
        ConfigError: The line is too slow for the rate, or the field is of another number of motors.
    """
    size = sum(LONG_FRAME_SIZE if frame == "combined" else FRAME_SIZE for frame in emulator.frames)
    required_bits_s = 10.0 * size * emulator.rate_hz
    fix = "raise baud_rate, lower rate_hz or send fewer frames"
    check_bit_rate(name, required_bits_s, device.baud_rate, fix)
    motors = len(emulator.motor_field_counts_per_a)
    if motors not in (0, plant.wheel_count):
        raise ConfigError(
            f"simulated sensor '{name}' has motor_field_counts_per_a of {motors} motors, the rover has "
            f"{plant.wheel_count}: give one row for each"
        )
    to_host = Line(serial_bits, device.baud_rate)
    to_device = Line(serial_bits, device.baud_rate)
    mounting = device.make_mounting(device.yaw_zero_deg)
    sensor = InertialSensor(emulator, mounting, plant, rng)
    magnetic_rng = np.random.default_rng(rng.integers(2**63)) if "magnetic" in emulator.frames else rng
    imu = ImuEmulator(emulator, sensor, plant, to_host, magnetic_rng, start_ns)
    return EmulatedDevice(name, imu, to_host, to_device)
