"""Estimation in the whole step: gyro pauses, standstill, late and lagging headings."""

import math
from dataclasses import replace

import pytest

from controllers.control_loop import ControlLoop, StepOutput
from controllers.estimation.filter.guarded_filter import Innovation
from controllers.estimation.ground_settings import GroundSettings
from controllers.estimation.pose_estimate import YawSource
from controllers.estimation.settings import FilterSettings
from controllers.roles import DeviceRoles
from controllers.safety import Mode
from drivers.samples import (
    HeadingReference,
    HeadingSample,
    RateSample,
    Sample,
    WheelSample,
)
from tests.controllers.simulated import (
    HONEST,
    LONG_WAY,
    MS,
    PERIOD_NS,
    ROLES,
    SECOND_NS,
    START_NS,
    Noise,
    SimulatedRover,
    long_drive,
    make_settings,
    omni_rover,
    run,
    silent,
)


def test_slip_shortens_the_true_path_and_the_filter_says_how_unsure_it_is() -> None:
    no_slip = GroundSettings(slip_sd=0.0, cross_slip_sd=0.0, local_slip_sd=0.0)
    loop = ControlLoop(make_settings(mission=LONG_WAY, ground=no_slip), ROLES)
    simulated = omni_rover()
    simulated.slip = 0.1
    last = run(loop, simulated, 11.0)[-1]
    assert last.odometry.x_m == pytest.approx(simulated.place.real / 0.9, rel=0.01)
    assert last.estimate.covariance[0] == pytest.approx(0.05**2 * last.odometry.x_m, rel=0.05)


def test_without_a_mission_it_only_observes() -> None:
    loop = ControlLoop(make_settings(), DeviceRoles(wheels="wheels", gyro="gyro", required={}))
    simulated = omni_rover()
    simulated.mute = silent("compass")
    simulated.set_point_rad_s = simulated.geometry.wheel_speeds(0.2 + 0.1j, 0.2)
    for _ in range(200):
        samples = simulated.advance(simulated.t_ns + PERIOD_NS)
        output = loop.step(simulated.t_ns, samples)
        assert output.mode is Mode.OBSERVING
        assert (output.command.speed_rad_s, output.cross_track_m) == ((0.0, 0.0, 0.0), None)
    # The rover never stood, so the gyro's bias of 0.02 rad/s is unknown and turns the estimate.
    assert output.estimate.yaw_rad == pytest.approx(simulated.yaw_rad + 0.08, abs=0.01)
    assert abs(complex(output.odometry.x_m, output.odometry.y_m) - simulated.place) < 0.005


@pytest.mark.parametrize("gyro_gap_s", [0.1, 0.7])
def test_when_the_gyro_pauses_no_turn_is_lost_or_counted_twice(gyro_gap_s: float) -> None:
    loop = ControlLoop(make_settings(), DeviceRoles(wheels="wheels", gyro="gyro", required={}))
    simulated = omni_rover(noise=Noise())
    turning = simulated.geometry.wheel_speeds(0j, 0.5)

    def observe(duration_s: float) -> StepOutput:
        for _ in range(round(duration_s / 0.02)):
            simulated.set_point_rad_s = turning
            samples = simulated.advance(simulated.t_ns + PERIOD_NS)
            output = loop.step(simulated.t_ns, samples)
        return output

    assert observe(1.0).estimate.yaw_source is YawSource.GYRO
    simulated.mute = silent("gyro")
    during = observe(gyro_gap_s)
    simulated.mute = lambda sample: sample
    after = observe(1.0)
    assert during.estimate.yaw_source is (YawSource.GYRO if gyro_gap_s < 0.15 else YawSource.WHEELS)
    assert after.estimate.yaw_source is YawSource.GYRO
    # One gyro period and one wheel period of turning at each end of the gap.
    assert after.estimate.yaw_rad == pytest.approx(simulated.yaw_rad, abs=0.5 * 0.02)


def observe_turning(
    lost: type[Sample], lost_s: float, turn_rad_s: float = 0.5
) -> tuple[StepOutput, SimulatedRover]:
    """Return the last cycle of a turn ahead; one kind of sample was lost in its last part."""
    loop = ControlLoop(make_settings(), DeviceRoles(wheels="wheels", gyro="gyro", required={}))
    simulated = omni_rover(noise=Noise())
    for cycle in range(50 + round(lost_s / 0.02)):
        if cycle == 50:
            simulated.mute = lambda sample: None if isinstance(sample, lost) else sample
        simulated.set_point_rad_s = simulated.geometry.wheel_speeds(0.2 + 0j, turn_rad_s)
        output = loop.step(simulated.t_ns, simulated.advance(simulated.t_ns + PERIOD_NS))
    return output, simulated


