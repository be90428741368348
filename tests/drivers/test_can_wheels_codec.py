"""CAN frames to samples and back, with the generic drive and a bus that uses everything."""

import itertools
import math
import struct
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.can.frame import unpack_can_frame
from drivers.can_wheels.codec import CanWheelsCodec
from drivers.can_wheels.mapping_file import load_mapping
from drivers.can_wheels.messages import MessageReader, MessageWriter
from drivers.position_counter import PositionCounter
from drivers.samples import FaultSample, PowerSample, WheelSample
from tests.drivers.can_wheels_frames import (
    assert_same,
    crc8,
    decode,
    frame,
    generic_state,
    reasons,
    wheel_samples,
)

GENERIC = load_mapping("generic_wheel")

RICH_DBC = """VERSION ""
BU_: A
BO_ 2566844416 All_Wheels: 8 A
 SG_ Left_Angle : 7|16@0+ (0.1,0) [0|359.9] "deg" A
 SG_ Right_Angle : 23|16@0+ (0.1,0) [0|359.9] "deg" A
 SG_ Left_Current : 32|8@1+ (0.1,0) [0|0] "A" A
 SG_ Right_Current : 40|8@1+ (0.1,0) [0|0] "A" A
 SG_ Supply : 48|8@1+ (100,0) [0|0] "mV" A
 SG_ Supply_Current : 56|8@1+ (100,0) [0|0] "mA" A
BO_ 200 Command: 5 A
 SG_ Left_Speed : 0|16@1- (1,0) [-3000|3000] "rpm" A
 SG_ Right_Speed : 16|16@1- (1,0) [-3000|3000] "rpm" A
 SG_ Enable : 32|1@1+ (1,0) [0|1] "" A
 SG_ Mode : 33|3@1+ (1,0) [0|7] "" A
BA_DEF_ SG_ "GenSigStartValue" INT 0 7;
BA_DEF_DEF_ "GenSigStartValue" 0;
BA_ "GenSigStartValue" SG_ 200 Mode 5;
"""
RICH_TOML = """dbc = "rich.dbc"
[every_wheel]
gear_ratio = 10
current_is_signed = false
position = { message = "All_Wheels", signal = "{node}_Angle", unit = "deg", wrap = 360 }
current = { message = "All_Wheels", signal = "{node}_Current", unit = "A" }
setpoint = { message = "Command", signal = "{node}_Speed", unit = "rpm", fixed = { Enable = 1 } }
[[wheel]]
node = "Left"
[[wheel]]
node = "Right"
sign = -1
[power]
voltage = { message = "All_Wheels", signal = "Supply", unit = "mV" }
current = { message = "All_Wheels", signal = "Supply_Current", unit = "mA" }
"""


@pytest.fixture
def rich(tmp_path: Path) -> CanWheelsCodec:
    (tmp_path / "rich.dbc").write_text(RICH_DBC, "utf-8")
    (tmp_path / "rich.toml").write_text(RICH_TOML, "utf-8")
    return CanWheelsCodec("wheels", load_mapping(str(tmp_path / "rich.toml")))


def test_generic_state_golden_bytes() -> None:
    payload = frame(0x122, "fbff3fdc0506ff62")
    assert payload == generic_state(2, position=-5, speed=1500, current=-250, counter=3)
    (sample,) = decode(CanWheelsCodec("wheels", GENERIC), payload)
    position_rad = -5 / 4096 * 2 * math.pi
    expected = WheelSample(
        device="wheels", t_ns=1, wheel=2, position_rad=position_rad, speed_rad_s=1.5, current_a=-0.25
    )
    assert_same(sample, expected)


def test_generic_status_tells_supply_and_faults() -> None:
    data = struct.pack("<HHB", 0x0009, 24_100, 0)
    fault, power = decode(CanWheelsCodec("wheels", GENERIC), frame(0x100, data + bytes((crc8(data),))))
    assert_same(power, PowerSample(device="wheels", t_ns=1, voltage_v=24.1))
    text = "Drive_Status.Faults: supply voltage too low, watchdog: setpoints missing"
    assert fault == FaultSample(device="wheels", t_ns=1, wheel=None, code=9, text=text)


