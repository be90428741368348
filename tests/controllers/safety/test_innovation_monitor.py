"""What no single sample shows: measurements that are always rejected, wheels that do not turn."""

import pytest

from controllers.guarded_filter import Innovation
from controllers.safety.innovation_monitor import InnovationMonitor, StallMonitor, StopReason
from controllers.safety.settings import SafetySettings
from drivers.clock import nanoseconds

SETTINGS = SafetySettings()


def innovation(name: str, *, accepted: bool, residual: float | None = 1.0) -> Innovation:
    return Innovation(name=name, residual=residual, variance=1.0, nis=1.0, accepted=accepted)


REJECTED = innovation("compass", accepted=False)
ACCEPTED = innovation("compass", accepted=True)


class Rejections:
    """An innovation monitor that is fed at given times."""

    def __init__(self) -> None:
        self.monitor = InnovationMonitor(SETTINGS)

    def at(self, t_s: float, *innovations: Innovation) -> list[StopReason]:
        return list(self.monitor.check(nanoseconds(t_s), innovations))


@pytest.mark.parametrize(("period_s", "stops_after_s"), [(0.02, 2.0), (0.5, 2.0), (1.0, 2.0), (5.0, 10.0)])
def test_rejections_stop_after_two_seconds_and_three_of_them(period_s: float, stops_after_s: float) -> None:
    rejections = Rejections()
    count = round(stops_after_s / period_s)
    for index in range(count):
        (reason,) = rejections.at(index * period_s, REJECTED, innovation("imu", accepted=True))
        assert not reason.must_stop
    (reason,) = rejections.at(count * period_s, REJECTED)
    assert reason == StopReason("compass", "compass: contradicts the estimate, rejected for 2 s")


def test_one_acceptance_ends_a_contradiction() -> None:
    rejections = Rejections()
    for index in range(4):
        rejections.at(float(index), REJECTED)
    (reason,) = rejections.at(3.5)
    assert reason.must_stop
    assert rejections.at(4.0, ACCEPTED) == []
    (reason,) = rejections.at(5.0, REJECTED)
    assert not reason.must_stop


def test_silence_after_a_rejection_is_no_further_evidence() -> None:
    rejections = Rejections()
    rejections.at(0.0, REJECTED)
    (reason,) = rejections.at(100.0)
    assert not reason.must_stop


def test_a_measurement_that_could_not_be_compared_neither_stops_nor_clears() -> None:
    rejections = Rejections()
    late = innovation("compass", accepted=False, residual=None)
    for index in range(100):
        assert rejections.at(float(index), late) == []
    for t_s in (100.0, 101.0, 102.0):
        (reason,) = rejections.at(t_s, REJECTED, late)
    assert reason.must_stop


class Wheels:
    """A stall monitor on a cycle of 20 ms."""

    def __init__(self, wheel_count: int = 1) -> None:
        self.monitor = StallMonitor(SETTINGS, wheel_count)
        self.now_ns = 0
        self.found: list[StopReason] = []

    def turn(self, duration_s: float, commanded: tuple[float, ...], measured: tuple[float, ...]) -> bool:
        """Return whether the rover must stop at the end of this time."""
        for _ in range(round(duration_s / 0.02)):
            self.found = list(self.monitor.check(self.now_ns, commanded, measured))
            self.now_ns += nanoseconds(0.02)
        return any(reason.must_stop for reason in self.found)


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
    assert not wheels.found[0].must_stop
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
