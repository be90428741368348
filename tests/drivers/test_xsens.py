"""MTData2 messages: recorded packets, frames, number formats, rejections, resynchronisation, corruption."""

import math
import struct
from collections.abc import Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from benchmarks.program.fuzz_parsers import held_bytes
from drivers.angles import wrap_rad
from drivers.driver import Rejection
from drivers.link import Received
from drivers.samples import (
    AccelerationSample,
    AttitudeSample,
    HeadingReference,
    HeadingSample,
    RateSample,
    Sample,
)
from drivers.xsens.codec import XsensCodec
from drivers.xsens.scanner import LARGEST_DATA, Message, MessageScanner
from drivers.xsens.settings import XsensSettings

# Content of packets of an MTi-300, firmware 1.8.2, recorded and decoded with the manufacturer's MT Manager:
# file "XSens Golden Packets" of a public driver.
FLAT = """
    10 20 02 A6 55 10 60 04 00 57 47 2E 20 10 10 3F 7F 7D C4 BC 10 10 7D 3B A1 57 70 BD 7E C6 56 40 20
    0C BD A2 1A F8 BE 2A 8E 96 41 1D 27 A2 40 10 0C B9 4F C8 00 B9 DA 24 00 3C C9 28 80 40 30 0C 3C 02
    C8 9C 3C 35 F6 C8 3C DB 0C 00 80 20 0C BB B1 7D 81 BB 96 32 00 3C 01 E8 41 80 30 10 3F 80 00 00 B6
    E3 30 01 B6 C0 40 00 37 26 48 00 C0 20 0C BE 99 9C 24 3F B6 1B 56 3F 16 6A EB 30 10 04 00 01 86 DE
    E0 20 04 00 40 00 03
"""
NO_MAGNETOMETER = """
    10 20 02 8D 90 10 60 04 00 54 DB F1 20 10 10 3F 7F 89 11 BC 11 1D FA 3B A0 CE F0 BD 73 25 73 40 20
    0C BD DC F9 D0 BE 3C 86 19 41 1D 0B 47 40 10 0C B9 8D B0 00 B9 F1 48 00 3C C9 04 30 40 30 0C BC B9
    89 2E BB 09 8C 00 3C A7 08 00 80 20 0C BA 63 BC 01 BC 04 D6 3F BB 6D E3 FE 80 30 10 3F 80 00 01 B5
    91 C0 00 B7 2A 08 00 B6 98 40 00 E0 20 04 00 40 00 03
"""
ON_ITS_SIDE = """
    10 20 02 91 8D 10 60 04 01 36 3F A6 20 10 10 3F 35 E0 42 3F 31 CD 15 BD 9F 49 DB BD A9 38 CF 40 20
    0C BD 63 5A 90 41 1D 08 D4 3E 5F AA 50 40 10 0C B9 11 68 00 3C C9 01 00 3A 0F 7D 00 40 30 0C BC 3B
    29 80 3C 35 FC 00 3C A4 6E 00 80 20 0C 3C AE A2 41 BB 56 D8 00 BA D5 AC 01 80 30 10 3F 80 00 00 37
    DF 88 01 B6 89 80 00 B6 08 C0 00 C0 20 0C BE FB FB F2 3F 33 C4 85 BF A0 A2 C1 08 10 04 42 16 80 00
    30 10 04 00 01 86 E1 E0 20 04 00 40 00 03
"""
SHAKEN = """
    10 20 02 FB 85 10 60 04 01 A4 98 DE 20 10 10 3F 2A 14 63 BE D7 EF A7 3C DE E5 08 3F 1D CE C9 40 20
    0C C1 F2 46 C3 C1 EC E0 76 C2 8F 85 3F 40 10 0C BD 93 2C CC BD 92 0A 16 BE 3A 6E EC 40 30 0C 42 51
    94 64 C2 7B 5A 5A C1 CC C0 AE 80 20 0C 40 85 4D 6D C1 25 55 9E C0 90 8E 1F 80 30 10 3F 7F F8 98 3B
    AA 9E E5 BC 53 9E C0 BB B9 06 0C C0 20 0C 3E DC 74 39 BE 75 2B 48 3F AF 9A 3F 30 10 04 00 01 86 DE
    E0 20 04 00 48 14 01
"""
ORIENTATION_ONLY = """
    10 20 02 46 82 10 60 04 01 C4 FC 3E 20 10 10 3F 71 CE 6C BE A5 6B CF 3C 61 3B D8 BD 69 1D 25 E0 20
    04 00 40 00 03
"""
# From the same file, with the manufacturer's sums.
WITH_SUMS = {
    "FA FF 30 00 D1": Message(0x30, b""),
    "FA FF C1 08 10 20 FF FF 10 60 FF FF 9C": Message(0xC1, bytes.fromhex("1020FFFF1060FFFF")),
    "FA FF 03 04 03 70 03 F8 8C": Message(0x03, bytes.fromhex("037003F8")),
    "FA FF 13 0B 01 08 02 00 00 00 25 00 01 15 34 69": Message(0x13, bytes.fromhex("0108020000002500011534")),
}
# Computed by hand from the manual by somebody else: Euler angles, rate and time.
EULER = bytes.fromhex(
    "fa ff 36 25 20 30 0c 3f 80 00 00 c0 00 00 00 42 c4 99 9a 80 20 0c 00 00 00 00 00 00 00 00 3d cc cc cd"
    "10 60 04 00 00 30 39 67"
)


