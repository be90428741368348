"""CANopen drives: recorded bytes, the way to operation, faults, rejections, and a peer of another make."""

import math
import struct
from collections.abc import Callable, Sequence

import canopen
import pytest
from canopen.objectdictionary import ObjectDictionary, ODArray, ODVariable, datatypes
from pydantic import ValidationError

from drivers.can.frame import CanFrame, pack_can_frame, unpack_can_frame
from drivers.can.link import CanLink
from drivers.canopen_wheels.codec import CALLS_UNTIL_REPEAT, CanopenWheelsCodec
from drivers.canopen_wheels.frames import ObjectValue, State, emcy_text, nmt, sdo_download, state_of
from drivers.canopen_wheels.settings import CanopenWheelsSettings
from drivers.clock import SystemClock
from drivers.driver import Rejection
from drivers.link import Received
from drivers.samples import FaultSample, LinkSample, Sample, WheelCommand, WheelSample

TABLE: dict[str, object] = {
    "interface": "virtual",
    "channel": "x",
    "wheel": [{"node": 1}, {"node": 2, "sign": -1}],
    "counts_per_motor_turn": 4096,
    "gear_ratio": 50.0,
    "rated_current_a": 2.0,
}
RPM = math.tau / 60 / 50
COUNT = math.tau / (50 * 4096)


def make_codec(**changes: object) -> CanopenWheelsCodec:
    return CanopenWheelsCodec("wheels", CanopenWheelsSettings.model_validate({**TABLE, **changes}))


def receive(codec: CanopenWheelsCodec, can_id: int, data: str, t_ns: int = 7) -> Sequence[Sample | Rejection]:
    frame = CanFrame(can_id, bytes.fromhex(data))
    return codec.decode(Received(t_ns, pack_can_frame(frame)))


def line(payload: bytes) -> str:
    frame = unpack_can_frame(payload)
    assert frame is not None
    assert not frame.is_extended
    return f"{frame.can_id:03X} {frame.data.hex(' ').upper()}"


def step(codec: CanopenWheelsCodec, speed_rad_s: float = 0.0) -> list[str]:
    """Return what the codec sends next, without its heartbeat."""
    payloads, _ = codec.encode_speeds((speed_rad_s, speed_rad_s))
    first, *others = map(line, payloads)
    assert first == "77F 05"
    return others


def configure(codec: CanopenWheelsCodec) -> list[str]:
    """Answer every SDO at once, and return everything sent until both drives are started."""
    sent: list[str] = []
    for _ in range(60):
        lines = step(codec)
        sent += lines
        for text in lines:
            if text.startswith("60"):
                receive(codec, 0x580 + int(text[2], 16), "60" + text[6:15] + "00000000")
        if {"000 01 01", "000 01 02"} <= set(sent):
            return sent
    raise AssertionError(sent)


def configure_node_1(codec: CanopenWheelsCodec) -> None:
    """Answer the SDOs to node 1 until it is started."""
    for _ in range(60):
        for text in step(codec):
            if text == "000 01 01":
                return
            if text.startswith("601"):
                receive(codec, 0x581, "60" + text[6:15] + "00000000")
    raise AssertionError


def enable(codec: CanopenWheelsCodec) -> None:
    for node in (1, 2):
        receive(codec, 0x180 + node, "37 06 00 00 00 00")


# Bytes that others published


@pytest.mark.parametrize(
    ("item", "expected"),
    [
        # Controlwords and mode of published bring-up sequences; the mapping of published traces.
        (ObjectValue(0x6040, 0, 2, 0x0F), "601 2B 40 60 00 0F 00 00 00"),
        (ObjectValue(0x6060, 0, 1, 3), "601 2F 60 60 00 03 00 00 00"),
        (ObjectValue(0x1A00, 1, 4, 0x6041_0010), "601 23 00 1A 01 10 00 41 60"),
        (ObjectValue(0x1A00, 0, 1, 0), "601 2F 00 1A 00 00 00 00 00"),
        (ObjectValue(0x1800, 1, 4, 0x8000_0181), "601 23 00 18 01 81 01 00 80"),
        # Festo CiA 402 manual GDCP-CMMS, page 20: writing of 6040_00, data 03E8; 6093_01, data 12345678.
        (ObjectValue(0x6040, 0, 2, 0x03E8), "601 2B 40 60 00 E8 03 00 00"),
        (ObjectValue(0x6093, 1, 4, 0x12345678), "601 23 93 60 01 78 56 34 12"),
    ],
)
def test_sdo_bytes(item: ObjectValue, expected: str) -> None:
    assert line(sdo_download(1, item)) == expected


