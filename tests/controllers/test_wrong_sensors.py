"""Gyros and encoders that are wrong while they look fresh, in the closed loop: noticed in time."""

import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from controllers.control_loop import ControlLoop, StepOutput
from controllers.motion.settings import WaypointsMission
from controllers.safety import Mode
from drivers.samples import RateSample, Sample, WheelSample
from tests.controllers.simulated import (
    LONG_WAY,
    MS,
    SECOND_NS,
    START_NS,
    Noise,
    SimulatedRover,
    long_drive,
    make_settings,
    omni_rover,
    run,
)
from tests.controllers.test_unseen_motion import GREATEST_NEES, NO_COMPASS, nees
from tests.controllers.wrong_encoders import WrongEncoders

ZIGZAG = WaypointsMission(
    type="waypoints",
    points=tuple((0.12 * i, 0.06 * (i % 2)) for i in range(1, 80)),
    speed_m_s=0.2,
    heading="along_path",
)
"""Turns all the time, so that sign and axis of the gyro can be seen."""

CHANGES: dict[str, Callable[[float], float]] = {
    "offset": lambda rate_rad_s: rate_rad_s + 0.5,
    "other offset": lambda rate_rad_s: rate_rad_s - 0.5,
    "zero": lambda _: 0.0,
    "stuck": lambda _: 0.0123,
    "30 rad/s": lambda _: 30.0,
    "wrong sign": lambda rate_rad_s: -rate_rad_s,
}


def change_gyro(change: Callable[[float], float]) -> Callable[[Sample], Sample]:
    """Return a fault of the gyro."""

    def disturb(sample: Sample) -> Sample:
        if isinstance(sample, RateSample):
            return replace(sample, rate_z_rad_s=change(sample.rate_z_rad_s))
        return sample

    return disturb


def first_stop(outputs: list[StepOutput]) -> StepOutput:
    """Return the first cycle in which the rover may not move."""
    return next(output for output in outputs if output.mode is not Mode.RUNNING)


def start(mission: WaypointsMission, seed: int) -> tuple[ControlLoop, SimulatedRover, int]:
    """Drive for a few seconds; return the time."""
    loop, rover = ControlLoop(make_settings(mission=mission), NO_COMPASS), omni_rover(seed)
    assert run(loop, rover, 4.0)[-1].mode is Mode.RUNNING
    return loop, rover, rover.t_ns


@pytest.mark.parametrize("change", CHANGES)
def test_a_wrong_gyro_is_named_within_the_bar(change: str) -> None:
    for seed in range(3):
        loop, rover, begin_ns = start(ZIGZAG, seed)
        rover.mute = change_gyro(CHANGES[change])
        outputs = run(loop, rover, 6.0)
        stop = first_stop(outputs)
        assert (stop.t_ns - begin_ns) / SECOND_NS <= 1.5
        assert stop.reason.startswith("gyro: yaw rate ")
        assert outputs[-1].mode in (Mode.SAFE_STOP, Mode.EMERGENCY_STOP)
        assert nees(rover, outputs[-1]) < GREATEST_NEES


@pytest.mark.parametrize("seed", range(3))
def test_a_gyro_without_a_signal_is_named_and_the_run_goes_on_with_a_yaw_wide_enough_for_both(
    seed: int,
) -> None:
    loop, rover = ControlLoop(make_settings(mission=ZIGZAG), NO_COMPASS), omni_rover(seed)
    rover.mute = change_gyro(lambda rate_rad_s: 0.01 * (rate_rad_s % 1.0))
    outputs = run(loop, rover, 8.0)
    named = next(output for output in outputs if output.suspicion)
    assert named.t_ns / SECOND_NS <= 3.5
    before = outputs[outputs.index(named) - 3].estimate.covariance[5]
    assert before > 0.01**2  # signs widen it before they are a reason
    assert re.match(r"gyro: (yaw rate follows|measures) ", named.suspicion)
    assert named.suspicion.endswith("; the yaw is uncertain by both, yaw unwatched")
    assert {output.mode for output in outputs} == {Mode.SETTLING, Mode.RUNNING}
    assert nees(rover, outputs[-1]) < GREATEST_NEES


