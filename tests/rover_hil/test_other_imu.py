"""An IMU with another rate or bandwidth than configured: named within seconds, never taken for slip."""

import math
from dataclasses import replace

import pytest

from benchmarks.safety.missions import ROVERS, Driven, drive
from controllers.safety import Mode
from controllers.slip.effort.excited_slip import UNKNOWN_GYRO
from controllers.slip.effort.yaw_excitation import TOO_FEW_READINGS
from drivers.samples import RateSample, Sample
from rover_hil.config import Config
from tests.cases import first_often
from tests.controllers.test_unseen_motion import GREATEST_NEES

SOON_S = 6.0
SEED = 30_100


class LowPass:
    """A sensor with a low-pass of first order, at the rate of its samples."""

    def __init__(self, bandwidth_hz: float) -> None:
        self._bandwidth_hz = bandwidth_hz
        self._t_s = self._rate_rad_s = 0.0

    def __call__(self, t_s: float, sample: Sample) -> Sample:
        if not isinstance(sample, RateSample):
            return sample
        keep = math.exp(-math.tau * self._bandwidth_hz * (t_s - self._t_s))
        self._rate_rad_s = sample.rate_z_rad_s + keep * (self._rate_rad_s - sample.rate_z_rad_s)
        self._t_s = t_s
        return replace(sample, rate_z_rad_s=self._rate_rad_s)


def config_of(rover: str, sent_hz: float, configured_hz: float | None = 50.0) -> Config:
    """Return a rover whose IMU sends at a rate, perhaps another one than configured."""
    table = ROVERS[rover](SEED).model_dump(by_alias=True)
    table["devices"]["imu"] |= {"rate_hz": configured_hz, "max_age_s": 0.2}
    table["simulation"]["devices"]["imu"] = {"type": "witmotion", "frames": ["rate"], "rate_hz": sent_hz}
    return Config.model_validate(table)


def slip_reasons(driven: Driven) -> set[str]:
    """Return why the slip was not valid while the rover travelled; empty for valid slip."""
    running = [moment.output for moment in driven.moments if moment.output.mode is Mode.RUNNING]
    return {
        "" if output.slip is None or output.slip.rover is None else output.slip.rover.reason
        for output in running[len(running) // 2 :]
    }


def greatest_nees(driven: Driven) -> float:
    """Return that of the time in which the rover travels; before, errors of micrometres count."""
    return max(moment.nees for moment in driven.moments if moment.t_s > SOON_S)


@pytest.mark.parametrize("rover", ROVERS)
@pytest.mark.parametrize("sent_hz", first_often([25.0, 100.0, 10.0]))
def test_another_rate_than_configured_stops_the_rover_and_is_named(rover: str, sent_hz: float) -> None:
    driven = drive(config_of(rover, sent_hz), limit_s=SOON_S)
    reasons = {moment.output.reason for moment in driven.moments}
    words = f"imu: sends {sent_hz:.0f} yaw rates per second, configured are 50"
    assert any(reason.startswith(words) for reason in reasons)
    assert driven.mode is not Mode.RUNNING
    running_s = [moment.t_s for moment in driven.moments if moment.output.mode is Mode.RUNNING]
    assert max(running_s, default=0.0) - min(running_s, default=0.0) < 2.0


@pytest.mark.parametrize("rover", ROVERS)
def test_the_configured_rate_stops_nothing(rover: str) -> None:
    driven = drive(config_of(rover, 100.0, 100.0), limit_s=SOON_S)
    assert driven.mode is Mode.RUNNING
    assert driven.stops() == []


@pytest.mark.parametrize("sent_hz", first_often([7.0, 5.0]))
def test_a_rate_below_that_of_the_excitation_gives_no_valid_slip(sent_hz: float) -> None:
    config = config_of("robotino", sent_hz, configured_hz=None)
    driven = drive(config, limit_s=10.0)
    assert driven.mode is Mode.RUNNING
    assert slip_reasons(driven) == {TOO_FEW_READINGS}
    assert greatest_nees(driven) < GREATEST_NEES


def test_a_low_pass_of_5_hz_that_is_not_calibrated_is_said_and_does_no_harm() -> None:
    driven = drive(config_of("robotino", 50.0), LowPass(5.0), limit_s=10.0)
    last = driven.moments[-1].output.slip
    assert last is not None
    assert last.rover is not None
    assert last.rover.unsure == UNKNOWN_GYRO
    assert greatest_nees(driven) < GREATEST_NEES


def test_a_low_pass_of_5_hz_does_no_harm_where_slip_is_not_read_from_the_gyro() -> None:
    driven = drive(config_of("el-dorado", 50.0), LowPass(5.0), limit_s=20.0)
    assert driven.mode is Mode.RUNNING
    assert greatest_nees(driven) < GREATEST_NEES