@pytest.mark.parametrize("lost", [WheelSample, RateSample])
def test_the_yaw_goes_on_with_the_gyro_while_wheels_are_lost_and_the_other_way_round(
    lost: type[Sample],
) -> None:
    output, simulated = observe_turning(lost, 0.1)
    assert output.estimate.yaw_source is YawSource.GYRO
    assert output.estimate.yaw_rad == pytest.approx(simulated.yaw_rad, abs=0.5 * 0.025)


def test_on_a_straight_line_too_the_yaw_is_uncertain_by_uneven_slip_while_the_gyro_is_lost() -> None:
    variances = [
        observe_turning(RateSample, lost_s, turn_rad_s=0.0)[0].estimate.covariance[5] for lost_s in (0.0, 0.1)
    ]
    # Two wheels at 30 deg to the line turn the rover by cos(30 deg) v / (3 r) each, one to either side.
    both_ways_rad = math.sqrt(2.0) * math.cos(math.pi / 6) * 0.2 * 0.1 / (3 * 0.125)
    assert math.sqrt(variances[1] - variances[0]) == pytest.approx(
        0.3 * both_ways_rad / math.sqrt(3.0), rel=0.2
    )


def test_the_covariance_contains_the_travel_since_the_last_positions() -> None:
    before, _ = observe_turning(WheelSample, 0.0)
    output, simulated = observe_turning(WheelSample, 0.1)
    estimate = output.estimate
    unseen_m = abs(complex(estimate.x_m, estimate.y_m) - simulated.place)
    added_m2 = sum(estimate.covariance[index] - before.estimate.covariance[index] for index in (0, 3))
    assert unseen_m == pytest.approx(0.02, rel=0.35)
    assert math.sqrt(added_m2) == pytest.approx(unseen_m, rel=0.35)


def test_a_gyro_that_is_slow_but_within_its_age_limit_turns_the_estimate() -> None:
    loop = ControlLoop(make_settings(), DeviceRoles(wheels="wheels", gyro="gyro", required={"gyro": 0.25}))
    simulated = omni_rover(noise=Noise())
    simulated.mute = lambda sample: (
        None if isinstance(sample, RateSample) and sample.t_ns % (200 * MS) else sample
    )
    for _ in range(100):
        simulated.set_point_rad_s = simulated.geometry.wheel_speeds(0j, 0.5)
        samples = simulated.advance(simulated.t_ns + PERIOD_NS)
        output = loop.step(simulated.t_ns, samples)
        if simulated.t_ns - START_NS > SECOND_NS:
            assert output.estimate.yaw_source is YawSource.GYRO
    assert output.estimate.yaw_rad == pytest.approx(simulated.yaw_rad, abs=0.5 * 0.22)


def test_at_standstill_the_yaw_is_held_and_the_bias_learnt() -> None:
    simulated = omni_rover(noise=replace(HONEST, gyro_rad_s=0.05))
    noise = FilterSettings(gyro_rate_noise_rad_s=0.05)
    outputs = run(ControlLoop(make_settings(filter_settings=noise), ROLES), simulated, 10.0)
    settled = [output.estimate for output in outputs if output.t_ns - START_NS >= 0.4 * SECOND_NS]
    assert {estimate.yaw_source for estimate in settled} == {YawSource.WHEELS}
    # Only the headings still move it, and hardly.
    assert max(abs(estimate.yaw_rad - settled[0].yaw_rad) for estimate in settled) < 0.01
    assert settled[-1].gyro_bias_rad_s == pytest.approx(0.02, abs=0.004)
    names = {item.name for output in outputs for item in output.innovations}
    assert names == {"compass magnetic", "gyro standstill"}


def test_the_bias_is_not_learnt_while_turning_and_is_taken_off_the_yaw_rate() -> None:
    loop, simulated = ControlLoop(make_settings(), ROLES), omni_rover()
    run(loop, simulated, 3.0)
    for i in range(100):
        simulated.set_point_rad_s = simulated.geometry.wheel_speeds(0j, 0.4)
        samples = simulated.advance(simulated.t_ns + PERIOD_NS)
        output = loop.step(simulated.t_ns, samples)
        assert i == 0 or "gyro standstill" not in {item.name for item in output.innovations}
    rates = RateSample(device="gyro", t_ns=simulated.t_ns + MS, rate_z_rad_s=0.42)
    estimate = loop.step(simulated.t_ns + MS, [rates]).estimate
    assert estimate.yaw_rate_rad_s == pytest.approx(0.4, abs=0.003)


