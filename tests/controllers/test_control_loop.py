"""The whole step in closed loop with a simulated rover, on virtual time."""

import hashlib
import math
import os
import subprocess
import sys
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from controllers.control_loop import ControlLoop, StepOutput
from controllers.motion.rover_geometry import OmniRoverSettings, SkidSteerRoverSettings
from controllers.roles import DeviceRoles
from controllers.safety import Mode
from controllers.safety.reasons import Cycle
from controllers.safety.settings import SafetySettings
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
    HONEST,
    LIMITS,
    LONG_WAY,
    MS,
    OMNI,
    PERIOD_NS,
    ROLES,
    SECOND_NS,
    SKID,
    START_NS,
    Geometry,
    Noise,
    SimulatedRover,
    long_drive,
    make_settings,
    omni_geometry,
    omni_rover,
    rectangle,
    run,
    silent,
    skid_geometry,
)


@pytest.mark.parametrize(
    ("rover", "geometry", "heading"),
    [
        (OMNI, omni_geometry(), "hold"),
        pytest.param(OMNI, omni_geometry(), "along_path", marks=pytest.mark.nightly),
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


class AskedTwice(ControlLoop):
    """Asks in each cycle twice what the rules see."""

    def __init__(self) -> None:
        super().__init__(make_settings(mission=LONG_WAY), ROLES)
        self.driven_m = 0.0

    def _cycle(self, *arguments: Any) -> Cycle:
        first, second = super()._cycle(*arguments), super()._cycle(*arguments)
        assert first == second
        self.driven_m += second.wheels.distance_m
        return second


def test_what_the_rules_see_can_be_asked_again_within_a_cycle() -> None:
    loop = AskedTwice()
    run(loop, omni_rover(), 5.0)
    assert loop.driven_m > 0.5


def test_without_slip_and_noise_the_wheels_alone_close_the_rectangle() -> None:
    loop = ControlLoop(make_settings(mission=rectangle()), ROLES)
    simulated = omni_rover(noise=Noise())
    outputs = run(loop, simulated, 30.0)
    assert outputs[-1].mode is Mode.FINISHED
    odometry = outputs[-1].odometry
    assert abs(complex(odometry.x_m, odometry.y_m) - simulated.place) < 1e-3


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


@pytest.mark.slow
def test_the_same_inputs_give_the_same_outputs_whatever_the_hash_seed() -> None:
    program = "from tests.controllers.test_control_loop import digest; print(digest())"
    digests = {
        subprocess.run(
            [sys.executable, "-c", program],
            env={**os.environ, "PYTHONHASHSEED": seed},
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


@settings(max_examples=100)
@given(cycles=CYCLES, has_mission=st.booleans())
@pytest.mark.slow
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


def test_without_a_mission_samples_are_not_kept() -> None:
    """Nothing is checked then, so that what waits for a check would grow for hours."""
    loop = ControlLoop(make_settings(), ROLES)
    times_ns = [START_NS + step * PERIOD_NS for step in range(101)]
    spare, *samples = [
        RateSample(device="gyro", t_ns=t_ns, rate_z_rad_s=0.01 * step) for step, t_ns in enumerate(times_ns)
    ]
    for sample in samples:
        loop.step(sample.t_ns, [sample])
    references = [sys.getrefcount(each) for each in [spare, *samples]]
    assert sum(count > references[0] for count in references[1:]) <= 2
