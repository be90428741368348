"""An Imu message of ROS as an MTData2 message of an Xsens sensor, whose numbers are exact."""

import struct
from collections.abc import Sequence

START = b"\xfa\xff"
MTDATA2 = 0x36
DOUBLES_EAST_NORTH_UP = 0x3
QUATERNION, ACCELERATION, RATE = 0x2010, 0x4020, 0x8020


def imu_bytes(
    rate_rad_s: Sequence[float] | None,
    acceleration_m_s2: Sequence[float] | None,
    orientation_wxyz: Sequence[float] | None,
) -> bytes:
    """Return the bytes of a message with what is given."""
    content = b"" if rate_rad_s is None else _item(RATE, rate_rad_s)
    if acceleration_m_s2 is not None:
        content += _item(ACCELERATION, acceleration_m_s2)
    if orientation_wxyz is not None:
        content += _item(QUATERNION, orientation_wxyz)
    body = bytes((0xFF, MTDATA2, len(content))) + content
    return START[:1] + body + bytes((-sum(body) & 0xFF,))


def _item(kind: int, numbers: Sequence[float]) -> bytes:
    data = struct.pack(f">{len(numbers)}d", *numbers)
    return struct.pack(">HB", kind | DOUBLES_EAST_NORTH_UP, len(data)) + data
