"""Frames for the tests of the CAN wheels, packed without the DBC files, and ways to look at what they say."""

import dataclasses
import struct
from collections.abc import Sequence

import pytest

from drivers.can.frame import CanFrame, pack_can_frame
from drivers.can_wheels.codec import CanWheelsCodec
from drivers.driver import Rejection
from drivers.link import Received
from drivers.samples import Sample, WheelSample


def frame(can_id: int, data: bytes | str, **flags: bool) -> bytes:
    return pack_can_frame(CanFrame(can_id, bytes.fromhex(data) if isinstance(data, str) else data, **flags))


def decode(codec: CanWheelsCodec, payload: bytes, t_ns: int = 1) -> list[Sample | Rejection]:
    return list(codec.decode(Received(t_ns, payload)))


def wheel_samples(told: Sequence[Sample | Rejection]) -> list[WheelSample]:
    return [sample for sample in told if isinstance(sample, WheelSample)]


def reasons(told: Sequence[Sample | Rejection]) -> list[str]:
    return [rejection.reason for rejection in told if isinstance(rejection, Rejection)]


def assert_same(told: Sample | Rejection, expected: Sample) -> None:
    """Compare field by field, floats approximately."""
    assert type(told) is type(expected)
    for field in dataclasses.fields(expected):
        value, wanted = getattr(told, field.name), getattr(expected, field.name)
        assert value == (pytest.approx(wanted) if isinstance(wanted, float) else wanted), field.name


def crc8(data: bytes) -> int:
    crc = 0xFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = ((crc << 1) ^ (0x1D if crc & 0x80 else 0)) & 0xFF
    return crc ^ 0xFF


def generic_state(wheel: int, position: int, speed: int, current: int, counter: int) -> bytes:
    """Pack a state message bit by bit as its DBC file describes it, without the DBC file."""
    first = (position & 0xFFFFF) | counter << 20
    data = first.to_bytes(3, "little") + struct.pack("<hh", speed, current)
    return frame(0x120 + wheel, data + bytes((crc8(data),)))
