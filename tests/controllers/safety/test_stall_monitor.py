"""Wheels that do not turn when they are commanded to."""

import math

import pytest

from controllers.fault import Bound, Cause, Fault, Severity
from controllers.safety.stall_monitor import StallMonitor, StallSettings
from drivers.clock import nanoseconds
from tests.controllers.safety.cycles import make_cycle


class Wheels:
    """A stall monitor on a cycle of 20 ms."""

    def __init__(self, wheel_count: int = 1, stall_s: float = 1.0) -> None:
        self.monitor = StallMonitor(StallSettings(stall_s=stall_s), wheel_count)
        self.now_ns = 0
        self.found: list[Fault] = []

    def turn(self, duration_s: float, commanded: tuple[float, ...], measured: tuple[float, ...]) -> bool:
        """Return whether the rover must stop at the end of this time."""
        for _ in range(round(duration_s / 0.02)):
            self.found = list(
                self.monitor.check(
                    make_cycle(now_ns=self.now_ns, commanded_rad_s=commanded, measured_rad_s=measured)
                )
            )
            self.now_ns += nanoseconds(0.02)
        return any(reason.severity is Severity.STOP for reason in self.found)


def test_a_wheel_at_rest_is_named_after_a_second_and_not_before() -> None:
    wheels = Wheels(2)
    assert not wheels.turn(1.0, (3.0, -3.0), (2.8, 0.0))
    assert wheels.turn(0.02, (3.0, -3.0), (2.8, 0.0))
    (reason,) = wheels.found
    assert reason == Fault(
        "wheels",
        Cause.WHEEL_STALL,
        "wheel 1: has not followed its setpoint for 1 s: commanded -3.00 rad/s, measured 0.00 rad/s",
        bound=Bound(wheel_rad=reason.bound.wheel_rad),
    )
    # A wheel that turns as it should lags a little behind its setpoint; of this a second is remembered.
    assert reason.bound.wheel_rad == pytest.approx((0.2 * (1.0 - math.exp(-1.0)), -3.0), rel=0.03)


@pytest.mark.parametrize(
    ("commanded", "measured", "after_s"), [(3.0, 0.0, 1.0), (0.49, 0.0, 3.08), (3.0, -3.0, 0.5)]
)
def test_a_wheel_that_has_turned_as_commanded_begins_at_zero(
    commanded: float, measured: float, after_s: float
) -> None:
    wheels = Wheels()
    assert not wheels.turn(1.0, (commanded,), (commanded,))
    assert not wheels.turn(after_s - 0.02, (commanded,), (measured,))
    assert wheels.turn(0.02, (commanded,), (measured,))


def test_what_is_remembered_of_a_wheel_that_turns_has_the_time_of_a_stall() -> None:
    wheels = Wheels(2, stall_s=2.0)
    assert wheels.turn(2.02, (3.0, -3.0), (2.8, 0.0))
    (reason,) = wheels.found
    assert reason.bound.wheel_rad == pytest.approx((0.4 * (1.0 - math.exp(-1.0)), -6.0), rel=0.03)


@pytest.mark.parametrize(
    ("commanded", "measured"),
    [(0.49, 0.0), (-0.49, 0.0), (0.52, 0.017), (0.5, 0.011), (-0.5, -0.011), (-3.0, -0.251)],
)
def test_small_set_points_and_wheels_that_turn_are_no_stall(commanded: float, measured: float) -> None:
    assert not Wheels().turn(3.0, (commanded,), (measured,))


@pytest.mark.parametrize(("commanded", "after_s"), [(0.49, 3.08), (-0.3, 5.02), (0.2, 7.52)])
def test_small_set_points_must_turn_a_wheel_before_they_add_up_to_the_creep_angle(
    commanded: float, after_s: float
) -> None:
    wheels = Wheels(2)
    assert not wheels.turn(after_s - 0.02, (0.0, commanded), (0.0, 0.0))
    assert wheels.turn(0.06, (0.0, commanded), (0.0, 0.0))
    assert [reason.text for reason in wheels.found] == [
        "wheel 1: has not turned although its setpoints add up to 1.5 rad: "
        f"commanded {commanded:.2f} rad/s, measured 0.00 rad/s"
    ]
    assert wheels.found[0].name == "stall"
    assert wheels.found[0].bound.wheel_rad == pytest.approx((0.0, commanded * after_s), rel=0.02)


