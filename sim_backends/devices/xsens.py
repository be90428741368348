"""An Xsens MTi sensor that sends MTData2 messages on its serial line.

The bytes are written here, apart from the driver: packet counter, fine sample time, quaternion in the
east-north-up frame, acceleration, rate of turn, status. The world's y axis points to north.

Not modelled: what `sim_backends/world/inertial.py` lists, the magnetic field, clipping, a filter that is not
valid, other number formats and frames, and commands from the host, which are ignored.

Source: Xsens MT Low-Level Communication Protocol (MT0101P), MTData2.
"""

import math
import struct
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from drivers.clock import nanoseconds
from drivers.heading_calibration import Vector
from drivers.xsens.settings import XsensSettings
from sim_backends.world.fit import check_bit_rate
from sim_backends.world.inertial import InertialErrorSettings, InertialSensor
from sim_backends.world.line import Line, serial_bits
from sim_backends.world.plant import Plant
from sim_backends.world.world import EmulatedDevice

ItemKind = Literal["quaternion", "acceleration", "rate"]
ITEM_SIZES: dict[ItemKind, int] = {"quaternion": 19, "acceleration": 15, "rate": 15}
FIXED_SIZE = 24
"""Bytes of header, packet counter, time, status and sum."""


class XsensEmulatorSettings(InertialErrorSettings):
    """Errors of an industrial inertial sensor.

    Attributes:
        rate_hz: Messages per second.
        content: Items of each message besides counter, time and status.
    """

    type: Literal["xsens"] = "xsens"
    rate_hz: Annotated[float, Field(gt=0, le=200)] = 100.0
    gyro_bias_deg_s: Annotated[float, Field(ge=-10, le=10)] = 0.05
    gyro_walk_deg_s: Annotated[float, Field(ge=0, le=10)] = 0.001
    gyro_noise_deg_s: Annotated[float, Field(ge=0, le=10)] = 0.1
    content: Annotated[tuple[ItemKind, ...], Field(min_length=1)] = ("quaternion", "acceleration", "rate")


class XsensEmulator:
    """The sensor: measures and starts to send a message every period.

    Args:
        settings: Errors of the sensor.
        sensor: What it measures.
        plant: Source of the true motion.
        to_host: Line to the host.
        start_ns: Time of power-on; the first message follows one period later.
    """

    def __init__(
        self,
        settings: XsensEmulatorSettings,
        sensor: InertialSensor,
        plant: Plant,
        to_host: Line[bytes],
        start_ns: int,
    ) -> None:
        self._content = settings.content
        self._sensor = sensor
        self._plant = plant
        self._to_host = to_host
        self._start_ns = start_ns
        self._period_ns = nanoseconds(1.0 / settings.rate_hz)
        self._count = 0
        self.next_event_ns = start_ns + self._period_ns

    def act(self, t_ns: int) -> None:
        """Measure and start to send the message."""
        self.next_event_ns += self._period_ns
        truth = self._plant.truth()
        ticks = (t_ns - self._start_ns) // 100_000 % 2**32
        data = struct.pack(">HBHHBI", 0x1020, 2, self._count % 65536, 0x1060, 4, ticks)
        self._count += 1
        if "quaternion" in self._content:
            data += struct.pack(">HB4f", 0x2010, 16, *_quaternion(self._sensor.angle(truth)))
        if "acceleration" in self._content:
            data += struct.pack(">HB3f", 0x4020, 12, *self._sensor.acceleration(truth))
        if "rate" in self._content:
            data += struct.pack(">HB3f", 0x8020, 12, *self._sensor.rate(truth))
        data += struct.pack(">HBI", 0xE020, 4, 0x00400003)
        self._sensor.remember(truth)
        message = bytes((0xFF, 0x36, len(data))) + data
        self._to_host.put(t_ns, b"\xfa" + message + bytes((-sum(message) % 256,)))

    def receive(self, t_ns: int, payload: bytes) -> None:
        """Ignore the payload."""


def _quaternion(angles_rad: Vector) -> tuple[float, float, float, float]:
    """Return w, x, y, z of a turn by yaw, then pitch, then roll about the turned axes."""
    roll, pitch, yaw = (0.5 * angle for angle in angles_rad)
    cr, sr, cp, sp, cy, sy = (
        *(math.cos(roll), math.sin(roll)),
        *(math.cos(pitch), math.sin(pitch)),
        *(math.cos(yaw), math.sin(yaw)),
    )
    return (
        cy * cp * cr + sy * sp * sr,
        cy * cp * sr - sy * sp * cr,
        cy * sp * cr + sy * cp * sr,
        sy * cp * cr - cy * sp * sr,
    )


def make_emulator(
    name: str,
    device: XsensSettings,
    emulator: XsensEmulatorSettings,
    plant: Plant,
    rng: np.random.Generator,
    start_ns: int,
) -> EmulatedDevice[bytes]:
    """Build the emulated sensor and its line, mounted as in the device's settings.

    Raises:
        ConfigError: The line is too slow for the rate.
    """
    size = FIXED_SIZE + sum(ITEM_SIZES[kind] for kind in set(emulator.content))
    required_bits_s = serial_bits(bytes(size)) * emulator.rate_hz
    fix = "raise baud_rate, lower rate_hz or shorten content"
    check_bit_rate(name, required_bits_s, device.baud_rate, fix)
    to_host = Line(serial_bits, device.baud_rate)
    to_device = Line(serial_bits, device.baud_rate)
    mounting = device.make_mounting(device.yaw_zero_deg)
    imu = XsensEmulator(emulator, InertialSensor(emulator, mounting, plant, rng), plant, to_host, start_ns)
    return EmulatedDevice(name, imu, to_host, to_device)
