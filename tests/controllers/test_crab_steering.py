"""Steering all four wheels alike against the slip angle."""

import cmath
import math
from collections.abc import Callable

import pytest

from benchmarks.crab_steering import STEEPEST_RETURN_RAD, CrabGains, CrabSteering

STEP_S = 0.2
SPEED_M_S = 0.07

Sense = Callable[[float], float | None]


def drive(drift_of: Callable[[float], float], heading_rad: float, sense: Sense, steps: int = 600) -> complex:
    """Return where a rover ends that slides by `drift_of` its way; `sense` is what it sees of its course."""
    steering = CrabSteering(CrabGains())
    place, steer_rad = 0j, 0.0
    for step in range(steps):
        travel_rad = steer_rad + drift_of(step * STEP_S * SPEED_M_S)
        place += cmath.rect(SPEED_M_S * STEP_S, heading_rad + travel_rad)
        steer_rad = steering.step(STEP_S, SPEED_M_S, heading_rad, sense(travel_rad))
    return place


@pytest.mark.parametrize("heading_deg", [0.0, 4.0, -8.0])
def test_a_rover_that_slides_stays_on_its_line_when_it_sees_that(heading_deg: float) -> None:
    end = drive(lambda way_m: math.radians(-10.0), math.radians(heading_deg), lambda travel: travel)
    assert end.real > 8.0
    assert abs(end.imag) < 0.01


def test_a_drift_that_changes_is_followed() -> None:
    end = drive(lambda way_m: math.radians(12.0) * math.sin(way_m), 0.0, lambda travel: travel)
    assert abs(end.imag) < 0.03


def test_a_rover_that_does_not_see_it_is_carried_away() -> None:
    end = drive(lambda way_m: math.radians(-10.0), 0.0, lambda travel: None)
    assert end.imag < -1.0


def test_the_distance_is_told_as_it_is() -> None:
    steering = CrabSteering(CrabGains(return_rad_m=0.0, greatest_steer_rad=0.0))
    for _ in range(100):
        steering.step(STEP_S, SPEED_M_S, 0.1, -0.2)
    assert steering.left_of_line_m == pytest.approx(100 * STEP_S * SPEED_M_S * math.sin(-0.1))


def test_far_off_it_returns_at_a_bounded_angle() -> None:
    steering = CrabSteering(CrabGains())
    angle = 0.0
    for _ in range(200):
        angle = steering.step(STEP_S, SPEED_M_S, 0.0, 0.5)  # it goes left whatever is done
        assert abs(angle) <= 0.6
    assert steering.left_of_line_m > 1.0
    # Steered to the limit, with 0.5 rad of course seen, the drift is 1.1: more than can be steered against.
    assert angle == -0.6
    calm = CrabSteering(CrabGains(greatest_steer_rad=2.0))
    angle = calm.step(100.0, SPEED_M_S, 0.5, None)
    assert calm.left_of_line_m > 3.0
    assert angle == pytest.approx(-STEEPEST_RETURN_RAD - 0.5)


def test_nothing_is_learnt_while_it_stands() -> None:
    steering = CrabSteering(CrabGains())
    for _ in range(50):
        assert steering.step(STEP_S, 0.0, 0.0, 0.4) == 0.0
    assert steering.left_of_line_m == 0.0


def test_without_a_trace_the_drift_seen_last_stays() -> None:
    steering = CrabSteering(CrabGains(return_rad_m=0.0))
    angle = 0.0
    for _ in range(100):
        angle = steering.step(STEP_S, SPEED_M_S, 0.0, angle - 0.15)
    assert angle == pytest.approx(0.15, abs=1e-3)
    for _ in range(20):
        assert steering.step(STEP_S, SPEED_M_S, 0.0, None) == pytest.approx(angle, abs=1e-3)
