import math
import struct
from collections.abc import Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from drivers.clock import VirtualClock
from drivers.driver import Rejection, WheelDrive
from drivers.link import Received
from drivers.robotino_board.codec import (
    REPLY_SIZE,
    REQUEST_SIZE,
    BoardReply,
    BoardRequest,
    RobotinoBoardCodec,
    build_reply,
    build_request,
    parse_reply,
    parse_request,
)
from drivers.robotino_board.parameters import Board
from drivers.robotino_board.settings import RobotinoBoardSettings
from drivers.samples import BumperSample, LinkSample, PowerSample, Sample, WheelCommand, WheelSample
from tests.drivers.test_driver import ScriptedLink

STEP_RAD_S = 27 * math.tau / 60 / 16
TICK_RAD = math.tau / 2000 / 16
MILLISECOND_NS = 1_000_000

GOLDEN_REQUEST = bytes.fromhex(
    "52 45 43 08 01 00 0c 00 00 00 00 ff ff ff 01 02 00 00 00 00 00 ff ff ff"
    "01 02 0c 00 00 00 00 ff ff ff 01 02 00 00 00 00 00 00 00 00 72 65 63"
)
GOLDEN_STOP = bytes.fromhex(
    "52 45 43 08 00 02 00 00 00 00 00 ff ff ff 00 02 00 00 00 00 00 ff ff ff"
    "00 02 00 00 00 00 00 ff ff ff 01 02 00 00 00 00 00 00 00 00 72 65 63"
)


def make_settings(board: Board = "EA05", **changes: object) -> RobotinoBoardSettings:
    return RobotinoBoardSettings.model_validate(
        {"type": "robotino_board", "port": "/dev/ttyUSB0", "board": board, **changes}
    )


def make_codec(board: Board = "EA05") -> RobotinoBoardCodec:
    return RobotinoBoardCodec("board", make_settings(board))


def make_reply(ticks: Sequence[int], time_ms: int = 1000, board: Board = "EA05") -> BoardReply:
    t0, t1, t2 = ticks
    return BoardReply((t0, t1, t2), (12, -3, 0), (40, 44, 0), 868, 60, False, time_ms, board)


def hand_made_reply() -> bytearray:
    """Write a reply byte by byte from the table of offsets."""
    frame = bytearray(REPLY_SIZE)
    frame[0:3] = b"REC"
    frame[3], frame[11] = 30, 0b01  # system current 121 counts
    frame[5] = 217  # battery 868 counts
    frame[14], frame[22] = 62, 0b10  # motor current 250 counts
    frame[24], frame[25] = 0x81, 12  # forward, version of an EA05; 12 steps
    frame[26:30] = struct.pack("<i", -70_000)
    frame[30] = 0x10  # bumper
    frame[31:35] = struct.pack("<I", 123_456)
    frame[35], frame[43] = 10, 0b00
    frame[45], frame[46] = 0x00, 7
    frame[47:51] = struct.pack("<i", 5)
    frame[56], frame[64] = 200, 0b11  # motor current 803 counts
    frame[66], frame[67] = 0x01, 255
    frame[68:72] = struct.pack("<i", 0)
    frame[98:101] = b"rec"
    return frame


def with_other_fields_set(frame: bytearray) -> bytearray:
    """Set every bit that belongs to other converters, inputs and the auxiliary output."""
    frame[4] = frame[6] = frame[10] = 0xFF
    frame[11] |= 0xFC
    for motor in (14, 35, 56):
        frame[motor + 1 : motor + 8] = bytes((0xFF,)) * 7
        frame[motor + 8] |= 0xFC
        frame[motor + 9] = 0xFF
        frame[motor + 16] |= 0x0F
    frame[77:98] = bytes((0xFF,)) * 21
    return frame


def decode(
    codec: RobotinoBoardCodec, payload: bytes, t_ns: int = 5 * MILLISECOND_NS
) -> list[Sample | Rejection]:
    return list(codec.decode(Received(t_ns, payload)))


def positions(decoded: Sequence[Sample | Rejection]) -> list[int]:
    """Return wheel positions in ticks, in the order in which they were reported."""
    found = [item.position_rad for item in decoded if isinstance(item, WheelSample)]
    return [round(angle / TICK_RAD) for angle in found if angle is not None]


def reasons(decoded: Sequence[Sample | Rejection]) -> list[str]:
    return [item.reason for item in decoded if isinstance(item, Rejection)]


def test_request_has_the_golden_bytes() -> None:
    rpm_331 = 331 * math.tau / 60 / 16
    payloads, really = make_codec().encode_speeds((-rpm_331, 0.0, rpm_331))
    assert payloads == [GOLDEN_REQUEST]
    assert really == pytest.approx((-12 * STEP_RAD_S, 0.0, 12 * STEP_RAD_S))


