"""Turns of the wheels on the spot that the gyro has not measured."""

import pytest

from controllers.estimation.filter.guarded_filter import Innovation, Outcome
from controllers.estimation.filter.measurement_model import Measured
from controllers.estimation.wheels.turn_evidence import TurnEvidence, WheelTurn
from controllers.fault import Fault, Severity
from controllers.roles import DeviceRoles
from controllers.safety.gyro_turn_rules import GyroTurnSettings
from controllers.safety.missed_turn_rule import MissedTurnRule
from controllers.safety.unproven_turn import UnprovenTurn
from tests.controllers.safety.cycles import make_cycle

ROLES = DeviceRoles(wheels="wheels", gyro="imu", fixes=("overhead",), required={})


def turn(
    rule: MissedTurnRule,
    share: float,
    left_rad: float,
    right_rad: float,
    steps: int,
    duration_s: float = 0.25,
) -> list[Fault]:
    """Return the reasons of some cycles with the same turn, of which the gyro measures a share."""
    wheels = WheelTurn(duration_s=duration_s, left_rad=left_rad, right_rad=right_rad)
    cycle = make_cycle(now_ns=0, turn=TurnEvidence(gyro_rad=share * wheels.turn_rad, wheels=wheels))
    return [reason for _ in range(steps) for reason in rule.check(cycle)]


def make_rule(unproven: UnprovenTurn | None = None) -> MissedTurnRule:
    return MissedTurnRule(GyroTurnSettings(), ROLES, unproven or UnprovenTurn())


@pytest.mark.parametrize("sides", [(0.125, 0.0), (0.0, 0.125)])
def test_a_steady_turn_without_a_signal_of_the_gyro_is_named_and_widens_the_yaw(
    sides: tuple[float, float],
) -> None:
    rule = make_rule()
    assert turn(rule, 0.05, *sides, 3) == []
    (reason,) = turn(rule, 0.05, *sides, 1)
    assert reason.severity is Severity.UNCERTAIN
    assert reason.name == "missed turn"
    assert reason.text.startswith("imu: measures 5 % of a turn of 0.50 rad by the wheels: ")
    assert reason.text.endswith("; the yaw is uncertain by both")
    assert reason.bound.gyro_rad == pytest.approx(0.475)
    assert turn(rule, 0.05, *sides, 3) == []
    assert turn(rule, 0.05, *sides, 1) != []


@pytest.mark.parametrize(("share", "severity"), [(-0.49, Severity.UNCERTAIN), (-0.51, Severity.FINAL)])
def test_a_gyro_that_turns_the_other_way_stops_for_good(share: float, severity: Severity) -> None:
    (reason,) = turn(make_rule(), share, 0.5, 0.0, 1)
    assert reason.severity is severity


@pytest.mark.parametrize("share", [0.11, 0.5, 1.0])
def test_a_gyro_that_measures_a_tenth_of_the_turn_is_alive(share: float) -> None:
    unproven = UnprovenTurn()
    unproven.add(WheelTurn(left_rad=1.0))
    rule = make_rule(unproven)
    # 0.3 of the motion on which the gyro was not seen to be alive.
    (reason,) = turn(rule, 0.0, 0.5, 0.0, 1)
    assert reason.bound.gyro_rad == pytest.approx(0.5 + 0.3)
    assert turn(rule, share, 0.5, 0.0, 1) == []
    assert unproven.error_rad(0.0) == 0.0


def test_wheels_that_move_the_rover_more_than_they_turn_it_are_no_evidence() -> None:
    """Uneven slip lets the wheels of a rover turn that goes straight ahead."""
    assert turn(make_rule(), 0.0, 0.95, 0.052, 10) == []
    assert turn(make_rule(), 0.0, 0.95, 0.049, 10) != []


def test_a_straight_part_begins_a_new_turn() -> None:
    rule = make_rule()
    turn(rule, 0.0, 0.4, 0.0, 1)
    turn(rule, 0.0, 0.4, 0.4, 1)
    assert turn(rule, 0.0, 0.4, 0.0, 1) == []


def test_parts_are_judged_as_a_whole() -> None:
    """A step of one wheel is no turn: its neighbour follows in the next cycle."""
    rule = make_rule()
    for _ in range(20):
        assert turn(rule, 0.0, 0.2, 0.0, 1, duration_s=0.1) == []
        assert turn(rule, 0.0, 0.0, 0.2, 1, duration_s=0.1) == []
        assert turn(rule, 0.0, 0.0, 0.0, 1, duration_s=0.1) == []


def test_without_evidence_there_is_no_verdict() -> None:
    assert list(make_rule().check(make_cycle(now_ns=0))) == []


def test_while_fixes_agree_with_the_yaw_it_is_a_suspicion() -> None:
    rule = make_rule()
    accepted = Innovation(
        measured=Measured("overhead", "yaw"), residual=0.0, variance=1.0, nis=0.0, outcome=Outcome.ACCEPTED
    )
    assert list(rule.check(make_cycle(now_ns=0, innovations=(accepted,)))) == []
    (reason,) = turn(rule, 0.0, 0.5, 0.0, 1)
    assert reason.severity is Severity.WARNING


def test_where_fixes_contradict_the_yaw_the_gyro_is_dead() -> None:
    unproven = UnprovenTurn()
    rule = make_rule(unproven)
    contradicting = Innovation(
        measured=Measured("overhead", "yaw"), residual=0.4, variance=0.01, nis=16.0, outcome=Outcome.REJECTED
    )
    assert list(rule.check(make_cycle(now_ns=0, innovations=(contradicting,)))) == []
    was_dead = [unproven.is_dead]
    (reason,) = turn(rule, 0.0, 0.5, 0.0, 1)
    assert reason.severity is Severity.STOP
    was_dead.append(unproven.is_dead)
    assert turn(rule, 1.0, 0.5, 0.0, 1) == []
    assert [*was_dead, unproven.is_dead] == [False, True, False]
