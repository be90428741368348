"""Robotino 3/4 board: vectors written by somebody else, escapes, resynchronisation, rejections, restarts."""

import math
import struct
from collections.abc import Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmarks.program.fuzz_parsers import held_bytes
from drivers.driver import Rejection
from drivers.link import Received
from drivers.robotino3_board.codec import Robotino3BoardCodec, build_message
from drivers.robotino3_board.frames import LARGEST_BODY, FrameScanner, build_frame
from drivers.robotino3_board.settings import Robotino3BoardSettings
from drivers.samples import BumperSample, PowerSample, Sample, WheelSample

SETTINGS = Robotino3BoardSettings(port="p")
RPM = math.tau / 60 / 32
TICK = math.tau / (2000 * 32)

# Written down from openrobotino's and fawkes' sources, independently of this program.
GET_READINGS = bytes.fromhex("aa 02 00 34 00 ca ff")
SPEEDS = bytes.fromhex("aa 0f 00 09 03 00 b5 fe 09 03 01 00 00 09 03 02 4b 01 cb fd")
ESCAPED = bytes.fromhex("aa 05 00 09 03 00 55 8a 00 45 ff")
READINGS = bytes.fromhex(
    "aa 2a 00 35 28 b6 fe 00 00 4a 01 00 00 5d f7 ff ff 00 00 00 00 9f 08 00 00 00 00 00 00"
    "00 00 00 bf cd cc 4c 3d 00 00 00 3f 00 00 00 00 61 f6"
)


def decode(
    data: bytes, codec: Robotino3BoardCodec | None = None, t_ns: int = 7
) -> Sequence[Sample | Rejection]:
    return (codec or Robotino3BoardCodec("board", SETTINGS)).decode(Received(t_ns, data))


def wheels(results: Sequence[Sample | Rejection]) -> list[WheelSample]:
    return [result for result in results if isinstance(result, WheelSample)]


def readings(ticks: tuple[int, int, int], current_a: float = 0.0) -> bytes:
    value = struct.pack("<4h4i4f", 0, 0, 0, 0, *ticks, 0, current_a, 0.0, 0.0, 0.0)
    return build_frame(build_message(53, value))


@pytest.mark.parametrize(
    ("frame", "body"),
    [
        (GET_READINGS, "34 00"),
        (SPEEDS, "09 03 00 b5 fe 09 03 01 00 00 09 03 02 4b 01"),
        (ESCAPED, "09 03 00 aa 00"),
    ],
)
def test_vectors_in_both_directions(frame: bytes, body: str) -> None:
    assert build_frame(bytes.fromhex(body)) == frame
    assert FrameScanner().feed(frame) == [bytes.fromhex(body)]


def test_vector_of_all_motor_readings() -> None:
    samples = wheels(decode(READINGS))
    assert [sample.wheel for sample in samples] == [0, 1, 2]
    assert [sample.speed_rad_s for sample in samples] == pytest.approx([-330 * RPM, 0.0, 330 * RPM])
    assert [sample.position_rad for sample in samples] == pytest.approx([-2211 * TICK, 0.0, 2207 * TICK])
    assert [sample.current_a for sample in samples] == pytest.approx([-0.5, 0.05, 0.5])
    assert all(sample.current_is_signed and sample.t_ns == 7 for sample in samples)


def test_a_request_holds_the_vector_of_its_set_points() -> None:
    codec = Robotino3BoardCodec("board", SETTINGS)
    (request,), meant = codec.encode_speeds((-331 * RPM, 0.0, 331 * RPM))
    assert request[3:18] == SPEEDS[3:18]
    (body,) = FrameScanner().feed(request)
    assert isinstance(body, bytes)
    assert body[15:] == bytes.fromhex("34 00 24 00")
    assert meant == pytest.approx((-331 * RPM, 0.0, 331 * RPM))


def test_set_points_are_whole_rpm_and_clipped() -> None:
    codec = Robotino3BoardCodec("board", SETTINGS)
    _, meant = codec.encode_speeds((100.4 * RPM, 1e6, -1e6))
    assert meant == pytest.approx((100 * RPM, 3000 * RPM, -3000 * RPM))


def test_stop_is_a_request_for_standstill() -> None:
    codec = Robotino3BoardCodec("board", SETTINGS)
    assert codec.encode_stop() == codec.encode_speeds((0.0, 0.0, 0.0))[0]


@pytest.mark.parametrize("is_on", [True, False])
def test_start_chooses_the_emergency_bumper(is_on: bool) -> None:
    codec = Robotino3BoardCodec("board", Robotino3BoardSettings(port="p", emergency_bumper=is_on))
    (start,) = codec.encode_start()
    assert FrameScanner().feed(start) == [bytes((57, 1, is_on))]


def test_bumper_and_power_source() -> None:
    power = struct.pack("<2f4BI", 24.5, 1.25, 1, 0, 2, 0, 0)
    bumper, supply = decode(build_frame(build_message(37, b"\x01") + build_message(65, power)))
    assert bumper == BumperSample(device="board", t_ns=7, pressed=True)
    assert supply == PowerSample(device="board", t_ns=7, voltage_v=24.5, current_a=1.25)