def test_stop_is_one_request_with_the_brakes_on_and_start_sends_nothing() -> None:
    assert make_codec().encode_stop() == [GOLDEN_STOP]
    assert make_codec().encode_start() == []


def test_gains_reach_each_motor() -> None:
    codec = RobotinoBoardCodec("board", make_settings(kp=200, ki=10, kd=3))
    (request,), _ = codec.encode_speeds((0.0, 0.0, 0.0))
    assert [request[at : at + 3] for at in (11, 21, 31)] == [bytes((200, 10, 3))] * 3


@pytest.mark.parametrize(
    ("board", "current_a", "system_a", "battery_v"),
    [
        ("EA05", 250 / 156, 121 / 61.44, 868 / 36.10),
        ("EA09", 0.15 * 250 / 156, 3 * 121 / 61.44, 0.89 * 868 / 36.10),
    ],
)
def test_hand_made_reply_is_read(board: Board, current_a: float, system_a: float, battery_v: float) -> None:
    frame = with_other_fields_set(hand_made_reply())
    if board == "EA09":
        frame[24] = 0x41
    first, second, third, power, bumper = decode(make_codec(board), bytes(frame), 77)
    assert isinstance(first, WheelSample)
    assert (first.device, first.t_ns, first.t_device_ns) == ("board", 77, 123_456 * MILLISECOND_NS)
    assert (first.wheel, first.current_is_signed, first.voltage_v) == (0, False, None)
    assert first.position_rad == pytest.approx(70_000 * TICK_RAD)
    assert first.speed_rad_s == pytest.approx(12 * STEP_RAD_S)
    assert first.current_a == pytest.approx(current_a)
    assert isinstance(second, WheelSample)
    assert isinstance(third, WheelSample)
    assert (second.wheel, third.wheel) == (1, 2)
    assert second.position_rad == pytest.approx(-5 * TICK_RAD)
    assert second.speed_rad_s == pytest.approx(-7 * STEP_RAD_S)
    assert third.speed_rad_s == pytest.approx(255 * STEP_RAD_S)
    assert third.current_a == pytest.approx(current_a * 803 / 250)
    assert isinstance(power, PowerSample)
    assert (power.voltage_v, power.current_a) == pytest.approx((battery_v, system_a))
    assert isinstance(bumper, BumperSample)
    assert bumper.pressed


def test_hand_made_reply_is_built() -> None:
    reply = BoardReply(
        ticks=(70_000, -5, 0),
        speed_steps=(12, -7, 255),
        current_raw=(250, 40, 803),
        battery_raw=868,
        system_current_raw=121,
        bumper_pressed=True,
        time_ms=123_456,
        board="EA05",
    )
    assert build_reply(reply) == bytes(hand_made_reply())


def three(elements: st.SearchStrategy[int]) -> st.SearchStrategy[tuple[int, int, int]]:
    return st.tuples(elements, elements, elements)


REPLIES = st.builds(
    BoardReply,
    ticks=three(st.integers(-(2**31), 2**31 - 1)),
    speed_steps=three(st.integers(-255, 255)),
    current_raw=three(st.integers(0, 1023)),
    battery_raw=st.integers(0, 255).map(lambda high: 4 * high),
    system_current_raw=st.integers(0, 1023),
    bumper_pressed=st.booleans(),
    time_ms=st.integers(0, 2**32 - 1),
    board=st.sampled_from(("EA05", "EA09")),
    motor_fault=st.booleans(),
)
REQUESTS = st.builds(
    BoardRequest,
    speed_steps=three(st.integers(-255, 255)),
    brakes_off=st.tuples(st.booleans(), st.booleans(), st.booleans()),
    gains=three(st.integers(0, 255)),
)


@given(REPLIES)
def test_reply_survives_the_wire(reply: BoardReply) -> None:
    frame = build_reply(reply)
    assert len(frame) == REPLY_SIZE
    assert parse_reply(frame) == reply


@given(REQUESTS)
def test_request_survives_the_wire(request: BoardRequest) -> None:
    frame = build_request(request)
    assert len(frame) == REQUEST_SIZE
    assert parse_request(frame) == request


FINITE = st.floats(allow_nan=False, allow_infinity=False)


@given(st.tuples(FINITE, FINITE, FINITE))
def test_speeds_are_cut_to_whole_steps_and_what_was_meant_is_told(speeds: tuple[float, ...]) -> None:
    codec = make_codec()
    (request,), really = codec.encode_speeds(speeds)
    steps = parse_request(request).speed_steps
    assert really == pytest.approx([count * STEP_RAD_S for count in steps])
    for asked, meant in zip(speeds, really, strict=True):
        assert meant * asked >= 0
        assert abs(meant) <= abs(asked) + 1e-8
        assert abs(asked) - abs(meant) < STEP_RAD_S or abs(meant) == pytest.approx(255 * STEP_RAD_S)
    assert codec.encode_speeds(really) == ([request], really)