def framed(data: bytes, kind: int = 0x36) -> bytes:
    size = bytes((len(data),)) if len(data) < 255 else b"\xff" + len(data).to_bytes(2, "big")
    message = b"\xff" + bytes((kind,)) + size + data
    return b"\xfa" + message + bytes((-sum(message) % 256,))


def item(identifier: int, data: bytes) -> bytes:
    return struct.pack(">HB", identifier, len(data)) + data


def decode(data: bytes, codec: XsensCodec | None = None) -> Sequence[Sample | Rejection]:
    return (codec or XsensCodec("imu")).decode(Received(7, data))


def recorded(packet: str) -> Sequence[Sample | Rejection]:
    return decode(framed(bytes.fromhex(packet)))


@pytest.mark.parametrize("message", WITH_SUMS)
def test_published_sums_are_right(message: str) -> None:
    assert MessageScanner().feed(bytes.fromhex(message)) == [WITH_SUMS[message]]


def test_recorded_packet_flat() -> None:
    attitude, heading, acceleration, rate = recorded(FLAT)
    assert isinstance(attitude, AttitudeSample)
    assert isinstance(heading, HeadingSample)
    assert isinstance(acceleration, AccelerationSample)
    assert isinstance(rate, RateSample)
    # Numbers as MT Manager decoded them.
    expected = Rotation.from_quat([-0.00879299, 0.00492375, -0.06220087, 0.99801278]).as_euler("ZYX")
    assert heading.heading_rad == pytest.approx(expected[0], abs=1e-6)
    assert attitude.pitch_rad == pytest.approx(expected[1], abs=1e-6)
    assert attitude.roll_rad == pytest.approx(expected[2], abs=1e-6)
    assert heading.reference is HeadingReference.MAGNETIC
    assert (acceleration.x_m_s2, acceleration.y_m_s2, acceleration.z_m_s2) == pytest.approx(
        (-0.07915300, -0.16655955, 9.82217598), abs=1e-7
    )
    assert (rate.rate_x_rad_s, rate.rate_y_rad_s, rate.rate_z_rad_s) == pytest.approx(
        (-0.00541657, -0.00458360, 0.00792891), abs=1e-8
    )
    assert {sample.t_device_ns for sample in (attitude, heading, acceleration, rate)} == {5719854 * 100_000}
    assert {(sample.device, sample.t_ns) for sample in (attitude, heading, acceleration, rate)} == {
        ("imu", 7)
    }


@pytest.mark.parametrize("packet", [FLAT, NO_MAGNETOMETER, ON_ITS_SIDE])
def test_gravity_and_orientation_of_recorded_packets_agree(packet: str) -> None:
    """The axes are right if the measured gravity is where roll and pitch say: nobody's encoder is needed."""
    attitude, _, acceleration, _ = recorded(packet)
    assert isinstance(attitude, AttitudeSample)
    assert isinstance(acceleration, AccelerationSample)
    assert attitude.roll_rad is not None
    assert attitude.pitch_rad is not None
    x, y, z = acceleration.x_m_s2, acceleration.y_m_s2, acceleration.z_m_s2
    up = (
        -math.sin(attitude.pitch_rad),
        math.cos(attitude.pitch_rad) * math.sin(attitude.roll_rad),
        math.cos(attitude.pitch_rad) * math.cos(attitude.roll_rad),
    )
    cosine = (up[0] * x + up[1] * y + up[2] * z) / math.hypot(x, y, z)
    assert math.degrees(math.acos(min(1.0, cosine))) < 1.0


def test_recorded_packet_shaken_gives_nothing_that_is_wrong() -> None:
    """The device was shaken until its sensors clipped, and says itself that its orientation is not valid."""
    assert list(recorded(SHAKEN)) == [
        Rejection("filter_invalid"),
        Rejection("clipped"),
        Rejection("clipped"),
    ]


def test_recorded_packet_with_orientation_only() -> None:
    assert [type(sample) for sample in recorded(ORIENTATION_ONLY)] == [AttitudeSample, HeadingSample]


