"""A GNSS receiver with NMEA 0183 output: GGA and GST of each position.

The world's x axis points to the east. Not modelled: heights, outliers of single satellites, jitter of the
sampling, and commands from the host, which are ignored.
"""

import math
from typing import Annotated, Literal

import numpy as np
from pydantic import Field
from pymap3d import enu2geodetic

from drivers.clock import nanoseconds, seconds
from drivers.nmea import encode_sentence
from drivers.nmea_gnss.settings import NmeaGnssSettings
from drivers.settings import Settings
from sim_backends.world.coloured_noise import ColouredNoise
from sim_backends.world.fit import check_bit_rate
from sim_backends.world.line import Line, serial_bits
from sim_backends.world.plant import Plant
from sim_backends.world.sensor_errors import standard_normals
from sim_backends.world.world import EmulatedDevice

Offset = Annotated[float, Field(ge=-1000, le=1000)]


class GnssDisturbance(Settings):
    """What happens to the positions for a while.

    Attributes:
        type: "step" moves them, of which the receiver says nothing: a jump when it is short, a reflection
            (multipath) when it lasts; "no_fix" sends quality 0; "stale" sends the last position and its time
            again and again.
        start_s: From the start of the simulation.
        duration_s: How long.
        east_m: How far a step moves them.
        north_m: How far a step moves them.
    """

    type: Literal["step", "no_fix", "stale"]
    start_s: Annotated[float, Field(ge=0, le=1e6)]
    duration_s: Annotated[float, Field(gt=0, le=1e6)]
    east_m: Offset = 0.0
    north_m: Offset = 0.0


class GnssEmulatorSettings(Settings):
    """Errors of a GNSS receiver, east and north alike.

    Attributes:
        rate_hz: Positions per second.
        latitude_deg: Where the origin of the world lies.
        longitude_deg: Where the origin of the world lies.
        quality: Quality of GGA: 1 without corrections, 2 differential, 4 and 5 RTK.
        white_m: Standard deviation of the error that is new in each position.
        slow_m: Standard deviation of the error that changes slowly.
        slow_time_s: Its correlation time.
        sends_deviation: Whether it sends GST, with the true standard deviation.
        latency_s: From the position to the first byte.
        disturbances: What else happens.
    """

    type: Literal["nmea_gnss"] = "nmea_gnss"
    rate_hz: Annotated[float, Field(gt=0, le=20)] = 5.0
    latitude_deg: Annotated[float, Field(ge=-80, le=80)] = 48.0
    longitude_deg: Annotated[float, Field(ge=-180, le=180)] = 11.0
    quality: Literal[1, 2, 4, 5] = 4
    white_m: Annotated[float, Field(ge=0, le=100)] = 0.01
    slow_m: Annotated[float, Field(ge=0, le=100)] = 0.01
    slow_time_s: Annotated[float, Field(ge=1, le=3600)] = 3.0
    sends_deviation: bool = True
    latency_s: Annotated[float, Field(ge=0, le=1)] = 0.1
    disturbances: tuple[GnssDisturbance, ...] = ()