def test_network_bytes() -> None:
    """EAO manual, boot-up of node 0x0b; a published sequence for pre-operational."""
    assert line(nmt(0x01, 0x0B)) == "000 01 0B"
    assert line(nmt(0x80, 1)) == "000 80 01"


@pytest.mark.parametrize(
    ("recorded", "state"),
    [
        ("40 06", State.SWITCH_ON_DISABLED),
        ("21 06", State.READY),
        ("33 06", State.SWITCHED_ON),
        ("37 06", State.ENABLED),
    ],
)
def test_statuswords_of_a_recorded_start(recorded: str, state: State) -> None:
    """A published candump of a drive between the controlwords 06, 07 and 0F."""
    assert state_of(int.from_bytes(bytes.fromhex(recorded), "little")) is state


@pytest.mark.parametrize(
    ("statusword", "state"),
    [(0x0208, State.FAULT), (0x020F, State.FAULT), (0x0207, State.QUICK_STOP), (0x0200, State.NOT_READY)],
)
def test_other_statuswords(statusword: int, state: State) -> None:
    assert state_of(statusword) is state


@pytest.mark.parametrize(
    ("code", "text"),
    [
        (0x2001, "emergency 0x2001, current"),
        (0x3ABC, "emergency 0x3ABC, voltage"),
        (0x8130, "emergency 0x8130, monitoring"),
        (0xFF01, "emergency 0xFF01, device specific"),
        (0xBEEF, "emergency 0xBEEF"),
    ],
)
def test_emergency_codes_have_the_names_of_cia_301(code: int, text: str) -> None:
    assert emcy_text(code) == text


def test_published_emergency_bytes() -> None:
    """The bytes of canopen-python's tests: code 2001h; then the error reset."""
    codec = make_codec()
    (fault,) = receive(codec, 0x081, "01 20 02 00 01 02 03 04")
    assert fault == FaultSample(
        device="wheels", t_ns=7, wheel=0, code=0x2001, text="node 1 emergency: emergency 0x2001, current"
    )
    (cleared,) = receive(codec, 0x081, "00 00 00 00 00 00 00 00")
    assert isinstance(cleared, FaultSample)
    assert (cleared.wheel, cleared.code) == (0, 0)


# Readings


def test_speed_position_and_current() -> None:
    codec = make_codec()
    (speed,) = receive(codec, 0x181, "37 06 E8 03 00 00")
    assert isinstance(speed, WheelSample)
    assert (speed.wheel, speed.position_rad) == (0, None)
    assert speed.speed_rad_s == pytest.approx(1000 * RPM)
    (position,) = receive(codec, 0x282, "00 10 00 00 F4 01")
    assert isinstance(position, WheelSample)
    assert position.wheel == 1
    assert position.position_rad == pytest.approx(-4096 * COUNT)
    assert position.current_a == pytest.approx(-1.0)


def test_a_position_continues_and_a_restarted_counter_does_not_move_the_rover() -> None:
    codec = make_codec(rated_current_a=None)
    receive(codec, 0x281, "FF FF FF 7F", 0)
    (after,) = receive(codec, 0x281, "01 00 00 80", 10_000_000)
    assert isinstance(after, WheelSample)
    assert after.position_rad == pytest.approx((2**31 + 1) * COUNT)
    assert list(receive(codec, 0x281, "00 00 00 00", 20_000_000)) == [Rejection("implausible_jump")]
    report, again = receive(codec, 0x281, "00 00 00 00", 30_000_000)
    assert isinstance(report, LinkSample)
    assert report.reason == "wheel 0: the position counter has restarted"
    assert isinstance(again, WheelSample)
    assert again.position_rad == after.position_rad


