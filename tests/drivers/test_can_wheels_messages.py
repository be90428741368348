"""Checksums, counters and limits of single CAN messages."""

import math
import struct
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Literal

import cantools
import numpy as np
import pytest
from cantools.database.can import Database, Message
from hypothesis import given
from hypothesis import strategies as st

from drivers import can_wheels
from drivers.can.frame import unpack_can_frame
from drivers.can_wheels.layout import Layout
from drivers.can_wheels.mapping import Protection
from drivers.can_wheels.messages import MessageReader, MessageWriter, crc8_j1850, sum8, xor8
from drivers.can_wheels.signals import make_scale, raw_limits

DBC = """VERSION ""
BU_: A B
BO_ 291 Protected: 4 A
 SG_ Value : 7|12@0- (0.5,10) [-900|900] "x" B
 SG_ Counter : 11|4@0+ (1,0) [0|15] "" B
 SG_ Other : 16|8@1+ (1,0) [0|0] "" B
 SG_ Checksum : 24|8@1+ (1,0) [0|255] "" B
BO_ 2147483939 Floats: 8 A
 SG_ First : 0|32@1- (1,0) [-100|100] "x" B
 SG_ Second : 32|32@1- (1,0) [0|0] "x" B
BO_ 5 Falling: 2 A
 SG_ Value : 0|16@1+ (-0.1,5) [-20|4] "x" B
BO_ 6 Checksum_First: 3 A
 SG_ Checksum : 7|8@0+ (1,0) [0|255] "" B
 SG_ Value : 8|16@1+ (1,0) [0|0] "x" B
SIG_VALTYPE_ 2147483939 First : 1;
SIG_VALTYPE_ 2147483939 Second : 1;
"""


def database() -> Database:
    loaded = cantools.database.load_string(DBC, "dbc")
    assert isinstance(loaded, Database)
    return loaded


def message(name: str) -> Message:
    return database().get_message_by_name(name)


def protection(
    *, modulus: int | None = None, checksum: str | None = "Checksum", counter: str | None = "Counter"
) -> Protection:
    return Protection(
        messages=("Protected",),
        counter=counter,
        counter_modulus=modulus,
        checksum=checksum,
        algorithm=None if checksum is None else "crc8_j1850",
    )


def slow_crc8_j1850(data: bytes) -> int:
    """Divide bit by bit, as SAE J1850 defines it."""
    crc = 0xFF
    for byte in data:
        for bit in range(7, -1, -1):
            feedback = (crc >> 7) ^ (byte >> bit & 1)
            crc = (crc << 1) & 0xFF
            if feedback:
                crc ^= 0x1D
    return crc ^ 0xFF


def data_of(payload: bytes) -> bytes:
    frame = unpack_can_frame(payload)
    assert frame is not None
    return frame.data


def counted(counters: Sequence[int], modulus: int | None = None) -> list[tuple[str, str]]:
    """Return ("taken" or "", objection) for messages with these counters and right checksums."""
    reader = MessageReader(message("Protected"), ["Value"], protection(modulus=modulus))
    told = []
    for counter in counters:
        data = bytes((0, counter, 0))
        values, objection = reader.read(data + bytes((slow_crc8_j1850(data),)))
        told.append(("" if values is None else "taken", "" if objection is None else objection.reason))
    return told


def test_checksums_have_their_published_check_values() -> None:
    assert crc8_j1850(b"123456789") == 0x4B
    assert sum8(b"123456789") == 0xDD
    assert xor8(b"123456789") == 0x31


@given(st.binary(max_size=12))
def test_table_crc_equals_bitwise_crc(data: bytes) -> None:
    assert crc8_j1850(data) == slow_crc8_j1850(data)


