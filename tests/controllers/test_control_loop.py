"""The whole step in closed loop with a simulated rover, on virtual time."""

import hashlib
import math
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from controllers.control_loop import ControlLoop, StepOutput
from controllers.limits import Limit
from controllers.pose_filter import YawSource
from controllers.roles import DeviceRoles
from controllers.safety import Mode
from controllers.settings import (
    FilterSettings,
    OmniRoverSettings,
    SafetySettings,
    SkidSteerRoverSettings,
    WaypointsMission,
)
from drivers.errors import ConfigError
from drivers.samples import (
    BumperSample,
    FaultSample,
    HeadingReference,
    HeadingSample,
    LinkSample,
    RateSample,
    Sample,
    WheelSample,
)
from tests.controllers.simulated import (
    LIMITS,
    OMNI,
    ROLES,
    SECOND_NS,
    SKID,
    START_NS,
    Geometry,
    Noise,
    SimulatedRover,
    make_settings,
    omni_geometry,
    rectangle,
    run,
    skid_geometry,
)

MS = 1_000_000
PERIOD_NS = 20 * MS
HONEST = Noise(gyro_rad_s=0.01, gyro_bias_rad_s=0.02, heading_rad=0.03)
LONG_WAY = WaypointsMission(type="waypoints", points=((50.0, 0.0),), speed_m_s=0.2)


def omni_rover(seed: int = 0, noise: Noise = HONEST) -> SimulatedRover:
    return SimulatedRover(omni_geometry(), np.random.default_rng(seed), noise)


def long_drive() -> ControlLoop:
    return ControlLoop(make_settings(mission=LONG_WAY), ROLES)


@pytest.mark.parametrize(
    ("rover", "geometry", "heading"),
    [
        (OMNI, omni_geometry(), "hold"),
        (OMNI, omni_geometry(), "along_path"),
        (SKID, skid_geometry(), "along_path"),
    ],
    ids=["omni holding", "omni turning", "skid-steer"],
)
def test_the_rectangle_closes(
    rover: OmniRoverSettings | SkidSteerRoverSettings, geometry: Geometry, heading: str
) -> None:
    loop = ControlLoop(make_settings(rover, rectangle(heading)), ROLES)
    simulated = SimulatedRover(geometry, np.random.default_rng(3), HONEST)
    places: list[complex] = []
    outputs: list[StepOutput] = []
    while not outputs or outputs[-1].mode is not Mode.FINISHED:
        outputs += run(loop, simulated, 0.02)
        places.append(simulated.place)
        assert len(outputs) < 3000, outputs[-1]
    for corner in (0.9, 0.9 + 0.4j, 0.4j):
        assert min(abs(place - corner) for place in places) < 0.03
    assert abs(simulated.place) < 0.03
    last = outputs[-1]
    assert abs(complex(last.estimate.x_m, last.estimate.y_m) - simulated.place) < 0.02
    assert abs(math.remainder(last.estimate.yaw_rad - simulated.yaw_rad, math.tau)) < math.radians(1.5)
    assert last.estimate.gyro_bias_rad_s == pytest.approx(0.02, abs=0.003)
    assert {output.mode for output in outputs} == {Mode.SETTLING, Mode.RUNNING, Mode.FINISHED}
    assert last.command.speed_rad_s == (0.0,) * len(geometry.drive)
    assert last.odometry_rebases == 0


def test_without_slip_and_noise_the_wheels_alone_close_the_rectangle() -> None:
    loop = ControlLoop(make_settings(mission=rectangle()), ROLES)
    simulated = omni_rover(noise=Noise())
    outputs = run(loop, simulated, 30.0)
    assert outputs[-1].mode is Mode.FINISHED
    odometry = outputs[-1].odometry
    assert abs(complex(odometry.x_m, odometry.y_m) - simulated.place) < 1e-3


def test_slip_shortens_the_true_path_and_the_filter_says_how_unsure_it_is() -> None:
    loop = ControlLoop(make_settings(mission=LONG_WAY), ROLES)
    simulated = omni_rover()
    simulated.slip = 0.1
    last = run(loop, simulated, 11.0)[-1]
    assert last.odometry.x_m == pytest.approx(simulated.place.real / 0.9, rel=0.01)
    assert last.estimate.covariance[0] == pytest.approx(0.05**2 * last.odometry.x_m, rel=0.05)


def silent(device: str) -> Callable[[Sample], Sample | None]:
    return lambda sample: None if sample.device == device else sample


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
    assert 0.5 <= (moving.t_ns - faulty[-1].t_ns) / SECOND_NS <= 0.6
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


def test_a_bumper_stops_in_the_same_step_and_for_good() -> None:
    loop, simulated = long_drive(), omni_rover()
    run(loop, simulated, 4.0)
    bumper = BumperSample(device="bumper", t_ns=simulated.t_ns, pressed=True)
    output = loop.step(simulated.t_ns + 1, [bumper])
    assert (output.mode, output.command.speed_rad_s) == (Mode.EMERGENCY_STOP, (0.0, 0.0, 0.0))
    assert {output.mode for output in run(loop, simulated, 3.0)} == {Mode.EMERGENCY_STOP}