@pytest.mark.parametrize(
    ("can_id", "data", "reason"),
    [
        (0x183, "37 06 00 00 00 00", "other_node"),
        (0x181, "37 06", "too_short"),
        (0x281, "00 00 00 00", "too_short"),
        (0x081, "01", "too_short"),
        (0x581, "60 40", "too_short"),
        (0x701, "", "too_short"),
        (0x201, "00 00", "other_traffic"),
        (0x080, "", "other_traffic"),
        (0x581, "60 17 10 00 00 00 00 00", "other_traffic"),  # nothing was written yet
    ],
)
def test_each_rejection(can_id: int, data: str, reason: str) -> None:
    assert list(receive(make_codec(), can_id, data)) == [Rejection(reason)]


def test_frames_of_other_kinds() -> None:
    codec = make_codec()
    extended = pack_can_frame(CanFrame(0x181, bytes(6), is_extended=True))
    assert list(codec.decode(Received(1, extended))) == [Rejection("other_traffic")]
    assert list(codec.decode(Received(1, b""))) == [Rejection("not_a_frame")]
    error = pack_can_frame(CanFrame(0x40, bytes(8), is_error=True))
    assert [type(result) for result in codec.decode(Received(1, error))] == [FaultSample]


# The way to operation


def test_drives_are_configured_one_answer_at_a_time() -> None:
    codec = make_codec()
    assert step(codec) == ["000 80 01", "000 80 02"]
    assert step(codec) == ["601 23 16 10 01 96 00 7F 00", "602 23 16 10 01 96 00 7F 00"]
    assert step(codec) == []
    receive(codec, 0x582, "60 16 10 01 00 00 00 00")
    assert step(codec) == ["602 2B 17 10 00 64 00 00 00"]
    sent = configure(codec)
    assert "000 01 02" in sent
    for expected in (
        "602 23 00 16 01 10 00 40 60",
        "602 23 00 16 02 20 00 FF 60",
        "602 23 00 14 01 02 02 00 00",
        "602 2B 00 18 05 0A 00 00 00",
        "602 23 01 1A 01 20 00 64 60",
        "602 23 01 1A 02 10 00 78 60",
        "602 23 01 18 01 82 02 00 00",
    ):
        assert expected in sent


def test_an_unanswered_sdo_is_repeated() -> None:
    codec = make_codec()
    step(codec)
    first = step(codec)
    waiting = [step(codec) for _ in range(CALLS_UNTIL_REPEAT + 1)]
    assert waiting[-1] == first
    assert not any(waiting[:-1])


def test_a_refused_object_is_a_fault_and_keeps_the_wheels_still() -> None:
    codec = make_codec()
    step(codec)
    step(codec)
    (fault,) = receive(codec, 0x581, "80 16 10 01 00 00 02 06")
    assert isinstance(fault, FaultSample)
    assert fault.text == "node 1 SDO: object 1016h:01 refused, abort code 0x06020000"
    enable(codec)
    _, meant = codec.encode_speeds((1.0, 1.0))
    assert meant == (0.0, 0.0)


def test_controlwords_follow_the_statuswords() -> None:
    codec = make_codec()
    configure(codec)
    for statusword, controlword in (("40 06", "06"), ("21 06", "07"), ("33 06", "0F"), ("37 06", "0F")):
        receive(codec, 0x181, statusword + "00 00 00 00")
        assert step(codec)[0] == f"201 {controlword} 00 00 00 00 00"


def test_set_points_wait_for_all_drives() -> None:
    codec = make_codec()
    configure(codec)
    receive(codec, 0x181, "37 06 00 00 00 00")
    assert step(codec, 1000 * RPM)[0] == "201 0F 00 00 00 00 00"
    enable(codec)
    payloads, meant = codec.encode_speeds((1000 * RPM, 1000 * RPM))
    assert [line(payload) for payload in payloads[1:]] == ["201 0F 00 E8 03 00 00", "202 0F 00 18 FC FF FF"]
    assert meant == pytest.approx((1000 * RPM, 1000 * RPM))
    _, meant = codec.encode_speeds((1e6, -1e6))
    assert meant == pytest.approx((5000 * RPM, -5000 * RPM))
    receive(codec, 0x182, "08 02 00 00 00 00")
    assert codec.encode_speeds((1.0, 1.0))[1] == (0.0, 0.0)


