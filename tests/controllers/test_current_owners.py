"""Currents that are those of other wheels."""

import pytest

from controllers.slip.effort.current_owners import CurrentOwners
from controllers.slip.effort.motor_model import EffortFlag, MotorSettings, WheelEffort
from controllers.slip.effort.parameters import EFFORT
from tests.controllers.slip_bench import Bench, currents_for, wheel_speeds

MOTOR = MotorSettings(coulomb_torque_nm=0.1, torque_constant_nm_a=0.5)
"""Without load it draws 0.2 A."""


def reason(
    currents_a: tuple[float, ...],
    speeds_rad_s: tuple[float, ...] = (-3.0, 0.0, 3.0),
    duration_s: float = 0.5,
    flags: tuple[EffortFlag, ...] = (),
) -> str:
    owners = CurrentOwners(MOTOR)
    pairs = zip(currents_a, speeds_rad_s, strict=True)
    owners.check([WheelEffort(current, speed, 0.0, 0.0, flags) for current, speed in pairs], duration_s)
    return owners.reason


def test_a_wheel_at_rest_that_draws_the_current_of_one_that_turns_is_named() -> None:
    assert reason((0.02, -0.9, 0.8)) == (
        "currents of other wheels: wheel 1 draws 0.90 A at rest, wheel 0 turns with 0.02 A"
    )


@pytest.mark.parametrize(
    ("currents_a", "speeds_rad_s", "duration_s", "flags"),
    [
        ((-0.8, 0.0, 0.8), (-3.0, 0.0, 3.0), 9.0, ()),
        ((0.02, 0.39, 0.8), (-3.0, 0.0, 3.0), 9.0, ()),
        ((0.11, 0.9, 0.8), (-3.0, 0.0, 3.0), 9.0, ()),
        ((0.02, 0.9, 0.8), (-3.0, 0.1, 3.0), 9.0, ()),
        ((0.02, 0.9, 0.02), (-0.9, 0.0, 0.9), 9.0, ()),
        ((0.02, 0.9, 0.8), (-3.0, 0.0, 3.0), 0.49, ()),
        ((0.02, 0.9, 0.8), (-3.0, 0.0, 3.0), 9.0, (EffortFlag.NO_CURRENT,)),
    ],
)
def test_what_a_load_may_do_is_not_named(
    currents_a: tuple[float, ...],
    speeds_rad_s: tuple[float, ...],
    duration_s: float,
    flags: tuple[EffortFlag, ...],
) -> None:
    assert reason(currents_a, speeds_rad_s, duration_s, flags) == ""


def test_it_is_withdrawn_when_the_currents_fit() -> None:
    owners = CurrentOwners(MOTOR)
    for currents, expected in (((0.02, 0.9), True), ((0.8, 0.0), False)):
        efforts = [WheelEffort(*pair, 0.0, 0.0, ()) for pair in zip(currents, (3.0, 0.0), strict=True)]
        owners.check(efforts, 1.0)
        assert bool(owners.reason) == expected


def test_slip_by_such_currents_is_not_valid_and_says_why() -> None:
    bench = Bench(known=("soft",))
    speeds = wheel_speeds(0.0, 0.2)
    own = currents_for(25.0, 0.0, speeds)
    for _ in range(150):
        report = bench.step(speeds, own)
    assert all(wheel.valid for wheel in report.wheels)
    rest = min(range(3), key=lambda wheel: abs(speeds[wheel]))
    assert abs(speeds[rest]) < EFFORT.stuck.standing_rad_s
    wrong = list(own)
    wrong[rest - 1], wrong[rest] = wrong[rest], wrong[rest - 1]
    for _ in range(75):
        report = bench.step(speeds, wrong)
    assert {wheel.valid for wheel in report.wheels} == {False}
    assert report.wheels[0].reason.startswith("currents of other wheels: ")
