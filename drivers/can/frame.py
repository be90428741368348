"""CAN frames as bytes, in the 16-byte layout of `struct can_frame` in linux/can.h."""

import struct
from typing import NamedTuple

EXTENDED_FLAG = 0x8000_0000
REMOTE_FLAG = 0x4000_0000
ERROR_FLAG = 0x2000_0000
EXTENDED_ID_MASK = 0x1FFF_FFFF
STANDARD_ID_MASK = 0x7FF
FRAME_SIZE = 16

_LAYOUT = struct.Struct("<IB3x8s")


class CanFrame(NamedTuple):
    """One classic CAN frame.

    Attributes:
        can_id: Identifier without flags, 11 or 29 bits; for an error frame its error classes.
        data: 0 to 8 bytes.
        is_extended: 29-bit identifier.
        is_remote: Requests data instead of carrying it.
        is_error: Made by the controller to report a bus error.
    """

    can_id: int
    data: bytes
    is_extended: bool = False
    is_remote: bool = False
    is_error: bool = False


def pack_can_frame(frame: CanFrame) -> bytes:
    """Return the 16 bytes of a frame with a valid identifier and at most 8 data bytes."""
    flags = frame.is_extended * EXTENDED_FLAG | frame.is_remote * REMOTE_FLAG | frame.is_error * ERROR_FLAG
    return _LAYOUT.pack(frame.can_id | flags, len(frame.data), frame.data)


def unpack_can_frame(payload: bytes) -> CanFrame | None:
    """Return the frame in 16 bytes, or None when they are not one (wrong size, length or identifier)."""
    if len(payload) != FRAME_SIZE:
        return None
    raw_id, length, data = _LAYOUT.unpack(payload)
    is_extended = bool(raw_id & EXTENDED_FLAG)
    is_error = bool(raw_id & ERROR_FLAG)
    can_id = raw_id & EXTENDED_ID_MASK
    if length > 8 or (can_id > STANDARD_ID_MASK and not is_extended and not is_error):
        return None
    return CanFrame(can_id, data[:length], is_extended, bool(raw_id & REMOTE_FLAG), is_error)


def can_frame_bits(payload: bytes) -> float:
    """Return the bits a frame occupies on the bus with average bit stuffing and inter-frame space.

    Source: ISO 11898-1 frame format; 47 or 67 fixed bits, data, and a stuff bit for every 10 on average.
    """
    frame = unpack_can_frame(payload)
    if frame is None:
        return 0.0
    return ((67 if frame.is_extended else 47) + 8 * len(frame.data)) * 1.1