def test_written_message_is_read_back_and_guarded_against_every_single_bit_error() -> None:
    writer = MessageWriter(message("Protected"), protection())
    data = data_of(writer.write({"Value": -700, "Other": 77}))
    # Value -700 = 0xD44 in the 12 bits from the top, counter 0 below, then 77.
    assert data[:3] == bytes((0xD4, 0x40, 77))
    values, objection = MessageReader(message("Protected"), ["Value"], protection()).read(data)
    assert objection is None
    assert values is not None
    assert values["Value"] == -700
    for bit in range(32):
        damaged = bytearray(data)
        damaged[bit // 8] ^= 1 << bit % 8
        values, objection = MessageReader(message("Protected"), ["Value"], protection()).read(bytes(damaged))
        assert values is None
        assert objection is not None
        assert objection.reason == "checksum"


def test_checksum_covers_the_other_bytes_in_order() -> None:
    data = data_of(MessageWriter(message("Protected"), protection()).write({"Value": 1, "Other": 2}))
    assert data[3] == slow_crc8_j1850(data[:3])


@pytest.mark.parametrize(
    ("algorithm", "expected"), [("crc8_j1850", 0xA5), ("xor8", 0x34 ^ 0x12), ("sum8", 0x46)]
)
def test_checksum_may_come_first(algorithm: Literal["crc8_j1850", "xor8", "sum8"], expected: int) -> None:
    first = Protection(messages=("Checksum_First",), checksum="Checksum", algorithm=algorithm)
    data = data_of(MessageWriter(message("Checksum_First"), first).write({"Value": 0x1234}))
    assert data == bytes((expected, 0x34, 0x12))
    values, _ = MessageReader(message("Checksum_First"), ["Value"], first).read(data)
    assert values is not None
    assert values["Value"] == 0x1234


def test_writer_counts_up_and_starts_again_at_the_modulus() -> None:
    writer = MessageWriter(message("Protected"), protection(modulus=3))
    assert [data_of(writer.write({}))[1] & 0xF for _ in range(5)] == [0, 1, 2, 0, 1]


def test_counter_that_stands_still_never_becomes_good_by_itself() -> None:
    told = counted([4] * 40)
    assert told[0] == ("taken", "")
    assert set(told[1:]) == {("", "counter_repeat")}


def test_counter_accepts_the_step_across_its_end() -> None:
    assert counted([14, 15, 0, 1]) == [("taken", "")] * 4
    assert counted([13, 14, 0, 1], modulus=15) == [("taken", "")] * 4


def test_lost_messages_are_counted_and_the_fresh_one_is_taken() -> None:
    assert counted([1, 3, 4, 9]) == [
        ("taken", ""), ("taken", "frames_lost"), ("taken", ""), ("taken", "frames_lost")
    ]  # fmt: skip


def test_a_message_from_before_is_refused_and_forgotten() -> None:
    assert counted([1, 3, 2, 4]) == [
        ("taken", ""), ("taken", "frames_lost"), ("", "counter_backwards"), ("taken", "")
    ]  # fmt: skip


def test_restarted_device_is_heard_again_after_a_quarter_of_the_range_at_most() -> None:
    for last in range(16):
        told = counted([last, *range(16)])
        refused = [objection for taken, objection in told if not taken]
        assert len(refused) <= 5
        assert told[-1][0] == "taken"


def test_damaged_message_does_not_move_the_counter() -> None:
    reader = MessageReader(message("Protected"), ["Value"], protection())
    good = [bytes((0, counter, 0)) for counter in range(4)]
    good = [data + bytes((slow_crc8_j1850(data),)) for data in good]
    assert reader.read(good[0])[1] is None
    assert reader.read(b"\x00\x08\x00\x00")[0] is None
    assert reader.read(good[1])[1] is None


def test_reset_forgets_the_counter() -> None:
    reader = MessageReader(message("Protected"), ["Value"], protection(checksum=None))
    assert reader.read(bytes((0, 5, 0, 0)))[1] is None
    reader.reset()
    assert reader.read(bytes((0, 5, 0, 0)))[1] is None


def test_short_message_is_refused_and_padding_ignored() -> None:
    reader = MessageReader(message("Protected"), ["Value"], None)
    values, objection = reader.read(b"\x00\x00\x00")
    assert values is None
    assert objection is not None
    assert objection.reason == "too_short"
    values, objection = reader.read(b"\x01\x00\x00\x00\xaa\xbb\xcc\xdd")
    assert objection is None
    assert values is not None
    assert values["Value"] == 16


@pytest.mark.parametrize(
    ("first", "second", "reason"),
    [
        (math.nan, 0.0, "not_finite"),
        (math.inf, 0.0, "not_finite"),
        (0.0, -math.inf, "not_finite"),
        (100.5, 0.0, "out_of_range"),
        (-100.5, 0.0, "out_of_range"),
    ],
)
def test_bad_floats_reject_the_whole_message(first: float, second: float, reason: str) -> None:
    reader = MessageReader(message("Floats"), ["First", "Second"], None)
    values, objection = reader.read(struct.pack("<ff", first, second))
    assert values is None
    assert objection is not None
    assert objection.reason == reason


def test_only_used_signals_are_checked() -> None:
    values, objection = MessageReader(message("Floats"), ["First"], None).read(
        struct.pack("<ff", 1, math.nan)
    )
    assert objection is None
    assert values is not None


def test_limits_come_from_size_and_dbc_even_when_the_scale_falls() -> None:
    assert raw_limits(message("Protected").get_signal_by_name("Value")) == (-1820, 1780)
    assert raw_limits(message("Protected").get_signal_by_name("Other")) == (0, 255)
    assert raw_limits(message("Falling").get_signal_by_name("Value")) == (10, 250)


@pytest.mark.parametrize("size", [1.0, -2.5])
def test_conversion_clips_and_rounds_as_the_message_will(size: float) -> None:
    scale = make_scale("Protected", message("Protected").get_signal_by_name("Value"), size)
    assert scale.to_si(2) == pytest.approx(11 * size)
    assert scale.to_raw(11.2 * size) == 2
    assert scale.to_raw(1e9 * size) == 1780
    assert scale.to_raw(-1e300 * size) == -1820


@given(st.floats(min_value=-100, max_value=100))
def test_float_signal_means_what_the_bytes_hold(value: float) -> None:
    scale = make_scale("Floats", message("Floats").get_signal_by_name("First"), 1.0)
    held: Mapping[str, float] = {"First": scale.to_raw(value)}
    data = data_of(MessageWriter(message("Floats"), None).write(held))
    assert struct.unpack("<f", data[:4])[0] == scale.to_raw(value) == pytest.approx(value, abs=4e-6)
    assert data[:4] != b"\x00\x00\x00\x80"  # no negative zero


SHIPPED = [
    cantools.database.load_file(path) for path in sorted(Path(can_wheels.__file__).parent.glob("*.dbc"))
]


@pytest.mark.parametrize(
    "known",
    [
        known
        for loaded in (database(), *SHIPPED)
        if isinstance(loaded, Database)
        for known in loaded.messages
        if known.length <= 8 and not known.is_multiplexed()
    ],
    ids=lambda known: known.name,
)
def test_messages_are_packed_and_read_as_by_cantools(known: Message) -> None:
    generator = np.random.default_rng(known.frame_id)
    layout = Layout(known, [signal.name for signal in known.signals])
    for _ in range(20):
        values: dict[str, float] = {}
        for signal in known.signals:
            low, high = raw_limits(signal)
            number = float(np.float32(generator.uniform(max(low, -1e6), min(high, 1e6))))
            values[signal.name] = number if signal.is_float else round(number)
        data = known.encode(values, scaling=False, strict=False)
        assert layout.pack(dict(values)) == data
        assert layout.unpack(data) == known.decode_simple(data, decode_choices=False, scaling=False) == values
