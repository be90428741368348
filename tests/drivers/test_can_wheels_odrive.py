"""ODrive axes in both dialects: golden bytes, faults, start and stop."""

import math

import pytest

from drivers.can_wheels.codec import CanWheelsCodec
from drivers.can_wheels.mapping_file import load_mapping
from drivers.samples import FaultSample, PowerSample, WheelSample
from tests.drivers.can_wheels_frames import assert_same, decode, frame, reasons

ODRIVE_5 = load_mapping("odrive_0_5")
ODRIVE_6 = load_mapping("odrive_0_6")


@pytest.mark.parametrize("bus", ["odrive_0_5", "odrive_0_6"])
def test_odrive_encoder_estimates(bus: str) -> None:
    codec = CanWheelsCodec("wheels", load_mapping(bus))
    (sample,) = decode(codec, frame(0x29, "0000c03f000010c0"), 77)
    expected = WheelSample(
        device="wheels", t_ns=77, wheel=1, position_rad=1.5 * 2 * math.pi, speed_rad_s=-2.25 * 2 * math.pi
    )
    assert_same(sample, expected)


def test_odrive_motor_current() -> None:
    (sample,) = decode(CanWheelsCodec("wheels", ODRIVE_5), frame(0x34, "0000003f1058f93e"))
    assert_same(sample, WheelSample(device="wheels", t_ns=1, wheel=1, current_a=0.48700001835823059))


def test_odrive_bus_voltage_is_taken_from_one_axis() -> None:
    codec = CanWheelsCodec("wheels", ODRIVE_5)
    (sample,) = decode(codec, frame(0x17, "cdccc0419a99993f"))
    assert_same(sample, PowerSample(device="wheels", t_ns=1, voltage_v=24.1, current_a=None))
    assert reasons(decode(codec, frame(0x37, "cdccc0419a99993f"))) == ["other_traffic"]


def test_odrive_set_point() -> None:
    payloads, meant = CanWheelsCodec("wheels", ODRIVE_5).encode_speeds((0.0, 4 * math.pi, -0.0, 0.0))
    assert list(payloads) == [
        frame(0x0D, "0000000000000000"),
        frame(0x2D, "0000004000000000"),
        frame(0x4D, "0000000000000000"),
        frame(0x6D, "0000000000000000"),
    ]
    assert meant == (0.0, 4 * math.pi, 0.0, 0.0)


@pytest.mark.parametrize("bus", ["odrive_0_5", "odrive_0_6"])
def test_odrive_clears_errors_and_starts_in_velocity_mode_and_closed_loop_and_stops_in_idle(bus: str) -> None:
    codec = CanWheelsCodec("wheels", load_mapping(bus))
    clear = {"odrive_0_5": "", "odrive_0_6": "00"}[bus]
    assert list(codec.encode_start()) == [
        *(frame(node << 5 | 0x18, clear) for node in range(4)),
        *(frame(node << 5 | 0x0B, "0200000001000000") for node in range(4)),
        *(frame(node << 5 | 0x07, "08000000") for node in range(4)),
    ]
    assert list(codec.encode_stop()) == [frame(node << 5 | 0x07, "01000000") for node in range(4)]


def test_odrive_dialects_differ_in_heartbeat_and_later_commands() -> None:
    old, new = ODRIVE_5.database, ODRIVE_6.database
    heartbeat = bytes.fromhex("0008000008010180")
    assert old.get_message_by_name("Axis0_Heartbeat").decode(heartbeat, decode_choices=False) == {
        "Axis_Error": 0x800,
        "Axis_State": 8,
        "Motor_Error_Flag": 1,
        "Encoder_Error_Flag": 1,
        "Controller_Error_Flag": 0,
        "Trajectory_Done_Flag": 1,
    }
    assert new.get_message_by_name("Axis0_Heartbeat").decode(heartbeat, decode_choices=False) == {
        "Axis_Error": 0x800,
        "Axis_State": 8,
        "Procedure_Result": 1,
        "Trajectory_Done_Flag": 1,
    }
    assert {m.frame_id for m in old.messages} - {m.frame_id for m in new.messages} == {
        node << 5 | 0x0A for node in range(4)
    }
    assert {m.frame_id for m in new.messages} - {m.frame_id for m in old.messages} == {
        node << 5 | command for node in range(4) for command in (0x1C, 0x1D)
    }


def test_odrive_faults_of_one_axis_are_told_together_and_cleared_together() -> None:
    codec = CanWheelsCodec("wheels", ODRIVE_5)
    assert decode(codec, frame(0x61, "0000000008000000")) == []
    error, flag = decode(codec, frame(0x61, "4008000008010000"))
    assert isinstance(error, FaultSample)
    assert (error.wheel, error.code) == (3, 0x840)
    assert error.text == "Axis3_Heartbeat.Axis_Error: motor failed, watchdog expired"
    assert isinstance(flag, FaultSample)
    assert (flag.wheel, flag.code) == (3, 0x840)
    assert flag.text == f"{error.text}; Axis3_Heartbeat.Motor_Error_Flag: set"
    assert decode(codec, frame(0x61, "4008000008010000")) == []
    (left,) = decode(codec, frame(0x61, "0000000008010000"))
    assert isinstance(left, FaultSample)
    assert (left.code, left.text) == (1, "Axis3_Heartbeat.Motor_Error_Flag: set")
    (cleared,) = decode(codec, frame(0x61, "0000000008000000"))
    assert isinstance(cleared, FaultSample)
    assert (cleared.wheel, cleared.code) == (3, 0)


def test_odrive_6_heartbeat_may_have_seven_or_eight_bytes() -> None:
    for padding in ("", "00"):
        (fault,) = decode(CanWheelsCodec("wheels", ODRIVE_6), frame(0x21, f"00000001010000{padding}"))
        assert isinstance(fault, FaultSample)
        assert fault.text == "Axis1_Heartbeat.Axis_Error: watchdog expired"


def test_active_fault_is_told_again_after_a_break_of_the_link() -> None:
    codec = CanWheelsCodec("wheels", ODRIVE_5)
    (first,) = decode(codec, frame(0x01, "0100000008000000"))
    codec.reset()
    assert decode(codec, frame(0x01, "0100000008000000")) == [first]
    codec.reset()
    (cleared,) = decode(codec, frame(0x01, "0000000008000000"))
    assert isinstance(cleared, FaultSample)
    assert cleared.code == 0


@pytest.mark.parametrize("bad", ["0000c07f", "0000807f", "000080ff"])
@pytest.mark.parametrize("order", [0, 1])
def test_float_that_is_no_number_rejects_the_message_whole(bad: str, order: int) -> None:
    codec = CanWheelsCodec("wheels", ODRIVE_5)
    data = bad + "0000803f" if order == 0 else "0000803f" + bad
    told = decode(codec, frame(0x09, data))
    assert reasons(told) == ["not_finite"]
    assert len(told) == 1
