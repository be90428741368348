"""A gyro that sends noise without a signal, on the simulated Robotino without its yaw excitation."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.safety.missions import drive, robotino, with_fixes
from controllers.safety import Mode
from drivers.samples import RateSample, Sample
from rover_hil.config import Config

SEED = 1005


def dead(noise_rad_s: float) -> Callable[[float, Sample], Sample]:
    rng = np.random.default_rng(3)

    def falsify(_: float, sample: Sample) -> Sample:
        if isinstance(sample, RateSample):
            return replace(sample, rate_z_rad_s=noise_rad_s * float(rng.standard_normal()))
        return sample

    return falsify


@pytest.mark.slow
def test_turns_of_the_mission_show_a_dead_gyro_and_the_yaw_is_wide_enough_for_it() -> None:
    table = robotino(SEED).model_dump(by_alias=True)
    table["slip"], table["mission"]["heading"] = None, "along_path"
    driven = drive(Config.model_validate(table), dead(0.002), limit_s=60.0)
    assert driven.stops() == []
    named = next(m for m in driven.moments if "no signal, wrong axis" in m.output.suspicion)
    after = [m for m in driven.moments if m.t_s > named.t_s + 0.1]
    assert after[-1].t_s - named.t_s > 10.0
    assert max(m.nees for m in after) < 16.27


@pytest.mark.slow
def test_fixes_that_contradict_a_gyro_without_a_signal_stop_the_rover_until_it_has_one() -> None:
    table = robotino(SEED).model_dump(by_alias=True)
    table["slip"], table["mission"]["heading"] = None, "along_path"
    driven = drive(with_fixes(Config.model_validate(table), 2.0), dead(0.002), limit_s=60.0)
    assert driven.moments[-1].output.reason == (
        "imu: no signal, although the rover turned: wrong axis, or broken; the rover stays stopped until the "
        "gyro measures a turn"
    )
    assert driven.mode is Mode.SAFE_STOP