def test_stop_lets_an_enabled_drive_brake_before_it_switches_off() -> None:
    codec = make_codec()
    configure(codec)
    receive(codec, 0x181, "37 06 E8 03 00 00")
    receive(codec, 0x182, "21 06 00 00 00 00")
    assert [line(payload) for payload in codec.encode_stop()] == [
        "201 07 00 00 00 00 00",
        "202 06 00 00 00 00 00",
    ]
    assert list(codec.encode_start()) == []


def test_a_fault_is_named_and_reset_a_limited_number_of_times() -> None:
    codec = make_codec(fault_resets=2)
    configure(codec)
    for _ in range(2):
        codec.encode_start()
        (fault, _) = receive(codec, 0x181, "08 02 00 00 00 00")
        assert isinstance(fault, FaultSample)
        assert (fault.wheel, fault.code, fault.text) == (0, 0x208, "node 1 state: fault")
        assert [step(codec)[0] for _ in range(3)] == ["201 80 00 00 00 00 00", *["201 00 00 00 00 00 00"] * 2]
        (cleared, _) = receive(codec, 0x181, "40 02 00 00 00 00")
        assert isinstance(cleared, FaultSample)
        assert cleared.code == 0
        assert step(codec)[0] == "201 06 00 00 00 00 00"
    receive(codec, 0x181, "08 02 00 00 00 00")
    codec.encode_start()
    assert [step(codec)[0] for _ in range(3)] == ["201 00 00 00 00 00 00"] * 3


def test_a_fault_is_reset_only_by_a_start_and_only_while_zero_speeds_are_commanded() -> None:
    codec = make_codec()
    codec.encode_start()
    configure(codec)
    enable(codec)
    receive(codec, 0x181, "08 02 00 00 00 00")
    assert [step(codec)[0] for _ in range(3)] == ["201 00 00 00 00 00 00"] * 3  # that start is used up
    codec.encode_start()
    assert [step(codec, 1.0)[0] for _ in range(3)] == ["201 00 00 00 00 00 00"] * 3
    assert [step(codec)[0] for _ in range(2)] == ["201 80 00 00 00 00 00", "201 00 00 00 00 00 00"]
    codec.encode_start()
    assert step(codec)[0] == "201 80 00 00 00 00 00"  # the fault has stayed: tried again


# Statuswords of CiA 402, as in `test_statuswords_of_a_recorded_start`


@pytest.mark.parametrize(
    ("statusword", "state"),
    [("40 06", "switch on disabled"), ("21 06", "ready"), ("33 06", "switched on"), ("17 06", "quick stop")],
)
def test_a_drive_that_leaves_operation_is_a_fault_until_it_is_back(statusword: str, state: str) -> None:
    codec = make_codec()
    configure(codec)
    enable(codec)
    step(codec, 1.0)
    assert len(receive(codec, 0x181, "37 06 00 00 00 00")) == 1
    fault, _ = receive(codec, 0x181, statusword + "00 00 00 00")
    assert isinstance(fault, FaultSample)
    assert (fault.wheel, fault.text) == (0, f"node 1 state: the drive does not obey setpoints: {state}")
    cleared, _ = receive(codec, 0x181, "37 06 00 00 00 00")
    assert isinstance(cleared, FaultSample)
    assert (cleared.wheel, cleared.code) == (0, 0)


def test_a_drive_that_does_not_come_to_operation_is_a_fault_after_a_second() -> None:
    codec = make_codec()
    configure(codec)
    step(codec)
    assert len(receive(codec, 0x181, "40 06 00 00 00 00", 0)) == 1
    step(codec)
    fault, _ = receive(codec, 0x181, "40 06 00 00 00 00", 1_000_000_000)
    assert isinstance(fault, FaultSample)
    assert fault.code == 0x0640


