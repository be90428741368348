"""The turn on which no rule has seen the gyro measure anything."""

import math

import pytest

from controllers.estimation.wheels.turn_evidence import TurnEvidence, WheelTurn
from controllers.fault import Fault
from controllers.roles import DeviceRoles
from controllers.safety.gyro_turn_rules import GyroFollowsRule
from controllers.safety.missed_turn_rule import MissedTurnRule
from controllers.safety.settings import SafetySettings, make_rules
from controllers.safety.unproven_turn import UnprovenTurn
from tests.controllers.safety.cycles import make_cycle

STEP_S = 0.02


def test_the_yaw_is_as_wrong_as_the_missed_turn_and_a_share_of_the_unproven_one() -> None:
    unproven = UnprovenTurn()
    assert unproven.error_rad(0.2) == 0.2
    unproven.add(WheelTurn(left_rad=3.0, right_rad=4.0))
    assert unproven.error_rad(0.2) == pytest.approx(0.2 + 0.3 * 5.0)
    unproven.prove()
    assert unproven.error_rad(0.2) == 0.2


def test_a_yaw_is_wrong_by_half_a_turn_at_most() -> None:
    unproven = UnprovenTurn()
    unproven.add(WheelTurn(left_rad=100.0, right_rad=100.0))
    assert unproven.error_rad(1.0) == math.pi


class Gyro:
    """Both rules as they are in force, and a gyro that measures a share of the turn."""

    def __init__(self) -> None:
        roles = DeviceRoles(wheels="wheels", gyro="imu", required={})
        rules = make_rules(SafetySettings(), roles, 2, 0.0)
        self.rules = [rule for rule in rules if isinstance(rule, GyroFollowsRule | MissedTurnRule)]

    def drive(self, share: float, rates_rad_s: list[tuple[float, float]]) -> list[Fault]:
        """Return the reasons while the wheels turn the rover to the left and to the right at these rates."""
        found: list[Fault] = []
        for left_rad_s, right_rad_s in rates_rad_s:
            wheels = WheelTurn(STEP_S, left_rad_s * STEP_S, right_rad_s * STEP_S)
            cycle = make_cycle(now_ns=0, turn=TurnEvidence(share * wheels.turn_rad, wheels))
            found += [reason for rule in self.rules for reason in rule.check(cycle)]
        return found


STRAIGHT = [(1.0, 1.0)] * 1000
SWEEP = [(1.0 + 0.3 * math.sin(math.tau * 2.0 * index * STEP_S), 1.0) for index in range(100)]
TURN = [(1.0, 0.0)] * 60


def test_after_a_long_straight_drive_the_yaw_is_wrong_by_half_a_turn_at_most() -> None:
    gyro = Gyro()
    assert gyro.drive(1.0, STRAIGHT) == []
    assert [reason.bound.gyro_rad for reason in gyro.drive(0.0, TURN)][-1] == math.pi


def test_what_one_rule_has_proven_the_other_does_not_doubt() -> None:
    gyro = Gyro()
    gyro.drive(1.0, STRAIGHT + SWEEP + STRAIGHT[:100])
    missed = [reason for reason in gyro.drive(0.0, TURN) if reason.name == "missed turn"]
    # The missed turn, and 0.3 of what the wheels of both sides have turned since the sweep, whose evidence
    # fades over a part of a second.
    assert missed[0].bound.gyro_rad == pytest.approx(0.5 + 0.3 * (math.hypot(2.0, 2.0) + 0.5), rel=0.2)
    gyro = Gyro()
    # The turn rate does not change: `GyroFollowsRule` alone has no evidence.
    gyro.drive(1.0, [(1.0, 0.0)] * 1000)
    sweep = [(left_rad_s, 0.0) for left_rad_s, _ in SWEEP]
    followed = [reason for reason in gyro.drive(0.0, sweep) if reason.name == "gyro follows"]
    assert followed[0].bound.gyro_rad < 0.3