def test_euler_angles() -> None:
    attitude, heading, rate = decode(EULER)
    assert isinstance(attitude, AttitudeSample)
    assert isinstance(heading, HeadingSample)
    assert isinstance(rate, RateSample)
    assert attitude.roll_rad == pytest.approx(math.radians(1.0))
    assert attitude.pitch_rad == pytest.approx(math.radians(-2.0))
    assert heading.heading_rad == pytest.approx(math.radians(98.3))
    assert rate.rate_z_rad_s == pytest.approx(0.1)
    assert rate.t_device_ns == 12345 * 100_000


def test_with_quaternion_and_euler_angles_there_is_one_heading() -> None:
    both = item(0x2030, struct.pack(">3f", 0.0, 0.0, 90.0)) + item(0x2010, struct.pack(">4f", 1, 0, 0, 0))
    _, heading = decode(framed(both))
    assert isinstance(heading, HeadingSample)
    assert heading.heading_rad == 0.0


def test_north_west_up_is_turned_to_east() -> None:
    _, heading = decode(framed(item(0x2038, struct.pack(">3f", 0.0, 0.0, 30.0))))
    assert isinstance(heading, HeadingSample)
    assert heading.heading_rad == pytest.approx(math.radians(120.0))


@pytest.mark.parametrize(
    ("identifier", "data"),
    [
        (0x8020, struct.pack(">3f", 0.5, -0.25, 1.5)),
        (0x8023, struct.pack(">3d", 0.5, -0.25, 1.5)),
        (0x8021, struct.pack(">3i", 2**19, -(2**18), 3 * 2**19)),
    ],
)
def test_number_formats(identifier: int, data: bytes) -> None:
    (rate,) = decode(framed(item(identifier, data)))
    assert isinstance(rate, RateSample)
    assert (rate.rate_x_rad_s, rate.rate_y_rad_s, rate.rate_z_rad_s) == (0.5, -0.25, 1.5)


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (item(0x8022, bytes(18)), "number_format"),
        (item(0x2034, bytes(12)), "ned_frame"),
        (item(0x8020, bytes(11)), "layout"),
        (item(0x2010, bytes(12)), "layout"),
        (item(0x1060, bytes(3)), "layout"),
        (item(0xE020, bytes(2)), "layout"),
        (bytes.fromhex("80 20 0c 55"), "layout"),
        (b"\x80\x20", "layout"),
        (item(0x8020, struct.pack(">3f", 0.0, math.nan, 0.0)), "range"),
        (item(0x8020, struct.pack(">3f", 0.0, 36.0, 0.0)), "range"),
        (item(0x4020, struct.pack(">3f", 0.0, -math.inf, 0.0)), "range"),
        (item(0x4020, struct.pack(">3f", 0.0, 300.0, 0.0)), "range"),
        (item(0x2010, struct.pack(">4f", 1.1, 0.0, 0.0, 0.0)), "range"),
        (item(0x2010, struct.pack(">4f", math.nan, 0.0, 0.0, 0.0)), "range"),
        (item(0x2030, struct.pack(">3f", 181.0, 0.0, 0.0)), "range"),
        (item(0x2030, struct.pack(">3f", 0.0, 91.0, 0.0)), "range"),
        (item(0x2030, struct.pack(">3f", 0.0, 0.0, -181.0)), "range"),
    ],
)
def test_each_rejected_item_and_the_next_message_is_read(data: bytes, reason: str) -> None:
    results = decode(framed(data) + EULER)
    assert results[0] == Rejection(reason)
    assert len(results) == 4


@pytest.mark.parametrize(
    ("kind", "reason"), [(0x42, "device_error"), (0x32, "legacy_output"), (0x3E, "other_message")]
)
def test_other_messages(kind: int, reason: str) -> None:
    assert decode(framed(b"\x1e", kind) + EULER)[0] == Rejection(reason)


def test_items_of_no_use_are_no_rejections() -> None:
    assert list(decode(framed(item(0xC020, bytes(12)) + item(0x0810, bytes(4))))) == []


@pytest.mark.parametrize(("bit", "clipped"), [(8, 0x4020), (10, 0x4020), (11, 0x8020), (13, 0x8020)])
def test_one_clipped_axis_spoils_its_sensor_only(bit: int, clipped: int) -> None:
    status = item(0xE020, (1 << bit | 2).to_bytes(4, "big"))
    data = item(0x4020, bytes(12)) + item(0x8020, bytes(12)) + status
    kept = RateSample if clipped == 0x4020 else AccelerationSample
    results = decode(framed(data))
    assert Rejection("clipped") in results
    assert [type(result) for result in results if isinstance(result, Sample)] == [kept]


