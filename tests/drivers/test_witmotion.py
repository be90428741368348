"""WitMotion frames: golden bytes, mounting, resynchronisation, corruption, headings from raw magnetics."""

import datetime as dt
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from benchmarks.program.fuzz_parsers import held_bytes
from drivers.angles import wrap_rad
from drivers.driver import Rejection
from drivers.heading_calibration import MagnetometerCalibration, Vector
from drivers.link import Received
from drivers.mounting import Mounting
from drivers.samples import (
    AccelerationSample,
    AttitudeSample,
    HeadingReference,
    HeadingSample,
    RateSample,
    Sample,
)
from drivers.witmotion.codec import (
    ACCELERATION_STEP_M_S2,
    ANGLE,
    ANGLE_STEP_RAD,
    FRAME_SIZE,
    MAGNETIC,
    RATE_STEP_RAD_S,
    WitMotionCodec,
    encode_acceleration,
    encode_angle,
    encode_frame,
    encode_rate,
)
from drivers.witmotion.settings import WitMotionSettings

ANGLE_GOLDEN = bytes.fromhex("55 53 b6 00 94 fe e7 45 00 00 1c")
RATE_GOLDEN = bytes.fromhex("55 52 00 00 00 00 a4 00 00 00 4b")
HEADER_IN_DATA = encode_frame(ANGLE, 0x5353, 0x5255, 0x5355)
WORD = st.integers(-32768, 32767)
TILT = st.floats(-1.2, 1.2)
TURN = st.floats(-math.pi, math.pi)


def decode(data: bytes, codec: WitMotionCodec | None = None) -> Sequence[Sample | Rejection]:
    return (codec or WitMotionCodec("imu")).decode(Received(7, data))


