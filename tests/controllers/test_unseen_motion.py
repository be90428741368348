"""Motion that no device measured widens the estimate, and too much of it keeps the rover stopped."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from controllers.control_loop import ControlLoop, StepOutput
from controllers.estimation.ground_settings import GroundSettings
from controllers.motion.settings import WaypointsMission
from controllers.roles import DeviceRoles
from controllers.safety import Mode
from controllers.safety.settings import SafetySettings
from drivers.samples import LinkSample, PoseFixSample, Sample
from tests.cases import first_often
from tests.controllers.simulated import (
    LONG_WAY,
    PERIOD_NS,
    ROLES,
    SECOND_NS,
    Noise,
    SimulatedRover,
    make_settings,
    omni_rover,
    run,
)

GREATEST_NEES = 16.27
"""The 99.9 % bound of chi-square with three degrees of freedom."""

NO_COMPASS = replace(ROLES, headings=(), required={"wheels": 0.15, "gyro": 0.15})
TO_AND_FRO = WaypointsMission(
    type="waypoints", points=((0.5, 0.0), (0.5, 0.6), (0.0, 0.6)), speed_m_s=0.2, heading="along_path"
)

NO_SLIP = GroundSettings(slip_sd=0.0, cross_slip_sd=0.0, local_slip_sd=0.0)
"""So that only what was not measured makes the position less certain."""


def nees(rover: SimulatedRover, output: StepOutput) -> float:
    """Normalised estimation error squared of the pose, 3 on average."""
    xx, xy, xt, yy, yt, tt = output.estimate.covariance
    covariance = np.array([[xx, xy, xt], [xy, yy, yt], [xt, yt, tt]]) + 1e-12 * np.eye(3)
    estimate = output.estimate
    turned_rad = np.angle(np.exp(1j * (estimate.yaw_rad - rover.yaw_rad)))
    error = np.array([estimate.x_m - rover.place.real, estimate.y_m - rover.place.imag, turned_rad])
    return float(error @ np.linalg.solve(covariance, error))


def pause(rover: SimulatedRover, duration_s: float) -> None:
    """Let the process stop: the rover goes on, and what its devices send is lost."""
    rover.advance(rover.t_ns + round(duration_s * SECOND_NS))


def break_link(loop: ControlLoop, rover: SimulatedRover, duration_s: float) -> list[StepOutput]:
    """Break the link of the wheels: the drive keeps its setpoints, and counts from zero afterwards."""
    outputs: list[StepOutput] = []
    down = LinkSample(device="wheels", t_ns=rover.t_ns, up=False, reason="unplugged")
    samples: list[Sample] = [down]
    for _ in range(round(duration_s * SECOND_NS / PERIOD_NS)):
        heard = [s for s in rover.advance(rover.t_ns + PERIOD_NS) if s.device != "wheels"]
        outputs.append(loop.step(rover.t_ns, [*samples, *heard]))
        samples = []
    rover.position_rad = np.zeros(3)
    rover.set_point_rad_s = np.array(outputs[-1].command.speed_rad_s)
    outputs.append(loop.step(rover.t_ns, [replace(down, up=True, t_ns=rover.t_ns)]))
    return outputs


def test_a_turn_while_the_process_was_stopped_is_that_of_the_wheels() -> None:
    loop = ControlLoop(make_settings(), DeviceRoles(wheels="wheels", gyro="gyro", required={}))
    rover = omni_rover(noise=Noise())
    rover.set_point_rad_s = rover.geometry.wheel_speeds(0j, 0.5)
    for _ in range(3):
        for _ in range(40):
            output = loop.step(rover.t_ns, rover.advance(rover.t_ns + PERIOD_NS))
        pause(rover, 0.4)
    assert output.estimate.yaw_rad == pytest.approx(rover.yaw_rad - 0.2, abs=0.01)


@pytest.mark.parametrize("paused_s", first_often([0.3, 0.6, 1.0]))
def test_after_a_pause_of_the_process_the_covariance_holds_the_error(paused_s: float) -> None:
    for seed in range(6):
        rover = omni_rover(seed)
        loop = ControlLoop(make_settings(mission=TO_AND_FRO), NO_COMPASS)
        # Into the turn at the first corner, a little further each time.
        run(loop, rover, 4.4 + 0.2 * seed)
        pause(rover, paused_s)
        outputs = run(loop, rover, 1.0)
        # In half a second the wheels go so far that they alone do not give the yaw.
        assert outputs[-1].mode is Mode.RUNNING or (paused_s > 0.5 and "yaw uncertain" in outputs[-1].reason)
        assert nees(rover, outputs[-1]) < GREATEST_NEES


@pytest.mark.parametrize("slipping", [0, 2])
def test_after_a_pause_on_a_straight_line_the_covariance_holds_the_slip_of_one_wheel(slipping: int) -> None:
    rover = omni_rover(noise=Noise())
    loop = ControlLoop(make_settings(mission=LONG_WAY), NO_COMPASS)
    run(loop, rover, 2.0)
    # The gyro sees nothing of this second, and the wheels add up to almost no turn.
    rover.slip = np.where(np.arange(3) == slipping, 0.5, 0.0)
    pause(rover, 1.0)
    rover.slip = 0.0
    outputs = run(loop, rover, 1.0)
    assert abs(outputs[-1].estimate.yaw_rad - rover.yaw_rad) > 0.05
    assert nees(rover, outputs[-1]) < GREATEST_NEES


def buffered(rover: SimulatedRover, duration_s: float, held_s: float) -> list[Sample]:
    """Let the process stop: of what the devices send `held_s` wait in buffers, stamped when they are read."""
    held = rover.advance(rover.t_ns + round(held_s * SECOND_NS))
    rover.advance(rover.t_ns + round((duration_s - held_s) * SECOND_NS))
    step_ns = SECOND_NS // 200 // max(1, len(held))
    first_ns = rover.t_ns - step_ns * len(held)
    return [replace(sample, t_ns=first_ns + step_ns * number) for number, sample in enumerate(held)]


@pytest.mark.parametrize(
    ("paused_s", "held_s"),
    first_often([(0.28, 0.28), (0.2, 0.2), (0.4, 0.4), (1.0, 1.0), (1.0, 0.5), (3.0, 1.5)]),
)
def test_what_waited_in_buffers_during_a_pause_does_not_turn_the_rover(
    paused_s: float, held_s: float
) -> None:
    for seed in range(6):
        rover = omni_rover(seed)
        loop = ControlLoop(make_settings(mission=TO_AND_FRO), NO_COMPASS)
        run(loop, rover, 4.4 + 0.2 * seed)
        late = buffered(rover, paused_s, held_s)
        outputs = [loop.step(rover.t_ns, late)]
        # A little more of it arrives with the next cycles, before what is new.
        for _ in range(3):
            fresh = rover.advance(rover.t_ns + PERIOD_NS)
            outputs.append(loop.step(rover.t_ns, [replace(late[-1], t_ns=rover.t_ns - PERIOD_NS), *fresh]))
        assert paused_s < 0.3 or outputs[-1].mode is not Mode.RUNNING
        outputs = run(loop, rover, 1.0)
        assert outputs[-1].mode is Mode.RUNNING or "uncertain" in outputs[-1].reason
        assert nees(rover, outputs[-1]) < GREATEST_NEES


@pytest.mark.parametrize("silent_s", first_often([0.5, 1.0]))
def test_what_devices_send_at_once_after_a_silence_does_not_turn_the_rover(silent_s: float) -> None:
    for seed in range(6):
        rover = omni_rover(seed)
        loop = ControlLoop(make_settings(mission=TO_AND_FRO), NO_COMPASS)
        run(loop, rover, 4.4 + 0.2 * seed)
        held: list[Sample] = []
        for _ in range(round(silent_s * SECOND_NS / PERIOD_NS)):
            held += rover.advance(rover.t_ns + PERIOD_NS)
            loop.step(rover.t_ns, [])
        step_ns = SECOND_NS // 200 // len(held)
        late = [replace(one, t_ns=rover.t_ns - step_ns * (len(held) - i)) for i, one in enumerate(held)]
        fresh = rover.advance(rover.t_ns + PERIOD_NS)
        loop.step(rover.t_ns, [*late, *fresh])
        outputs = run(loop, rover, 1.5)
        assert outputs[-1].mode is Mode.RUNNING or "uncertain" in outputs[-1].reason
        assert nees(rover, outputs[-1]) < GREATEST_NEES


@pytest.mark.parametrize("broken_s", first_often([0.5, 0.2, 1.0]))
def test_after_a_break_of_the_wheels_link_the_covariance_holds_the_error(broken_s: float) -> None:
    for seed in range(6):
        rover = omni_rover(seed)
        loop = ControlLoop(make_settings(mission=TO_AND_FRO, ground=NO_SLIP), NO_COMPASS)
        run(loop, rover, 3.4 + 0.4 * seed)
        before = break_link(loop, rover, broken_s)[0]
        outputs = run(loop, rover, 1.0)
        assert outputs[-1].mode is Mode.RUNNING
        assert nees(rover, outputs[-1]) < GREATEST_NEES
        # Not wider than the motion requires: 0.2 m/s, none to all of the time.
        assert outputs[-1].estimate.covariance[0] - before.estimate.covariance[0] < (0.2 * broken_s) ** 2


def test_a_break_at_rest_adds_nothing() -> None:
    rover = omni_rover()
    loop = ControlLoop(make_settings(mission=LONG_WAY), NO_COMPASS)
    before = run(loop, rover, 0.5)[-1]
    break_link(loop, rover, 3.0)
    after = run(loop, rover, 0.3)[-1]
    assert after.estimate.covariance[0] == pytest.approx(before.estimate.covariance[0], abs=1e-9)


def test_after_too_much_unseen_motion_the_run_ends_where_no_device_can_find_the_rover() -> None:
    rover = omni_rover()
    loop = ControlLoop(make_settings(mission=LONG_WAY), ROLES)
    run(loop, rover, 4.0)
    break_link(loop, rover, 2.0)
    last = run(loop, rover, 1.0)[-1]
    assert last.mode is Mode.EMERGENCY_STOP
    seen, uncertain = last.reason.split("; ")
    assert seen == "wheels: no wheel motion measured for 0.3 s"
    assert uncertain.startswith("pose filter: position uncertain by 0.24 m, ")
    assert nees(rover, last) < GREATEST_NEES


def test_the_user_may_allow_more() -> None:
    rover = omni_rover()
    safety = SafetySettings(unseen_position_m=1.0)
    loop = ControlLoop(make_settings(mission=LONG_WAY, safety=safety), ROLES)
    run(loop, rover, 4.0)
    break_link(loop, rover, 2.0)
    assert run(loop, rover, 1.0)[-1].mode is Mode.RUNNING


def test_after_too_much_unseen_motion_a_fix_lets_the_rover_go_on() -> None:
    rover = omni_rover()
    roles = replace(NO_COMPASS, fixes=("overhead",))
    loop = ControlLoop(make_settings(mission=LONG_WAY), roles)
    outputs = run(loop, rover, 0.6)
    loop.step(rover.t_ns, [fix_of(rover)])
    outputs = run(loop, rover, 3.4)
    break_link(loop, rover, 2.0)
    outputs = run(loop, rover, 3.0)
    assert outputs[-1].mode is Mode.SAFE_STOP
    assert (
        outputs[-1].reason
        == "pose filter: position uncertain by 0.24 m, motion was not measured: needs a fix"
    )
    assert not any(any(output.command.speed_rad_s) for output in outputs)
    loop.step(rover.t_ns, [fix_of(rover)])
    outputs = run(loop, rover, 1.0)
    assert outputs[-1].mode is Mode.RUNNING
    assert abs(outputs[-1].estimate.x_m - rover.place.real) < 0.03
    times_ns = [output.t_ns for output in outputs if output.mode is Mode.SAFE_STOP]
    assert 0.4 <= (times_ns[-1] - times_ns[0]) / SECOND_NS <= 0.6
    assert all(old.estimate.t_ns <= new.estimate.t_ns for old, new in pairwise(outputs))


def fix_of(rover: SimulatedRover) -> PoseFixSample:
    return PoseFixSample(
        device="overhead",
        t_ns=rover.t_ns,
        x_m=rover.place.real,
        y_m=rover.place.imag,
        yaw_rad=rover.yaw_rad,
        position_std_m=0.01,
        yaw_std_rad=0.01,
        t_capture_ns=rover.t_ns,
    )
