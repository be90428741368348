"""VectorNav messages: published sentences, axes, rejections, resynchronisation, corruption."""

import math
from collections.abc import Sequence
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

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
from drivers.vectornav.codec import LONGEST_MESSAGE, VectorNavCodec, crc16
from drivers.vectornav.settings import VectorNavSettings

# VectorNav programming library, example of the C API: a message "by a VectorNav sensor".
YMR = (
    b"$VNYMR,+100.949,-007.330,+000.715,-00.0049,-00.2449,+00.5397,-01.258,-00.100,-09.701,"
    b"-00.000018,+00.001122,-00.000551*69\r\n"
)
# Captures quoted in the sources of three independent drivers; the sensor of the second lies on its side.
CAPTURES = [
    b"$VNYMR,+104.977,+004.548,-001.276,-00.8012,-02.7376,+01.0070,+00.837,+00.235,-10.414,"
    b"-00.002081,-00.001151,+00.002113*61\r\n",
    b"$VNYMR,+029.694,+003.114,+115.116,+00.5800,+02.5299,-00.5768,+00.527,-09.024,+04.208,"
    b"-00.002434,-00.003153,-00.000194*60\r\n",
    b"$VNYMR,+164.618,+022.062,-003.757,-00.3611,-00.0797,+00.2916,+03.553,+00.595,-08.826,"
    b"+00.004000,-00.000843,+00.000141*64\r\n",
]
# Captures quoted in a Python and a MATLAB reader.
YBA = b"$VNYBA,+059.745,+003.857,-004.949,+00.001,-00.008,+00.150,+00.000478,-00.000896,-00.001366*5B\r\n"
IMU = (
    b"$VNIMU,-00.0350,+00.4222,-00.6643,-00.015,+00.019,+09.948,"
    b"+00.002066,-00.008442,-00.044656,+20.7,+084.322*66\r\n"
)
# User manual UM001, communication protocol control register.
WITH_COUNT = b"$VNYPR,+010.071,+000.278,-002.026,T1162704*2F\r\n"
WITH_STATUS = b"$VNYPR,+010.071,+000.278,-002.026,S0000*1F\r\n"

NUMBER = st.floats(-15, 15)


def decode(data: bytes, codec: VectorNavCodec | None = None) -> Sequence[Sample | Rejection]:
    return (codec or VectorNavCodec("imu")).decode(Received(7, data))


def line(body: str) -> bytes:
    checksum = 0
    for byte in body.encode():
        checksum ^= byte
    return f"${body}*{checksum:02X}\r\n".encode()


def test_published_message_has_every_quantity_in_our_axes() -> None:
    attitude, heading, acceleration, rate = decode(YMR)
    assert isinstance(attitude, AttitudeSample)
    assert isinstance(heading, HeadingSample)
    assert isinstance(acceleration, AccelerationSample)
    assert isinstance(rate, RateSample)
    assert heading.heading_rad == pytest.approx(math.radians(90 - 100.949))
    assert heading.reference is HeadingReference.MAGNETIC
    assert attitude.roll_rad == pytest.approx(math.radians(0.715))
    assert attitude.pitch_rad == pytest.approx(math.radians(7.330))  # nose down
    assert (acceleration.x_m_s2, acceleration.y_m_s2, acceleration.z_m_s2) == (-1.258, 0.100, 9.701)
    assert (rate.rate_x_rad_s, rate.rate_y_rad_s, rate.rate_z_rad_s) == (-0.000018, -0.001122, 0.000551)
    assert {(sample.device, sample.t_ns) for sample in (attitude, heading, acceleration, rate)} == {
        ("imu", 7)
    }


@pytest.mark.parametrize("capture", [YMR, *CAPTURES])
def test_gravity_and_attitude_of_captures_agree(capture: bytes) -> None:
    """The axes are right if the measured gravity is where roll and pitch say: nobody's encoder is needed."""
    attitude, _, acceleration, _ = decode(capture)
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
    assert math.degrees(math.acos(cosine)) < 3.0


def test_published_yba_gives_no_acceleration_as_its_own_is_without_gravity() -> None:
    attitude, heading, rate = decode(YBA)
    assert isinstance(attitude, AttitudeSample)
    assert isinstance(heading, HeadingSample)
    assert isinstance(rate, RateSample)
    assert heading.heading_rad == pytest.approx(math.radians(90 - 59.745))
    assert rate.rate_z_rad_s == 0.001366