def test_tags_of_no_use_are_skipped() -> None:
    body = build_message(39, b"\x00") + build_message(70, bytes(8)) + build_message(37, b"\x00")
    assert list(decode(build_frame(body))) == [BumperSample(device="board", t_ns=7, pressed=False)]


@pytest.mark.parametrize(
    ("body", "reason"),
    [
        (build_message(53, bytes(39)), "layout"),
        (build_message(65, bytes(15)), "layout"),
        (build_message(37), "layout"),
        (b"\x35\x28\x00", "layout"),
        (b"\x35", "layout"),
        (build_message(252, b"motor 1"), "board_error"),
        (build_message(251, b"low"), "board_warning"),
        (build_message(65, struct.pack("<2f4BI", math.nan, 1.0, 0, 0, 1, 0, 0)), "range"),
        (build_message(65, struct.pack("<2f4BI", -1.0, 1.0, 0, 0, 1, 0, 0)), "range"),
        (build_message(65, struct.pack("<2f4BI", 24.0, 50.0, 0, 0, 1, 0, 0)), "range"),
    ],
)
def test_each_rejection_and_the_next_frame_is_read(body: bytes, reason: str) -> None:
    results = decode(build_frame(body) + READINGS)
    assert results[0] == Rejection(reason)
    assert len(wheels(results)) == 3


@pytest.mark.parametrize("current_a", [math.nan, math.inf, -21.0])
def test_currents_that_cannot_be(current_a: float) -> None:
    assert list(decode(readings((0, 0, 0), current_a))) == [Rejection("range")]


def test_positions_continue_across_the_end_of_the_register() -> None:
    codec = Robotino3BoardCodec("board", SETTINGS)
    top = 2**31 - 1
    before = wheels(decode(readings((top, -top, 0)), codec, 0))
    after = wheels(decode(readings((-top, top, 0)), codec, 20_000_000))
    turned = [(b.position_rad or 0.0) - (a.position_rad or 0.0) for a, b in zip(before, after, strict=True)]
    assert turned == pytest.approx([2 * TICK, -2 * TICK, 0.0], abs=1e-9)


def test_a_restarted_board_does_not_move_the_rover() -> None:
    codec = Robotino3BoardCodec("board", SETTINGS)
    before = wheels(decode(readings((500_000, -500_000, 0)), codec, 0))
    jump = decode(readings((0, 0, 0)), codec, 20_000_000)
    assert [result for result in jump if isinstance(result, Rejection)] == [Rejection("implausible_jump")] * 2
    after = wheels(decode(readings((0, 0, 0)), codec, 40_000_000))
    assert [sample.position_rad for sample in after] == [sample.position_rad for sample in before]


# Framing


@given(st.binary(max_size=LARGEST_BODY))
def test_every_body_survives_its_frame(body: bytes) -> None:
    frame = build_frame(body)
    assert frame.count(b"\xaa") == 1
    assert FrameScanner().feed(frame) == [body]


@pytest.mark.parametrize(
    ("before", "reason"),
    [
        (b"\x00\x01\x02", "framing"),
        (READINGS[:20], "framing"),
        (READINGS[5:], "framing"),
        (b"\xaa\xff\xff\x00", "framing"),
        (READINGS[:-1] + b"\xf7", "checksum"),
        (b"\xaa\x55", "framing"),
    ],
)
def test_resynchronises(before: bytes, reason: str) -> None:
    results = decode(before + READINGS)
    assert results[0] == Rejection(reason)
    assert len(results) == 4


def test_split_at_every_byte_changes_nothing() -> None:
    stream = b"\x12" + ESCAPED + READINGS[:9] + READINGS + ESCAPED + b"\x55" + readings((0xAA, 0x55, 0)) * 2
    whole = list(decode(stream))
    assert sum(isinstance(result, Sample) for result in whole) == 9
    for cut in range(len(stream) + 1):
        codec = Robotino3BoardCodec("board", SETTINGS)
        assert [*decode(stream[:cut], codec), *decode(stream[cut:], codec)] == whole


def test_no_single_bit_error_gives_a_sample() -> None:
    for bit in range(8 * len(READINGS)):
        flipped = bytearray(READINGS)
        flipped[bit // 8] ^= 1 << bit % 8
        results = decode(bytes(flipped))
        assert [result for result in results if isinstance(result, Sample)] == []


def test_buffer_is_bounded_and_forgotten_on_reset() -> None:
    codec = Robotino3BoardCodec("board", SETTINGS)
    decode(b"\xaa\x90\x01" + bytes(10_000), codec)
    assert held_bytes(codec) <= held_bytes(Robotino3BoardCodec("board", SETTINGS)) + LARGEST_BODY + 4
    codec.reset()
    decode(READINGS[:20], codec)
    codec.reset()
    assert list(decode(READINGS[20:], codec)) == [Rejection("framing")]