def test_a_drive_that_was_stopped_may_leave_operation() -> None:
    codec = make_codec()
    configure(codec)
    enable(codec)
    step(codec, 1.0)
    receive(codec, 0x181, "37 06 00 00 00 00")
    codec.encode_stop()
    assert len(receive(codec, 0x181, "33 06 00 00 00 00", 5_000_000_000)) == 1


@pytest.mark.parametrize(("speed", "is_told"), [(1000, False), (-1000, True), (0, True), (100, True)])
def test_a_speed_that_cannot_have_turned_the_wheel_is_told(speed: int, *, is_told: bool) -> None:
    codec, found = make_codec(), set()
    counts_per_s = 4096 * 1000 / 60
    for index in range(50):
        t_ns = 20_000_000 * index
        receive(codec, 0x181, struct.pack("<Hi", 0x0637, speed).hex(), t_ns)
        position = struct.pack("<ih", round(counts_per_s * 0.02 * index), 0).hex()
        told = receive(codec, 0x281, position, t_ns + 1_000_000)
        found |= {each.reason for each in told if isinstance(each, Rejection)}
    assert found == ({"speed_contradicts_position"} if is_told else set())


def test_a_restarted_drive_is_named_and_configured_again() -> None:
    codec = make_codec(fault_resets=1)
    configure(codec)
    enable(codec)
    (fault,) = receive(codec, 0x701, "00")
    assert isinstance(fault, FaultSample)
    assert fault.text == "node 1 network: restarted"
    assert step(codec, 1.0)[0] == "000 80 01"
    assert codec.encode_speeds((1.0, 1.0))[1] == (0.0, 0.0)
    assert list(receive(codec, 0x701, "05")) == []  # somebody else has started it, not configured
    configure_node_1(codec)
    (cleared,) = receive(codec, 0x701, "05")
    assert isinstance(cleared, FaultSample)
    assert cleared.code == 0


@pytest.mark.parametrize("sign", ["00", "7F"])
def test_a_drive_that_restarts_too_often_stays_off(sign: str) -> None:
    """Without its configuration it would not notice that this computer fails."""
    codec = make_codec(fault_resets=0)
    configure(codec)
    enable(codec)
    (fault,) = receive(codec, 0x701, sign)
    assert isinstance(fault, FaultSample)
    enable(codec)
    for _ in range(2 * CALLS_UNTIL_REPEAT):
        payloads, meant = codec.encode_speeds((1.0, 1.0))
        assert meant == (0.0, 0.0)
        assert {line(payload)[:3] for payload in payloads} == {"77F", "202"}
    assert list(receive(codec, 0x701, "05")) == []
    assert list(receive(codec, 0x701, sign)) == []
    codec.reset()
    assert step(codec) == ["000 80 01", "000 80 02"]


def test_a_started_drive_that_is_pre_operational_is_configured_again() -> None:
    codec = make_codec()
    configure(codec)
    enable(codec)
    (fault,) = receive(codec, 0x701, "7F")
    assert isinstance(fault, FaultSample)
    assert fault.text == "node 1 network: no longer operational"
    enable(codec)
    payloads, meant = codec.encode_speeds((1.0, 1.0))
    assert meant == (0.0, 0.0)
    assert line(payloads[1]) == "000 80 01"


def test_a_heartbeat_that_crossed_with_the_start_changes_nothing_and_a_lost_start_configures_anew() -> None:
    codec = make_codec()
    configure(codec)
    assert list(receive(codec, 0x701, "7F")) == []
    assert step(codec)[0] == "201 00 00 00 00 00 00"
    assert list(receive(codec, 0x701, "7F")) == []
    assert step(codec)[0] == "000 80 01"


