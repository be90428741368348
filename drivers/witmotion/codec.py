"""WitMotion frames: 0x55, type, four signed 16-bit little-endian words, sum of the first ten bytes.

The Bluetooth models (WT901BLE, WT901BLECL on USB, WT9011DCL and others) send acceleration, rate and angle in
one frame of 20 bytes: 0x55, 0x61, nine words of the same scales, no sum. Damaged words in it are not noticed,
lost bytes are: a frame counts only where another begins behind it. A magnetic field is not sent.

Source: WT901 data sheet v20-0702, sections 5.1.2 to 5.1.5; WT901BLECL manual, section 6.1.1. Sensor axes are
right-handed with z up; angles are Euler angles in the order z, y, x against an east-north-up frame, so yaw is
counter-clockwise.
"""

import math
import struct
from collections.abc import Sequence

from drivers.angles import wrap_rad
from drivers.driver import Rejection
from drivers.heading_calibration import MagnetometerCalibration, Vector
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

HEADER = 0x55
ACCELERATION, RATE, ANGLE, MAGNETIC = 0x51, 0x52, 0x53, 0x54
KNOWN_TYPES = frozenset({*range(0x50, 0x5B), 0x5F})
REGISTERS = 0x5F
COMBINED, LONG_REGISTERS = 0x61, 0x71
"""Types of frames of 20 bytes: measurements, and the answer to a request for registers."""
FRAME_SIZE = 11
LONG_FRAME_SIZE = 20
READ_BANDWIDTH = bytes((0xFF, 0xAA, 0x27, 0x1F, 0x00))
"""Request to read the register of the bandwidth; the answer is a frame of `REGISTERS`."""

ACCELERATION_STEP_M_S2 = 16.0 * STANDARD_GRAVITY_M_S2 / 32768
RATE_STEP_RAD_S = math.radians(2000.0) / 32768
ANGLE_STEP_RAD = math.pi / 32768

OLDEST_TILT_NS = 500_000_000
"""The device sends the angle frame just before the magnetic one; some may be damaged in between."""

_WORDS = struct.Struct("<BB4h")
_LONG_WORDS = struct.Struct("<BB9h")
_TYPES_BEHIND = frozenset({b""} | {bytes((kind,)) for kind in KNOWN_TYPES | {COMBINED, LONG_REGISTERS}})


def encode_frame(frame_type: int, first: int, second: int, third: int, fourth: int = 0) -> bytes:
    """Return a frame of four signed 16-bit words."""
    frame = _WORDS.pack(HEADER, frame_type, first, second, third, fourth)
    return frame + bytes((sum(frame) & 0xFF,))


def encode_acceleration(x_m_s2: float, y_m_s2: float, z_m_s2: float) -> bytes:
    """Return an acceleration frame in sensor axes; saturates at 16 g."""
    return _encode(ACCELERATION, ACCELERATION_STEP_M_S2, x_m_s2, y_m_s2, z_m_s2)


def encode_rate(x_rad_s: float, y_rad_s: float, z_rad_s: float) -> bytes:
    """Return an angular rate frame in sensor axes; saturates at 2000 deg/s."""
    return _encode(RATE, RATE_STEP_RAD_S, x_rad_s, y_rad_s, z_rad_s)


def encode_magnetic(x_counts: float, y_counts: float, z_counts: float) -> bytes:
    """Return a magnetic frame in sensor axes; saturates at 32767 counts."""
    return _encode(MAGNETIC, 1.0, x_counts, y_counts, z_counts)


def encode_angle(roll_rad: float, pitch_rad: float, yaw_rad: float) -> bytes:
    """Return an angle frame of the sensor; angles are wrapped to [-pi, pi)."""
    return _encode(ANGLE, ANGLE_STEP_RAD, wrap_rad(roll_rad), wrap_rad(pitch_rad), wrap_rad(yaw_rad))


def _encode(frame_type: int, step: float, first: float, second: float, third: float) -> bytes:
    words = [max(-32768, min(32767, round(value / step))) for value in (first, second, third)]
    return encode_frame(frame_type, *words)


