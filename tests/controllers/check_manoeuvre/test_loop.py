"""The check manoeuvre in the control loop: it returns, sound sources agree, wrong ones are named."""

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from benchmarks.safety.missions import Driven, drive
from controllers.check_manoeuvre.comparison import confirmed_by
from controllers.check_manoeuvre.verdict import SourceCheck, Verdict
from controllers.control_loop import ControlLoop, StepOutput
from controllers.roles import DeviceRoles
from controllers.safety import Mode
from controllers.safety.settings import SafetySettings
from drivers.samples import BumperSample, HeadingSample, PoseFixSample, RateSample, Sample
from rover_hil.config import Config, load_config
from tests.controllers.simulated import (
    HONEST,
    LONG_WAY,
    ROLES,
    SKID,
    SimulatedRover,
    make_settings,
    omni_rover,
    run,
    skid_geometry,
)
from tests.rover_hil.test_gnss_run import config_with

Change = Callable[[Sample], Sample]
ON = SafetySettings(check_manoeuvre=True)
NO_COMPASS = DeviceRoles(wheels="wheels", gyro="gyro", required={"wheels": 0.15, "gyro": 0.15})
EXAMPLES = Path(__file__).parents[3] / "docs" / "examples"


def rates(share: float, offset_rad_s: float = 0.0) -> Change:
    def change(sample: Sample) -> Sample:
        if not isinstance(sample, RateSample):
            return sample
        return replace(sample, rate_z_rad_s=share * sample.rate_z_rad_s + offset_rad_s)

    return change


def noise_only(sample: Sample) -> Sample:
    """Return a gyro that sends noise: the last digits of the real rate."""
    if not isinstance(sample, RateSample):
        return sample
    return replace(sample, rate_z_rad_s=0.01 * math.sin(1e6 * sample.rate_z_rad_s))


def reversed_compass(sample: Sample) -> Sample:
    return replace(sample, heading_rad=-sample.heading_rad) if isinstance(sample, HeadingSample) else sample


def mirrored_east(sample: Sample) -> Sample:
    return replace(sample, x_m=-sample.x_m) if isinstance(sample, PoseFixSample) else sample


def unchanged(sample: Sample) -> Sample:
    return sample


def looped(
    change: Change = unchanged, roles: DeviceRoles = ROLES, *, slip: float = 0.0, seconds_s: float = 40.0
) -> tuple[ControlLoop, SimulatedRover, list[StepOutput]]:
    """Drive the small omnidirectional rover of the tests."""
    rover = omni_rover(noise=HONEST)
    rover.mute, rover.slip = change, slip
    loop = ControlLoop(make_settings(mission=LONG_WAY, safety=ON), roles)
    outputs: list[StepOutput] = []
    while rover.t_ns < seconds_s * 1e9 and not any(output.checks for output in outputs):
        outputs += run(loop, rover, 0.1)
    return loop, rover, outputs + run(loop, rover, 0.1)


def checks_of(outputs: list[StepOutput]) -> tuple[SourceCheck, ...]:
    (checks,) = [output.checks for output in outputs if output.checks is not None]
    return checks


@pytest.mark.parametrize("slip", [0.0, 0.3])
@pytest.mark.parametrize("roles", [ROLES, NO_COMPASS], ids=["compass", "gyro alone"])
def test_sound_sources_agree_the_rover_is_where_it_was_and_the_mission_begins(
    slip: float, roles: DeviceRoles
) -> None:
    loop, rover, outputs = looped(roles=roles, slip=slip)
    assert {check.verdict for check in checks_of(outputs)} == {Verdict.AGREES}
    assert confirmed_by(checks_of(outputs)) == {"wheels", "gyro", *roles.headings}
    assert abs(rover.place) < 0.03
    assert abs(rover.yaw_rad) < math.radians(3.0)
    assert outputs[-1].mode is Mode.RUNNING
    run(loop, rover, 2.0)
    assert rover.place.real > 0.1


