"""MTData2 messages of Xsens MTi sensors: items of a data identifier, a size and big-endian numbers.

The lowest four bits of an identifier say how its numbers are stored (0 float, 1 fixed point 12.20, 3 double)
and in which frame (0 east-north-up, 4 north-east-down, 8 north-west-up). Sensor axes are right-handed with z
up; orientations turn sensor axes into the frame. North-east-down is refused: sources differ about its sensor
axes.

The sum over a message catches every single-bit error. After a loss of synchronisation a chance match has
probability 1/256 per candidate. The packet counter, where the device sends one, shows lost messages.

Source: Xsens MT Low-Level Communication Protocol (MT0101P), sections "Data structures" and MTData2;
ethz-asl/ethzasl_xsens_driver `mtdef.py`; recorded packets of an MTi-300 with their decoded values.
"""

import math
import struct
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import NamedTuple

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
from drivers.xsens.scanner import Message, MessageScanner

LARGEST_RATE_RAD_S = math.radians(2000.0)
LARGEST_ACCELERATION_M_S2 = 250.0
"""A little more than the ranges of the sensors: 2000 deg/s and 20 g."""
LARGEST_NORM_ERROR = 0.02
"""By which the norm of a quaternion may differ from 1."""
NANOSECONDS_PER_TICK = 100_000
"""The fine sample time counts 10 kHz."""

_MTDATA2, _MTDATA, _ERROR = 0x36, 0x32, 0x42
_COUNTER, _TIME, _STATUS = 0x1020, 0x1060, 0xE020
_QUATERNION, _EULER, _ACCELERATION, _RATE = 0x2010, 0x2030, 0x4020, 0x8020
_KIND = 0xFFF0
_FORMAT, _FRAME = 0x3, 0xC
_EAST_NORTH_UP, _NORTH_WEST_UP = 0x0, 0x8

_FILTER_VALID = 1 << 1
_CLIPPED_ACCELERATION = 0b111 << 8
_CLIPPED_RATE = 0b111 << 11


class _Format(NamedTuple):
    code: str
    size: int
    factor: float


_FORMATS: Mapping[int, _Format] = {
    0: _Format("f", 4, 1.0),
    1: _Format("i", 4, 2.0**-20),
    3: _Format("d", 8, 1.0),
}
_COUNTS = {_QUATERNION: 4, _EULER: 3, _ACCELERATION: 3, _RATE: 3}
_WHOLE_NUMBERS = {_COUNTER: 2, _TIME: 4, _STATUS: 4}


class _RejectedError(Exception):
    """An item holds something that must not become a sample; the argument is the rejection's reason."""


class _Item(NamedTuple):
    """The numbers of one item, and the bits of its identifier that name their frame."""

    numbers: tuple[float, ...]
    frame: int


