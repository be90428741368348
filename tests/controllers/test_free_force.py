"""The drive force against that of free driving."""

import pytest

from controllers.estimation.wheels.odometry import BodyIncrement
from controllers.slip.effort.free_force import FreeForce

STEP_M = 0.05


def go(force: FreeForce, force_n: float | None, length_m: float, turn_rad: float = 0.0) -> None:
    for _ in range(round(length_m / STEP_M)):
        increment = BodyIncrement(x_m=STEP_M, y_m=0.0, turn_rad=turn_rad, duration_s=0.1, turned_rad=(1.0,))
        force.move(increment, None if force_n is None else force_n * STEP_M)


@pytest.mark.parametrize(("force_n", "is_odd"), [(0.0, True), (3.0, False), (19.0, False), (25.0, True)])
def test_a_force_of_none_or_more_than_twice_that_of_free_driving_is_odd(force_n: float, is_odd: bool) -> None:
    force = FreeForce(0.1)
    go(force, 10.0, 0.6)
    assert force.reason == ""
    assert force.far_m == pytest.approx(0.15)
    go(force, force_n, 0.3)
    assert bool(force.reason) is is_odd
    assert force.far_m == pytest.approx(0.45 if is_odd else 0.15)
    go(force, 10.0, 0.15)
    assert force.reason == ""


def test_the_reason_says_both_forces() -> None:
    force = FreeForce(0.1)
    go(force, 10.0, 0.45)
    go(force, 40.0, 0.15)
    assert force.reason == "drive force 40.0 N by the currents, 10.0 N in the travel before"


@pytest.mark.parametrize("free_n", [2.0, -1.0])
def test_where_free_driving_takes_hardly_any_force_none_is_odd(free_n: float) -> None:
    force = FreeForce(0.1)
    go(force, free_n, 1.0)
    go(force, 40.0, 0.15)
    assert force.reason == ""


def test_turns_and_unknown_currents_say_nothing() -> None:
    force = FreeForce(0.1)
    go(force, 10.0, 0.6)
    go(force, 40.0, 0.3, turn_rad=0.5)
    assert force.reason == ""
    go(force, 40.0, 0.15)
    assert force.reason
    go(force, None, 0.3)
    assert force.reason
