"""Stops that the closed loop must hold, on virtual time: jammed wheels, contradictions, late fixes."""

import math
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from controllers.control_loop import ControlLoop, StepOutput
from controllers.motion.settings import WaypointsMission
from controllers.roles import DeviceRoles
from controllers.safety import Mode
from controllers.safety.settings import SafetySettings
from drivers.samples import HeadingSample, LinkSample, PoseFixSample, Sample
from tests.controllers.simulated import (
    LONG_WAY,
    PERIOD_NS,
    ROLES,
    SECOND_NS,
    SimulatedRover,
    long_drive,
    make_settings,
    omni_rover,
    run,
)

RADIUS_M = 0.04
FORWARD_SHARE = math.cos(math.radians(30.0))


def drive_at(wheel_speed_rad_s: float) -> ControlLoop:
    """Return a loop that drives ahead with setpoints of plus and minus this for the two front wheels."""
    speed_m_s = wheel_speed_rad_s * RADIUS_M / FORWARD_SHARE
    mission = WaypointsMission(type="waypoints", points=((50.0, 0.0),), speed_m_s=speed_m_s)
    return ControlLoop(make_settings(mission=mission), ROLES)


def stop_times_s(outputs: list[StepOutput], since_ns: int) -> list[float]:
    """Return when the mode left RUNNING for a stop, in s since a time."""
    return [
        (after.t_ns - since_ns) / SECOND_NS
        for before, after in pairwise(outputs)
        if before.mode is Mode.RUNNING and after.mode is not Mode.RUNNING
    ]


@pytest.mark.parametrize("set_point_rad_s", [0.6, 0.8, 1.0, 1.4, 2.0, 4.0])
def test_a_jammed_wheel_is_noticed_in_about_a_second_at_any_set_point_a_drive_can_follow(
    set_point_rad_s: float,
) -> None:
    loop, rover = drive_at(set_point_rad_s), omni_rover()
    started = run(loop, rover, 2.5)
    assert {output.mode for output in started} == {Mode.SETTLING, Mode.RUNNING}
    rover.jammed = (0,)
    outputs = run(loop, rover, 3.0)
    assert 0.9 <= stop_times_s([started[-1], *outputs], started[-1].t_ns)[0] <= 1.3
    stopped = next(output for output in outputs if output.mode is Mode.SAFE_STOP)
    assert stopped.reason.startswith("wheel 0: ")
    assert stopped.command.speed_rad_s == (0.0, 0.0, 0.0)


def test_a_jammed_wheel_is_driven_three_times_and_then_no_more() -> None:
    loop, rover = long_drive(), omni_rover()
    run(loop, rover, 2.5)
    rover.jammed = (0,)
    outputs = run(loop, rover, 10.0)
    assert len(stop_times_s(outputs, 0)) == 3
    assert outputs[-1].mode is Mode.EMERGENCY_STOP
    assert "wheel 0" in outputs[-1].reason
    driven_s = sum(any(output.command.speed_rad_s) for output in outputs) * PERIOD_NS / SECOND_NS
    assert driven_s < 5.0


def test_a_link_that_breaks_whenever_the_rover_moves_stops_it_for_good() -> None:
    loop, rover = long_drive(), omni_rover()
    outputs = run(loop, rover, 2.5)
    for _ in range(250):
        samples = rover.advance(rover.t_ns + PERIOD_NS)
        is_moving = bool(np.abs(rover.speed_rad_s).max() > 2.0)
        link = LinkSample(device="gyro", t_ns=rover.t_ns, up=not is_moving, reason="shaken")
        outputs.append(loop.step(rover.t_ns, [*samples, link]))
        rover.set_point_rad_s = np.array(outputs[-1].command.speed_rad_s)
    assert len(stop_times_s(outputs, 0)) == 3
    assert outputs[-1].mode is Mode.EMERGENCY_STOP
    assert outputs[-1].reason.startswith("gyro: link down (shaken)")


def test_stops_with_enough_driving_between_them_are_not_the_same_again() -> None:
    safety = SafetySettings(settle_s=0.1, recover_s=0.1, stall_s=0.3, forget_stops_m=0.2)
    loop, rover = ControlLoop(make_settings(mission=LONG_WAY, safety=safety), ROLES), omni_rover()
    run(loop, rover, 2.0)
    for _ in range(4):
        rover.jammed = (0,)
        assert Mode.SAFE_STOP in {output.mode for output in run(loop, rover, 0.5)}
        rover.jammed = ()
        # At 0.2 m/s: more than 0.2 m.
        assert run(loop, rover, 1.8)[-1].mode is Mode.RUNNING


def wrong_compass(period_ns: int) -> Callable[[Sample], Sample | None]:
    """Return a fault: the compass is off by a quarter turn, and gives a heading every `period_ns` only."""
    newest_ns = 0

    def disturb(sample: Sample) -> Sample | None:
        nonlocal newest_ns
        if not isinstance(sample, HeadingSample):
            return sample
        if sample.t_ns - newest_ns < period_ns:
            return None
        newest_ns = sample.t_ns
        return replace(sample, heading_rad=math.remainder(sample.heading_rad + 1.5, math.tau))

    return disturb


@pytest.mark.parametrize(("period_s", "least_s", "most_s"), [(0.05, 2.0, 2.2), (1.0, 2.0, 3.2)])
def test_a_contradiction_stops_after_seconds_whatever_the_rate_of_the_sensor(
    period_s: float, least_s: float, most_s: float
) -> None:
    roles = replace(ROLES, required={**ROLES.required, "compass": 5.0})
    loop, rover = ControlLoop(make_settings(mission=LONG_WAY), roles), omni_rover()
    start = run(loop, rover, 2.5)[-1]
    rover.mute = wrong_compass(round(period_s * SECOND_NS))
    outputs = run(loop, rover, most_s + 0.2)
    assert least_s <= stop_times_s([start, *outputs], start.t_ns)[0] <= most_s
    assert outputs[-1].reason.startswith("compass magnetic: ")
    assert "contradicts the estimate" in outputs[-1].reason


def test_late_fixes_are_reported_and_never_stop_the_rover() -> None:
    roles = DeviceRoles(wheels="wheels", gyro="gyro", fixes=("overhead",), required=ROLES.required)
    roles = replace(roles, required={name: age for name, age in ROLES.required.items() if name != "compass"})
    loop, rover = ControlLoop(make_settings(mission=LONG_WAY), roles), omni_rover()
    run(loop, rover, 2.5)
    names: list[str] = []
    for _ in range(30):
        names += drive_with_a_late_fix(loop, rover)
    assert names == ["overhead too late"] * 30


def drive_with_a_late_fix(loop: ControlLoop, rover: SimulatedRover) -> list[str]:
    """Drive for 0.1 s with one fix whose picture is three seconds old; return the innovations' names."""
    fix = PoseFixSample(
        device="overhead",
        t_ns=rover.t_ns,
        x_m=1e-3 * rover.t_ns / SECOND_NS,
        y_m=0.0,
        yaw_rad=0.0,
        position_std_m=0.01,
        yaw_std_rad=0.01,
        t_capture_ns=rover.t_ns - 3 * SECOND_NS,
    )
    outputs = [loop.step(rover.t_ns, [fix]), *run(loop, rover, 0.1)]
    assert {output.mode for output in outputs} == {Mode.RUNNING}
    return [innovation.name for output in outputs for innovation in output.innovations]
