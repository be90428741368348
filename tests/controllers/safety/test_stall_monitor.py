"""Wheels that do not turn when they are commanded to."""

import pytest

from controllers.safety.reasons import Cycle, Severity, StopReason
from controllers.safety.stall_monitor import StallMonitor, StallSettings
from drivers.clock import nanoseconds


class Wheels:
    """A stall monitor on a cycle of 20 ms."""

    def __init__(self, wheel_count: int = 1) -> None:
        self.monitor = StallMonitor(StallSettings(), wheel_count)
        self.now_ns = 0
        self.found: list[StopReason] = []

    def turn(self, duration_s: float, commanded: tuple[float, ...], measured: tuple[float, ...]) -> bool:
        """Return whether the rover must stop at the end of this time."""
        for _ in range(round(duration_s / 0.02)):
            self.found = list(
                self.monitor.check(
                    Cycle(now_ns=self.now_ns, commanded_rad_s=commanded, measured_rad_s=measured)
                )
            )
            self.now_ns += nanoseconds(0.02)
        return any(reason.severity is Severity.STOP for reason in self.found)


def test_a_wheel_at_rest_is_named_after_a_second_and_not_before() -> None:
    wheels = Wheels(2)
    assert not wheels.turn(1.0, (3.0, -3.0), (2.8, 0.0))
    assert wheels.turn(0.02, (3.0, -3.0), (2.8, 0.0))
    (reason,) = wheels.found
    assert reason == StopReason(
        "stall",
        "wheel 1: has not followed its set-point for 1 s: commanded -3.00 rad/s, measured 0.00 rad/s",
    )


@pytest.mark.parametrize(("commanded", "measured"), [(0.49, 0.0), (-0.49, 0.0), (3.0, 0.31), (3.0, -0.31)])
def test_small_set_points_and_wheels_that_turn_are_no_stall(commanded: float, measured: float) -> None:
    assert not Wheels().turn(5.0, (commanded,), (measured,))


@pytest.mark.parametrize(("commanded", "measured"), [(0.5, 0.0), (-0.5, 0.05), (3.0, 0.3), (-3.0, 0.0)])
def test_set_points_from_the_least_one_on_must_turn_a_wheel(commanded: float, measured: float) -> None:
    assert Wheels().turn(1.1, (commanded,), (measured,))


def test_a_set_point_that_swings_through_zero_does_not_hide_a_stall() -> None:
    wheels = Wheels()
    for _ in range(9):
        wheels.turn(0.1, (1.0,), (0.0,))
        wheels.turn(0.1, (0.2,), (0.0,))
    assert wheels.found[0].severity is Severity.SIGN
    assert wheels.turn(0.14, (-1.0,), (0.0,))


@pytest.mark.parametrize(("commanded", "measured"), [(3.0, 0.31), (0.1, 0.06), (0.1, -0.06), (0.0, 0.0)])
def test_motion_and_a_commanded_rest_clear_a_stall(commanded: float, measured: float) -> None:
    wheels = Wheels()
    wheels.turn(0.9, (3.0,), (0.0,))
    wheels.turn(0.02, (commanded,), (measured,))
    assert wheels.found == []
    assert not wheels.turn(0.9, (3.0,), (0.0,))


def test_a_wheel_that_neither_turns_nor_has_to_keeps_its_account() -> None:
    wheels = Wheels()
    wheels.turn(0.9, (3.0,), (0.0,))
    assert not wheels.turn(2.0, (0.1,), (0.01,))
    assert wheels.turn(0.2, (3.0,), (0.0,))


def test_a_pause_of_the_loop_is_no_stall() -> None:
    wheels = Wheels()
    wheels.turn(0.04, (3.0,), (2.9,))
    wheels.now_ns += nanoseconds(5.0)
    assert not wheels.turn(0.4, (3.0,), (0.0,))
