"""Wheels that do not steer when they are commanded to."""

import math

import pytest

from controllers.safety.reasons import Cycle, StopReason
from controllers.safety.steering_monitor import SteeringMonitor, SteeringSettings
from drivers.clock import nanoseconds


def drive(set_deg: list[float], angles_deg: list[float]) -> list[StopReason]:
    """Return the reasons of the last cycle of 20 ms; the second wheel does not steer."""
    monitor = SteeringMonitor(SteeringSettings())
    found: list[StopReason] = []
    for index, (target, angle) in enumerate(zip(set_deg, angles_deg, strict=True)):
        cycle = Cycle(
            now_ns=nanoseconds(0.02 * index),
            set_steering_rad=(math.radians(target), 0.0),
            steering_rad=(math.radians(angle), 0.0),
        )
        found = list(monitor.check(cycle))
    return found


def test_a_wheel_that_does_not_steer_is_named() -> None:
    assert not drive([30.0] * 100, [5.0] * 100)
    (reason,) = drive([30.0] * 101, [5.0] * 101)
    assert reason.cause == "steering"
    assert reason.text.startswith("wheel 0: has not steered for 2 s: commanded 30 deg, measured 5 deg;")


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
    assert not list(SteeringMonitor(SteeringSettings()).check(Cycle(now_ns=0)))