class WitMotionCodec:
    """Reads acceleration, angular rate, angle, combined and, with a calibration, magnetic frames.

    Resynchronises by header, plausible type and sum. The sum catches every single-bit error in a frame; after
    a loss of synchronisation a chance match has probability 1/256 per candidate. Rejections: "framing" and
    "checksum" (once per stretch of unreadable bytes), "other_type", "no_attitude" (a magnetic frame
    without an angle frame in the half second before it), "no_magnetic_field" (a combined frame where a
    calibration asks for the field; its other quantities are read).

    Args:
        name: Name of the device in the configuration.
        mounting: Mounting of the sensor on the rover.
        calibration: Hard and soft iron; with it the heading comes from magnetic frames, tilt-compensated
            with the last roll and pitch, and no longer from the device's yaw.
    """

    def __init__(
        self, name: str, mounting: Mounting | None = None, calibration: MagnetometerCalibration | None = None
    ) -> None:
        self._name = name
        self._mounting = mounting or Mounting()
        self._calibration = calibration
        self._readers = {
            ACCELERATION: self._read_acceleration,
            RATE: self._read_rate,
            ANGLE: self._read_angle,
            REGISTERS: _read_nothing,
        }
        if calibration is not None:
            self._readers[MAGNETIC] = self._read_magnetic
        self._buffer = b""
        self._lost = False
        self._follows_long = False
        self._tilt_rad = (0.0, 0.0)
        self._tilt_ns: int | None = None

    def decode(self, item: Received[bytes]) -> Sequence[Sample | Rejection]:
        """Return the samples and rejections of the frames that `item` completes."""
        data = self._buffer + item.payload
        results: list[Sample | Rejection] = []
        position = 0
        while position < len(data):
            size = _frame_size(data, position)
            reason = _unreadable(data, position, size)
            if reason is None:
                if not self._is_whole(data, position + size, size):
                    break
                self._lost = False
                self._follows_long = size == LONG_FRAME_SIZE
                results.extend(self._read_frame(data, position, item.t_ns))
                position += size
            else:
                if not self._lost:
                    results.append(Rejection(reason))
                self._lost = True
                self._follows_long = False
                next_header = data.find(HEADER, position + 1)
                position = len(data) if next_header < 0 else next_header
        self._buffer = data[position:]
        return results

    def reset(self) -> None:
        """Forget a half-received frame and the last attitude."""
        self._buffer = b""
        self._lost = False
        self._follows_long = False
        self._tilt_ns = None

    def _is_whole(self, data: bytes, end: int, size: int) -> bool:
        """Return whether a frame has arrived; a long one, without a sum, needs another beside it."""
        return end < len(data) or (end == len(data) and (size == FRAME_SIZE or self._follows_long))

    def _read_frame(self, data: bytes, position: int, t_ns: int) -> Sequence[Sample | Rejection]:
        if data[position + 1] == COMBINED:
            return self._read_combined(t_ns, _LONG_WORDS.unpack_from(data, position)[2:])
        if data[position + 1] == LONG_REGISTERS:
            return ()
        _, frame_type, first, second, third, _ = _WORDS.unpack_from(data, position)
        reader = self._readers.get(frame_type)
        return (Rejection("other_type"),) if reader is None else reader(t_ns, (first, second, third))

    def _read_combined(self, t_ns: int, words: Sequence[float]) -> Sequence[Sample | Rejection]:
        ax, ay, az, rx, ry, rz, roll, pitch, yaw = words
        return (
            *self._read_acceleration(t_ns, (ax, ay, az)),
            *self._read_rate(t_ns, (rx, ry, rz)),
            *self._read_angle(t_ns, (roll, pitch, yaw)),
            *(() if self._calibration is None else (Rejection("no_magnetic_field"),)),
        )

    def _read_acceleration(self, t_ns: int, words: Vector) -> Sequence[Sample | Rejection]:
        x, y, z = (word * ACCELERATION_STEP_M_S2 for word in self._mounting.vector_to_rover(words))
        return (AccelerationSample(device=self._name, t_ns=t_ns, x_m_s2=x, y_m_s2=y, z_m_s2=z),)

    def _read_rate(self, t_ns: int, words: Vector) -> Sequence[Sample | Rejection]:
        x, y, z = self._mounting.vector_to_rover(words)
        x, y, z = self._mounting.correct_rate((x * RATE_STEP_RAD_S, y * RATE_STEP_RAD_S, z * RATE_STEP_RAD_S))
        return (RateSample(device=self._name, t_ns=t_ns, rate_x_rad_s=x, rate_y_rad_s=y, rate_z_rad_s=z),)

    def _read_angle(self, t_ns: int, words: Vector) -> Sequence[Sample | Rejection]:
        roll_rad, pitch_rad, yaw_rad = (word * ANGLE_STEP_RAD for word in words)
        roll_rad, pitch_rad, yaw_rad = self._mounting.attitude_to_rover(roll_rad, pitch_rad, yaw_rad)
        self._tilt_rad, self._tilt_ns = (roll_rad, pitch_rad), t_ns
        attitude = AttitudeSample(device=self._name, t_ns=t_ns, roll_rad=roll_rad, pitch_rad=pitch_rad)
        if self._calibration is not None:
            return (attitude,)
        return attitude, self._heading(t_ns, yaw_rad)

    def _read_magnetic(self, t_ns: int, words: Vector) -> Sequence[Sample | Rejection]:
        if self._calibration is None or not self._has_tilt(t_ns):
            return (Rejection("no_attitude"),)
        x, y, z = self._mounting.vector_to_rover(self._calibration.apply(words))
        roll_rad, pitch_rad = self._tilt_rad
        cos_roll, sin_roll = math.cos(roll_rad), math.sin(roll_rad)
        level_y = cos_roll * y - sin_roll * z
        level_x = math.cos(pitch_rad) * x + math.sin(pitch_rad) * (sin_roll * y + cos_roll * z)
        # The horizontal field points north, and yaw is the angle from east to the x axis.
        return (self._heading(t_ns, wrap_rad(math.atan2(level_x, level_y))),)

    def _has_tilt(self, t_ns: int) -> bool:
        return self._tilt_ns is not None and t_ns - self._tilt_ns <= OLDEST_TILT_NS

    def _heading(self, t_ns: int, yaw_rad: float) -> HeadingSample:
        reference = HeadingReference.MAGNETIC
        return HeadingSample(device=self._name, t_ns=t_ns, heading_rad=yaw_rad, reference=reference)


