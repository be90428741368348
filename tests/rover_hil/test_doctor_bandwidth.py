"""Bandwidth and rate of the gyro, against the yaw excitation and the configuration."""

from dataclasses import replace

import pytest

from controllers.slip.effort.gyro_response import GyroResponse
from drivers.link import Received
from drivers.samples import RateSample
from drivers.witmotion.codec import REGISTERS, WitMotionCodec, encode_frame, encode_rate
from rover_hil.config import Config, load_config
from rover_hil.doctor.devices.gyro_bandwidth import check_gyro_bandwidth, stated_bandwidth_hz
from rover_hil.doctor.devices.gyro_rate import check_gyro_rate
from rover_hil.doctor.devices.listening import Reception
from rover_hil.doctor.finding import Level
from tests.rover_hil.test_doctor_samples import reception as silent

ROBOTINO = load_config("robotino")


def reception(*payloads: bytes) -> Reception:
    arrivals = tuple(Received(index, payload) for index, payload in enumerate(payloads))
    return replace(silent(settings=ROBOTINO.devices["imu"]), device="imu", arrivals=arrivals)


def calibrated(bandwidth_hz: float) -> Config:
    assert ROBOTINO.slip is not None
    response = GyroResponse(source="by hand", identified_on="2026-01-01", bandwidth_hz=bandwidth_hz)
    return ROBOTINO.model_copy(update={"slip": ROBOTINO.slip.model_copy(update={"gyro_response": response})})


@pytest.mark.parametrize(("value", "bandwidth_hz"), [(0, 256.0), (4, 20.0), (6, 5.0), (7, None)])
def test_the_register_is_read_between_measurements(value: int, bandwidth_hz: float | None) -> None:
    answer = encode_frame(REGISTERS, value, 0, 0)
    stream = encode_rate(0.1, 0.2, 0.3) + answer + encode_rate(0.0, 0.0, 0.0)
    assert stated_bandwidth_hz(stream) == bandwidth_hz
    assert stated_bandwidth_hz(stream[:15]) is None
    assert stated_bandwidth_hz(stream.replace(answer, answer[:-1] + bytes((answer[-1] ^ 1,)))) is None


def test_the_answer_is_no_rejection() -> None:
    assert WitMotionCodec("imu").decode(Received(0, encode_frame(REGISTERS, 4, 0, 0))) == []


@pytest.mark.parametrize(
    ("config", "value", "level", "word"),
    [
        (ROBOTINO, 5, Level.WARNING, "calibrate imu"),
        (ROBOTINO, 4, Level.OK, ""),
        (calibrated(18.0), 4, Level.OK, ""),
        (calibrated(200.0), 4, Level.WARNING, "again"),
    ],
)
def test_a_low_pass_that_slip_would_be_read_through_is_named(
    config: Config, value: int, level: Level, word: str
) -> None:
    (finding,) = check_gyro_bandwidth(reception(encode_frame(REGISTERS, value, 0, 0)), config)
    assert finding.level is level
    assert word in finding.fix


def test_without_an_answer_or_the_yaw_probe_nothing_is_wrong() -> None:
    (finding,) = check_gyro_bandwidth(reception(encode_rate(0.0, 0.0, 0.0)), ROBOTINO)
    assert finding.level is Level.OK
    assert check_gyro_bandwidth(reception(), ROBOTINO.model_copy(update={"slip": None})) == []


@pytest.mark.parametrize(("period_s", "is_named"), [(0.02, False), (0.03, False), (0.04, True), (0.01, True)])
def test_a_gyro_with_another_rate_than_configured_is_named(period_s: float, is_named: bool) -> None:
    times_ns = [round(1e9 * period_s * index) for index in range(round(2.0 / period_s))]
    samples = [RateSample(device="imu", t_ns=t_ns, rate_z_rad_s=0.0) for t_ns in times_ns]
    received = replace(reception(), samples=tuple(samples), start_ns=0, end_ns=2_000_000_000)
    found = check_gyro_rate(received, ROBOTINO)
    assert [finding.what for finding in found] == (
        [f"yaw rate: {1.0 / period_s:.1f} Hz, configured are 50 Hz"] if is_named else []
    )


def test_a_burst_from_a_buffer_has_no_rate() -> None:
    samples = tuple(RateSample(device="imu", t_ns=index, rate_z_rad_s=0.0) for index in range(500))
    received = replace(reception(), samples=samples, start_ns=-2_000_000_000, end_ns=1000)
    assert check_gyro_rate(received, ROBOTINO) == []
    assert check_gyro_rate(replace(received, samples=()), ROBOTINO) == []
