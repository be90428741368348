"""What devices say on the wire, opened, changed and closed again: between emulator and driver.

Nothing here knows how the rover estimates or what stops it. Checksums and counters stay right, so that a
changed payload is one that a faulty device, mounting or wiring would send.
"""

import math
import re
import struct
from collections.abc import Sequence
from typing import NamedTuple, Protocol

from drivers.can.frame import CanFrame, pack_can_frame, unpack_can_frame
from drivers.can_wheels.messages import crc8_j1850
from drivers.nmea import encode_sentence
from drivers.robotino_board.codec import build_reply, build_request, parse_reply, parse_request
from drivers.witmotion.codec import FRAME_SIZE, RATE, encode_frame


class Reading(NamedTuple):
    """One number of a device.

    Attributes:
        channel: Wheel or axis, from 0.
        value: In the units of the wire.
        is_total: The value is a total (an angle turned, a heading), not a rate.
    """

    channel: int
    value: float
    is_total: bool


class Change(Protocol):
    """What a fault makes of the numbers of one payload, in their order."""

    def __call__(self, t_ns: int, readings: Sequence[Reading]) -> Sequence[float]:
        """Return the values that the driver sees."""
        ...


class Wire(Protocol):
    """One kind of payload."""

    def change(self, t_ns: int, payload: bytes, change: Change) -> bytes:
        """Return the payload with changed numbers; others pass as they are."""
        ...


class RobotinoReplies:
    """Positions and speeds of three wheels in a reply of a Robotino board."""

    def change(self, t_ns: int, payload: bytes, change: Change) -> bytes:
        """Return the reply with changed positions and speeds."""
        reply = parse_reply(payload)
        totals = [Reading(wheel, ticks, is_total=True) for wheel, ticks in enumerate(reply.ticks)]
        rates = [Reading(wheel, steps, is_total=False) for wheel, steps in enumerate(reply.speed_steps)]
        a, b, c, *speeds = (round(value) for value in change(t_ns, [*totals, *rates]))
        d, e, f = (max(-255, min(255, speed)) for speed in speeds)
        return build_reply(reply._replace(ticks=(a, b, c), speed_steps=(d, e, f)))


class RobotinoSupply:
    """The voltage of the battery in a reply of a Robotino board, in counts."""

    def change(self, t_ns: int, payload: bytes, change: Change) -> bytes:
        """Return the reply with a changed voltage."""
        reply = parse_reply(payload)
        (value,) = change(t_ns, [Reading(0, reply.battery_raw, is_total=False)])
        return build_reply(reply._replace(battery_raw=round(value) & ~3))


class RobotinoRequests:
    """Setpoints of three wheels in a request to a Robotino board."""

    def change(self, t_ns: int, payload: bytes, change: Change) -> bytes:
        """Return the request with changed setpoints."""
        request = parse_request(payload)
        readings = [Reading(wheel, steps, is_total=False) for wheel, steps in enumerate(request.speed_steps)]
        a, b, c = (max(-255, min(255, round(value))) for value in change(t_ns, readings))
        return build_request(request._replace(speed_steps=(a, b, c)))


class WheelStates:
    """Position and speed in `Wheel{node}_State` of the mapping `generic_wheel`."""

    _FIRST_ID = 288

    def change(self, t_ns: int, payload: bytes, change: Change) -> bytes:
        """Return the frame with changed position and speed."""
        frame = unpack_can_frame(payload)
        if frame is None or not 0 <= frame.can_id - self._FIRST_ID < 4:
            return payload
        wheel = frame.can_id - self._FIRST_ID
        word = int.from_bytes(frame.data[:3], "little")
        position = (word & 0xFFFFF) - ((word & 0x80000) << 1)
        (speed,) = struct.unpack_from("<h", frame.data, 3)
        readings = [Reading(wheel, position, is_total=True), Reading(wheel, speed, is_total=False)]
        new_position, new_speed = (round(value) for value in change(t_ns, readings))
        head = (word & 0xF00000 | new_position & 0xFFFFF).to_bytes(3, "little")
        body = head + struct.pack("<h", max(-32767, min(32767, new_speed))) + frame.data[5:7]
        return pack_can_frame(CanFrame(frame.can_id, body + bytes((crc8_j1850(body),))))