def test_before_its_end_no_source_is_confirmed() -> None:
    loop, rover = ControlLoop(make_settings(mission=LONG_WAY, safety=ON), ROLES), omni_rover()
    assert not any(output.checks for output in run(loop, rover, 3.0))


@pytest.mark.parametrize(
    ("change", "roles", "device", "verdict"),
    [
        (rates(-1.0), NO_COMPASS, "gyro", Verdict.OPPOSITE),
        (rates(-1.0), ROLES, "gyro", Verdict.OPPOSITE),
        (noise_only, NO_COMPASS, "gyro", Verdict.DOES_NOT_FOLLOW),
        (rates(0.0, 0.02), NO_COMPASS, "gyro", Verdict.DOES_NOT_FOLLOW),
        (reversed_compass, ROLES, "compass", Verdict.OPPOSITE),
    ],
    ids=["gyro reversed", "gyro reversed, compass", "gyro of noise", "gyro dead", "compass reversed"],
)
def test_a_wrong_source_is_named_and_ends_the_run(
    change: Change, roles: DeviceRoles, device: str, verdict: Verdict
) -> None:
    loop, rover, outputs = looped(change, roles)
    wrong = [check for check in checks_of(outputs) if check.verdict is not Verdict.AGREES]
    assert (device, verdict) in [(check.device, check.verdict) for check in wrong]
    assert device not in confirmed_by(checks_of(outputs))
    assert outputs[-1].mode is Mode.EMERGENCY_STOP
    assert f"check manoeuvre: {device}: rotation" in outputs[-1].reason
    before = abs(rover.place)
    run(loop, rover, 2.0)
    assert abs(rover.place) == pytest.approx(before, abs=0.01)


def test_a_wrong_scale_is_named_and_the_mission_begins_with_an_unconfirmed_source() -> None:
    _, _, outputs = looped(rates(0.5), NO_COMPASS)
    (check,) = checks_of(outputs)
    assert (check.device, check.verdict) == ("gyro", Verdict.SCALE)
    assert check.slope_low is not None
    assert check.slope_high is not None
    assert check.slope_low < 0.5 < check.slope_high
    assert confirmed_by(checks_of(outputs)) == frozenset()
    assert outputs[-1].mode is Mode.RUNNING


def test_with_a_gyro_that_agrees_with_the_compass_the_wheels_are_named() -> None:
    """Left and right exchanged: the wheels say the opposite of what the rover does."""

    def reverse(sample: Sample) -> Sample:
        return reversed_compass(rates(-1.0)(sample))

    _, _, outputs = looped(reverse)
    assert [(check.device, check.verdict) for check in checks_of(outputs)] == [
        ("wheels", Verdict.OPPOSITE),
        ("gyro", Verdict.AGREES),
        ("compass", Verdict.AGREES),
    ]
    assert "wheels: rotation has the opposite sign of gyro" in outputs[-1].reason


def test_a_rover_with_wheels_alone_compares_nothing_and_drives() -> None:
    _, _, outputs = looped(roles=DeviceRoles(wheels="wheels", required={"wheels": 0.15}))
    (check,) = checks_of(outputs)
    assert (check.verdict, check.text) == (
        Verdict.NOT_COMPARED,
        "wheels: rotation not compared: no other source measures it",
    )
    assert confirmed_by(checks_of(outputs)) == frozenset()


def test_a_bumper_ends_the_manoeuvre() -> None:
    loop, rover = ControlLoop(make_settings(mission=LONG_WAY, safety=ON), NO_COMPASS), omni_rover()
    run(loop, rover, 3.0)
    pressed = BumperSample(device="wheels", t_ns=rover.t_ns, pressed=True)
    output = loop.step(rover.t_ns + 1, [pressed])
    assert output.mode is Mode.EMERGENCY_STOP
    assert output.command.speed_rad_s == (0.0, 0.0, 0.0)