def test_published_imu_message_is_read_with_temperature_and_pressure_behind() -> None:
    acceleration, rate = decode(IMU)
    assert isinstance(acceleration, AccelerationSample)
    assert isinstance(rate, RateSample)
    assert acceleration.z_m_s2 == -9.948
    assert rate.rate_z_rad_s == 0.044656


INS = "VNINS,{},2300,{},+009.597,-000.201,-000.301,+50.0,+006.0,+00050.0,+0.0,+0.0,+0.0,02.0,00.5,00.10"


@pytest.mark.parametrize("status", ["0002", "0006", "0306", "030A"])
def test_yaw_of_a_tracking_navigation_filter_is_from_true_north(status: str) -> None:
    """Order of the fields, units and modes as in the manual UM004."""
    attitude, heading = decode(line(INS.format("+100000.000000", status)))
    assert isinstance(attitude, AttitudeSample)
    assert isinstance(heading, HeadingSample)
    assert math.degrees(heading.heading_rad) == pytest.approx(90 - 9.597)
    assert heading.reference is HeadingReference.TRUE
    assert math.degrees(attitude.pitch_rad or 0.0) == pytest.approx(0.201)
    assert math.degrees(attitude.roll_rad or 0.0) == pytest.approx(-0.301)


@pytest.mark.parametrize("status", ["0004", "0005", "0003", "0100"])
def test_yaw_of_a_filter_that_has_not_settled_is_rejected_by_its_name(status: str) -> None:
    assert list(decode(line(INS.format("100000.0", status)))) == [Rejection("not_tracking")]


@pytest.mark.parametrize("status", ["", "2", "00G2", "+002"])
def test_navigation_message_with_another_status_is_malformed(status: str) -> None:
    assert list(decode(line(INS.format("100000.0", status)))) == [Rejection("format")]
    assert list(decode(line("VNINS,100000.0"))) == [Rejection("format")]


def test_reported_navigation_messages_are_rejected_as_their_filter_does_not_track(shared_data: Path) -> None:
    data = (shared_data / "field_reports" / "serial" / "vectornav_ins.txt").read_bytes()
    assert set(decode(data)) == {Rejection("not_tracking")}
    tracking = b"".join(line(text.decode()[1:-3].replace(",0004,", ",0006,")) for text in data.split())
    yaws = [math.degrees(each.heading_rad) for each in decode(tracking) if isinstance(each, HeadingSample)]
    assert (90 - max(yaws), 90 - min(yaws)) == pytest.approx((9.597, 9.677), abs=1e-9)


@pytest.mark.parametrize("message", [WITH_COUNT, WITH_STATUS])
def test_appended_count_or_status_is_ignored(message: bytes) -> None:
    attitude, heading = decode(message)
    assert isinstance(attitude, AttitudeSample)
    assert isinstance(heading, HeadingSample)
    assert heading.heading_rad == pytest.approx(math.radians(90 - 10.071))


@pytest.mark.parametrize(
    ("body", "kinds"),
    [
        ("VNMAR,1,2,3,+0.1,+0.2,-9.8,+0.01,+0.02,+0.03", (AccelerationSample, RateSample)),
        ("VNACC,+0.1,+0.2,-9.8", (AccelerationSample,)),
        ("VNGYR,+0.1,+0.2,-0.3", (RateSample,)),
        ("VNYIA,+1,+2,+3,+0.1,+0.2,+0.3,+0.01,+0.02,+0.03", (AttitudeSample, HeadingSample, RateSample)),
    ],
)
def test_each_message_gives_what_it_contains(body: str, kinds: tuple[type[Sample], ...]) -> None:
    assert tuple(map(type, decode(line(body)))) == kinds


