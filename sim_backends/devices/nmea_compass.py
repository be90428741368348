"""A fluxgate compass with NMEA 0183 output.

Not modelled: tilt error, magnetic disturbances, variation (the world's y axis points to magnetic north),
jitter of the sampling, and commands from the host, which are ignored.
"""

import math
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from drivers.angles import compass_deg_from_yaw
from drivers.clock import nanoseconds
from drivers.errors import ConfigError
from drivers.nmea import encode_sentence
from drivers.nmea_compass.settings import NmeaCompassSettings
from drivers.settings import Settings
from sim_backends.world.fit import check_bit_rate
from sim_backends.world.line import Line, serial_bits
from sim_backends.world.plant import Plant, Truth
from sim_backends.world.sensor_errors import DirectionLag, standard_normals
from sim_backends.world.world import EmulatedDevice

_BODY = {"HDG": "HCHDG,{:.1f},,,,", "HDM": "HCHDM,{:.1f},M"}

Degrees = Annotated[float, Field(ge=-90, le=90)]
Share = Annotated[float, Field(ge=-10, le=10)]


class CompassEmulatorSettings(Settings):
    """Errors of a fluxgate compass; headings and errors are clockwise positive.

    Reading = lagged heading + bias + deviation error + noise, rounded to 0.1 deg.

    Attributes:
        rate_hz: Sentences per second.
        sentence: Sentence that the compass sends.
        motor_field_per_a: Field of each motor per ampere of its current, ahead and to the left of the rover,
            over the earth's horizontal field.
        lag_s: Time constant of the damping, first order.
        bias_deg: Constant error.
        deviation_error_deg: Factors of sin h, cos h, sin 2h, cos 2h of the lagged heading h. The nautical
            deviation, which is added to a reading to correct it, has the opposite sign.
        noise_deg: Standard deviation of the white noise of each reading.
    """

    type: Literal["nmea_compass"] = "nmea_compass"
    rate_hz: Annotated[float, Field(gt=0, le=50)] = 10.0
    sentence: Literal["HDG", "HDM"] = "HDG"
    motor_field_per_a: tuple[tuple[Share, Share], ...] = ()
    lag_s: Annotated[float, Field(ge=0, le=10)] = 0.45
    bias_deg: Degrees = 0.5
    deviation_error_deg: tuple[Degrees, Degrees, Degrees, Degrees] = (1.0, -0.6, 0.4, 0.3)
    noise_deg: Annotated[float, Field(ge=0, le=90)] = 0.3


class CompassEmulator:
    """The compass: takes a reading and starts to send it every period.

    Args:
        settings: Errors of the compass.
        plant: Source of the true heading.
        to_host: Line to the host.
        rng: Source of the noise.
        start_ns: Time of power-on; the first reading follows one period later.
    """

    def __init__(
        self,
        settings: CompassEmulatorSettings,
        plant: Plant,
        to_host: Line[bytes],
        rng: np.random.Generator,
        start_ns: int,
    ) -> None:
        self._settings = settings
        self._plant = plant
        self._to_host = to_host
        self._noise = standard_normals(rng)
        self._body = _BODY[settings.sentence]
        self._period_ns = nanoseconds(1.0 / settings.rate_hz)
        self._lag = DirectionLag(settings.lag_s, 1.0 / settings.rate_hz)
        self._lag.settle(plant.truth().yaw_rad)
        self.next_event_ns = start_ns + self._period_ns

    def act(self, t_ns: int) -> None:
        """Take a reading and start to send it."""
        self.next_event_ns += self._period_ns
        heading_deg = compass_deg_from_yaw(self._lag.step(self._shown_rad(self._plant.truth())))
        noise_deg = self._settings.noise_deg * next(self._noise)
        reading_deg = heading_deg + self._error_deg(heading_deg) + noise_deg
        self._to_host.put(t_ns, encode_sentence(self._body.format(round(reading_deg * 10.0) % 3600 / 10.0)))

    def receive(self, t_ns: int, payload: bytes) -> None:
        """Ignore the payload."""

    def _shown_rad(self, truth: Truth) -> float:
        """Return the yaw by the sum of the earth's field and those of the motors."""
        motors = self._settings.motor_field_per_a
        if not motors:
            return truth.yaw_rad
        ahead, left = math.sin(truth.yaw_rad), math.cos(truth.yaw_rad)
        for (x, y), current_a in zip(motors, truth.motor_current_a, strict=True):
            ahead, left = ahead + x * current_a, left + y * current_a
        return math.atan2(ahead, left)

    def _error_deg(self, heading_deg: float) -> float:
        heading_rad = math.radians(heading_deg)
        sine, cosine, sine_2, cosine_2 = self._settings.deviation_error_deg
        return (
            self._settings.bias_deg
            + sine * math.sin(heading_rad)
            + cosine * math.cos(heading_rad)
            + sine_2 * math.sin(2.0 * heading_rad)
            + cosine_2 * math.cos(2.0 * heading_rad)
        )


def make_emulator(
    name: str,
    device: NmeaCompassSettings,
    emulator: CompassEmulatorSettings,
    plant: Plant,
    rng: np.random.Generator,
    start_ns: int,
) -> EmulatedDevice[bytes]:
    """Build the emulated compass and its line.

    Raises:
        ConfigError: The line is too slow for the rate, or the field is of another number of motors.
    """
    motors = len(emulator.motor_field_per_a)
    if motors not in (0, plant.wheel_count):
        raise ConfigError(
            f"simulated compass '{name}' has motor_field_per_a of {motors} motors, the rover has "
            f"{plant.wheel_count}: give one pair for each"
        )
    longest = encode_sentence(_BODY[emulator.sentence].format(359.9))
    required_bits_s = serial_bits(longest) * emulator.rate_hz
    check_bit_rate(name, required_bits_s, device.baud_rate, "raise baud_rate or lower rate_hz")
    to_host = Line(serial_bits, device.baud_rate)
    to_device = Line(serial_bits, device.baud_rate)
    return EmulatedDevice(name, CompassEmulator(emulator, plant, to_host, rng, start_ns), to_host, to_device)