def test_generic_set_point_golden_bytes_clipping_and_counters() -> None:
    codec = CanWheelsCodec("wheels", GENERIC)
    for count in range(18):
        payloads, meant = codec.encode_speeds((1.5004, -1.5, 1e9, -1e300))
        assert meant == pytest.approx((1.5, -1.5, 32.767, -32.767))
        for wheel, (payload, raw) in enumerate(zip(payloads, (1500, -1500, 32767, -32767), strict=True)):
            data = struct.pack("<hB", raw, count % 16)
            assert payload == frame(0x110 + wheel, data + bytes((crc8(data),)))
    assert codec.encode_start() == codec.encode_stop() == []


@given(
    st.integers(-(2**19), 2**19 - 1), st.integers(-32767, 32767), st.integers(-32767, 32767),
    st.integers(0, 15), st.integers(0, 3),
)  # fmt: skip
def test_generic_state_round_trip(position: int, speed: int, current: int, counter: int, wheel: int) -> None:
    payload = generic_state(wheel, position, speed, current, counter)
    (sample,) = wheel_samples(decode(CanWheelsCodec("wheels", GENERIC), payload))
    assert sample.wheel == wheel
    assert sample.position_rad == pytest.approx(position * 2 * math.pi / 4096)
    assert sample.speed_rad_s == pytest.approx(speed / 1000)
    assert sample.current_a == pytest.approx(current / 1000)
    message = GENERIC.message(f"Wheel{wheel}_State")
    writer = MessageWriter(message, GENERIC.protection(message.name))
    raw = {"Position": position, "Speed": speed, "Current": current}
    written = [writer.write(raw) for _ in range(counter + 1)]
    assert written[counter] == payload


@given(st.lists(st.floats(-40, 40), min_size=4, max_size=4))
def test_set_points_mean_what_is_reported(speeds: list[float]) -> None:
    payloads, meant = CanWheelsCodec("wheels", GENERIC).encode_speeds(speeds)
    for wheel, payload in enumerate(payloads):
        message = GENERIC.message(f"Wheel{wheel}_Setpoint")
        heard = unpack_can_frame(payload)
        assert heard is not None
        values, objection = MessageReader(message, ["Speed"], GENERIC.protection(message.name)).read(
            heard.data
        )
        assert objection is None
        assert values is not None
        assert values["Speed"] / 1000 == pytest.approx(meant[wheel])
        clipped = max(-32.767, min(32.767, speeds[wheel]))
        assert meant[wheel] == pytest.approx(clipped, abs=0.00051)


@given(
    st.lists(st.integers(-(2**19) + 1, 2**19 - 1), min_size=1, max_size=60),
    st.integers(-(2**19), 2**19 - 1),
)
def test_position_follows_the_wheel_across_the_end_of_its_range(steps: list[int], start: int) -> None:
    codec = CanWheelsCodec("wheels", GENERIC)
    ticks = list(itertools.accumulate(steps, initial=start))
    for index, true_ticks in enumerate(ticks):
        payload = generic_state(0, true_ticks, 0, 0, index % 16)
        (sample,) = wheel_samples(decode(codec, payload, index * 1_000_000_000))
        assert sample.position_rad == pytest.approx(true_ticks * 2 * math.pi / 4096, abs=1e-9)


@given(st.lists(st.floats(-179, 179), max_size=40))
def test_counter_follows_fractions_of_a_turn(steps: list[float]) -> None:
    counter = PositionCounter(360, math.inf)
    counter.count(0, 0.0)
    angle = 0.0
    for step in steps:
        angle += step
        assert counter.count(0, angle % 360) == pytest.approx(angle, abs=1e-6)


def test_reset_forgets_turns_and_counters() -> None:
    codec = CanWheelsCodec("wheels", GENERIC)
    decode(codec, generic_state(0, 2**19 - 1, 0, 0, 0))
    (beyond,) = wheel_samples(decode(codec, generic_state(0, -(2**19), 0, 0, 1)))
    assert beyond.position_rad == pytest.approx(2**19 * 2 * math.pi / 4096)
    codec.reset()
    (again,) = wheel_samples(decode(codec, generic_state(0, -(2**19), 0, 0, 1)))
    assert again.position_rad == pytest.approx(-(2**19) * 2 * math.pi / 4096)


def test_rejected_message_changes_no_position() -> None:
    codec = CanWheelsCodec("wheels", GENERIC)
    decode(codec, generic_state(0, 500_000, 0, 0, 0))
    assert reasons(decode(codec, generic_state(0, -500_000, -32768, 0, 1))) == ["out_of_range"]
    (sample,) = wheel_samples(decode(codec, generic_state(0, 499_000, 0, 0, 2)))
    assert sample.position_rad == pytest.approx(499_000 * 2 * math.pi / 4096)


