"""Drives that obey a part of their setpoints and do not report it."""

from collections.abc import Callable

import pytest

from controllers.fault import Fault, Severity
from controllers.roles import DeviceRoles
from controllers.safety.response_rule import ResponseRule, ResponseSettings
from drivers.clock import nanoseconds
from tests.controllers.safety.cycles import make_cycle

CYCLE_S = 0.02
STOPS = ResponseSettings(response_ratio=0.5)


class Wheels:
    """A rule on a cycle of 20 ms."""

    def __init__(self, settings: ResponseSettings = STOPS, **roles_of: frozenset[int]) -> None:
        roles = DeviceRoles(wheels="wheels", required={}, **roles_of)  # type: ignore[arg-type]
        self.rule = ResponseRule(settings, roles, wheel_count=2)
        self.now_ns = 0
        self.found: list[Fault] = []

    def cycle(self, commanded: tuple[float, float], measured: tuple[float, float]) -> None:
        self.found = list(
            self.rule.check(
                make_cycle(now_ns=self.now_ns, commanded_rad_s=commanded, measured_rad_s=measured)
            )
        )
        self.now_ns += nanoseconds(CYCLE_S)

    def turn(
        self, duration_s: float, commanded: tuple[float, float], measured: tuple[float, float]
    ) -> list[Severity]:
        """Return the severities at the end of this time."""
        for _ in range(round(duration_s / CYCLE_S)):
            self.cycle(commanded, measured)
        return [reason.severity for reason in self.found]


def test_a_drive_that_obeys_two_fifths_stops_the_rover_within_the_time() -> None:
    wheels = Wheels()
    assert not wheels.turn(20.0, (3.0, -3.0), (2.9, -2.9))
    assert Severity.RECOVERABLE not in wheels.turn(2.0, (3.0, -3.0), (2.9, -1.2))
    assert wheels.turn(3.0, (3.0, -3.0), (2.9, -1.2)) == [Severity.RECOVERABLE]
    (reason,) = wheels.found
    assert reason.name == "response"
    assert reason.text.startswith("wheel 1: turns at 4")
    assert "of its setpoints over 5 s of driving" in reason.text


def test_without_a_setting_it_is_a_warning() -> None:
    wheels = Wheels(ResponseSettings())
    assert wheels.turn(60.0, (3.0, 3.0), (0.4, 1.2)) == [Severity.WARNING] * 2


def test_a_warning_comes_before_the_stop() -> None:
    wheels, seen = Wheels(ResponseSettings(response_ratio=0.45)), []
    wheels.turn(20.0, (3.0, 3.0), (2.9, 2.9))
    for _ in range(250):
        seen += [each for each in wheels.turn(CYCLE_S, (3.0, 3.0), (1.2, 2.9)) if each not in seen]
    assert seen == [Severity.WARNING, Severity.RECOVERABLE]


@pytest.mark.parametrize("setting_s", [5.0, 10.0])
def test_it_warns_after_half_of_its_time_of_driving_and_stops_after_all_of_it(setting_s: float) -> None:
    wheels = Wheels(ResponseSettings(response_ratio=0.5, response_s=setting_s))
    assert not wheels.turn(0.46 * setting_s, (3.0, 3.0), (1.2, 1.2))
    assert wheels.turn(0.1 * setting_s, (3.0, 3.0), (1.2, 1.2)) == [Severity.WARNING] * 2
    assert f"over {0.5 * setting_s:g} s of driving" in wheels.found[0].text
    assert wheels.turn(0.38 * setting_s, (3.0, 3.0), (1.2, 1.2)) == [Severity.WARNING] * 2
    assert wheels.turn(0.08 * setting_s, (3.0, 3.0), (1.2, 1.2)) == [Severity.RECOVERABLE] * 2


@pytest.mark.parametrize(
    ("commanded", "measured"),
    [
        pytest.param(3.0, 1.9, id="63 %"),
        pytest.param(0.9, 0.41, id="46 %, which the load may take"),
        pytest.param(0.49, 0.05, id="too small a setpoint"),
        pytest.param(3.0, 0.2, id="stalled, of which the stall monitor judges"),
        pytest.param(3.0, -1.0, id="against its setpoint, too"),
    ],
)
def test_what_is_no_evidence(commanded: float, measured: float) -> None:
    assert not Wheels().turn(60.0, (commanded, commanded), (measured, measured))


def lagging(time_constant_s: float) -> Callable[[float, float], float]:
    """Return a drive that follows its setpoint like a low-pass."""
    return lambda speed, set_point: speed + (set_point - speed) * CYCLE_S / time_constant_s