def test_reset_configures_anew() -> None:
    codec = make_codec()
    configure(codec)
    codec.reset()
    assert step(codec) == ["000 80 01", "000 80 02"]


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"wheel": [{"node": 4}, {"node": 4}]}, "two wheels have the node 4"),
        ({"host_node": 2}, "host_node 2 is the node of a wheel"),
    ],
)
def test_settings_that_contradict_each_other(changes: dict[str, object], words: str) -> None:
    with pytest.raises(ValidationError, match=words):
        CanopenWheelsSettings.model_validate({**TABLE, **changes})


# A peer of another make: nodes of the library canopen-python on a virtual bus


def dictionary() -> ObjectDictionary:
    objects = ObjectDictionary()  # type: ignore[no-untyped-call]
    sizes = {1: datatypes.UNSIGNED8, 2: datatypes.UNSIGNED16, 4: datatypes.UNSIGNED32}
    plain = {
        0x1017: 2,
        0x6007: 2,
        0x6040: 2,
        0x6041: 2,
        0x6060: 1,
        0x6064: 4,
        0x606C: 4,
        0x6078: 2,
        0x60FF: 4,
    }
    for index, size in plain.items():
        variable = ODVariable(f"object {index:X}", index)
        variable.data_type = sizes[size]
        variable.default = 0
        objects.add_object(variable)
    for index in (0x1016, 0x1400, 0x1600, 0x1800, 0x1801, 0x1A00, 0x1A01):
        array = ODArray(f"object {index:X}", index)
        for sub in range(9):
            member = ODVariable(f"object {index:X} {sub}", index, sub)
            is_mapping = index in (0x1600, 0x1A00, 0x1A01)
            size = {0: 1, 2: 4 if is_mapping else 1, 5: 2}.get(sub, 4)
            member.data_type = sizes[size]
            member.default = 0
            array.add_member(member)
        objects.add_object(array)
    return objects


def wait_until(condition: Callable[[], bool], advance: Callable[[], None]) -> None:
    for _ in range(600):
        if condition():
            return
        advance()
    raise AssertionError("not within 600 cycles")


def test_nodes_of_another_make_are_configured_started_and_heard() -> None:
    settings = CanopenWheelsSettings.model_validate({**TABLE, "channel": "peer"})
    network = canopen.Network()
    network.connect(interface="virtual", channel="peer")
    nodes = [canopen.LocalNode(node, dictionary()) for node in (1, 2)]
    for node in nodes:
        network.add_node(node)
        node.nmt.state = "PRE-OPERATIONAL"
    clock = SystemClock()
    driver = settings.make_driver("wheels", CanLink("virtual", "peer", 500_000, clock, 1.0), clock)
    heard: list[Sample] = []

    def advance() -> None:
        now_ns = clock.now_ns()
        driver.command(WheelCommand(t_ns=now_ns, expires_ns=now_ns + 10**9, speed_rad_s=(0.0, 0.0)))
        clock.sleep_until(clock.now_ns() + 5_000_000)
        heard.extend(driver.poll())

    try:
        driver.connect()
        wait_until(lambda: all(node.nmt.state == "OPERATIONAL" for node in nodes), advance)
        for node, number in zip(nodes, (1, 2), strict=True):
            written = {
                (index, sub): int.from_bytes(node.get_data(index, sub), "little")
                for index, sub in ((0x6060, 0), (0x1600, 1), (0x1A00, 2), (0x1800, 1), (0x1016, 1))
            }
            assert written == {
                (0x6060, 0): 3,
                (0x1600, 1): 0x6040_0010,
                (0x1A00, 2): 0x606C_0020,
                (0x1800, 1): 0x180 + number,
                (0x1016, 1): 0x007F_0096,
            }
        nodes[1].emcy.send(0x3210, 0x05)
        network.send_message(0x181, bytes.fromhex("40 02 00 00 00 00"))
        wait_until(lambda: any(isinstance(sample, WheelSample) for sample in heard), advance)
        (fault,) = (sample for sample in heard if isinstance(sample, FaultSample))
        assert fault.text == "node 2 emergency: emergency 0x3210, voltage"
        # An answer that comes after its question was repeated, on a busy computer, is no longer expected.
        assert driver.health().rejected.keys() <= {"other_traffic"}
    finally:
        driver.close()
        network.disconnect()