def test_a_gyro_that_repeats_one_reading_is_named_among_wrong_time_stamps_too() -> None:
    loop, rover, begin_ns = start(LONG_WAY, seed=1)
    generator = np.random.default_rng(1)

    def disturb(sample: Sample) -> Sample:
        if isinstance(sample, WheelSample):
            return replace(sample, t_ns=sample.t_ns - round(5 * MS * abs(generator.normal())))
        return replace(sample, rate_z_rad_s=0.0123) if isinstance(sample, RateSample) else sample

    rover.mute = disturb
    stop = first_stop(run(loop, rover, 1.5))
    assert stop.reason == "gyro: yaw rate stuck at 0.0123 rad/s for 1 s while the wheels turned"
    assert (stop.t_ns - begin_ns) / SECOND_NS <= 1.1


@pytest.mark.parametrize("wheels", [None, (0,), (2,)])
@pytest.mark.parametrize("speed_m_s", [0.03, 0.2])
def test_reversed_encoders_are_named_within_the_bar(wheels: tuple[int, ...] | None, speed_m_s: float) -> None:
    # 0.03 m/s are 0.65 rad/s of 12: 5 % of the limit.
    loop, rover, begin_ns = start(LONG_WAY.model_copy(update={"speed_m_s": speed_m_s}), seed=1)
    place = rover.place
    rover.mute = WrongEncoders(-1.0, wheels)
    stop = first_stop(run(loop, rover, 0.7))
    assert stop.mode is Mode.SAFE_STOP
    assert (stop.t_ns - begin_ns) / SECOND_NS <= 0.7
    assert "turns against its setpoint for 0.5 s" in stop.reason
    assert abs(rover.place - place) <= 0.15
    last = run(loop, rover, 0.2)[-1]
    assert nees(rover, last) < GREATEST_NEES


def test_stuck_encoders_are_not_taken_for_rest() -> None:
    loop, rover, _ = start(LONG_WAY, seed=2)
    rover.mute = WrongEncoders(0.0)
    outputs = run(loop, rover, 1.4)
    assert first_stop(outputs).reason.startswith("wheel ")
    assert "gyro standstill" not in {
        innovation.name
        for output in outputs
        if output.mode is Mode.RUNNING
        for innovation in output.innovations
    }
    assert nees(rover, outputs[-1]) < GREATEST_NEES


def test_a_gyro_that_is_off_at_rest_keeps_the_rover_stopped() -> None:
    loop, rover, _ = start(LONG_WAY, seed=0)
    rover.mute = change_gyro(CHANGES["offset"])
    outputs = run(loop, rover, 1.2)
    assert outputs[-1].mode in (Mode.SAFE_STOP, Mode.EMERGENCY_STOP)
    loop, rover = long_drive(), omni_rover()
    rover.mute = change_gyro(CHANGES["offset"])
    outputs = run(loop, rover, 4.0)
    assert {output.mode for output in outputs} == {Mode.SETTLING}
    assert outputs[-1].reason.startswith("gyro: reads 0.5")


def test_a_step_of_the_bias_is_named_at_the_next_rest_and_the_yaw_becomes_uncertain() -> None:
    short = WaypointsMission(type="waypoints", points=((3.0, 0.0),), speed_m_s=0.2)
    loop = ControlLoop(make_settings(mission=short), NO_COMPASS)
    rover = omni_rover(noise=Noise(gyro_rad_s=0.002, gyro_bias_rad_s=0.01))
    run(loop, rover, 5.0)
    rover.mute = change_gyro(lambda rate_rad_s: rate_rad_s + 0.0087)
    driven = run(loop, rover, 5.0)
    assert driven[-1].mode is Mode.RUNNING
    # A pause of the process stops the rover; at rest the step shows.
    rover.mute = lambda sample: None
    run(loop, rover, 1.0)
    rover.mute = change_gyro(lambda rate_rad_s: rate_rad_s + 0.0087)
    outputs = run(loop, rover, 1.5)
    reasons = {output.reason for output in outputs}
    assert any("gyro: bias changed by 0.00" in reason for reason in reasons)
    before, after = driven[-1].estimate.covariance[5], outputs[-1].estimate.covariance[5]
    driven_s = (rover.t_ns - START_NS) / SECOND_NS
    assert 0.01 < (after - before) ** 0.5 < 0.0087 * driven_s
    assert nees(rover, outputs[-1]) < GREATEST_NEES
