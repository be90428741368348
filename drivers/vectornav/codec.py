"""Asynchronous ASCII messages of VectorNav sensors: `$VNYMR,+100.949,...*69`, comma-separated numbers.

The checksum behind the asterisk covers everything between `$` and `*`: two hex digits are the exclusive or of
the bytes, four the CRC-16 with polynomial 0x1021 and start 0. The device may append its sync count or status
(`,T1162704` or `,S0000`); it is ignored.

The device's frame is north-east-down: x forward, y right, z down; yaw clockwise from north, pitch nose up
positive. At rest its z acceleration reads -9.8 m/s2.

A message carries no time and no counter: lost messages do not show, and a value that a damaged byte changed
passes the 8-bit checksum with probability 1/256 where the damage is more than one bit.

Source: VN-100 user manual UM001 (asynchronous output types, serial checksum, communication protocol control
register); VN-200 user manual UM004, sections 3.2 and 4 (VNINS and its status); VectorNav programming library
1.1 (`vnupack.c`).
"""

import math
import re
from collections.abc import Callable, Mapping, Sequence
from functools import reduce
from operator import xor

from drivers.angles import yaw_from_compass_deg
from drivers.driver import Rejection
from drivers.heading_calibration import Vector
from drivers.link import Received
from drivers.mounting import Mounting
from drivers.samples import (
    AccelerationSample,
    AttitudeSample,
    HeadingReference,
    HeadingSample,
    RateSample,
    Sample,
)
from drivers.units import STANDARD_GRAVITY_M_S2

LONGEST_MESSAGE = 255
"""Bytes kept of a line; the longest message in use here (VNYMR) has about 125."""
LARGEST_RATE_RAD_S = math.radians(2000.0)
LARGEST_ACCELERATION_M_S2 = 16.0 * STANDARD_GRAVITY_M_S2 * 1.1
"""Ranges of the sensors, gyroscopes 2000 deg/s and accelerometers 16 g, the latter before calibration."""

_LINE_END = re.compile(rb"[\r\n]+")
_BODY_AND_CHECKSUM = re.compile(rb"([ -)+-~]+)\*([0-9A-Fa-f]{4}|[0-9A-Fa-f]{2})")
_NUMBER = re.compile(r"[+-]?\d{1,6}(?:\.\d{1,9})?(?:[Ee][+-]?\d{1,2})?")
_APPENDED = re.compile(r"[TS][0-9A-Fa-f]+")

_ANGLES, _RATES, _ACCELERATIONS, _IGNORED = "angles", "rates", "accelerations", ""
_GROUPS: Mapping[str, tuple[str, ...]] = {
    "VNYMR": (_ANGLES, _IGNORED, _ACCELERATIONS, _RATES),
    "VNYPR": (_ANGLES,),
    "VNYBA": (_ANGLES, _IGNORED, _RATES),  # its accelerations are without gravity
    "VNYIA": (_ANGLES, _IGNORED, _RATES),
    "VNMAR": (_IGNORED, _ACCELERATIONS, _RATES),
    "VNACC": (_ACCELERATIONS,),
    "VNGYR": (_RATES,),
    "VNIMU": (_IGNORED, _ACCELERATIONS, _RATES),
}
"""The groups of three numbers in each message."""
_NUMBERS_BEHIND = {"VNIMU": 2}
"""Numbers behind the groups: temperature and pressure."""
_INS_STATUS, _INS_ANGLES, _INS_FIELDS = 2, slice(3, 6), 15
"""Fields of VNINS: time, week, status in hex, yaw, pitch, roll, position, velocity, three uncertainties."""
_STATUS = re.compile(r"[0-9A-Fa-f]{4}")
_INS_MODE, _TRACKING = 3, 2
"""Two bits of the status: 0 not tracking, 1 aligning, 2 tracking, 3 without GNSS for 45 s."""


class _RejectedError(Exception):
    """A message holds something that must not become a sample; the argument is the rejection's reason."""


def crc16(data: bytes) -> int:
    """Return the CRC-16 of the VectorNav protocols: polynomial 0x1021, start 0, not reflected."""
    crc = 0
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1 ^ 0x1021 if crc & 0x8000 else crc << 1) & 0xFFFF
    return crc