@pytest.mark.parametrize("period_s", [0.5, 1.0, 2.0, 5.0])
def test_a_drive_that_lags_behind_its_ramps_is_healthy(period_s: float) -> None:
    wheels, follow, speed = Wheels(), lagging(0.3), 0.0
    for cycle in range(round(60.0 / CYCLE_S)):
        set_point = 4.0 if (cycle * CYCLE_S) % period_s < 0.5 * period_s else -4.0
        speed = follow(speed, set_point)
        wheels.cycle((set_point, 3.0), (speed, 2.5))
        assert not wheels.found


def test_times_at_rest_do_not_count_and_do_not_clear() -> None:
    wheels = Wheels()
    assert Severity.RECOVERABLE not in wheels.turn(3.0, (3.0, 3.0), (3.0, 1.2))
    assert Severity.RECOVERABLE not in wheels.turn(40.0, (0.0, 0.0), (0.0, 0.0))
    assert wheels.turn(3.0, (3.0, 3.0), (3.0, 1.2)) == [Severity.RECOVERABLE]


def test_after_a_stop_for_it_the_wheels_are_measured_again() -> None:
    wheels = Wheels()
    assert wheels.turn(6.0, (3.0, 3.0), (3.0, 1.2)) == [Severity.RECOVERABLE]
    wheels.turn(2 * CYCLE_S, (0.0, 0.0), (0.0, 0.0))
    assert Severity.RECOVERABLE not in wheels.turn(4.0, (3.0, 3.0), (3.0, 1.2))
    assert wheels.turn(1.5, (3.0, 3.0), (3.0, 1.2)) == [Severity.RECOVERABLE]


@pytest.mark.parametrize("role", ["unmeasured_wheels", "undriven_wheels"])
def test_a_wheel_without_an_encoder_or_without_a_motor_is_not_judged(role: str) -> None:
    assert not Wheels(STOPS, **{role: frozenset({1})}).turn(10.0, (3.0, 3.0), (3.0, 1.2))


def test_a_pause_of_the_loop_counts_for_a_part_of_the_window() -> None:
    wheels = Wheels()
    wheels.turn(20.0, (3.0, 3.0), (3.0, 3.0))
    wheels.turn(0.1, (3.0, 3.0), (1.2, 1.2))
    wheels.now_ns += nanoseconds(60.0)
    assert not wheels.turn(0.1, (3.0, 3.0), (1.2, 1.2))


def found_by(set_point: Callable[[float], float], follow: Callable[[float, float], float]) -> set[Severity]:
    """Return what is found on one wheel within 14 s."""
    wheels, speed, found = Wheels(), 0.0, set()
    for cycle in range(round(14.0 / CYCLE_S)):
        commanded = set_point(cycle * CYCLE_S)
        speed = follow(speed, commanded)
        wheels.cycle((commanded, 3.0), (speed, 2.9))
        found |= {reason.severity for reason in wheels.found}
    return found


@pytest.mark.parametrize(("on_s", "period_s"), [(0.2, 0.5), (0.3, 1.0), (0.1, 1.0)])
def test_a_drive_that_obeys_a_part_of_the_time_stops_the_rover(on_s: float, period_s: float) -> None:
    cycles = iter(range(10_000))
    found = found_by(
        lambda _: 4.0, lambda _, wanted: wanted if next(cycles) * CYCLE_S % period_s < on_s else 0.0
    )
    assert Severity.RECOVERABLE in found


SET_POINTS = {
    "short moves": lambda t_s: 4.0 if t_s % 1.5 < 0.5 else 0.0,
    "steps": lambda t_s: 4.0 if t_s % 0.8 < 0.4 else 1.0,
    "slows down": lambda t_s: 4.0 if t_s < 8.0 else max(1.2, 4.0 - 0.9 * (t_s - 8.0)),
    "reversals": lambda t_s: 4.0 if t_s % 2.0 < 1.0 else -4.0,
}


@pytest.mark.parametrize("name", SET_POINTS)
@pytest.mark.parametrize("time_constant_s", [CYCLE_S, 0.1, 0.3])
def test_setpoints_that_change_hide_no_weak_drive_and_blame_no_healthy_one(
    name: str, time_constant_s: float
) -> None:
    follow = lagging(time_constant_s)
    found = found_by(SET_POINTS[name], lambda speed, wanted: follow(speed, 0.4 * wanted))
    assert Severity.RECOVERABLE in found or (name == "short moves" and Severity.WARNING in found)
    assert not found_by(SET_POINTS[name], follow)


def test_a_loaded_drive_that_slows_down_at_once_is_healthy() -> None:
    assert not found_by(
        lambda t_s: max(0.6, 4.0 - 0.8 * max(0.0, t_s - 6.0)), lambda _, wanted: wanted - 0.45
    )


def test_a_wheel_that_stalls_again_and_again_is_left_to_the_stall_monitor() -> None:
    wheels = Wheels()
    for _ in range(20):
        assert not wheels.turn(0.98, (3.0, 3.0), (2.9, 0.0))
        assert not wheels.turn(1.0, (0.0, 0.0), (0.0, 0.0))