STREAM = b"".join(build_reply(make_reply((n, -n, 2 * n), 1000 + n)) for n in (100, 200, 300))
STREAM_POSITIONS = [100, -100, 200, 200, -200, 400, 300, -300, 600]


def test_stream_may_be_split_at_every_byte() -> None:
    for cut in range(len(STREAM) + 1):
        codec = make_codec()
        decoded = decode(codec, STREAM[:cut]) + decode(codec, STREAM[cut:])
        assert positions(decoded) == STREAM_POSITIONS
        assert reasons(decoded) == []


def test_stream_may_come_byte_by_byte_with_the_time_of_each_last_byte() -> None:
    codec = make_codec()
    decoded = [item for t_ns, byte in enumerate(STREAM) for item in decode(codec, bytes((byte,)), t_ns)]
    assert positions(decoded) == STREAM_POSITIONS
    assert [item.t_ns for item in decoded if isinstance(item, BumperSample)] == [100, 201, 302]


@given(st.integers(0, len(STREAM)), st.binary(min_size=1, max_size=300), st.integers(1, 120))
def test_inserted_noise_costs_at_most_the_replies_it_touches(at: int, noise: bytes, chunk: int) -> None:
    damaged = STREAM[:at] + noise + STREAM[at:] + STREAM[-REPLY_SIZE:]
    codec = make_codec()
    decoded = [
        item
        for start in range(0, len(damaged), chunk)
        for item in decode(codec, damaged[start : start + chunk])
    ]
    heard = positions(decoded)
    touched = at // REPLY_SIZE if at % REPLY_SIZE else None
    without_touched = [
        ticks for n in range(3) if n != touched for ticks in STREAM_POSITIONS[3 * n : 3 * n + 3]
    ]
    # Noise inside a reply may happen to leave it whole, such as an R after its first R.
    assert heard in (without_touched + STREAM_POSITIONS[-3:], STREAM_POSITIONS + STREAM_POSITIONS[-3:])
    assert set(reasons(decoded)) == {"framing"}