def test_a_lost_message_shows_in_the_counter() -> None:
    def counted(counter: int) -> bytes:
        return framed(item(0x1020, counter.to_bytes(2, "big")) + item(0x8020, bytes(12)))

    codec = XsensCodec("imu")
    assert len(decode(counted(65_535) + counted(0) + counted(1), codec)) == 3
    first, second = decode(counted(3), codec)
    assert first == Rejection("messages_lost")
    assert isinstance(second, RateSample)
    codec.reset()
    assert len(decode(counted(100), codec)) == 1


@given(
    st.floats(-3.1, 3.1),
    st.floats(-1.5, 1.5),
    st.floats(-3.1, 3.1),
    st.sampled_from([-180.0, -90.0, 0.0, 33.0]),
)
def test_orientation_is_that_of_the_quaternion(
    yaw: float, pitch: float, roll: float, mounting_yaw_deg: float
) -> None:
    rover = Rotation.from_euler("ZYX", [yaw, pitch, roll])
    sensor = rover * Rotation.from_euler("Z", mounting_yaw_deg, degrees=True)
    x, y, z, w = sensor.as_quat()
    settings = XsensSettings(port="/dev/null", mounting_yaw_deg=mounting_yaw_deg)
    attitude, heading = settings.make_codec("imu").decode(
        Received(1, framed(item(0x2013, struct.pack(">4d", w, x, y, z))))
    )
    assert isinstance(attitude, AttitudeSample)
    assert isinstance(heading, HeadingSample)
    ours = Rotation.from_euler(
        "ZYX", [heading.heading_rad, attitude.pitch_rad or 0.0, attitude.roll_rad or 0.0]
    )
    assert (ours.inv() * rover).magnitude() < 1e-6


def test_settings_name_reference_and_zero() -> None:
    settings = XsensSettings(port="/dev/null", yaw_zero_deg=90.0, heading_reference="true")
    _, heading = settings.make_codec("imu").decode(
        Received(1, framed(item(0x2030, struct.pack(">3f", 0.0, 0.0, 30.0))))
    )
    assert isinstance(heading, HeadingSample)
    assert wrap_rad(heading.heading_rad - math.radians(120.0)) == pytest.approx(0.0)
    assert heading.reference is HeadingReference.TRUE


# Framing


def test_extended_length() -> None:
    padding = item(0xC020, bytes(250)) + item(0xC020, bytes(250))
    message = framed(padding + item(0x8020, bytes(12)))
    assert message[3] == 0xFF
    (rate,) = decode(message)
    assert isinstance(rate, RateSample)


@pytest.mark.parametrize(
    ("before", "reason"),
    [
        (b"\x00\x01\x02", "framing"),
        (b"\xfa\x01", "framing"),
        (b"\xfa\xff\x36\xff\x00\x10", "framing"),
        (b"\xfa\xff\x36\xff\xff\xff", "framing"),
        (EULER[:20], "checksum"),
        (EULER[5:], "framing"),
        (EULER[:-1] + b"\x68", "checksum"),
    ],
)
def test_resynchronises(before: bytes, reason: str) -> None:
    results = decode(before + EULER + EULER)
    assert results[0] == Rejection(reason)
    assert [type(result) for result in results[-3:]] == [AttitudeSample, HeadingSample, RateSample]
    assert sum(isinstance(result, Rejection) for result in results) == 1


def test_split_at_every_byte_changes_nothing() -> None:
    stream = b"\x12\xfa" + EULER + EULER[:7] + EULER + b"\xfa" + framed(bytes.fromhex(FLAT)) + EULER
    whole = list(decode(stream))
    assert sum(isinstance(result, Sample) for result in whole) == 13
    for cut in range(len(stream) + 1):
        codec = XsensCodec("imu")
        assert [*decode(stream[:cut], codec), *decode(stream[cut:], codec)] == whole


def test_no_single_bit_error_gives_a_sample() -> None:
    for bit in range(8 * len(EULER)):
        flipped = bytearray(EULER)
        flipped[bit // 8] ^= 1 << bit % 8
        results = decode(bytes(flipped) + bytes(LARGEST_DATA + 10))  # a longer length is waited for
        assert [result for result in results if isinstance(result, Sample)] == []


def test_buffer_is_bounded_and_forgotten_on_reset() -> None:
    codec = XsensCodec("imu")
    decode(b"\xfa\xff\x36\xff\x04\x00" * 10_000, codec)
    assert held_bytes(codec) <= held_bytes(XsensCodec("imu")) + LARGEST_DATA + 7
    codec.reset()
    decode(EULER[:20], codec)
    codec.reset()
    assert list(decode(EULER[20:], codec)) == [Rejection("framing")]
