"""Faults on virtual time: what stops the rover, when, and how it goes on."""

import math
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from controllers.control_loop import ControlLoop, StepOutput
from controllers.estimation.parameters import ESTIMATION
from controllers.motion.limits import Limit
from controllers.safety import Mode
from controllers.safety.settings import SafetySettings
from drivers.samples import (
    BumperSample,
    FaultSample,
    LinkSample,
    Sample,
    WheelSample,
)
from tests.controllers.simulated import (
    LIMITS,
    LONG_WAY,
    MS,
    PERIOD_NS,
    ROLES,
    SECOND_NS,
    long_drive,
    make_settings,
    omni_rover,
    run,
    silent,
)


def one_wheel_silent(sample: Sample) -> Sample | None:
    return None if isinstance(sample, WheelSample) and sample.wheel == 1 else sample


def frozen_stamps(sample: Sample) -> Sample | None:
    return replace(sample, t_ns=4 * SECOND_NS) if sample.device == "wheels" else sample


def nan_positions(sample: Sample) -> Sample | None:
    return replace(sample, position_rad=math.nan) if isinstance(sample, WheelSample) else sample


FAULTS = [
    pytest.param(silent("wheels"), 150, "wheels: no position of wheel 0", id="wheels silent"),
    pytest.param(one_wheel_silent, 150, "wheels: no position of wheel 1", id="one wheel silent"),
    pytest.param(nan_positions, 150, "wheels: no position of wheel 0", id="positions not finite"),
    pytest.param(frozen_stamps, 150, "wheels: no position of wheel 0", id="stamps frozen"),
    pytest.param(silent("gyro"), 150, "gyro: no yaw rate", id="gyro silent"),
    pytest.param(silent("compass"), 250, "compass: no heading", id="compass silent"),
]


@pytest.mark.parametrize(("fault", "limit_ms", "reason"), FAULTS)
def test_a_silent_device_stops_the_rover_in_the_step_its_age_is_exceeded_and_motion_resumes_without_a_jump(
    fault: Callable[[Sample], Sample | None], limit_ms: int, reason: str
) -> None:
    loop, simulated = long_drive(), omni_rover()
    assert run(loop, simulated, 4.0)[-1].mode is Mode.RUNNING
    began_ns = simulated.t_ns
    simulated.mute = fault
    faulty = run(loop, simulated, 1.0)
    first = next(output for output in faulty if output.mode is Mode.SAFE_STOP)
    # The newest honest sample is at most one sensor period older than the fault.
    sensor_ms = 50 if "compass" in reason else 10
    assert limit_ms - sensor_ms <= (first.t_ns - began_ns) / MS <= limit_ms + 20
    assert first.reason.startswith(reason)
    for output in faulty:
        is_moving = any(output.command.speed_rad_s)
        assert is_moving == (output.t_ns < first.t_ns)
    simulated.mute = lambda sample: sample
    resumed = run(loop, simulated, 3.0)
    assert_no_jump([faulty[-1], *resumed])
    moving = next(output for output in resumed if output.mode is Mode.RUNNING)
    # Half a second without a reason to stop; after a silence of the wheels also what may wait in buffers.
    assert 0.5 <= (moving.t_ns - faulty[-1].t_ns) / SECOND_NS <= 0.6 + ESTIMATION.pose.backlog_s
    assert moving.limit is Limit.ACCELERATION
    assert resumed[-1].mode is Mode.RUNNING
    assert resumed[-1].estimate.velocity_x_m_s == pytest.approx(0.2, abs=0.02)
    assert resumed[-1].odometry_rebases == 0
    assert resumed[-1].estimate.x_m == pytest.approx(simulated.place.real, abs=0.01)


def assert_no_jump(outputs: list[StepOutput]) -> None:
    allowed = LIMITS.wheel_acceleration_rad_s2 * PERIOD_NS / SECOND_NS
    for before, after in pairwise(outputs):
        for old, new in zip(before.command.speed_rad_s, after.command.speed_rad_s, strict=True):
            assert abs(new - old) <= allowed + 1e-9