class VectorNavCodec:
    """Reads YMR, YPR, YBA, YIA, MAR, ACC, GYR, IMU and INS messages; the yaw of INS is from true north.

    Rejections: "framing", "checksum", "format" (wrong number of fields, or a field that is not a number),
    "range", "other_message", "not_tracking" (the filter behind an INS message has not settled), and
    "device_error" (`$VNERR`: the device refuses a command, or its output does not fit through the line).

    Args:
        name: Name of the device in the configuration.
        mounting: Mounting of the sensor on the rover.
        reference: What the device's yaw is measured against.
    """

    def __init__(
        self,
        name: str,
        mounting: Mounting | None = None,
        reference: HeadingReference = HeadingReference.MAGNETIC,
    ) -> None:
        self._name = name
        self._mounting = mounting or Mounting()
        self._reference = reference
        self._tail = b""
        self._readers: Mapping[str, Callable[[int, Vector], Sequence[Sample]]] = {
            _ANGLES: self._read_angles,
            _RATES: self._read_rates,
            _ACCELERATIONS: self._read_accelerations,
            _IGNORED: _read_nothing,
        }

    def decode(self, item: Received[bytes]) -> Sequence[Sample | Rejection]:
        """Return the samples and rejections of the lines that `item` completes."""
        *lines, tail = _LINE_END.split(self._tail + item.payload)
        self._tail = tail[-LONGEST_MESSAGE:]
        results: list[Sample | Rejection] = []
        for line in lines:
            if line:
                results.extend(self._read_line(line[-LONGEST_MESSAGE:], item.t_ns))
        return results

    def reset(self) -> None:
        """Forget a half-received line."""
        self._tail = b""

    def _read_line(self, line: bytes, t_ns: int) -> Sequence[Sample | Rejection]:
        try:
            header, *fields = _checked_body(line).split(",")
            if header == "VNERR":
                raise _RejectedError("device_error")
            if header == "VNINS":
                return self._read_ins(t_ns, fields)
            groups = _GROUPS.get(header)
            if groups is None:
                raise _RejectedError("other_message")
            numbers = _numbers(fields, 3 * len(groups) + _NUMBERS_BEHIND.get(header, 0))
            samples: list[Sample] = []
            for index, group in enumerate(groups):
                first, second, third = numbers[3 * index : 3 * index + 3]
                samples += self._readers[group](t_ns, (first, second, third))
        except _RejectedError as rejected:
            return (Rejection(str(rejected)),)
        return samples

    def _read_ins(self, t_ns: int, fields: Sequence[str]) -> Sequence[Sample]:
        status = fields[_INS_STATUS] if len(fields) > _INS_STATUS else ""
        if _STATUS.fullmatch(status) is None:
            raise _RejectedError("format")
        numbers = _numbers([*fields[:_INS_STATUS], "0", *fields[_INS_STATUS + 1 :]], _INS_FIELDS)
        if int(status, 16) & _INS_MODE != _TRACKING:
            raise _RejectedError("not_tracking")
        yaw_deg, pitch_deg, roll_deg = numbers[_INS_ANGLES]
        return self._read_angles(t_ns, (yaw_deg, pitch_deg, roll_deg), HeadingReference.TRUE)

    def _read_angles(
        self, t_ns: int, degrees: Vector, reference: HeadingReference | None = None
    ) -> Sequence[Sample]:
        yaw_deg, pitch_deg, roll_deg = degrees
        if not (abs(yaw_deg) <= 360.0 and abs(pitch_deg) <= 90.0 and abs(roll_deg) <= 180.0):
            raise _RejectedError("range")
        roll_rad, pitch_rad, yaw_rad = self._mounting.attitude_to_rover(
            math.radians(roll_deg), -math.radians(pitch_deg), yaw_from_compass_deg(yaw_deg)
        )
        return (
            AttitudeSample(device=self._name, t_ns=t_ns, roll_rad=roll_rad, pitch_rad=pitch_rad),
            HeadingSample(
                device=self._name, t_ns=t_ns, heading_rad=yaw_rad, reference=reference or self._reference
            ),
        )

    def _read_rates(self, t_ns: int, rates_rad_s: Vector) -> Sequence[Sample]:
        x, y, z = self._mounting.correct_rate(self._to_rover(rates_rad_s, LARGEST_RATE_RAD_S))
        return (RateSample(device=self._name, t_ns=t_ns, rate_x_rad_s=x, rate_y_rad_s=y, rate_z_rad_s=z),)

    def _read_accelerations(self, t_ns: int, accelerations_m_s2: Vector) -> Sequence[Sample]:
        x, y, z = self._to_rover(accelerations_m_s2, LARGEST_ACCELERATION_M_S2)
        return (AccelerationSample(device=self._name, t_ns=t_ns, x_m_s2=x, y_m_s2=y, z_m_s2=z),)

    def _to_rover(self, vector: Vector, largest: float) -> Vector:
        if max(map(abs, vector)) > largest:
            raise _RejectedError("range")
        x, y, z = vector
        return self._mounting.vector_to_rover((x, -y, -z))


def _checked_body(line: bytes) -> str:
    """Return what is between `$` and `*`."""
    _, start, message = line.rpartition(b"$")
    match = _BODY_AND_CHECKSUM.fullmatch(message)
    if not start or match is None:
        raise _RejectedError("framing")
    body, checksum = match.groups()
    expected = reduce(xor, body) if len(checksum) == 2 else crc16(body)
    if int(checksum, 16) != expected:
        raise _RejectedError("checksum")
    return body.decode("ascii")


def _numbers(fields: Sequence[str], count: int) -> list[float]:
    texts, appended = fields[:count], fields[count:]
    is_readable = len(texts) == count and all(map(_NUMBER.fullmatch, texts))
    if not is_readable or not all(map(_APPENDED.fullmatch, appended)):
        raise _RejectedError("format")
    return [float(text) for text in texts]


def _read_nothing(t_ns: int, numbers: Vector) -> Sequence[Sample]:
    return ()