def test_a_skidding_rover_agrees_where_its_wheels_turn_three_times_as_far() -> None:
    rover = SimulatedRover(skid_geometry(), noise=HONEST)

    def skid(sample: Sample) -> Sample:
        if isinstance(sample, HeadingSample):
            return replace(
                sample, heading_rad=1.0 + 0.33 * math.remainder(sample.heading_rad - 1.0, math.tau)
            )
        return rates(0.33)(sample)

    rover.mute = skid
    loop = ControlLoop(
        make_settings(SKID, LONG_WAY.model_copy(update={"heading": "along_path"}), safety=ON), ROLES
    )
    outputs = run(loop, rover, 20.0)
    assert {check.verdict for check in checks_of(outputs)} == {Verdict.AGREES}


def example(name: str, *, is_car: bool = False) -> Config:
    table = load_config(str(EXAMPLES / f"{name}.toml")).model_dump(by_alias=True)
    if is_car:  # the corner wheels of the six-wheel rover do not reach the angles of a rotation on the spot
        for wheel in table["rover"]["wheels"]:
            if wheel["steering"]:
                wheel["steering"].update(low_deg=-30.0, high_deg=30.0)
    return switched_on(Config.model_validate(table))


def switched_on(config: Config) -> Config:
    return config.model_copy(update={"safety": config.safety.model_copy(update={"check_manoeuvre": True})})


def falsified(config: Config, change: Change, limit_s: float = 35.0) -> Driven:
    return drive(config, lambda _, sample: change(sample), limit_s=limit_s)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "is_car"),
    [("differential", False), ("mecanum", False), ("six_wheels", False), ("six_wheels", True)],
    ids=["differential", "mecanum", "steered", "car-like"],
)
def test_every_kind_of_rover_ends_where_it_began(name: str, is_car: bool) -> None:
    driven = falsified(example(name, is_car=is_car), unchanged)
    (end,) = [moment for moment in driven.moments if moment.output.checks]
    x_m, y_m, yaw_rad = end.truth
    assert math.hypot(x_m, y_m) < 0.03
    assert abs(yaw_rad) < math.radians(3.0)
    assert {check.verdict for check in end.output.checks or ()} == {Verdict.AGREES}
    yaws_deg = [math.degrees(moment.truth[2]) for moment in driven.moments if moment.t_s <= end.t_s]
    assert max(yaws_deg) == pytest.approx(20.0, abs=3.0)
    assert min(yaws_deg) == pytest.approx(-20.0, abs=3.0)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["mecanum", "six_wheels"])
def test_on_every_kind_of_rover_a_reversed_gyro_is_named(name: str) -> None:
    driven = falsified(example(name), rates(-1.0))
    assert driven.mode is Mode.EMERGENCY_STOP
    assert "imu: rotation has the opposite sign of the wheels" in driven.moments[-1].output.reason


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "verdict"), [(unchanged, Verdict.AGREES), (mirrored_east, Verdict.MIRRORED)]
)
def test_positions_are_compared_on_two_directions(change: Change, verdict: Verdict) -> None:
    driven = falsified(switched_on(config_with()), change)
    (checks,) = [moment.output.checks for moment in driven.moments if moment.output.checks]
    verdicts = {check.device: check.verdict for check in checks}
    assert verdicts == {"wheels": Verdict.AGREES, "imu": Verdict.AGREES, "gnss": verdict}
    is_refused = verdict is Verdict.MIRRORED
    assert (driven.mode is Mode.EMERGENCY_STOP) is is_refused
    assert ("gnss: position is mirrored" in driven.moments[-1].output.reason) is is_refused


@pytest.mark.slow
def test_positions_with_much_noise_are_not_compared_and_the_needed_path_is_stated() -> None:
    def noisy(sample: Sample) -> Sample:
        if not isinstance(sample, PoseFixSample):
            return sample
        return replace(sample, x_m=sample.x_m + 2.0 * math.sin(1e4 * sample.y_m), position_std_m=2.0)

    driven = falsified(switched_on(config_with()), noisy)
    (checks,) = [moment.output.checks for moment in driven.moments if moment.output.checks]
    (gnss,) = [check for check in checks if check.device == "gnss"]
    assert gnss.verdict is Verdict.NOT_COMPARED
    assert "it needs about" in gnss.text