INCIDENTS = [
    pytest.param(
        [LinkSample(device="compass", t_ns=0, up=False, reason="unplugged")],
        [LinkSample(device="compass", t_ns=0, up=True, reason="reopened")],
        id="link down",
    ),
    pytest.param(
        [FaultSample(device="wheels", t_ns=0, wheel=2, code=8, text="over current")],
        [FaultSample(device="wheels", t_ns=0, code=0, text="ok")],
        id="drive fault",
    ),
]


@pytest.mark.parametrize(("incident", "clearance"), INCIDENTS)
def test_links_and_faults_stop_within_the_same_step(incident: list[Sample], clearance: list[Sample]) -> None:
    loop, simulated = long_drive(), omni_rover()
    assert any(run(loop, simulated, 4.0)[-1].command.speed_rad_s)
    samples = simulated.advance(simulated.t_ns + PERIOD_NS)
    output = loop.step(simulated.t_ns, [*samples, *incident])
    assert output.mode is Mode.SAFE_STOP
    assert output.command.speed_rad_s == (0.0, 0.0, 0.0)
    simulated.set_point_rad_s = np.zeros(3)
    held = run(loop, simulated, 1.0)
    assert not any(any(output.command.speed_rad_s) for output in held)
    loop.step(simulated.t_ns, clearance)
    resumed = run(loop, simulated, 3.0)
    assert_no_jump([held[-1], *resumed])
    assert resumed[-1].mode is Mode.RUNNING


def test_a_wheel_link_that_comes_back_counting_from_zero_does_not_move_the_estimate() -> None:
    loop, simulated = long_drive(), omni_rover()
    run(loop, simulated, 4.0)
    down = LinkSample(device="wheels", t_ns=simulated.t_ns, up=False, reason="unplugged")
    before = loop.step(simulated.t_ns, [down]).estimate
    simulated.set_point_rad_s = np.zeros(3)
    simulated.advance(simulated.t_ns + SECOND_NS)
    simulated.position_rad = simulated.position_rad + np.array([2.0, 0.0, 0.0])
    loop.step(simulated.t_ns, [replace(down, up=True, t_ns=simulated.t_ns)])
    outputs = run(loop, simulated, 0.3)
    assert all(old.estimate.t_ns <= new.estimate.t_ns for old, new in pairwise(outputs))
    assert outputs[0].estimate.t_ns == before.t_ns
    after = outputs[-1]
    assert (after.estimate.x_m, after.estimate.y_m) == pytest.approx((before.x_m, before.y_m), abs=1e-3)
    assert after.odometry_rebases == 1


def test_after_a_stop_shorter_than_the_expiry_motion_resumes_from_the_measured_speed() -> None:
    safety = SafetySettings(recover_s=0.0)
    loop, simulated = ControlLoop(make_settings(mission=LONG_WAY, safety=safety), ROLES), omni_rover()
    cruising = run(loop, simulated, 4.0)[-1].command.speed_rad_s
    down = LinkSample(device="compass", t_ns=simulated.t_ns, up=False, reason="unplugged")
    loop.step(simulated.t_ns, [down])
    # The wheels are blocked.
    simulated.speed_rad_s = np.zeros(3)
    simulated.set_point_rad_s = np.zeros(3)
    run(loop, simulated, 0.1)
    loop.step(simulated.t_ns, [replace(down, up=True)])
    resumed = run(loop, simulated, 0.02)[-1]
    assert resumed.mode is Mode.RUNNING
    assert max(map(abs, resumed.command.speed_rad_s)) < 0.3 * max(cruising)


