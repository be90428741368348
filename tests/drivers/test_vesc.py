"""VESC frames: published bytes, signs, wrapping, restarts, faults, rejections."""

import math
import struct
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from drivers.can.frame import CanFrame, pack_can_frame, unpack_can_frame
from drivers.driver import Rejection
from drivers.link import Received
from drivers.position_counter import PositionCounter
from drivers.samples import FaultSample, PowerSample, Sample, WheelSample
from drivers.vesc.codec import MOST_UNANSWERED, Command, VescCodec, encode_command, encode_fault_question
from drivers.vesc.settings import VescSettings
from tests.drivers.candump import feed

POLE_PAIRS, GEAR = 7, 10.0
WHEELS: list[dict[str, object]] = [{"node": 4}, {"node": 5, "sign": -1}]
TABLE: dict[str, object] = {
    "interface": "virtual",
    "channel": "x",
    "wheel": WHEELS,
    "pole_pairs": POLE_PAIRS,
    "gear_ratio": GEAR,
}
ERPM_PER_RAD_S = 60 / math.tau * POLE_PAIRS * GEAR
RAD_PER_STEP = math.tau / (6 * POLE_PAIRS * GEAR)


def make_codec(**changes: object) -> VescCodec:
    return VescCodec("wheels", VescSettings.model_validate({**TABLE, **changes}))


def decode(
    line: str, codec: VescCodec | None = None, t_ns: int = 7, *, is_extended: bool = True
) -> Sequence[Sample | Rejection]:
    """Decode a line of candump: identifier and bytes in hex."""
    can_id, data = line.split("#")
    payload = pack_can_frame(CanFrame(int(can_id, 16), bytes.fromhex(data), is_extended))
    return (codec or make_codec()).decode(Received(t_ns, payload))


def sent(payload: bytes) -> str:
    frame = unpack_can_frame(payload)
    assert frame is not None
    assert frame.is_extended
    return f"{frame.can_id:08X}#{frame.data.hex(' ').upper()}"


# Recorded on a VESC with the ID 4: https://vesc-project.com/node/3345


def test_recorded_status_1_of_a_standing_motor() -> None:
    (sample,) = decode("00000904#00 00 00 00 00 00 00 29")
    assert isinstance(sample, WheelSample)
    assert (sample.wheel, sample.speed_rad_s, sample.current_a, sample.position_rad) == (0, 0.0, 0.0, None)
    assert sample.t_ns == 7


def test_recorded_status_5_has_the_tachometer_and_the_supply() -> None:
    wheel, power = decode("00001B04#00 00 00 0C 00 EF 00 00")
    assert isinstance(wheel, WheelSample)
    assert isinstance(power, PowerSample)
    assert wheel.position_rad == pytest.approx(12 * RAD_PER_STEP)  # two electrical turns
    assert power.voltage_v == pytest.approx(23.9)


@pytest.mark.parametrize(
    "line",
    [
        "00000E04#00 00 00 00 00 00 00 00",
        "00000F04#00 00 00 00 00 00 00 00",
        "00001004#00 FD FE 84 00 00 25 1E",
    ],
)
def test_recorded_status_messages_without_motion_give_nothing(line: str) -> None:
    assert list(decode(line)) == []


# Vectors written down from the tables of comm_can.md, independently of this program.


def test_status_1_turning() -> None:
    (sample,) = decode("00000904#00 00 05 78 00 05 00 D2")
    assert isinstance(sample, WheelSample)
    assert sample.speed_rad_s == pytest.approx(1400 / ERPM_PER_RAD_S)
    assert sample.current_a == 0.5


@pytest.mark.parametrize(
    ("line", "speed_sign", "current_a"),
    [
        ("00000904#FF FF FA 88 00 05 FF 2E", -1, -0.5),  # backwards, driving
        ("00000904#00 00 05 78 FF FB 00 D2", 1, -0.5),  # forwards, braking
        ("00000904#FF FF FA 88 FF FB FF 2E", -1, 0.5),  # backwards, braking
        ("00000904#00 00 00 00 00 05 FF 2E", 0, -0.5),  # held from turning, driving backwards
        ("00000905#FF FF FA 88 00 05 FF 2E", 1, 0.5),  # counts backwards: forwards, driving
        ("00000905#00 00 05 78 00 05 00 D2", -1, -0.5),
    ],
)
def test_current_is_positive_where_it_drives_forwards(line: str, speed_sign: int, current_a: float) -> None:
    (sample,) = decode(line)
    assert isinstance(sample, WheelSample)
    assert sample.speed_rad_s == pytest.approx(speed_sign * 1400 / ERPM_PER_RAD_S)
    assert sample.current_a == current_a


