"""A WitMotion inertial sensor on its serial line.

Not modelled: temperature drift, scale and cross-axis errors, vibration, magnetic disturbances, magnetic
frames, coupling of tilt and turning in the x and y rates, and commands from the host, which are ignored.
"""

from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from drivers.clock import nanoseconds
from drivers.errors import ConfigError
from drivers.mounting import Mounting
from drivers.witmotion.codec import FRAME_SIZE, encode_acceleration, encode_angle, encode_rate
from drivers.witmotion.settings import WitMotionSettings
from sim_backends.world.inertial import InertialErrorSettings, InertialSensor
from sim_backends.world.line import Line, serial_bits
from sim_backends.world.plant import Plant
from sim_backends.world.world import EmulatedDevice

FrameKind = Literal["acceleration", "rate", "angle"]


class ImuEmulatorSettings(InertialErrorSettings):
    """Errors of a low-cost inertial sensor.

    Attributes:
        frames: Frames in each set; always sent in the order acceleration, rate, angle.
    """

    type: Literal["witmotion"] = "witmotion"
    frames: Annotated[tuple[FrameKind, ...], Field(min_length=1)] = ("rate", "angle")


class ImuEmulator:
    """The sensor: measures and starts to send a set of frames every period.

    Args:
        settings: Errors of the sensor.
        sensor: What it measures.
        plant: Source of the true motion.
        to_host: Line to the host.
        start_ns: Time of power-on; the first set follows one period later.
    """

    def __init__(
        self,
        settings: ImuEmulatorSettings,
        sensor: InertialSensor,
        plant: Plant,
        to_host: Line[bytes],
        start_ns: int,
    ) -> None:
        self._frames = settings.frames
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
        self._to_host.put(t_ns, burst)
        sensor.remember(truth)

    def receive(self, t_ns: int, payload: bytes) -> None:
        """Ignore the payload."""


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
    sensor = InertialSensor(emulator, mounting, plant, rng)
    imu = ImuEmulator(emulator, sensor, plant, to_host, start_ns)
    return EmulatedDevice(name, imu, to_host, to_device)