def test_a_bumper_stops_in_the_same_step_and_for_good() -> None:
    loop, simulated = long_drive(), omni_rover()
    run(loop, simulated, 4.0)
    bumper = BumperSample(device="bumper", t_ns=simulated.t_ns, pressed=True)
    output = loop.step(simulated.t_ns + 1, [bumper])
    assert (output.mode, output.command.speed_rad_s) == (Mode.EMERGENCY_STOP, (0.0, 0.0, 0.0))
    assert {output.mode for output in run(loop, simulated, 3.0)} == {Mode.EMERGENCY_STOP}


def test_a_stamp_from_the_future_neither_looks_fresh_nor_blocks_what_follows() -> None:
    loop, simulated = long_drive(), omni_rover()
    run(loop, simulated, 4.0)
    simulated.mute = lambda sample: replace(sample, t_ns=sample.t_ns + 3600 * SECOND_NS)
    run(loop, simulated, 0.1)
    simulated.mute = lambda sample: sample
    outputs = run(loop, simulated, 1.0)
    assert {output.mode for output in outputs} == {Mode.RUNNING}
    assert outputs[-1].estimate.x_m == pytest.approx(simulated.place.real, abs=0.005)
    simulated.mute = silent("wheels")
    assert run(loop, simulated, 0.2)[-1].mode is Mode.SAFE_STOP


def test_after_a_short_break_of_the_wheels_link_motion_resumes_from_standstill() -> None:
    safety = SafetySettings(recover_s=0.0)
    loop, simulated = ControlLoop(make_settings(mission=LONG_WAY, safety=safety), ROLES), omni_rover()
    run(loop, simulated, 4.0)
    down = LinkSample(device="wheels", t_ns=simulated.t_ns, up=False, reason="unplugged")
    stopped = loop.step(simulated.t_ns, [down])
    simulated.speed_rad_s = np.zeros(3)
    simulated.set_point_rad_s = np.zeros(3)
    simulated.advance(simulated.t_ns + SECOND_NS)
    loop.step(simulated.t_ns, [replace(down, up=True, t_ns=simulated.t_ns)])
    resumed = run(loop, simulated, 1.0)
    assert_no_jump([stopped, *resumed])
    assert resumed[-1].mode is Mode.RUNNING


@pytest.mark.parametrize(("fault_s", "then"), [(0.8, Mode.RUNNING), (3.0, Mode.EMERGENCY_STOP)])
def test_positions_that_jump_to_and_fro_stop_the_rover_although_they_are_fresh(
    fault_s: float, then: Mode
) -> None:
    loop, simulated = long_drive(), omni_rover()
    run(loop, simulated, 4.0)
    began_ns = simulated.t_ns

    def jumping(sample: Sample) -> Sample:
        if isinstance(sample, WheelSample) and sample.wheel == 0 and sample.t_ns // (10 * MS) % 2:
            return replace(sample, position_rad=(sample.position_rad or 0.0) + 100.0)
        return sample

    simulated.mute = jumping
    faulty = run(loop, simulated, fault_s)
    first = next(output for output in faulty if output.mode is Mode.SAFE_STOP)
    assert (first.t_ns - began_ns) / MS <= 2 * 150 + 20
    assert first.reason == "wheels: no wheel motion measured for 0.3 s"
    assert faulty[-1].mode is Mode.SAFE_STOP
    simulated.mute = lambda sample: sample
    # At 0.2 m/s, and nothing tells when the wheels stopped: after 3 s the place is too uncertain.
    assert run(loop, simulated, 1.0)[-1].mode is then


def test_positions_that_jump_from_the_start_keep_the_rover_standing() -> None:
    loop, simulated = long_drive(), omni_rover()

    def jumping(sample: Sample) -> Sample:
        if isinstance(sample, WheelSample):
            return replace(sample, position_rad=float(sample.t_ns % (20 * MS)))
        return sample

    simulated.mute = jumping
    assert {output.mode for output in run(loop, simulated, 4.0)} == {Mode.SETTLING}