def test_damaged_stalled_and_missing_messages_are_told_apart() -> None:
    codec = CanWheelsCodec("wheels", GENERIC)
    good = generic_state(1, 10, 0, 0, 7)
    assert reasons(decode(codec, good)) == []
    assert reasons(decode(codec, good)) == ["counter_repeat"]
    damaged = bytearray(generic_state(1, 11, 0, 0, 8))
    damaged[8] ^= 4
    assert reasons(decode(codec, bytes(damaged))) == ["checksum"]
    told = decode(codec, generic_state(1, 12, 0, 0, 10))
    assert reasons(told) == ["frames_lost"]
    assert len(wheel_samples(told)) == 1
    assert reasons(decode(codec, generic_state(1, 11, 0, 0, 9))) == ["counter_backwards"]


def test_each_message_has_its_own_counter() -> None:
    codec = CanWheelsCodec("wheels", GENERIC)
    for wheel in range(4):
        assert reasons(decode(codec, generic_state(wheel, 0, 0, 0, 5))) == []


def test_foreign_frames_are_counted_not_read() -> None:
    codec = CanWheelsCodec("wheels", GENERIC)
    state = generic_state(0, 1, 2, 3, 0)
    data = state[8:]
    assert reasons(decode(codec, frame(0x7FF, data))) == ["other_traffic"]
    assert reasons(decode(codec, frame(0x120, data, is_extended=True))) == ["other_traffic"]
    assert reasons(decode(codec, frame(0x120, b"", is_remote=True))) == ["other_traffic"]
    assert reasons(decode(codec, frame(0x110, data[:4]))) == ["other_traffic"]
    assert reasons(decode(codec, frame(0x120, data[:7]))) == ["too_short"]
    assert reasons(decode(codec, b"")) == ["not_a_frame"]
    assert reasons(decode(codec, state)) == []


def test_one_message_tells_several_wheels(rich: CanWheelsCodec) -> None:
    data = struct.pack(">HH", 3590, 20) + bytes((15, 25, 241, 12))
    left, right, power = decode(rich, frame(0x18FEF000, data, is_extended=True))
    for sample, wheel, angle_deg, current_a in ((left, 0, 35.9, 1.5), (right, 1, -0.2, 2.5)):
        expected = WheelSample(
            device="wheels",
            t_ns=1,
            wheel=wheel,
            position_rad=math.radians(angle_deg),
            current_a=current_a,
            current_is_signed=False,
        )
        assert_same(sample, expected)
    assert_same(power, PowerSample(device="wheels", t_ns=1, voltage_v=24.1, current_a=1.2))
    data = struct.pack(">HH", 10, 3590) + bytes((15, 25, 241, 12))
    left, right, _ = decode(rich, frame(0x18FEF000, data, is_extended=True))
    assert isinstance(left, WheelSample)
    assert isinstance(right, WheelSample)
    assert left.position_rad == pytest.approx(math.radians(36.1))
    assert right.position_rad == pytest.approx(math.radians(0.1))


def test_one_bad_signal_rejects_all_wheels_of_its_message(rich: CanWheelsCodec) -> None:
    data = struct.pack(">HH", 100, 3600) + bytes(4)
    assert reasons(decode(rich, frame(0x18FEF000, data, is_extended=True))) == ["out_of_range"]


def test_one_message_commands_several_wheels(rich: CanWheelsCodec) -> None:
    payloads, meant = rich.encode_speeds((math.pi, math.pi))
    # 30 rpm at the wheels are 300 rpm at the motors; enabled, mode at its start value 5.
    assert list(payloads) == [frame(200, struct.pack("<hhB", 300, -300, 1 | 5 << 1))]
    assert meant == pytest.approx((math.pi, math.pi))


def test_wheel_without_set_point_is_not_commanded(tmp_path: Path) -> None:
    (tmp_path / "rich.dbc").write_text(RICH_DBC, "utf-8")
    listening = "\n".join(line for line in RICH_TOML.splitlines() if not line.startswith("setpoint"))
    (tmp_path / "rich.toml").write_text(listening, "utf-8")
    codec = CanWheelsCodec("wheels", load_mapping(str(tmp_path / "rich.toml")))
    assert codec.encode_speeds((1.0, 2.0)) == ([], (0.0, 0.0))
