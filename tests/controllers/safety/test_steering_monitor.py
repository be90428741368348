"""Wheels that do not steer when they are commanded to."""

import math

import pytest

from controllers.fault import Cause, Fault
from controllers.roles import DeviceRoles
from controllers.safety.steering_monitor import SteeringMonitor, SteeringReportRule, SteeringSettings
from drivers.clock import nanoseconds
from tests.controllers.safety.cycles import make_cycle


def drive(set_deg: list[float], angles_deg: list[float]) -> list[Fault]:
    """Return the reasons of the last cycle of 20 ms; the second wheel does not steer."""
    monitor = SteeringMonitor(SteeringSettings())
    found: list[Fault] = []
    for index, (target, angle) in enumerate(zip(set_deg, angles_deg, strict=True)):
        cycle = make_cycle(
            now_ns=nanoseconds(0.02 * index),
            set_steering_rad=(math.radians(target), 0.0),
            steering_rad=(math.radians(angle), 0.0),
        )
        found = list(monitor.check(cycle))
    return found


def test_a_wheel_that_does_not_steer_is_named() -> None:
    assert not drive([30.0] * 100, [5.0] * 100)
    (reason,) = drive([30.0] * 101, [5.0] * 101)
    assert reason.name == "steering"
    assert reason.text.startswith("wheel 0: has not steered for 2 s: commanded 30 deg, measured 5 deg; ")


def test_a_wheel_that_steers_the_wrong_way_is_noticed() -> None:
    assert drive([30.0] * 101, [-0.1 * step for step in range(101)])


@pytest.mark.parametrize(
    ("set_deg", "angles_deg"),
    [
        ([30.0] * 500, [0.05 * step for step in range(500)]),  # 2.5 deg/s
        ([30.0] * 500, [21.0] * 500),
        ([30.0 if step // 50 % 2 else 0.0 for step in range(500)], [0.0] * 500),
    ],
    ids=["slow", "close", "asked in turns"],
)
def test_a_wheel_that_follows_is_not_stopped(set_deg: list[float], angles_deg: list[float]) -> None:
    assert not drive(set_deg, angles_deg)


def test_a_rover_that_does_not_steer_is_not_watched() -> None:
    assert not list(SteeringMonitor(SteeringSettings()).check(make_cycle(now_ns=0)))


def reasons(monitor: SteeringMonitor, now_s: float, set_deg: list[float], deg: list[float]) -> list[str]:
    cycle = make_cycle(
        now_ns=nanoseconds(now_s),
        set_steering_rad=tuple(map(math.radians, set_deg)),
        steering_rad=tuple(map(math.radians, deg)),
    )
    return [reason.text.split(":")[0] for reason in monitor.check(cycle)]


def test_every_wheel_is_watched() -> None:
    monitor = SteeringMonitor(SteeringSettings())
    assert reasons(monitor, 0.0, [0.0, 30.0, 30.0], [0.0, 0.0, 0.0]) == []
    assert reasons(monitor, 2.0, [0.0, 30.0, 30.0], [0.0, 0.0, 0.0]) == ["wheel 1", "wheel 2"]


def test_angles_that_are_not_reported_yet_are_not_watched() -> None:
    monitor = SteeringMonitor(SteeringSettings())
    assert reasons(monitor, 0.0, [30.0, 30.0], []) + reasons(monitor, 5.0, [30.0, 30.0], []) == []


@pytest.mark.parametrize(("closer_deg", "steers"), [(1.0, False), (1.01, True)])
def test_an_error_of_exactly_the_limit_counts_and_a_degree_is_no_progress(
    closer_deg: float, steers: bool
) -> None:
    monitor = SteeringMonitor(SteeringSettings(steering_error_deg=10.0))
    assert reasons(monitor, 0.0, [10.0 + closer_deg], [0.0]) == []
    assert reasons(monitor, 2.0, [10.0 + closer_deg], [closer_deg]) == ([] if steers else ["wheel 0"])


def test_an_angle_of_exactly_the_limit_off_is_not_followed() -> None:
    monitor = SteeringMonitor(SteeringSettings(steering_error_deg=10.0))
    assert reasons(monitor, 0.0, [10.0], [0.0]) == []
    assert reasons(monitor, 2.0, [10.0], [0.0]) == ["wheel 0"]


def test_an_angle_older_than_the_limit_of_the_wheels_is_named() -> None:
    rule = SteeringReportRule(DeviceRoles(wheels="drive", required={"drive": 0.25}))

    def found(*ages_s: float) -> list[Fault]:
        stamps = {wheel: nanoseconds(9.0 - age_s) for wheel, age_s in enumerate(ages_s)}
        return list(rule.check(make_cycle(now_ns=nanoseconds(9.0), steering_ns=stamps)))

    assert found(0.25, 0.0) == []
    assert found(0.26, 0.0, 0.5) == [
        Fault("wheel 0", Cause.STEERING_ANGLE, "wheel 0: reports no steering angle for 0.25 s"),
        Fault("wheel 2", Cause.STEERING_ANGLE, "wheel 2: reports no steering angle for 0.25 s"),
    ]