class MagneticReader(WitMotionCodec):
    """Keeps the raw magnetic frames, for a calibration.

    Args:
        mounting: Mounting of the sensor on the rover.

    Attributes:
        readings: Time in ns, counts of each axis of the sensor, and the rover's last roll and pitch in rad;
            only those that have an angle frame in the half second before.
    """

    def __init__(self, mounting: Mounting) -> None:
        super().__init__("", mounting)
        self.readings: list[tuple[int, Vector, tuple[float, float]]] = []
        self._readers[MAGNETIC] = self._keep

    def _keep(self, t_ns: int, words: Vector) -> Sequence[Sample | Rejection]:
        if self._has_tilt(t_ns):
            self.readings.append((t_ns, words, self._tilt_rad))
        return ()


def _read_nothing(t_ns: int, words: Vector) -> Sequence[Sample | Rejection]:
    """Return no sample of an answer to a request for registers; the doctor reads it."""
    return ()


def _frame_size(data: bytes, position: int) -> int:
    frame_type = data[position + 1] if position + 1 < len(data) else None
    return LONG_FRAME_SIZE if frame_type in (COMBINED, LONG_REGISTERS) else FRAME_SIZE


def _unreadable(data: bytes, position: int, size: int) -> str | None:
    """Return why no frame starts here; None when one does, or may do so once more bytes have arrived."""
    if data[position] != HEADER:
        return "framing"
    end = position + size
    if size == LONG_FRAME_SIZE:
        behind = data[end : end + 2]
        is_frame = not behind or (behind[0] == HEADER and behind[1:] in _TYPES_BEHIND)
        return None if is_frame else "framing"
    if position + 1 < len(data) and data[position + 1] not in KNOWN_TYPES:
        return "framing"
    if end <= len(data) and sum(data[position : end - 1]) & 0xFF != data[end - 1]:
        return "checksum"
    return None