class GnssEmulator:
    """The receiver: takes a position every period and sends it after its latency.

    Args:
        device: Place of the antenna.
        settings: Errors.
        plant: Source of the true pose.
        to_host: Line to the host.
        rng: Source of the noise.
        start_ns: Time of power-on; the first position follows one period later.
    """

    def __init__(
        self,
        device: NmeaGnssSettings,
        settings: GnssEmulatorSettings,
        plant: Plant,
        to_host: Line[bytes],
        rng: np.random.Generator,
        start_ns: int,
    ) -> None:
        self._settings = settings
        self._antenna_m = complex(device.antenna_x_m, device.antenna_y_m)
        self._plant = plant
        self._to_host = to_host
        white, slow = rng.spawn(2)
        self._white = standard_normals(white)
        self._slow = ColouredNoise(2, settings.slow_time_s, slow, start_ns)
        self._start_ns = start_ns
        self._period_ns = nanoseconds(1.0 / settings.rate_hz)
        self._last = b""
        self.next_event_ns = start_ns + self._period_ns

    def act(self, t_ns: int) -> None:
        """Take a position and put it on the line."""
        self.next_event_ns += self._period_ns
        active = {each.type: each for each in self._settings.disturbances if self._holds(each, t_ns)}
        if "stale" not in active or not self._last:
            self._last = self.sentences(t_ns, active.get("step"), has_fix="no_fix" not in active)
        self._to_host.put(t_ns + nanoseconds(self._settings.latency_s), self._last)

    def receive(self, t_ns: int, payload: bytes) -> None:
        """Ignore the payload."""

    def _holds(self, disturbance: GnssDisturbance, t_ns: int) -> bool:
        since_s = seconds(t_ns - self._start_ns) - disturbance.start_s
        return 0.0 <= since_s < disturbance.duration_s

    def sentences(self, t_ns: int, step: GnssDisturbance | None, *, has_fix: bool) -> bytes:
        """Return what the receiver says of the present place."""
        settings, truth = self._settings, self._plant.truth()
        cosine, sine = math.cos(truth.yaw_rad), math.sin(truth.yaw_rad)
        place_m = complex(truth.x_m, truth.y_m) + self._antenna_m * complex(cosine, sine)
        east, north = self._slow.at(t_ns)
        place_m += settings.slow_m * complex(east, north)
        place_m += settings.white_m * complex(next(self._white), next(self._white))
        if step is not None:
            place_m += complex(step.east_m, step.north_m)
        latitude_deg, longitude_deg, _ = enu2geodetic(
            place_m.real, place_m.imag, 0.0, settings.latitude_deg, settings.longitude_deg, 0.0
        )
        time = _time(seconds(t_ns - self._start_ns))
        where = f"{_angle(latitude_deg, 2, 'NS')},{_angle(longitude_deg, 3, 'EW')}" if has_fix else ",,,"
        quality = settings.quality if has_fix else 0
        bodies = [f"GNGGA,{time},{where},{quality},12,0.8,500.0,M,47.0,M,,"]
        if settings.sends_deviation and has_fix:
            std_m = math.hypot(settings.white_m, settings.slow_m)
            bodies.append(f"GNGST,{time},,,,,{std_m:.3f},{std_m:.3f},{2 * std_m:.3f}")
        return b"".join(encode_sentence(body) for body in bodies)


def _time(since_s: float) -> str:
    hundredths = round(100.0 * since_s) % 8_640_000
    minutes, in_minute = divmod(hundredths, 6000)
    return f"{minutes // 60:02d}{minutes % 60:02d}{in_minute // 100:02d}.{in_minute % 100:02d}"


def _angle(angle_deg: float, digits: int, sides: str) -> str:
    """Return degrees and minutes to 1e-7 minutes, which are 0.2 mm, and the side."""
    units = round(abs(float(angle_deg)) * 60e7)
    degrees, in_degree = divmod(units, 600_000_000)
    minutes, fraction = divmod(in_degree, 10_000_000)
    return f"{degrees:0{digits}d}{minutes:02d}.{fraction:07d},{sides[int(angle_deg < 0.0)]}"


def make_emulator(
    name: str,
    device: NmeaGnssSettings,
    emulator: GnssEmulatorSettings,
    plant: Plant,
    rng: np.random.Generator,
    start_ns: int,
) -> EmulatedDevice[bytes]:
    """Build the emulated receiver and its line.

    Raises:
        ConfigError: The line is too slow for the rate.
    """
    to_host = Line(serial_bits, device.baud_rate)
    receiver = GnssEmulator(device, emulator, plant, to_host, rng, start_ns)
    required_bits_s = serial_bits(receiver.sentences(start_ns, None, has_fix=True)) * emulator.rate_hz
    check_bit_rate(name, required_bits_s, device.baud_rate, "raise baud_rate or lower rate_hz")
    return EmulatedDevice(name, receiver, to_host, Line(serial_bits, device.baud_rate))