def no_iron() -> MagnetometerCalibration:
    return MagnetometerCalibration(
        source="made up",
        date=dt.date(2026, 5, 4),
        hard_iron_counts=(0.0, 0.0, 0.0),
        soft_iron=((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
    )


def test_golden_angle() -> None:
    attitude, heading = decode(ANGLE_GOLDEN)
    assert isinstance(attitude, AttitudeSample)
    assert isinstance(heading, HeadingSample)
    assert attitude.roll_rad == pytest.approx(math.radians(1.0), abs=ANGLE_STEP_RAD)
    assert attitude.pitch_rad == pytest.approx(math.radians(-2.0), abs=ANGLE_STEP_RAD)
    assert heading.heading_rad == pytest.approx(math.radians(98.3), abs=ANGLE_STEP_RAD)
    assert heading.reference is HeadingReference.MAGNETIC
    assert (heading.device, heading.t_ns) == ("imu", 7)


def test_golden_rate() -> None:
    (sample,) = decode(RATE_GOLDEN)
    assert isinstance(sample, RateSample)
    assert sample.rate_z_rad_s == pytest.approx(math.radians(10.0), abs=RATE_STEP_RAD_S)
    assert (sample.rate_x_rad_s, sample.rate_y_rad_s) == (0.0, 0.0)


def test_encoders_reproduce_golden_frames() -> None:
    assert encode_angle(math.radians(1), math.radians(-2), math.radians(98.3)) == ANGLE_GOLDEN
    assert encode_rate(0.0, 0.0, math.radians(10.0)) == RATE_GOLDEN


def test_level_and_at_rest_z_reads_one_g() -> None:
    (sample,) = decode(encode_frame(0x51, 0, 0, 2048))
    assert isinstance(sample, AccelerationSample)
    assert (sample.x_m_s2, sample.y_m_s2) == (0.0, 0.0)
    assert sample.z_m_s2 == pytest.approx(9.80665)


@given(WORD, WORD, WORD)
def test_every_frame_survives_a_round_trip(first: int, second: int, third: int) -> None:
    frame = encode_rate(first * RATE_STEP_RAD_S, second * RATE_STEP_RAD_S, third * RATE_STEP_RAD_S)
    (rate,) = decode(frame)
    assert isinstance(rate, RateSample)
    assert (rate.rate_x_rad_s, rate.rate_y_rad_s, rate.rate_z_rad_s) == pytest.approx(
        [word * RATE_STEP_RAD_S for word in (first, second, third)]
    )
    step = ACCELERATION_STEP_M_S2
    (acceleration,) = decode(encode_acceleration(first * step, second * step, third * step))
    assert isinstance(acceleration, AccelerationSample)
    assert (acceleration.x_m_s2, acceleration.y_m_s2, acceleration.z_m_s2) == pytest.approx(
        [word * step for word in (first, second, third)]
    )


def test_encoders_saturate_and_wrap() -> None:
    (rate,) = decode(encode_rate(1e9, -1e9, 0.0))
    assert isinstance(rate, RateSample)
    assert rate.rate_x_rad_s == pytest.approx(math.radians(2000.0), abs=2 * RATE_STEP_RAD_S)
    assert rate.rate_y_rad_s == pytest.approx(-math.radians(2000.0))
    _, heading = decode(encode_angle(0.0, 0.0, 3.5 * math.pi))
    assert isinstance(heading, HeadingSample)
    assert heading.heading_rad == pytest.approx(-0.5 * math.pi)


@given(TILT, TILT, TURN, TURN, TURN, TILT)
def test_mounting_is_a_rotation_by_roll_then_pitch_then_yaw(
    roll: float, pitch: float, yaw: float, mounting_yaw: float, mounting_roll: float, mounting_pitch: float
) -> None:
    world_from_rover = Rotation.from_euler("ZYX", [yaw, pitch, roll])
    rover_from_sensor = Rotation.from_euler("ZYX", [mounting_yaw, mounting_pitch, mounting_roll])
    sensor_yaw, sensor_pitch, sensor_roll = (world_from_rover * rover_from_sensor).as_euler("ZYX")
    assume(abs(sensor_pitch) < 1.4)
    mounting = Mounting(yaw_rad=mounting_yaw, roll_rad=mounting_roll, pitch_rad=mounting_pitch)
    ours = mounting.attitude_to_rover(sensor_roll, sensor_pitch, sensor_yaw)
    for measured, expected in zip(ours, (roll, pitch, yaw), strict=True):
        assert wrap_rad(measured - expected) == pytest.approx(0.0, abs=1e-6)
    vector = (1.0, -2.0, 3.0)
    assert mounting.vector_to_rover(vector) == pytest.approx(tuple(rover_from_sensor.apply(vector)))


def test_settings_turn_a_sensor_whose_y_axis_points_forward() -> None:
    settings = WitMotionSettings(port="/dev/null", mounting_yaw_deg=-90, yaw_zero_deg=10)
    codec = settings.make_codec("imu")
    # Nose down 5 deg, heading north-east: the sensor's x axis points right, to the south-east.
    results = codec.decode(Received(1, encode_angle(math.radians(-5), 0.0, math.radians(-55))))
    attitude, heading = results
    assert isinstance(attitude, AttitudeSample)
    assert isinstance(heading, HeadingSample)
    assert attitude.pitch_rad == pytest.approx(math.radians(5), abs=ANGLE_STEP_RAD)
    assert attitude.roll_rad == pytest.approx(0.0, abs=ANGLE_STEP_RAD)
    assert heading.heading_rad == pytest.approx(math.radians(45), abs=ANGLE_STEP_RAD)
    (rate,) = codec.decode(Received(1, encode_rate(-0.5, 0.0, 0.0)))  # the sensor's left side goes down
    assert isinstance(rate, RateSample)
    assert rate.rate_y_rad_s == pytest.approx(0.5, abs=RATE_STEP_RAD_S)


def test_an_upside_down_sensor_counts_counter_clockwise_with_scale_and_bias() -> None:
    settings = WitMotionSettings(
        port="/dev/null", mounting_roll_deg=180.0, gyro_scale=1.02, gyro_bias_deg_s=2.0
    )
    (rate,) = settings.make_codec("imu").decode(Received(1, encode_rate(0.1, 0.2, -0.5)))
    assert isinstance(rate, RateSample)
    assert rate.rate_x_rad_s == pytest.approx(0.102, abs=2 * RATE_STEP_RAD_S)
    assert rate.rate_y_rad_s == pytest.approx(-0.204, abs=2 * RATE_STEP_RAD_S)
    assert rate.rate_z_rad_s == pytest.approx(0.51 - math.radians(2.0), abs=2 * RATE_STEP_RAD_S)


@pytest.mark.parametrize("frame_type", [0x50, 0x54, 0x55, 0x56, 0x57, 0x58, 0x59, 0x5A])
def test_known_but_unused_frames_are_counted(frame_type: int) -> None:
    assert list(decode(encode_frame(frame_type, 1, 2, 3))) == [Rejection("other_type")]


def test_resynchronises_behind_noise_and_half_frames() -> None:
    for before, reason in (
        (b"\x00\x01\x02", "framing"),
        (b"\x55\x12", "framing"),
        (b"\x55\x55", "checksum"),
        (ANGLE_GOLDEN[4:], "framing"),
        (ANGLE_GOLDEN[:6], "checksum"),
        (HEADER_IN_DATA[2:], "framing"),
    ):
        results = decode(before + RATE_GOLDEN + ANGLE_GOLDEN)
        assert results[0] == Rejection(reason)
        assert [type(result) for result in results[1:]] == [RateSample, AttitudeSample, HeadingSample]


def test_stretch_of_noise_is_counted_once() -> None:
    noise = bytes(range(0x60, 0xA0)) * 3
    assert list(decode(noise)) == [Rejection("framing")]
    results = decode(noise + RATE_GOLDEN + noise)
    assert [type(result) for result in results] == [Rejection, RateSample, Rejection]


def test_split_at_every_byte_changes_nothing() -> None:
    broken = bytes([*RATE_GOLDEN[:5], RATE_GOLDEN[5] ^ 1, *RATE_GOLDEN[6:]])
    stream = b"\x12\x55" + ANGLE_GOLDEN + broken + RATE_GOLDEN + HEADER_IN_DATA * 2 + b"\x55" + RATE_GOLDEN
    whole = list(decode(stream))
    assert sum(isinstance(result, Sample) for result in whole) == 8
    for cut in range(len(stream) + 1):
        codec = WitMotionCodec("imu")
        assert [*decode(stream[:cut], codec), *decode(stream[cut:], codec)] == whole
    codec = WitMotionCodec("imu")
    assert [result for byte in stream for result in decode(bytes([byte]), codec)] == whole


def test_buffer_stays_below_one_frame() -> None:
    codec = WitMotionCodec("imu")
    for filler in (b"\x55", b"\x55\x53", b"\x00"):
        decode(filler * 10_000, codec)
        assert held_bytes(codec) < held_bytes(WitMotionCodec("imu")) + FRAME_SIZE


@pytest.mark.parametrize("frame", [ANGLE_GOLDEN, RATE_GOLDEN, HEADER_IN_DATA])
def test_no_single_bit_error_gives_a_sample(frame: bytes) -> None:
    """Holds for every single-bit error, as the sum changes; errors of opposite sign can cancel out."""
    for bit in range(8 * FRAME_SIZE):
        flipped = bytearray(frame)
        flipped[bit // 8] ^= 1 << bit % 8
        results = decode(bytes(flipped) + RATE_GOLDEN)
        assert [result for result in results if isinstance(result, Sample)] == list(decode(RATE_GOLDEN))
        assert isinstance(results[0], Rejection)


def test_reset_forgets_half_a_frame_and_the_attitude() -> None:
    codec = WitMotionCodec("imu", calibration=no_iron())
    decode(ANGLE_GOLDEN + ANGLE_GOLDEN[:5], codec)
    codec.reset()
    assert list(decode(encode_frame(MAGNETIC, 0, 300, -400), codec)) == [Rejection("no_attitude")]


def test_an_old_attitude_levels_no_magnetic_frame() -> None:
    codec = WitMotionCodec("imu", calibration=no_iron())
    decode(ANGLE_GOLDEN, codec)
    magnetic = encode_frame(MAGNETIC, 0, 300, -400)
    (heading,) = codec.decode(Received(7 + 500_000_000, magnetic))
    assert isinstance(heading, HeadingSample)
    assert list(codec.decode(Received(8 + 500_000_000, magnetic))) == [Rejection("no_attitude")]


@given(TILT, TILT, TURN)
def test_heading_from_magnetics_is_tilt_compensated(roll: float, pitch: float, yaw: float) -> None:
    north_and_down = (0.0, 2000.0, -4500.0)  # east, north, up; steep as in northern Europe
    field = Rotation.from_euler("ZYX", [yaw, pitch, roll]).inv().apply(north_and_down)
    codec = WitMotionCodec("imu", calibration=no_iron())
    (attitude,) = decode(encode_angle(roll, pitch, 0.123), codec)
    assert isinstance(attitude, AttitudeSample)
    (heading,) = decode(encode_frame(MAGNETIC, *np.round(field).astype(int).tolist()), codec)
    assert isinstance(heading, HeadingSample)
    assert wrap_rad(heading.heading_rad - yaw) == pytest.approx(0.0, abs=2e-3)


def test_settings_load_hard_and_soft_iron(tmp_path: Path) -> None:
    file = tmp_path / "iron.toml"
    file.write_text(
        'source = "made up"\ndate = 2026-05-04\nhard_iron_counts = [100, -50, 30]\n'
        "soft_iron = [[2.0, 0, 0], [0, 1.0, 0], [0, 0, 1.0]]\n"
    )
    settings = WitMotionSettings(port="/dev/null", calibration=str(file))
    assert settings.data_files() == {"calibration": (file,)}
    codec = settings.make_codec("imu")
    codec.decode(Received(1, encode_angle(0.0, 0.0, 0.0)))
    raw: Vector = (100 + 50, -50 + 100, 30)
    (heading,) = codec.decode(Received(1, encode_frame(MAGNETIC, *map(int, raw))))
    assert isinstance(heading, HeadingSample)
    assert heading.heading_rad == pytest.approx(math.radians(45.0))


# Frames of the Bluetooth models

COMBINED_GOLDEN = bytes.fromhex("5561 0c00 e2ff f807 0000 0000 a400 6e00 24ff 401f")
"""By the manual of the WT901BLECL: z 0.9961 g; z 10.01 deg/s; 0.604, -1.208 and 43.945 deg."""
SECOND = bytes.fromhex("5561 0c00 e2ff f807 0000 0000 0000 6e00 24ff 5055")


def combined(results: Sequence[Sample | Rejection]) -> list[float]:
    """Return z acceleration in g, yaw rate, roll, pitch and yaw in deg of the last frame."""
    acceleration, rate, attitude, heading = results[-4:]
    assert isinstance(acceleration, AccelerationSample)
    assert isinstance(rate, RateSample)
    assert isinstance(attitude, AttitudeSample)
    assert isinstance(heading, HeadingSample)
    angles_rad = (attitude.roll_rad or 0.0, attitude.pitch_rad or 0.0, heading.heading_rad)
    return [
        acceleration.z_m_s2 / 9.80665,
        math.degrees(rate.rate_z_rad_s),
        *(math.degrees(angle_rad) for angle_rad in angles_rad),
    ]


def test_golden_combined_frame() -> None:
    results = decode(COMBINED_GOLDEN + b"\x55")
    assert len(results) == 4
    assert combined(results) == pytest.approx([0.9961, 10.01, 0.604, -1.208, 43.945], abs=1e-3)


def test_reported_stream_of_a_bluetooth_model(shared_data: Path) -> None:
    data = (shared_data / "field_reports" / "serial" / "witmotion_bluetooth.bin").read_bytes()
    results = decode(data)
    assert len(results) == 4 * 99 + 4
    yaws = {combined(results[: 4 * count])[4] for count in range(1, 101)}
    assert (min(yaws), max(yaws)) == pytest.approx((43.95, 43.97), abs=6e-3)
    assert combined(results)[0] == pytest.approx(0.996, abs=1e-3)


@pytest.mark.parametrize("size", [1, 7, 20, 33])
def test_combined_frames_may_come_in_any_pieces_and_are_read_when_they_are_whole(size: int) -> None:
    codec, count = WitMotionCodec("imu"), 0
    data = 5 * COMBINED_GOLDEN
    for begin in range(0, len(data), size):
        results = decode(data[begin : begin + size], codec)
        assert not [each for each in results if isinstance(each, Rejection)]
        count += len(results) // 4
        whole = min(begin + size, len(data)) // 20
        assert count == (whole if whole > 1 or begin + size > 20 else 0)


@pytest.mark.parametrize("place", [0, 1, 2, 9, 19])
def test_a_byte_lost_from_a_combined_frame_gives_no_sample(place: int) -> None:
    damaged = COMBINED_GOLDEN[:place] + COMBINED_GOLDEN[place + 1 :]
    results = decode(COMBINED_GOLDEN + SECOND + damaged + COMBINED_GOLDEN + COMBINED_GOLDEN)
    good = [each for each in results if not isinstance(each, Rejection)]
    assert len(results) == len(good) + 1
    assert len(good) // 4 == (3 if place == 1 else 4)  # without its type it does not end the one before, too
    assert combined(good) == pytest.approx([0.9961, 10.01, 0.604, -1.208, 43.945], abs=1e-3)


def test_bytes_of_other_frames_that_look_like_a_combined_one_give_no_sample() -> None:
    look_alike = encode_frame(ANGLE, 0x6155, 0x6155, 0x6155)
    results = decode(look_alike[3:] + look_alike + ANGLE_GOLDEN + RATE_GOLDEN)
    assert [type(each) for each in results] == [
        Rejection, AttitudeSample, HeadingSample, AttitudeSample, HeadingSample, RateSample,
    ]  # fmt: skip
    assert results[0] == Rejection("framing")


def test_an_answer_of_a_bluetooth_model_is_no_measurement() -> None:
    answer = bytes.fromhex("5571 1f00 0400") + bytes(14)
    assert len(decode(COMBINED_GOLDEN + answer + COMBINED_GOLDEN)) == 8


def test_a_bluetooth_model_has_no_field_for_a_calibration() -> None:
    results = decode(COMBINED_GOLDEN + b"\x55", WitMotionCodec("imu", None, no_iron()))
    assert [type(each) for each in results] == [AccelerationSample, RateSample, AttitudeSample, Rejection]
    assert results[-1] == Rejection("no_magnetic_field")
