"""What the CAN controller reports, faults in words, and bytes that nobody should send."""

import math
import struct
from collections.abc import Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.can.faults import fault_text
from drivers.can_wheels.codec import CanWheelsCodec
from drivers.can_wheels.mapping_file import load_mapping
from drivers.driver import Rejection
from drivers.samples import FaultSample, Sample, WheelSample
from tests.drivers.can_wheels_frames import crc8, decode, frame, generic_state, reasons, wheel_samples

GENERIC = load_mapping("generic_wheel")
ODRIVE_5 = load_mapping("odrive_0_5")
ODRIVE_6 = load_mapping("odrive_0_6")


@pytest.mark.parametrize(
    ("classes", "data", "told"),
    [
        (0x040, "", "bus off: the controller has left the bus"),
        (0x020, "", "no acknowledge: nobody else on the bus listens"),
        (0x001, "", "transmit time-out"),
        (0x088, "", "protocol violation, bus error"),
        (0x004, "0001", "receive overflow: frames were lost"),
        (0x004, "0020", "error-passive after transmit errors"),
        (0x204, "0018000000008000", "warning level of transmit errors, error-passive after receive errors"),
        (0x044, "0040", "bus off: the controller has left the bus"),
        (0x400, "", "error classes 0x400"),
        (0x004, "", "error classes 0x4"),
    ],
)
def test_error_frame_is_a_fault_of_the_bus(classes: int, data: str, told: str) -> None:
    (fault,) = decode(CanWheelsCodec("wheels", GENERIC), frame(classes, data, is_error=True))
    code = classes & ~0x200
    assert fault == FaultSample(device="wheels", t_ns=1, wheel=None, code=code, text=f"CAN bus: {told}")


@pytest.mark.parametrize(
    ("classes", "data", "reason"),
    [(0x002, "0b", "bus_lost_arbitration"), (0x004, "0008", "bus_warning"), (0x204, "000c", "bus_warning")],
)
def test_normal_reports_of_the_controller_are_only_counted(classes: int, data: str, reason: str) -> None:
    told = decode(CanWheelsCodec("wheels", GENERIC), frame(classes, data, is_error=True))
    assert told == [Rejection(reason)]


@pytest.mark.parametrize(("classes", "data"), [(0x100, ""), (0x004, "0040")])
def test_controller_that_recovers_clears_the_bus_fault(classes: int, data: str) -> None:
    codec = CanWheelsCodec("wheels", GENERIC)
    assert decode(codec, frame(classes, data, is_error=True)) == []
    decode(codec, frame(0x040, "", is_error=True))
    (cleared,) = decode(codec, frame(classes, data, is_error=True), 5)
    assert cleared == FaultSample(device="wheels", t_ns=5, code=0, text="CAN bus: cleared")


def test_bus_fault_ends_when_frames_come_and_errors_stay_away_for_a_second() -> None:
    codec = CanWheelsCodec("wheels", GENERIC)
    assert len(decode(codec, frame(0x080, "", is_error=True), 0)) == 1
    assert decode(codec, frame(0x080, "", is_error=True), 500_000_000) == []
    assert wheel_samples(decode(codec, generic_state(0, 1, 0, 0, 0), 1_400_000_000)) != []
    told = decode(codec, frame(0x7FF, ""), 1_500_000_000)
    assert reasons(told) == ["other_traffic"]
    assert told[0] == FaultSample(device="wheels", t_ns=1_500_000_000, code=0, text="CAN bus: cleared")
    assert len(decode(codec, generic_state(0, 1, 0, 0, 1), 1_600_000_000)) == 1


def test_bus_fault_does_not_hide_a_fault_of_the_drive() -> None:
    codec = CanWheelsCodec("wheels", GENERIC)
    data = struct.pack("<HHB", 0x10, 24_000, 0)
    decode(codec, frame(0x100, data + bytes((crc8(data),))))
    decode(codec, frame(0x040, "", is_error=True))
    (left,) = decode(codec, frame(0x100, "", is_error=True))
    assert isinstance(left, FaultSample)
    assert (left.code, left.text) == (0x10, "Drive_Status.Faults: emergency stop")


def test_error_word_in_words() -> None:
    names = {0: "fine", 1: "one", 2: "two", 3: "both", 8: "eight"}
    assert fault_text(3, names) == "both"
    assert fault_text(10, names) == "two, eight"
    assert fault_text(0x40, names) == "code 0x40"
    assert fault_text(0, {}) == ""


VALID = (
    [generic_state(wheel, 1234, 100, -100, 0) for wheel in range(4)]
    + [frame(node << 5 | 0x09, "0000c03f000010c0") for node in range(4)]
    + [frame(0x61, "4008000008010000"), frame(0x17, "cdccc0419a99993f")]
    + [frame(0x204, "00180000", is_error=True)]
)  # fmt: skip


def assert_sound(told: Sequence[Sample | Rejection]) -> None:
    for part in told:
        assert isinstance(part, Sample | Rejection)
        if isinstance(part, WheelSample):
            for value in (part.position_rad, part.speed_rad_s, part.current_a, part.voltage_v):
                assert value is None or math.isfinite(value)


@given(
    st.lists(
        st.tuples(
            st.sampled_from(VALID),
            st.dictionaries(st.integers(0, 15), st.integers(0, 255), max_size=4),
            st.integers(0, 16),
            st.integers(0, 2 * 10**9),
        ),
        max_size=20,
    )
)
def test_damaged_frames_never_raise(parts: list[tuple[bytes, dict[int, int], int, int]]) -> None:
    for bus in (GENERIC, ODRIVE_5, ODRIVE_6):
        codec = CanWheelsCodec("wheels", bus)
        for valid, changes, length, t_ns in parts:
            payload = bytearray(valid)
            for index, value in changes.items():
                payload[index] = value
            assert_sound(decode(codec, bytes(payload), t_ns))
            assert_sound(decode(codec, bytes(payload[:length]), t_ns))