def test_set_points_to_and_fro_or_below_those_that_a_drive_sends_do_not_add_up() -> None:
    assert not Wheels().turn(60.0, (0.19,), (0.0,))
    wheels = Wheels()
    for _ in range(10):
        assert not wheels.turn(2.0, (0.4,), (0.0,))
        assert not wheels.turn(2.0, (-0.4,), (0.0,))


@pytest.mark.parametrize(
    ("commanded", "measured"), [(3.0, -0.251), (-3.0, 2.9), (0.3, -0.21), (-0.3, 0.3), (0.48, -0.021)]
)
def test_a_wheel_that_turns_against_its_set_point_is_named_after_half_a_second(
    commanded: float, measured: float
) -> None:
    wheels = Wheels(2)
    assert not wheels.turn(0.5, (0.0, commanded), (0.0, measured))
    assert wheels.turn(0.02, (0.0, commanded), (0.0, measured))
    (reason,) = wheels.found
    assert reason.name == "reversed"
    assert reason.severity is Severity.STOP
    assert reason.text == (
        f"wheel 1: turns against its setpoint for 0.5 s: commanded {commanded:.2f} rad/s, "
        f"measured {measured:.2f} rad/s; encoder or motor reversed"
    )
    # A reversed encoder is wrong by what it measures, twice; a drive that follows turned by its setpoints.
    assert reason.bound.wheel_rad == pytest.approx((0.0, (commanded - measured) * 0.5))


@pytest.mark.parametrize(
    ("commanded", "measured"), [(0.3, -0.19), (0.48, -0.019), (0.495, -0.02), (-0.1, 0.3)]
)
def test_a_load_may_push_a_wheel_back_by_the_droop_of_its_loop(commanded: float, measured: float) -> None:
    assert not Wheels().turn(2.0, (commanded,), (measured,))


def test_a_wheel_that_swings_back_for_a_moment_is_not_reversed() -> None:
    wheels = Wheels()
    for _ in range(5):
        assert not wheels.turn(0.4, (0.6,), (-0.1,))
        assert not wheels.turn(0.1, (0.0,), (0.0,))
        assert not wheels.turn(0.4, (0.4,), (-0.2,))
        assert not wheels.turn(0.02, (0.4,), (-0.05,))


def test_all_wheels_that_miss_something_are_in_doubt() -> None:
    wheels = Wheels(3)
    wheels.turn(0.5, (3.0, 3.0, 3.0), (0.0, 2.9, 2.9))
    assert wheels.turn(0.52, (3.0, 1.0, 3.0), (0.0, 0.0, 2.9))
    assert wheels.found[0].bound.wheel_rad == pytest.approx((3.0, 0.56, 0.06), abs=0.02)


def test_the_other_one_of_two_swapped_encoders_is_in_doubt_although_it_turns() -> None:
    wheels = Wheels(2)
    # The setpoint of wheel 1 swings through zero, so that it follows half of the time.
    for _ in range(4):
        wheels.turn(0.1, (3.0, 0.3), (-0.3, 3.0))
        wheels.turn(0.1, (3.0, -0.9), (-0.9, 3.0))
    (reason,) = [reason for reason in wheels.found if reason.severity is Severity.STOP]
    assert reason.name == "reversed"
    assert reason.bound.wheel_rad[1] < -0.8 * 3.3 * 0.8


def test_the_time_of_a_reversal_can_be_set() -> None:
    monitor = StallMonitor(StallSettings(reverse_s=0.2), 1)
    for index in range(12):
        cycle = make_cycle(now_ns=nanoseconds(0.02 * index), commanded_rad_s=(1.0,), measured_rad_s=(-1.0,))
        found = {reason.severity for reason in monitor.check(cycle)}
        assert (Severity.STOP in found) == (index >= 10)


@pytest.mark.parametrize(
    ("commanded", "measured"), [(0.5, 0.01), (-0.5, -0.01), (0.52, 0.0098), (3.0, 0.25), (-3.0, 0.25)]
)
def test_set_points_from_the_least_one_on_must_turn_a_wheel(commanded: float, measured: float) -> None:
    assert Wheels().turn(1.1, (commanded,), (measured,))


def test_a_loaded_wheel_that_creeps_by_the_droop_of_its_loop_is_not_stalled() -> None:
    # The simulated Robotino on sand: 0.62 of 0.67 rad/s are lost at 1.1 A.
    assert not Wheels().turn(5.0, (-0.67,), (-0.05,))