class XsensCodec:
    """Reads rate of turn, acceleration and orientation (quaternion or Euler angles) of MTData2 messages.

    Rejections: "framing" and "checksum" (once per stretch of unreadable bytes); "layout", items that do not
    fit into their message or have another size than their kind; "number_format" and "ned_frame", settings of
    the output that are not supported; "range"; "clipped", a sensor at the end of its range; "filter_invalid",
    an orientation that the device itself does not trust; "messages_lost", which accompanies the samples of
    the message that showed the gap; "other_message"; "legacy_output"; "device_error".

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
        self._scanner = MessageScanner()
        self._counter: int | None = None
        self._readers: Mapping[int, Callable[[int, int | None, _Item, int], Sequence[Sample]]] = {
            _QUATERNION: self._read_quaternion,
            _EULER: self._read_euler,
            _ACCELERATION: self._read_acceleration,
            _RATE: self._read_rate,
        }

    def decode(self, item: Received[bytes]) -> Sequence[Sample | Rejection]:
        """Return the samples and rejections of the messages that `item` completes."""
        results: list[Sample | Rejection] = []
        for scanned in self._scanner.feed(item.payload):
            if isinstance(scanned, Rejection):
                results.append(scanned)
            else:
                results += self._read_message(item.t_ns, scanned)
        return results

    def reset(self) -> None:
        """Forget a half-received message and the packet counter."""
        self._scanner.reset()
        self._counter = None

    def _read_message(self, t_ns: int, message: Message) -> list[Sample | Rejection]:
        if message.kind == _ERROR:
            return [Rejection("device_error")]
        if message.kind != _MTDATA2:
            return [Rejection("legacy_output" if message.kind == _MTDATA else "other_message")]
        try:
            content = dict(_split(message.data))
            whole = {kind: _whole_number(kind, content[kind]) for kind in _WHOLE_NUMBERS if kind in content}
        except _RejectedError as rejected:
            return [Rejection(str(rejected))]
        results = self._note_counter(whole.get(_COUNTER))
        ticks, status = whole.get(_TIME), whole.get(_STATUS, _FILTER_VALID)
        t_device_ns = None if ticks is None else ticks * NANOSECONDS_PER_TICK
        if any(identifier & _KIND == _QUATERNION for identifier in content):
            content = {key: value for key, value in content.items() if key & _KIND != _EULER}
        for identifier, data in content.items():
            reader = self._readers.get(identifier & _KIND)
            if reader is None:
                continue
            try:
                results += reader(t_ns, t_device_ns, _numbers(identifier, data), status)
            except _RejectedError as rejected:
                results.append(Rejection(str(rejected)))
        return results

    def _note_counter(self, counter: int | None) -> list[Sample | Rejection]:
        last, self._counter = self._counter, counter
        is_gap = last is not None and counter is not None and (counter - last) & 0xFFFF != 1
        return [Rejection("messages_lost")] if is_gap else []

    def _read_quaternion(
        self, t_ns: int, t_device_ns: int | None, item: _Item, status: int
    ) -> Sequence[Sample]:
        w, x, y, z = item.numbers
        norm = math.sqrt(w * w + x * x + y * y + z * z)
        if not abs(norm - 1.0) <= LARGEST_NORM_ERROR:
            raise _RejectedError("range")
        w, x, y, z = w / norm, x / norm, y / norm, z / norm
        roll_rad = math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
        pitch_rad = math.asin(max(-1.0, min(1.0, 2.0 * (w * y - z * x))))
        yaw_rad = math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
        return self._orientation(t_ns, t_device_ns, (roll_rad, pitch_rad, yaw_rad), item.frame, status)

    def _read_euler(self, t_ns: int, t_device_ns: int | None, item: _Item, status: int) -> Sequence[Sample]:
        roll_deg, pitch_deg, yaw_deg = item.numbers
        if not (abs(roll_deg) <= 180.0 and abs(pitch_deg) <= 90.0 and abs(yaw_deg) <= 180.0):
            raise _RejectedError("range")
        angles = (math.radians(roll_deg), math.radians(pitch_deg), math.radians(yaw_deg))
        return self._orientation(t_ns, t_device_ns, angles, item.frame, status)

    def _orientation(
        self, t_ns: int, t_device_ns: int | None, angles_rad: Vector, frame: int, status: int
    ) -> Sequence[Sample]:
        if not status & _FILTER_VALID:
            raise _RejectedError("filter_invalid")
        if frame not in (_EAST_NORTH_UP, _NORTH_WEST_UP):
            raise _RejectedError("ned_frame")
        roll_rad, pitch_rad, yaw_rad = angles_rad
        yaw_from_east_rad = yaw_rad + (math.pi / 2 if frame == _NORTH_WEST_UP else 0.0)
        roll_rad, pitch_rad, yaw_rad = self._mounting.attitude_to_rover(
            roll_rad, pitch_rad, yaw_from_east_rad
        )
        name = self._name
        return (
            AttitudeSample(
                device=name, t_ns=t_ns, t_device_ns=t_device_ns, roll_rad=roll_rad, pitch_rad=pitch_rad
            ),
            HeadingSample(
                device=name,
                t_ns=t_ns,
                t_device_ns=t_device_ns,
                heading_rad=yaw_rad,
                reference=self._reference,
            ),
        )

    def _read_acceleration(
        self, t_ns: int, t_device_ns: int | None, item: _Item, status: int
    ) -> Sequence[Sample]:
        x, y, z = self._to_rover(item, LARGEST_ACCELERATION_M_S2, status & _CLIPPED_ACCELERATION)
        return (
            AccelerationSample(
                device=self._name, t_ns=t_ns, t_device_ns=t_device_ns, x_m_s2=x, y_m_s2=y, z_m_s2=z
            ),
        )

    def _read_rate(self, t_ns: int, t_device_ns: int | None, item: _Item, status: int) -> Sequence[Sample]:
        rate_rad_s = self._to_rover(item, LARGEST_RATE_RAD_S, status & _CLIPPED_RATE)
        x, y, z = self._mounting.correct_rate(rate_rad_s)
        return (
            RateSample(
                device=self._name,
                t_ns=t_ns,
                t_device_ns=t_device_ns,
                rate_x_rad_s=x,
                rate_y_rad_s=y,
                rate_z_rad_s=z,
            ),
        )

    def _to_rover(self, item: _Item, largest: float, clipped: int) -> Vector:
        if clipped:
            raise _RejectedError("clipped")
        x, y, z = item.numbers
        if not (abs(x) <= largest and abs(y) <= largest and abs(z) <= largest):  # rejects NaN too
            raise _RejectedError("range")
        return self._mounting.vector_to_rover((x, y, z))


def _split(data: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield identifier and content of each item."""
    position = 0
    while position < len(data):
        end = position + 3
        if end > len(data):
            raise _RejectedError("layout")
        end += data[position + 2]
        if end > len(data):
            raise _RejectedError("layout")
        yield int.from_bytes(data[position : position + 2], "big"), data[position + 3 : end]
        position = end


def _whole_number(identifier: int, data: bytes) -> int:
    if len(data) != _WHOLE_NUMBERS[identifier]:
        raise _RejectedError("layout")
    return int.from_bytes(data, "big")


def _numbers(identifier: int, data: bytes) -> _Item:
    number_format = _FORMATS.get(identifier & _FORMAT)
    if number_format is None:
        raise _RejectedError("number_format")
    count = _COUNTS[identifier & _KIND]
    if len(data) != count * number_format.size:
        raise _RejectedError("layout")
    raw = struct.unpack(f">{count}{number_format.code}", data)
    return _Item(tuple(value * number_format.factor for value in raw), identifier & _FRAME)
