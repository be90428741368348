"""A VectorNav sensor that sends VNYMR or VNGYR messages on its serial line.

The bytes are written here, apart from the driver: north-east-down, yaw clockwise from north, XOR checksum.
The world's y axis points to north.

Not modelled: what `sim_backends/world/inertial.py` lists, the magnetic field (its fields are sent as zeros),
CRC-16, binary output, and commands from the host, which are ignored.

Source: VN-100 user manual UM001, asynchronous output types and number formats.
"""

import math
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from drivers.clock import nanoseconds
from drivers.heading_calibration import Vector
from drivers.vectornav.settings import VectorNavSettings
from sim_backends.world.fit import check_bit_rate
from sim_backends.world.inertial import InertialErrorSettings, InertialSensor
from sim_backends.world.line import Line, serial_bits
from sim_backends.world.plant import Plant
from sim_backends.world.world import EmulatedDevice


class VectorNavEmulatorSettings(InertialErrorSettings):
    """Errors of an industrial inertial sensor.

    Attributes:
        rate_hz: Messages per second.
        message: Message that the device sends.
    """

    type: Literal["vectornav"] = "vectornav"
    rate_hz: Annotated[float, Field(gt=0, le=200)] = 40.0
    gyro_bias_deg_s: Annotated[float, Field(ge=-10, le=10)] = 0.02
    gyro_walk_deg_s: Annotated[float, Field(ge=0, le=10)] = 0.001
    gyro_noise_deg_s: Annotated[float, Field(ge=0, le=10)] = 0.05
    message: Literal["VNYMR", "VNGYR"] = "VNYMR"


class VectorNavEmulator:
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
        settings: VectorNavEmulatorSettings,
        sensor: InertialSensor,
        plant: Plant,
        to_host: Line[bytes],
        start_ns: int,
    ) -> None:
        self._message = settings.message
        self._sensor = sensor
        self._plant = plant
        self._to_host = to_host
        self._period_ns = nanoseconds(1.0 / settings.rate_hz)
        self.next_event_ns = start_ns + self._period_ns

    def act(self, t_ns: int) -> None:
        """Measure and start to send the message."""
        self.next_event_ns += self._period_ns
        truth = self._plant.truth()
        rate_rad_s = self._sensor.rate(truth)
        if self._message == "VNGYR":
            body = "VNGYR" + _rates(rate_rad_s)
        else:
            roll_rad, pitch_rad, yaw_rad = self._sensor.angle(truth)
            north_deg = math.degrees(math.remainder(math.pi / 2 - yaw_rad, math.tau))
            angles = f",{north_deg:+08.3f},{-math.degrees(pitch_rad):+08.3f},{math.degrees(roll_rad):+08.3f}"
            x, y, z = self._sensor.acceleration(truth)
            magnetic = ",+00.0000" * 3
            body = f"VNYMR{angles}{magnetic},{x:+07.3f},{-y:+07.3f},{-z:+07.3f}" + _rates(rate_rad_s)
        self._sensor.remember(truth)
        self._to_host.put(t_ns, _message(body))

    def receive(self, t_ns: int, payload: bytes) -> None:
        """Ignore the payload."""


def _rates(rate_rad_s: Vector) -> str:
    x, y, z = rate_rad_s
    return f",{x:+010.6f},{-y:+010.6f},{-z:+010.6f}"


def _message(body: str) -> bytes:
    data = body.encode("ascii")
    checksum = 0
    for byte in data:
        checksum ^= byte
    return b"$" + data + b"*%02X\r\n" % checksum


def make_emulator(
    name: str,
    device: VectorNavSettings,
    emulator: VectorNavEmulatorSettings,
    plant: Plant,
    rng: np.random.Generator,
    start_ns: int,
) -> EmulatedDevice[bytes]:
    """Build the emulated sensor and its line, mounted as in the device's settings.

    Raises:
        ConfigError: The line is too slow for the rate.
    """
    size = {"VNYMR": 122, "VNGYR": 43}[emulator.message]
    required_bits_s = serial_bits(bytes(size)) * emulator.rate_hz
    fix = "raise baud_rate, lower rate_hz or send VNGYR only"
    check_bit_rate(name, required_bits_s, device.baud_rate, fix)
    to_host = Line(serial_bits, device.baud_rate)
    to_device = Line(serial_bits, device.baud_rate)
    sensor = InertialSensor(emulator, device.make_mounting(), plant, rng)
    imu = VectorNavEmulator(emulator, sensor, plant, to_host, start_ns)
    return EmulatedDevice(name, imu, to_host, to_device)