def test_sixteen_bit_checksum() -> None:
    assert crc16(b"123456789") == 0x31C3  # CRC-16/XMODEM's check value
    body = b"VNGYR,+0.1,+0.2,-0.3"
    (rate,) = decode(b"$%b*%04X\r\n" % (body, crc16(body)))
    assert isinstance(rate, RateSample)
    assert list(decode(b"$%b*%04X\r\n" % (body, crc16(body) ^ 1))) == [Rejection("checksum")]


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (b"$VNRRG,11*73\r\n", "other_message"),  # user manual UM004, section 3.1
        (b"$VNWRG,6,16*6B\r\n", "other_message"),
        (line("GPGGA,1,2"), "other_message"),
        (line("VNERR,03"), "device_error"),
        (b"$VNGYR,+0.1,+0.2,-0.3*00\r\n", "checksum"),
        (b"$VNGYR,+0.1,+0.2,-0.3\r\n", "framing"),
        (b"$VNGYR,+0.1,+0.2,-0.3*XX\r\n", "framing"),
        (b"VNGYR,+0.1,+0.2,-0.3*5A\r\n", "framing"),
        (b"\xfa\x01\x29\x01\r\n", "framing"),
        (line("VNGYR,+0.1,+0.2"), "format"),
        (line("VNGYR,+0.1,+0.2,-0.3,+0.4"), "format"),
        (line("VNGYR,+0.1,+0.2,nan"), "format"),
        (line("VNGYR,+0.1,+0.2,1e999"), "format"),
        (line("VNGYR,+0.1,+0.2,"), "format"),
        (line("VNGYR,+0.1,+0.2,+36.0"), "range"),
        (line("VNACC,+0.1,+0.2,-200.0"), "range"),
        (line("VNYPR,+361,+0,+0"), "range"),
        (line("VNYPR,+0,+91,+0"), "range"),
        (line("VNYPR,+0,+0,-181"), "range"),
    ],
)
def test_each_rejection_and_the_next_message_is_read(data: bytes, reason: str) -> None:
    results = decode(data + YMR)
    assert results[0] == Rejection(reason)
    assert len(results) == 5


def test_mounted_sideways_and_true_north() -> None:
    settings = VectorNavSettings(port="/dev/null", mounting_yaw_deg=90.0, heading_reference="true")
    codec = settings.make_codec("imu")
    # The sensor's x axis points to the rover's left. The rover faces east, so the sensor's yaw is north.
    results = codec.decode(Received(1, line("VNYPR,+0.0,+5.0,+0.0") + line("VNGYR,+0.5,+0.0,-0.1")))
    attitude, heading, rate = results
    assert isinstance(attitude, AttitudeSample)
    assert isinstance(heading, HeadingSample)
    assert isinstance(rate, RateSample)
    assert wrap_rad(heading.heading_rad) == pytest.approx(0.0)
    assert heading.reference is HeadingReference.TRUE
    assert attitude.roll_rad == pytest.approx(math.radians(5.0))  # its nose up is the rover's left side up
    assert (rate.rate_x_rad_s, rate.rate_y_rad_s) == pytest.approx((0.0, 0.5))
    assert rate.rate_z_rad_s == 0.1


@given(NUMBER, NUMBER, NUMBER)
def test_rates_and_accelerations_survive_the_format_of_the_manual(x: float, y: float, z: float) -> None:
    numbers = f"{x:+010.6f},{-y:+010.6f},{-z:+010.6f}"
    rate, acceleration = decode(line(f"VNGYR,{numbers}") + line(f"VNACC,{numbers}"))
    assert isinstance(rate, RateSample)
    assert isinstance(acceleration, AccelerationSample)
    assert (rate.rate_x_rad_s, rate.rate_y_rad_s, rate.rate_z_rad_s) == pytest.approx((x, y, z), abs=1e-6)
    assert (acceleration.x_m_s2, acceleration.y_m_s2, acceleration.z_m_s2) == pytest.approx(
        (x, y, z), abs=1e-6
    )


def test_split_at_every_byte_changes_nothing() -> None:
    stream = b"1,2*00\r\n" + YMR + YBA[:40] + WITH_COUNT + b"\r\n" + IMU
    whole = list(decode(stream))
    assert sum(isinstance(result, Sample) for result in whole) == 8
    for cut in range(len(stream) + 1):
        codec = VectorNavCodec("imu")
        assert [*decode(stream[:cut], codec), *decode(stream[cut:], codec)] == whole


@pytest.mark.parametrize("message", [YMR, YBA, IMU, WITH_STATUS])
def test_no_single_bit_error_gives_a_wrong_sample(message: bytes) -> None:
    good = list(decode(message))
    for bit in range(8 * (len(message) - 2)):
        flipped = bytearray(message)
        flipped[bit // 8] ^= 1 << bit % 8
        samples = [result for result in decode(bytes(flipped)) if isinstance(result, Sample)]
        assert samples in ([], good)  # a flipped case bit of the checksum's letters is harmless


def test_buffer_is_bounded_and_forgotten_on_reset() -> None:
    codec = VectorNavCodec("imu")
    decode(b"$" * 10_000, codec)
    assert held_bytes(codec) <= held_bytes(VectorNavCodec("imu")) + LONGEST_MESSAGE
    codec.reset()
    decode(YMR[:50], codec)
    codec.reset()
    assert list(decode(YMR[50:], codec)) == [Rejection("framing")]
