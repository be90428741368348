"""Steering over a bus of wheel drives: setpoints, measured angles, and drives without steering."""

import math
from pathlib import Path

import pytest

from drivers.can.frame import CanFrame, pack_can_frame, unpack_can_frame
from drivers.can_wheels.codec import CanWheelsCodec
from drivers.can_wheels.mapping_file import load_mapping
from drivers.clock import VirtualClock
from drivers.driver import WheelDrive
from drivers.link import Received
from drivers.samples import WheelCommand, WheelSample
from rover_hil.run.replay_link import ReplayLink

FOLDER = Path(__file__).parents[2] / "docs" / "examples" / "can"
SIX = FOLDER / "six_wheels.toml"
ANGLES = (0.3, -0.3, 0.0, 0.0, -0.25, 0.25)


def frames(payloads: list[bytes]) -> dict[int, bytes]:
    unpacked = [unpack_can_frame(payload) for payload in payloads]
    return {frame.can_id: frame.data for frame in unpacked if frame is not None}


def make_drive(mapping: Path) -> tuple[WheelDrive, ReplayLink[bytes]]:
    link: ReplayLink[bytes] = ReplayLink()
    codec = CanWheelsCodec("wheels", load_mapping(str(mapping)))
    drive = WheelDrive("wheels", link, codec, VirtualClock(0), max_age_s=1.0)
    drive.connect(0.0)
    return drive, link


def command(count: int, steering_rad: tuple[float, ...] | None) -> WheelCommand:
    return WheelCommand(t_ns=0, expires_ns=10**9, speed_rad_s=(1.0,) * count, steering_rad=steering_rad)


def test_a_set_point_message_holds_speed_and_angle() -> None:
    payloads, speeds, angles = CanWheelsCodec("wheels", load_mapping(str(SIX))).encode_set_points(
        (1.0,) * 6, ANGLES
    )
    sent = frames(list(payloads))
    assert speeds == pytest.approx((1.0,) * 6)
    assert angles == pytest.approx(ANGLES, abs=math.radians(0.005))
    # 0.3 rad are 17.19 deg, in steps of 0.01 deg; 1 rad/s in steps of 0.001.
    assert sent[512] == (1000).to_bytes(2, "little") + (1719).to_bytes(2, "little")
    assert sent[514] == (1000).to_bytes(2, "little") + bytes(2)


def test_a_stop_keeps_the_angles() -> None:
    drive, link = make_drive(SIX)
    assert drive.command(command(6, ANGLES)).steering_rad == pytest.approx(ANGLES, abs=1e-4)
    link.sent.clear()
    drive.stop()
    assert frames(link.sent)[512] == bytes(2) + (1719).to_bytes(2, "little")


def test_an_expired_command_does_not_steer() -> None:
    drive, link = make_drive(SIX)
    drive.command(command(6, ANGLES))
    link.sent.clear()
    drive.command(WheelCommand(t_ns=-1, expires_ns=0, speed_rad_s=(1.0,) * 6, steering_rad=(0.0,) * 6))
    assert frames(link.sent)[512] == bytes(2) + (1719).to_bytes(2, "little")


@pytest.mark.parametrize("steering_rad", [None, (0.1,), (math.nan,) * 6])
def test_angles_that_are_missing_or_malformed_change_nothing(steering_rad: tuple[float, ...] | None) -> None:
    drive, link = make_drive(SIX)
    drive.command(command(6, ANGLES))
    link.sent.clear()
    assert drive.command(command(6, steering_rad)).steering_rad is None
    assert frames(link.sent)[512] == (1000).to_bytes(2, "little") + (1719).to_bytes(2, "little")


def test_a_drive_without_steering_takes_none() -> None:
    drive, _ = make_drive(FOLDER / "mecanum.toml")
    assert drive.command(command(4, (0.1,) * 4)).steering_rad is None


def test_a_measured_angle_has_sign_and_zero(tmp_path: Path) -> None:
    text = SIX.read_text("utf-8").replace(
        'signal = "Angle", unit = "deg" }', 'signal = "Angle", unit = "deg", zero = 5 }'
    )
    (tmp_path / "turned.toml").write_text(
        text.replace("node = 1\n", "node = 1\nsteering_sign = -1\n"), "utf-8"
    )
    (tmp_path / "six_wheels.dbc").write_bytes((FOLDER / "six_wheels.dbc").read_bytes())
    codec = CanWheelsCodec("wheels", load_mapping(str(tmp_path / "turned.toml")))
    data = bytes(5) + (1500).to_bytes(2, "little") + bytes(1)
    for can_id, expected_deg in ((528, 10.0), (529, -10.0)):
        (sample,) = codec.decode(Received(1, pack_can_frame(CanFrame(can_id, data, is_extended=False))))
        assert isinstance(sample, WheelSample)
        assert sample.steering_rad == pytest.approx(math.radians(expected_deg))
    payloads, _, angles = codec.encode_set_points(
        (0.0,) * 6, (math.radians(10.0), math.radians(-10.0), *(0.0,) * 4)
    )
    sent = frames(list(payloads))
    assert sent[512][2:] == sent[513][2:] == (1500).to_bytes(2, "little")
    assert angles[:2] == pytest.approx((math.radians(10.0), math.radians(-10.0)))