def test_short_status_5_of_the_published_table_is_read() -> None:
    wheel, _ = decode("00001B04#00 00 02 58 00 F1")
    assert isinstance(wheel, WheelSample)
    assert wheel.position_rad == pytest.approx(600 * RAD_PER_STEP)


def test_published_current_command() -> None:
    """51 A for the VESC ID 23: the example of comm_can.md."""
    assert sent(encode_command(Command.CURRENT, 23, 51.0)) == "00000117#00 00 C7 38"


def test_other_commands_by_the_published_table() -> None:
    assert sent(encode_command(Command.RPM, 5, 1400.0)) == "00000305#00 00 05 78"
    assert sent(encode_command(Command.DUTY, 5, -0.2)) == "00000005#FF FF B1 E0"


def test_question_and_answer_for_a_fault() -> None:
    """The bytes of a published client of firmware 5.02, whose source derives them from the firmware's."""
    assert sent(encode_fault_question(4, 3)) == "00000804#03 00 32 00 00 80 00"
    codec = make_codec(host_id=3)
    (fault,) = decode("00000803#04 01 32 00 00 80 00 04", codec)
    assert fault == FaultSample(
        device="wheels", t_ns=7, wheel=0, code=4, text="VESC 4: absolute over current"
    )
    assert list(decode("00000803#04 01 32 00 00 80 00 04", codec)) == []
    (cleared,) = decode("00000803#04 01 32 00 00 80 00 00", codec)
    assert isinstance(cleared, FaultSample)
    assert (cleared.code, cleared.wheel) == (0, 0)


def test_an_unknown_fault_is_reported_by_its_number() -> None:
    (fault,) = decode("000008FE#05 01 32 00 00 80 00 C8")
    assert isinstance(fault, FaultSample)
    assert (fault.wheel, fault.code, fault.text) == (1, 200, "VESC 5: fault 200")


# Controllers that do not obey: bit 21 of the mask in `commands.c` of the firmware


STATUS = "000008FE#04 01 32 00 20 00 00"


@pytest.mark.parametrize(
    ("code", "text"),
    [(1, "timeout expired"), (2, "kill switch active"), (3, "timeout expired, kill switch active")],
)
def test_a_controller_that_stops_obeying_is_a_fault_until_it_obeys(code: int, text: str) -> None:
    codec = make_codec()
    codec.encode_speeds((2.0, 2.0))
    assert list(decode(f"{STATUS} 00", codec, 0)) == []
    (fault,) = decode(f"{STATUS} {code:02X}", codec, 10_000_000)
    assert fault == FaultSample(
        device="wheels", t_ns=10_000_000, wheel=0, code=code, text=f"VESC 4 status: {text}"
    )
    (cleared,) = decode(f"{STATUS} 00", codec, 20_000_000)
    assert isinstance(cleared, FaultSample)
    assert (cleared.code, cleared.wheel) == (0, 0)


def test_a_controller_may_have_timed_out_before_the_first_set_point_and_after_the_stop() -> None:
    codec = make_codec()
    assert list(decode(f"{STATUS} 01", codec, 0)) == []
    codec.encode_speeds((2.0, 2.0))
    assert (
        list(decode(f"{STATUS} 01", codec, 10_000_000)) == []
    )  # the flag follows the setpoint a little later
    assert list(decode(f"{STATUS} 00", codec, 20_000_000)) == []
    codec.encode_stop()
    assert list(decode(f"{STATUS} 01", codec, 5_000_000_000)) == []


def test_a_controller_that_never_obeys_is_a_fault_after_a_second() -> None:
    codec = make_codec()
    codec.encode_speeds((2.0, 2.0))
    assert list(decode(f"{STATUS} 02", codec, 0)) == []
    (fault,) = decode(f"{STATUS} 02", codec, 1_000_000_000)
    assert isinstance(fault, FaultSample)
    assert fault.code == 2


def test_an_old_firmware_that_does_not_tell_its_status_obeys() -> None:
    codec = make_codec()
    codec.encode_speeds((2.0, 2.0))
    assert list(decode(STATUS, codec)) == [Rejection("other_traffic")]


# Speeds that contradict positions