def test_a_set_point_that_swings_through_zero_does_not_hide_a_stall() -> None:
    wheels = Wheels()
    for _ in range(9):
        wheels.turn(0.1, (1.0,), (0.0,))
        wheels.turn(0.1, (0.2,), (0.0,))
    assert wheels.found[0].severity is Severity.SYMPTOM
    assert wheels.turn(0.14, (-1.0,), (0.0,))


@pytest.mark.parametrize(("commanded", "measured"), [(3.0, 0.26), (0.1, 0.03), (-0.1, -0.03), (0.0, 0.0)])
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


def severities(
    times_ns: tuple[int, ...], commanded_rad_s: float = 3.0, stall_s: float = 1.0
) -> list[Severity]:
    """Return the reasons' severities when a wheel at rest is checked at these times."""
    monitor = StallMonitor(StallSettings(stall_s=stall_s), 1)
    return [
        reason.severity
        for now_ns in times_ns
        for reason in monitor.check(
            make_cycle(now_ns=now_ns, commanded_rad_s=(commanded_rad_s,), measured_rad_s=(0.0,))
        )
    ]


def test_a_pause_of_the_loop_counts_for_half_of_a_stall_at_most() -> None:
    assert severities((10**9, 7 * 10**9, 7_499_999_999, 7_500_000_000)) == [
        Severity.SYMPTOM,
        Severity.SYMPTOM,
        Severity.STOP,
    ]


def test_the_time_of_a_stall_can_be_set() -> None:
    assert severities((0, 10**9, 2 * 10**9, 3 * 10**9, 4 * 10**9), stall_s=4.0)[-1] is Severity.STOP
    assert severities((0, 10**9, 2 * 10**9, 3 * 10**9, 4 * 10**9 - 1), stall_s=4.0)[-1] is Severity.SYMPTOM


def test_nothing_counts_before_the_first_cycle() -> None:
    assert severities((10**9,)) == []
    assert severities((10**9, 2 * 10**9), commanded_rad_s=0.3) == []


def test_a_wheel_without_a_measurement_is_an_error() -> None:
    monitor = StallMonitor(StallSettings(), 2)
    with pytest.raises(ValueError, match="argument 2 is shorter"):
        list(monitor.check(make_cycle(now_ns=0, commanded_rad_s=(3.0, 3.0), measured_rad_s=(0.0,))))


def reasons_at(times_s: list[float], commanded: float, *measured: float) -> list[Fault]:
    """Return the reasons of the last cycle; the wheel turns at the last speed from the second cycle on."""
    monitor = StallMonitor(StallSettings(), 1)
    for index, t_s in enumerate(times_s):
        speed = measured[min(index, len(measured) - 1)]
        cycle = make_cycle(now_ns=nanoseconds(t_s), commanded_rad_s=(commanded,), measured_rad_s=(speed,))
        found = list(monitor.check(cycle))
    return found


def test_the_limits_of_a_reversed_wheel_are_exact() -> None:
    reversed_text = "wheel 0: turns against its setpoint for 0.5 s: commanded {} rad/s, measured {} rad/s"
    (reason,) = reasons_at([0.0, 0.5], 0.25, -0.25)
    assert reason.text.startswith(reversed_text.format("0.25", "-0.25"))
    (reason,) = reasons_at([0.0, 0.5], 3.0, -0.021)
    assert reason.text.startswith(reversed_text.format("3.00", "-0.02"))
    for found in (reasons_at([0.0, 0.5], 3.0, -0.02), reasons_at([0.0, 0.5 - 1e-9], 3.0, 0.0, -1.0)):
        assert found == [
            Fault("wheels", Cause.WHEEL_STALL, "wheel 0: does not follow its setpoint", Severity.SYMPTOM)
        ]


def test_set_points_may_add_up_to_less_than_the_creep_angle() -> None:
    times_s = [0.5 * index for index in range(13)]
    assert reasons_at(times_s[:-1], 0.25, 0.0) == []
    assert reasons_at(times_s, 0.25, 0.0) != []


@pytest.mark.parametrize("measured", [0.0, 2.8])
def test_time_that_runs_back_counts_for_nothing(measured: float) -> None:
    wheels = Wheels()
    wheels.turn(0.5, (3.0,), (measured,))
    wheels.now_ns -= nanoseconds(1000.0)
    # What it had stood before still counts, the step back does not.
    assert not wheels.turn(0.02 + 0.5, (3.0,), (measured,))
    assert wheels.turn(0.02, (3.0,), (measured,)) is (measured == 0.0)
