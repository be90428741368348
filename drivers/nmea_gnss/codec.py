"""Positions of a GNSS receiver: sentences GGA, GST and RMC of NMEA 0183.

Source: NMEA 0183 field tables as published by manufacturers (u-blox, Trimble). Position on the tangent plane
of the WGS 84 ellipsoid by pymap3d; heights are left out, so a place is right to 1e-6 of its distance from
the origin per 6 m of height.

Not detectable here: a position that is wrong by less than the receiver says, as by reflections (multipath).
"""

import math
from collections.abc import Callable, Sequence

from pymap3d import geodetic2enu

from drivers.clock import nanoseconds, seconds
from drivers.nmea import RejectedError, SentenceCodec, number, parse
from drivers.nmea_gnss.parameters import NmeaGnssParameters
from drivers.samples import UNKNOWN_YAW_STD_RAD, PoseFixSample, Sample

SINGLE, DIFFERENTIAL, PRECISE, FIXED, FLOAT = "1", "2", "3", "4", "5"
"""Qualities of GGA that are positions; 0 is none, 6 is guessed on, 7 and 8 are not measured."""
QUALITY_OF_MODE = {"A": SINGLE, "D": DIFFERENTIAL, "P": PRECISE, "R": FIXED, "F": FLOAT}
"""Modes of RMC; others are no positions."""
LARGEST_STD_M = 100.0
"""Receivers that are less certain know their region only."""


def correlated_std_m(std_m: float, elapsed_s: float | None, correlation_s: float) -> float:
    """Return the deviation of a fix so that the mean of many is as certain as they are.

    The mean of n fixes with this correlation is as certain as that of n elapsed / (2 correlation).

    Args:
        std_m: Of one fix alone.
        elapsed_s: Since the fix before; None for the first one.
        correlation_s: Time over which errors of successive fixes are alike.
    """
    elapsed_s = 1.0 if elapsed_s is None else max(elapsed_s, 1e-3)
    return std_m * math.sqrt(max(1.0, 2.0 * correlation_s / elapsed_s))


class NmeaGnssCodec(SentenceCodec):
    """Reads GGA and GST of any talker, and RMC as long as no GGA comes; others are "other_sentence".

    A fix holds no yaw, see `PoseFixSample`. Rejections beside those of `SentenceCodec`: "no_fix",
    "invalid_mode" (guessed on, manual, simulated), "stale" (the time of the position has not advanced),
    "uncertain" (a deviation above 100 m), "format", "empty", "range".

    Args:
        name: Name of the device.
        settings: Antenna, origin and deviations.
    """

    def __init__(self, name: str, settings: NmeaGnssParameters) -> None:
        super().__init__(require_checksum=True)
        self._name = name
        self._settings = settings
        self._origin_deg: tuple[float, float] | None = None
        if settings.origin_latitude_deg is not None and settings.origin_longitude_deg is not None:
            self._origin_deg = settings.origin_latitude_deg, settings.origin_longitude_deg
        self._std_m = {
            SINGLE: settings.single_m,
            DIFFERENTIAL: settings.differential_m,
            PRECISE: settings.differential_m,
            FIXED: settings.fixed_m,
            FLOAT: settings.float_m,
        }
        self._readers: dict[str, Callable[[dict[str, object], int], Sequence[Sample]]] = {
            "GGA": self._read_gga,
            "GST": self._read_gst,
            "RMC": self._read_rmc,
        }
        self.reset()

    def reset(self) -> None:
        """Forget what came, but for the origin: the local frame stays."""
        super().reset()
        self._has_gga = False
        self._newest = ""
        self._newest_ns: int | None = None
        self._quality = ""
        self._told_m: float | None = None

    def read_sentence(self, name: str, body: bytes, t_ns: int) -> Sequence[Sample]:
        """Return the fix of a sentence, see `SentenceCodec`."""
        reader = self._readers.get(name)
        if reader is None:
            raise RejectedError("other_sentence")
        return reader(parse(body), t_ns)

    def _read_gga(self, fields: dict[str, object], t_ns: int) -> Sequence[Sample]:
        self._has_gga = True
        quality = str(fields.get("quality", ""))
        self._take_quality(quality, none="0")
        return [self._fix(fields, t_ns, max(1.0, number(fields, "HDOP", 0.0, 100.0)))]

    def _read_rmc(self, fields: dict[str, object], t_ns: int) -> Sequence[Sample]:
        if self._has_gga:
            raise RejectedError("other_sentence")
        if fields.get("status") != "A":
            raise RejectedError("no_fix")
        mode = str(fields.get("posMode") or "A")  # receivers before NMEA 2.3 send none
        self._take_quality(QUALITY_OF_MODE.get(mode, mode), none="N")
        return [self._fix(fields, t_ns, 1.0)]

    def _read_gst(self, fields: dict[str, object], t_ns: int) -> Sequence[Sample]:
        """Note what the receiver says of the fix before; it holds as long as the quality stays."""
        del t_ns
        self._told_m = max(number(fields, key, 0.0, 1e6) for key in ("stdLat", "stdLong"))
        return ()

    def _take_quality(self, quality: str, none: str) -> None:
        if quality != self._quality:
            self._quality, self._told_m = quality, None
        if quality == none:
            raise RejectedError("no_fix")
        if quality not in self._std_m:
            raise RejectedError("invalid_mode")

    def _fix(self, fields: dict[str, object], t_ns: int, dilution: float) -> PoseFixSample:
        settings = self._settings
        latitude_deg = number(fields, "lat", -90.0, 90.0)
        longitude_deg = number(fields, "lon", -180.0, 180.0)
        time = str(fields.get("time", ""))
        if not time:
            raise RejectedError("empty")
        if time == self._newest:
            raise RejectedError("stale")
        std_m = dilution * self._std_m[self._quality] if self._told_m is None else self._told_m
        if std_m > LARGEST_STD_M:
            raise RejectedError("uncertain")
        if self._origin_deg is None:
            self._origin_deg = latitude_deg, longitude_deg
        east_m, north_m, _ = geodetic2enu(latitude_deg, longitude_deg, 0.0, *self._origin_deg, 0.0)
        elapsed_s = None if self._newest_ns is None else seconds(t_ns - self._newest_ns)
        self._newest, self._newest_ns = time, t_ns
        alone_std_m = max(settings.least_std_m, std_m)
        return PoseFixSample(
            device=self._name,
            t_ns=t_ns,
            x_m=float(east_m),
            y_m=float(north_m),
            yaw_rad=0.0,
            position_std_m=correlated_std_m(alone_std_m, elapsed_s, settings.correlation_s),
            alone_std_m=alone_std_m,
            yaw_std_rad=UNKNOWN_YAW_STD_RAD,
            t_capture_ns=t_ns - nanoseconds(settings.latency_s),
            arm_x_m=settings.antenna_x_m,
            arm_y_m=settings.antenna_y_m,
        )
