"""Turns by gyro and wheels that exclude each other, and what would explain them."""

import math

import pytest

from controllers.estimation.wheels.turn_evidence import TurnEvidence, WheelTurn
from controllers.fault import Fault
from controllers.roles import DeviceRoles
from controllers.safety.reasons import Cycle
from controllers.safety.turn_comparison import TurnComparison
from tests.controllers.safety.cycles import make_cycle

STEP_S = 0.02
ROLES = DeviceRoles(wheels="wheels", gyro="imu", required={})
UNSURE = "; this drive does not show which"


def cycle(gyro_rad_s: float, parts_rad_s: tuple[float, ...]) -> Cycle:
    """Return a cycle of a rover whose wheels turn it at these rates together."""
    wheels = WheelTurn(
        duration_s=STEP_S,
        left_rad=STEP_S * sum(max(0.0, part) for part in parts_rad_s),
        right_rad=STEP_S * sum(max(0.0, -part) for part in parts_rad_s),
    )
    parts = tuple(STEP_S * part for part in parts_rad_s)
    evidence = TurnEvidence(gyro_rad=STEP_S * gyro_rad_s, wheels=wheels, by_wheel_rad=parts)
    return make_cycle(now_ns=0, turn=evidence)


def reasons_of(gyro_rad_s: float, parts_rad_s: tuple[float, ...], duration_s: float) -> list[Fault]:
    """Return the reasons of a turn after a straight second, and of the rest behind it."""
    rule = TurnComparison(ROLES)
    cycles = [cycle(0.0, (0.4, -0.4))] * round(1.0 / STEP_S)
    cycles += [cycle(gyro_rad_s, parts_rad_s)] * round(duration_s / STEP_S)
    cycles += [make_cycle(now_ns=0), make_cycle(now_ns=0, is_still=True)]
    return [reason for each in cycles for reason in rule.check(each)]


@pytest.mark.parametrize(
    ("gyro_rad_s", "parts_rad_s", "why"),
    [
        (-1.0, (0.5, 0.5), f"sign of the gyro, or left and right exchanged{UNSURE}"),
        (
            -1.0,
            (0.02, 0.98),
            f"sign of the gyro, or left and right exchanged, or wheel 1 counts backwards{UNSURE}",
        ),
        (0.0, (0.5, 0.5), f"wheel 0 or 1 counts backwards{UNSURE}"),
        (-0.6, (0.2, 0.8), "wheel 1 counts backwards"),
        (57.3, (0.5, 0.5), "the gyro sends deg/s that are taken for rad/s"),
        (0.0175, (0.8, 0.2), "the gyro sends rad/s that are taken for deg/s"),
        (0.12, (0.5, 0.5), "the gyro measures 12 % of it: no signal, wrong axis or scale, or wheels"),
        (2.0, (0.5, 0.5), "the gyro measures 2 times as much: scale or unit of the gyro, ticks"),
        (-2.0, (0.5, 0.5), "the gyro measures -2 times as much: scale or unit of the gyro"),
        (-0.5, (0.5, 0.5), "opposite senses: sign or axis of the gyro, or wheels that slip"),
    ],
)
def test_a_turn_that_cannot_be_is_told_with_what_would_explain_it(
    gyro_rad_s: float, parts_rad_s: tuple[float, ...], why: str
) -> None:
    reasons = reasons_of(gyro_rad_s, parts_rad_s, 1.0)
    assert reasons
    for reason in reasons:
        assert reason.name == "turn"
        assert reason.bound.is_motion_unknown
        assert f"in this turn: {why}" in reason.text


@pytest.mark.parametrize(
    ("gyro_rad_s", "parts_rad_s"),
    [
        (1.0, (0.5, 0.5)),
        (0.8, (0.5, 0.5)),
        (0.4, (0.5, 0.5)),  # wheels of a rover that skids
        (1.4, (0.5, 0.5)),
        (0.0, (5.0, -4.4)),  # uneven radii, straight ahead
        (-0.1, (0.05, 0.05)),  # a small turn
    ],
)
def test_a_turn_that_slip_explains_is_not_told(gyro_rad_s: float, parts_rad_s: tuple[float, ...]) -> None:
    assert reasons_of(gyro_rad_s, parts_rad_s, 1.0) == []


def test_numbers_are_those_of_the_turn_alone_and_a_long_one_is_told_in_parts() -> None:
    (reason,) = reasons_of(-1.0, (0.5, 0.5), 1.57)
    assert "wheels +1.560 rad, gyro -1.560 rad" in reason.text
    assert len(reasons_of(-1.0, (0.5, 0.5), 10.0)) == 6


def test_a_turn_ends_on_a_straight_and_its_size_has_a_floor() -> None:
    rule = TurnComparison(ROLES)
    turn = [cycle(-1.0, (0.5, 0.5))] * round(0.6 / STEP_S)
    straight = [cycle(0.0, (0.4, -0.4))] * round(0.5 / STEP_S)
    found = [[*rule.check(each)] for each in [*turn, *straight, cycle(0.0, (0.4, -0.4))]]
    assert sum(map(len, found)) == 1
    assert found[len(turn) + len(straight)] or found[len(turn) + len(straight) - 1]
    assert math.isclose(len(turn) * STEP_S, 0.6)