def test_reported_speed_of_zero_of_a_turning_motor_is_told(shared_data: Path) -> None:
    text = (shared_data / "field_reports" / "can" / "vesc_speed_zero.log").read_text("utf-8")
    codec = make_codec(wheel=[{"node": 0x17}], pole_pairs=5, gear_ratio=5.4)
    results = feed(codec, text)
    turned = [each.position_rad for _, each in results if isinstance(each, WheelSample) and each.position_rad]
    assert [after - before for before, after in pairwise(turned)] == pytest.approx([2.327] * 19, abs=1e-3)
    told = [each for _, each in results if isinstance(each, Rejection)]
    assert told == [Rejection("speed_contradicts_position")]


@pytest.mark.parametrize(("erpm", "is_told"), [(5000, False), (-5000, True), (0, True), (24_000, True)])
def test_a_speed_that_cannot_have_turned_the_wheel_is_told(erpm: int, *, is_told: bool) -> None:
    codec, found = make_codec(), set()
    for index in range(50):
        t_ns = 20_000_000 * index
        decode("00000904#" + struct.pack(">ihh", erpm, 0, 100).hex(), codec, t_ns)
        steps = round(5000 / 60 * 6 * 0.02 * index)
        told = decode("00001B04#" + struct.pack(">ihh", steps, 240, 0).hex(), codec, t_ns + 1_000_000)
        found |= {each.reason for each in told if isinstance(each, Rejection)}
    assert found == ({"speed_contradicts_position"} if is_told else set())


# Setpoints


def test_set_points_are_whole_electrical_turns_and_one_wheel_is_asked() -> None:
    codec = make_codec()
    payloads, meant = codec.encode_speeds((2.0, 2.0))
    erpm = round(2.0 * ERPM_PER_RAD_S)
    assert erpm == 1337
    assert [sent(payload) for payload in payloads] == [
        "00000304#00 00 05 39",
        "00000305#FF FF FA C7",
        "00000804#FE 00 32 00 00 80 00",
        "00000804#FE 00 32 00 20 00 00",
    ]
    assert meant == pytest.approx((erpm / ERPM_PER_RAD_S, erpm / ERPM_PER_RAD_S))
    payloads, _ = codec.encode_speeds((0.0, 0.0))
    assert [sent(payload) for payload in payloads] == [
        "00000304#00 00 00 00",
        "00000305#00 00 00 00",
        "00000805#FE 00 32 00 00 80 00",
        "00000805#FE 00 32 00 20 00 00",
    ]


def test_set_points_are_clipped_to_the_limit() -> None:
    payloads, meant = make_codec(erpm_limit=1000).encode_speeds((100.0, -100.0))
    assert [sent(payload)[:20] for payload in payloads[:2]] == [
        "00000304#00 00 03 E8",
        "00000305#00 00 03 E8",
    ]
    assert meant == pytest.approx((1000 / ERPM_PER_RAD_S, -1000 / ERPM_PER_RAD_S))


def test_stop_releases_no_motor() -> None:
    """A current of 0 after the zero speeds would let a wheel roll on at speed."""
    assert list(make_codec().encode_stop()) == []
    assert list(make_codec().encode_start()) == []


@given(st.tuples(st.floats(-1e4, 1e4), st.floats(-1e4, 1e4)))
def test_what_is_meant_is_what_is_sent(speeds: tuple[float, float]) -> None:
    payloads, meant = make_codec().encode_speeds(speeds)
    for payload, sign, speed in zip(payloads[:2], (1, -1), meant, strict=True):
        frame = unpack_can_frame(payload)
        assert frame is not None
        erpm = int.from_bytes(frame.data, "big", signed=True)
        assert speed == pytest.approx(sign * erpm / ERPM_PER_RAD_S, abs=1e-12)
        assert abs(erpm) <= 100_000


# Counting


def tachometer(steps: int) -> str:
    return f"00001B05#{steps % 2**32:08X}00EF0000"


def positions(results: Sequence[Sample | Rejection]) -> list[float]:
    return [result.position_rad or 0.0 for result in results if isinstance(result, WheelSample)]


def test_position_continues_across_the_end_of_the_register() -> None:
    codec = make_codec()
    first = positions(decode(tachometer(2**31 - 10), codec, 0))
    after = positions(decode(tachometer(2**31 + 30), codec, 20_000_000))
    assert after[0] - first[0] == pytest.approx(-40 * RAD_PER_STEP, rel=1e-6)  # sign is -1


def test_a_restarted_controller_does_not_move_the_rover() -> None:
    codec = make_codec()
    before = positions(decode(tachometer(600_000), codec, 0))
    assert list(decode(tachometer(0), codec, 20_000_000)) == [Rejection("implausible_jump")]
    after = positions(decode(tachometer(6), codec, 40_000_000))
    assert after[0] - before[0] == pytest.approx(-6 * RAD_PER_STEP)
    assert positions(decode(tachometer(12), codec, 60_000_000))[0] - before[0] == pytest.approx(
        -12 * RAD_PER_STEP
    )