@given(st.integers(0, 2 * REPLY_SIZE - 1), st.integers(1, REPLY_SIZE - 1))
def test_lost_bytes_cost_at_most_the_replies_they_touch(at: int, count: int) -> None:
    decoded = decode(make_codec(), STREAM[:at] + STREAM[at + count :])
    touched = range(at // REPLY_SIZE, (at + count - 1) // REPLY_SIZE + 1)
    expected = [ticks for n in range(3) if n not in touched for ticks in STREAM_POSITIONS[3 * n : 3 * n + 3]]
    assert positions(decoded) == expected
    assert set(reasons(decoded)) == {"framing"}


@given(REPLIES, st.integers(0, 8 * REPLY_SIZE - 1))
def test_a_flipped_bit_raises_nothing_and_the_next_reply_is_heard(reply: BoardReply, bit: int) -> None:
    codec = make_codec(reply.board)
    frame = bytearray(build_reply(reply._replace(motor_fault=False)))
    decode(codec, bytes(frame))
    damaged = frame.copy()
    damaged[bit // 8] ^= 1 << bit % 8
    decode(codec, bytes(damaged))
    decode(codec, bytes(frame))
    assert sum(isinstance(item, WheelSample) for item in decode(codec, bytes(frame))) == 3


@pytest.mark.parametrize("wheel", range(3))
@pytest.mark.parametrize("bit", range(32))
def test_damaged_ticks_leave_no_trace_in_later_positions(wheel: int, bit: int) -> None:
    codec = make_codec()
    frame = bytearray(build_reply(make_reply((1000, 2000, 3000))))
    assert positions(decode(codec, bytes(frame))) == [1000, 2000, 3000]
    damaged = frame.copy()
    damaged[26 + 21 * wheel + bit // 8] ^= 1 << bit % 8
    decoded = decode(codec, bytes(damaged))
    assert reasons(decoded) == (["implausible_jump"] if bit >= 15 else [])
    assert positions(decode(codec, bytes(frame))) == [1000, 2000, 3000]


def test_restarted_counters_are_refused_once_and_positions_go_on() -> None:
    codec = make_codec()
    decode(codec, build_reply(make_reply((500_000, 0, 0), 60_000)))
    assert reasons(decode(codec, build_reply(make_reply((0, 0, 0), 60_020)))) == ["implausible_jump"]
    report, *samples = decode(codec, build_reply(make_reply((30, 0, 0), 60_040)))
    assert isinstance(report, LinkSample)
    assert report.reason == "board: the position counter has restarted"
    assert positions(samples) == [500_030, 0, 0]
    assert not any(
        isinstance(sample, LinkSample)
        for sample in decode(codec, build_reply(make_reply((60, 0, 0), 60_060)))
    )


def test_time_that_runs_backwards_shows_a_restart_close_to_the_old_position() -> None:
    codec = make_codec()
    decode(codec, build_reply(make_reply((400, 0, 0), 60_000)))
    assert reasons(decode(codec, build_reply(make_reply((0, 0, 0), 10)))) == ["implausible_jump"]
    assert positions(decode(codec, build_reply(make_reply((7, 0, 0), 30)))) == [407, 0, 0]


def test_two_different_wild_replies_are_both_refused() -> None:
    codec = make_codec()
    decode(codec, build_reply(make_reply((0, 0, 0))))
    for ticks in (10**6, -(10**6)):
        assert reasons(decode(codec, build_reply(make_reply((ticks, 0, 0))))) == ["implausible_jump"]
    assert positions(decode(codec, build_reply(make_reply((5, 0, 0))))) == [5, 0, 0]


def test_fast_turning_is_no_jump_once_the_time_allows_it() -> None:
    ticks = 255 * 900 * 2  # two seconds at 6885 rpm
    for elapsed_ns, refused in ((1_990_000_000, True), (2_000_000_000, False)):
        codec = make_codec()
        decode(codec, build_reply(make_reply((0, 0, 0))), 0)
        decoded = decode(codec, build_reply(make_reply((ticks, 0, 0))), elapsed_ns)
        assert bool(reasons(decoded)) is refused


def test_position_is_unwrapped_over_the_32_bit_counter() -> None:
    codec = make_codec()
    decode(codec, build_reply(make_reply((2**31 - 10, -(2**31), 0))))
    decoded = decode(codec, build_reply(make_reply((-(2**31) + 10, 2**31 - 1, 0))))
    assert positions(decoded) == [2**31 + 10, -(2**31) - 1, 0]


@pytest.mark.parametrize(("configured", "other"), [("EA05", "EA09"), ("EA09", "EA05")])
def test_reply_of_the_other_board_is_refused_by_name(configured: Board, other: Board) -> None:
    decoded = decode(make_codec(configured), build_reply(make_reply((0, 0, 0), board=other)))
    assert decoded == [Rejection(f"board_is_{other}")]


@pytest.mark.parametrize("bit", [2, 3])
@pytest.mark.parametrize("offset", [24, 45, 66])
def test_motor_that_the_board_could_not_read_spoils_the_reply(offset: int, bit: int) -> None:
    frame = hand_made_reply()
    frame[offset] |= 1 << bit
    assert decode(make_codec(), bytes(frame)) == [Rejection("motor_fault")]


def test_digital_inputs_are_no_bumper() -> None:
    frame = with_other_fields_set(bytearray(build_reply(make_reply((0, 0, 0)))))
    (bumper,) = (item for item in decode(make_codec(), bytes(frame)) if isinstance(item, BumperSample))
    assert not bumper.pressed


def test_battery_that_reads_nothing_is_not_reported() -> None:
    decoded = decode(make_codec(), build_reply(make_reply((0, 0, 0))._replace(battery_raw=0)))
    assert [type(item) for item in decoded] == [WheelSample] * 3 + [BumperSample]


def test_reset_forgets_the_half_reply_and_the_positions() -> None:
    codec = make_codec()
    decode(codec, STREAM[:REPLY_SIZE] + STREAM[:50])
    codec.reset()
    decoded = decode(codec, build_reply(make_reply((10**8, 0, 0), 0)))
    assert positions(decoded) == [10**8, 0, 0]
    assert reasons(decoded) == []


def test_drive_sends_one_request_per_command_and_tells_what_it_meant() -> None:
    link = ScriptedLink()
    clock = VirtualClock()
    drive = make_settings().make_driver("board", link, clock)
    assert isinstance(drive, WheelDrive)
    drive.connect()
    command = WheelCommand(t_ns=clock.now_ns(), expires_ns=clock.now_ns() + 1, speed_rad_s=(2.0, -2.0, 0.1))
    sent = drive.command(command)
    assert len(link.sent) == 1
    assert sent.speed_rad_s == pytest.approx((11 * STEP_RAD_S, -11 * STEP_RAD_S, 0.0))
    drive.stop()
    assert link.sent[-1] == GOLDEN_STOP


@pytest.mark.parametrize(
    "changes",
    [{"board": "EA10"}, {"kp": 256}, {"gear_ratio": 0}, {"gear": 16}, {"ticks_per_motor_turn": 1.5}],
)
def test_settings_refuse_what_no_board_has(changes: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        RobotinoBoardSettings.model_validate({"type": "robotino_board", "port": "p", **changes})