class DriveSupply:
    """The bus voltage in `Drive_Status` of the mapping `generic_wheel`."""

    _ID = 256

    def change(self, t_ns: int, payload: bytes, change: Change) -> bytes:
        """Return the frame with a changed voltage."""
        frame = unpack_can_frame(payload)
        if frame is None or frame.can_id != self._ID:
            return payload
        (voltage,) = struct.unpack_from("<H", frame.data, 2)
        (value,) = change(t_ns, [Reading(0, voltage, is_total=False)])
        body = frame.data[:2] + struct.pack("<H", round(value)) + frame.data[4:5]
        return pack_can_frame(CanFrame(frame.can_id, body + bytes((crc8_j1850(body),))))


class WheelSetPoints:
    """Setpoints in `Wheel{node}_Setpoint` of the mapping `generic_wheel`."""

    _FIRST_ID = 272

    def change(self, t_ns: int, payload: bytes, change: Change) -> bytes:
        """Return the frame with a changed setpoint."""
        frame = unpack_can_frame(payload)
        if frame is None or not 0 <= frame.can_id - self._FIRST_ID < 4:
            return payload
        (speed,) = struct.unpack_from("<h", frame.data)
        (value,) = change(t_ns, [Reading(frame.can_id - self._FIRST_ID, speed, is_total=False)])
        body = struct.pack("<h", max(-32767, min(32767, round(value)))) + frame.data[2:3]
        return pack_can_frame(CanFrame(frame.can_id, body + bytes((crc8_j1850(body),))))


class GyroFrames:
    """Rates about x, y and z in the frames of a WitMotion sensor."""

    def change(self, t_ns: int, payload: bytes, change: Change) -> bytes:
        """Return the frames with changed rates."""
        frames = [payload[start : start + FRAME_SIZE] for start in range(0, len(payload), FRAME_SIZE)]
        return b"".join(self._changed(t_ns, frame, change) for frame in frames)

    def _changed(self, t_ns: int, frame: bytes, change: Change) -> bytes:
        if len(frame) < FRAME_SIZE or frame[1] != RATE:
            return frame
        words = struct.unpack_from("<3h", frame, 2)
        values = change(t_ns, [Reading(axis, word, is_total=False) for axis, word in enumerate(words)])
        x, y, z = (max(-32768, min(32767, round(value))) for value in values)
        return encode_frame(RATE, x, y, z)


class PositionSentences:
    """The position in a sentence GGA of a GNSS receiver: metres to the north and east of where it says."""

    _PLACE = re.compile(rb"\$(G[A-Z]GGA,[0-9.]+),([0-9.]+),([NS]),([0-9.]+),([EW]),([^*]*)\*")
    _DEGREE_M = 111_200.0

    def change(self, t_ns: int, payload: bytes, change: Change) -> bytes:
        """Return the sentences with a changed position; those without one pass as they are."""
        match = self._PLACE.match(payload)
        if match is None:
            return payload
        latitude, longitude = (_degrees(match[place]) for place in (2, 4))
        # One size for all places of a run: a held longitude is held in degrees, too.
        per_degree = (self._DEGREE_M, self._DEGREE_M * math.cos(math.radians(round(latitude, 1))))
        readings = [
            Reading(axis, value * size, is_total=True)
            for axis, (value, size) in enumerate(zip((latitude, longitude), per_degree, strict=True))
        ]
        values = [value / size for value, size in zip(change(t_ns, readings), per_degree, strict=True)]
        north, east = (
            _degrees_and_minutes(value, digits) for value, digits in zip(values, (2, 3), strict=True)
        )
        body = (
            f"{match[1].decode()},{north},{match[3].decode()},{east},{match[5].decode()},{match[6].decode()}"
        )
        return encode_sentence(body) + payload.partition(b"\n")[2]


def _degrees(text: bytes) -> float:
    degrees, minutes = divmod(float(text), 100.0)
    return degrees + minutes / 60.0


def _degrees_and_minutes(degrees: float, digits: int) -> str:
    units = round(degrees * 60e7)
    whole, in_degree = divmod(units, 600_000_000)
    return f"{whole:0{digits}d}{in_degree // 10_000_000:02d}.{in_degree % 10_000_000:07d}"


class CompassSentences:
    """The heading in a sentence of a compass, in degrees clockwise."""

    _HEADING = re.compile(rb"\$(HC[A-Z]+),([0-9.]+),([^*]*)\*")

    def change(self, t_ns: int, payload: bytes, change: Change) -> bytes:
        """Return the sentence with a changed heading."""
        match = self._HEADING.match(payload)
        if match is None:
            return payload
        (value,) = change(t_ns, [Reading(0, float(match[2]), is_total=True)])
        return encode_sentence(f"{match[1].decode()},{value % 360.0:.1f},{match[3].decode()}")