def test_one_wild_value_is_refused_and_changes_nothing() -> None:
    codec = make_codec()
    decode(tachometer(100), codec, 0)
    assert list(decode(tachometer(-(10**6)), codec, 20_000_000)) == [Rejection("implausible_jump")]
    assert positions(decode(tachometer(106), codec, 40_000_000)) == pytest.approx([-106 * RAD_PER_STEP])


def test_reset_starts_from_the_controllers_own_count() -> None:
    codec = make_codec()
    decode(tachometer(10**6), codec, 0)
    codec.reset()
    assert positions(decode(tachometer(6), codec, 20_000_000)) == pytest.approx([-6 * RAD_PER_STEP])


@given(st.lists(st.integers(-900, 900), max_size=50), st.integers(-(2**31), 2**31 - 1))
def test_counter_follows_any_motion_within_the_limit(steps: list[int], start: int) -> None:
    counter = PositionCounter(2**32, 10_000.0)
    true = start
    assert counter.count(0, start) == start
    for index, step in enumerate(steps):
        true += step
        wrapped = (true + 2**31) % 2**32 - 2**31
        assert counter.count(20_000_000 * (index + 1), wrapped) == true


# Rejections


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        ("00000909#00 00 00 00 00 00 00 00", "other_node"),
        ("000008FE#09 01 32 00 00 80 00 04", "other_node"),
        ("00000904#00 00 00 00", "too_short"),
        ("00001B04#00 00 00 00 00", "too_short"),
        ("00000304#00 00 05 78", "other_traffic"),
        ("00001204#FF FF", "other_traffic"),
        ("00010904#00 00 00 00 00 00 00 00", "other_traffic"),  # all upper bits are the command
        ("000008FE#04 01 32 00 00 80", "other_traffic"),
        ("000008FE#04 00 32 00 00 80 00 04", "other_traffic"),
        ("000008FE#04 01 32 00 00 40 00 04", "other_traffic"),
        ("000008FE#04 01 04 00 00 80 00 04", "other_traffic"),
    ],
)
def test_each_rejection(line: str, reason: str) -> None:
    assert list(decode(line)) == [Rejection(reason)]


def test_standard_and_remote_frames_are_other_traffic() -> None:
    assert list(decode("123#00", is_extended=False)) == [Rejection("other_traffic")]
    remote = pack_can_frame(CanFrame(0x904, b"", is_extended=True, is_remote=True))
    assert list(make_codec().decode(Received(1, remote))) == [Rejection("other_traffic")]
    assert list(make_codec().decode(Received(1, b"\x00" * 15))) == [Rejection("not_a_frame")]


def test_a_bus_error_is_a_fault_that_ends_with_good_frames() -> None:
    codec = make_codec()
    (fault,) = codec.decode(Received(0, pack_can_frame(CanFrame(0x40, bytes(8), is_error=True))))
    assert isinstance(fault, FaultSample)
    assert "bus off" in fault.text
    assert len(decode("00000904#00 00 00 00 00 00 00 00", codec, 500_000_000)) == 1
    cleared, _ = decode("00000904#00 00 00 00 00 00 00 00", codec, 1_000_000_000)
    assert isinstance(cleared, FaultSample)
    assert cleared.code == 0


def test_a_controller_that_never_tells_its_fault_is_noticed() -> None:
    codec = make_codec()
    silent = "00000904#00 00 00 00 00 00 00 00"
    for _ in range(2 * MOST_UNANSWERED):
        codec.encode_speeds((0.0, 0.0))
    assert len(decode(silent, codec)) == 1
    codec.encode_speeds((0.0, 0.0))
    assert list(decode(silent, codec))[1:] == [Rejection("no_fault_report")]
    assert len(decode(silent, codec)) == 1  # counted anew
    for _ in range(4 * MOST_UNANSWERED):
        codec.encode_speeds((0.0, 0.0))
        decode("000008FE#04 01 32 00 00 80 00 00", codec)
    codec.encode_speeds((0.0, 0.0))
    assert len(decode(silent, codec)) == 1


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"wheel": [{"node": 4}, {"node": 4}]}, "two wheels have the node 4"),
        ({"host_id": 5}, "host_id 5 is the node of a wheel"),
    ],
)
def test_settings_that_contradict_each_other(changes: dict[str, object], words: str) -> None:
    with pytest.raises(ValidationError, match=words):
        VescSettings.model_validate({**TABLE, **changes})
