"""The bandwidth that a WitMotion sensor states, against the yaw excitation."""

from dataclasses import replace

import pytest

from controllers.slip.effort.gyro_response import GyroResponse
from drivers.link import Received
from drivers.witmotion.codec import REGISTERS, WitMotionCodec, encode_frame, encode_rate
from rover_hil.config import Config, load_config
from rover_hil.doctor.finding import Level
from rover_hil.doctor.gyro_bandwidth import check_gyro_bandwidth, stated_bandwidth_hz
from rover_hil.doctor.listening import Reception
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
        (ROBOTINO, 4, Level.WARNING, "calibrate imu"),
        (ROBOTINO, 2, Level.OK, ""),
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