def test_a_heading_that_comes_late_is_compared_with_the_yaw_of_its_time() -> None:
    loop, simulated = ControlLoop(make_settings(), replace(ROLES, required={})), omni_rover(noise=Noise())
    run(loop, simulated, 2.0)
    waiting: list[Sample] = []
    late: list[Sample] = []
    innovations: list[Innovation] = []
    for _ in range(100):
        simulated.set_point_rad_s = simulated.geometry.wheel_speeds(0j, 0.4)
        samples = simulated.advance(simulated.t_ns + PERIOD_NS)
        waiting += [sample for sample in samples if sample.device == "compass"]
        late = [sample for sample in waiting if simulated.t_ns - sample.t_ns >= 300 * MS]
        waiting = waiting[len(late) :]
        punctual = [sample for sample in samples if sample.device != "compass"]
        innovations += loop.step(simulated.t_ns, [*punctual, *late]).innovations
    residuals = [item.residual or 0.0 for item in innovations if item.name == "compass magnetic"]
    assert len(residuals) > 30
    # Unless its age is allowed for, each is 0.4 rad/s * 0.3 s = 0.12 rad behind.
    assert max(map(abs, residuals[-15:])) < 0.01


def test_a_heading_is_used_once() -> None:
    loop, rover = ControlLoop(make_settings(), ROLES), omni_rover(noise=Noise())
    names: list[str] = []
    for cycle in range(6):
        punctual = [
            sample
            for sample in rover.advance(rover.t_ns + PERIOD_NS)
            if not isinstance(sample, HeadingSample)
        ]
        heading = HeadingSample(
            device="compass", t_ns=rover.t_ns, heading_rad=1.0, reference=HeadingReference.MAGNETIC
        )
        if cycle == 2:
            first, older = heading, replace(heading, t_ns=rover.t_ns - MS)
            punctual += [first, first, older, replace(heading, device="other")]
        elif cycle == 3:
            punctual.append(first)
        names += [item.name for item in loop.step(rover.t_ns, punctual).innovations]
    assert names.count("compass magnetic") == 1
    assert not any("other" in name for name in names)


def test_a_lagging_compass_is_compared_with_the_past() -> None:
    residuals = []
    for lag_s in (0.0, 0.4):
        loop = ControlLoop(
            make_settings(filter_settings=FilterSettings(heading_lag_s=lag_s)),
            replace(ROLES, required={}),
        )
        rover = omni_rover(noise=Noise())
        history: list[float] = []

        def lag(sample: Sample, rover: SimulatedRover = rover, history: list[float] = history) -> Sample:
            if not isinstance(sample, HeadingSample):
                return sample
            history.append(rover.yaw_rad)
            past = history[max(0, len(history) - 9)]
            return replace(sample, heading_rad=math.remainder(past + 1.0, math.tau))

        rover.mute = lag
        for i in range(150):
            rover.set_point_rad_s = rover.geometry.wheel_speeds(0j, 0.3 if i > 50 else 0.0)
            samples = rover.advance(rover.t_ns + PERIOD_NS)
            output = loop.step(rover.t_ns, samples)
            residuals += [(lag_s, item.residual) for item in output.innovations if item.name[0] == "c"]
    assert max(abs(residual or 0.0) for lag_s, residual in residuals[1:] if lag_s == 0.0) > 0.05
    assert abs(residuals[-1][1] or 0.0) < 0.02


def test_magnetic_and_true_headings_of_one_run_keep_apart() -> None:
    loop = long_drive()
    simulated = omni_rover(noise=Noise())
    yaws = []

    def sometimes_true(sample: Sample) -> Sample:
        if isinstance(sample, HeadingSample) and sample.t_ns % (100 * MS) == 7 * MS:
            heading_rad = math.remainder(sample.heading_rad + 1.0, math.tau)
            return replace(sample, heading_rad=heading_rad, reference=HeadingReference.TRUE)
        return sample

    simulated.mute = sometimes_true
    for output in run(loop, simulated, 6.0):
        yaws.append(output.estimate.yaw_rad)
        assert all(item.accepted for item in output.innovations)
    assert max(map(abs, yaws)) < 0.01


def test_headings_wait_while_the_motion_of_the_wheels_is_unknown() -> None:
    roles = DeviceRoles(wheels="wheels", headings=("compass",), required={"wheels": 0.15})
    loop, simulated = ControlLoop(make_settings(), roles), omni_rover(noise=Noise())
    run(loop, simulated, 1.0)
    for _ in range(100):
        simulated.set_point_rad_s = simulated.geometry.wheel_speeds(0j, 0.3)
        samples = simulated.advance(simulated.t_ns + PERIOD_NS)
        turning = loop.step(simulated.t_ns, samples)
    # The last known yaw rate would turn the yaw expected for each of the headings further and further.
    simulated.mute = silent("wheels")
    silence = run(loop, simulated, 30.0)
    named = {item.name for output in silence[20:] for item in output.innovations}
    assert named == set()
    assert silence[-1].estimate.yaw_rad == pytest.approx(turning.estimate.yaw_rad, abs=0.02)
    simulated.mute = lambda sample: sample
    assert any(output.innovations for output in run(loop, simulated, 1.0))