def test_every_step_gives_a_command_that_expires() -> None:
    loop = ControlLoop(make_settings(mission=LONG_WAY, safety=SafetySettings(expiry_s=0.2)), ROLES)
    for output in run(loop, omni_rover(), 2.0):
        assert output.command.t_ns == output.t_ns
        assert output.command.expires_ns == output.t_ns + 200 * MS


def test_the_rover_stands_while_it_settles() -> None:
    for output in run(long_drive(), omni_rover(), 2.0):
        if output.mode is Mode.SETTLING:
            assert output.command.speed_rad_s == (0.0, 0.0, 0.0)
            assert output.cross_track_m is None
        else:
            assert output.t_ns - START_NS >= SECOND_NS
            assert output.cross_track_m is not None


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
            heading_rad = math.remainder(sample.heading_rad + 0.2, math.tau)
            return replace(sample, heading_rad=heading_rad, reference=HeadingReference.TRUE)
        return sample

    simulated.mute = sometimes_true
    for output in run(loop, simulated, 6.0):
        yaws.append(output.estimate.yaw_rad)
        assert all(item.accepted for item in output.innovations)
    assert max(map(abs, yaws)) < 0.01


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


def test_the_wheel_device_must_be_required_for_a_mission() -> None:
    with pytest.raises(ConfigError, match="wheels"):
        ControlLoop(make_settings(mission=LONG_WAY), DeviceRoles(wheels="wheels", required={"gyro": 0.1}))


def digest() -> str:
    """Return a fingerprint of everything that two seconds of faulty driving gave out."""
    loop, simulated = long_drive(), omni_rover(seed=5)
    outputs = run(loop, simulated, 1.5)
    simulated.mute = silent("gyro")
    outputs += run(loop, simulated, 0.5)
    return hashlib.sha256(repr(outputs).encode()).hexdigest()


def test_the_same_inputs_give_the_same_outputs_whatever_the_hash_seed() -> None:
    program = "from tests.controllers.test_control_loop import digest; print(digest())"
    digests = {
        subprocess.run(
            [sys.executable, "-c", program],
            env={"PYTHONHASHSEED": seed},
            capture_output=True,
            text=True,
            check=True,
        ).stdout.strip()
        for seed in ("1", "2")
    }
    assert digests == {digest()}


DEVICES = st.sampled_from(["wheels", "gyro", "compass", "bumper", "stranger"])
STAMPS = st.integers(-(2**62), 2**62) | st.integers(START_NS, START_NS + SECOND_NS)
NUMBERS = st.floats() | st.floats(-10.0, 10.0)
SAMPLES: st.SearchStrategy[Sample] = st.one_of(
    st.builds(
        WheelSample,
        device=st.just("wheels"),
        t_ns=STAMPS,
        wheel=st.integers(-2, 5),
        position_rad=st.none() | NUMBERS,
    ),
    st.builds(WheelSample, device=DEVICES, t_ns=STAMPS, wheel=st.integers(0, 2), position_rad=NUMBERS),
    st.builds(RateSample, device=DEVICES, t_ns=STAMPS, rate_z_rad_s=NUMBERS),
    st.builds(
        HeadingSample,
        device=DEVICES,
        t_ns=STAMPS,
        heading_rad=NUMBERS,
        reference=st.sampled_from(HeadingReference),
    ),
    st.builds(LinkSample, device=DEVICES, t_ns=STAMPS, up=st.booleans(), reason=st.text(max_size=3)),
    st.builds(
        FaultSample,
        device=DEVICES,
        t_ns=STAMPS,
        wheel=st.none() | st.integers(-1, 4),
        code=st.integers(0, 3),
        text=st.text(max_size=3),
    ),
    st.builds(BumperSample, device=DEVICES, t_ns=STAMPS, pressed=st.just(False)),
)
CYCLES = st.lists(
    st.tuples(
        st.integers(0, 40 * MS) | st.integers(-SECOND_NS, 2**61),
        st.booleans(),
        st.lists(SAMPLES, max_size=12),
    ),
    max_size=30,
)


@settings(max_examples=200)
@given(cycles=CYCLES, has_mission=st.booleans())
def test_no_stream_of_samples_makes_it_raise_or_ask_for_too_much(
    cycles: list[tuple[int, bool, list[Sample]]], has_mission: bool
) -> None:
    mission = LONG_WAY if has_mission else None
    safety = SafetySettings(settle_s=0.0, recover_s=0.0)
    loop = ControlLoop(make_settings(mission=mission, safety=safety), ROLES)
    simulated = omni_rover()
    for elapsed_ns, is_honest, samples in cycles:
        now_ns = simulated.t_ns + elapsed_ns
        honest: list[Sample] = []
        if is_honest:
            honest = simulated.advance(simulated.t_ns + PERIOD_NS)
            now_ns = simulated.t_ns
        output = loop.step(now_ns, [*samples, *honest])
        assert output.estimate.is_finite
        assert all(abs(speed) <= LIMITS.wheel_speed_rad_s for speed in output.command.speed_rad_s)
        if output.mode is not Mode.RUNNING:
            assert output.command.speed_rad_s == (0.0, 0.0, 0.0)
