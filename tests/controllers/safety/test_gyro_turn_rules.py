"""The gyro against the wheels: what slip can explain, and what it cannot."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest

from controllers.estimation.filter.guarded_filter import Innovation, Outcome
from controllers.estimation.filter.measurement_model import Measured
from controllers.estimation.wheels.turn_evidence import TurnEvidence, WheelTurn
from controllers.fault import Fault, Severity
from controllers.roles import DeviceRoles
from controllers.safety.gyro_turn_rules import GyroDifferenceRule, GyroFollowsRule, GyroTurnSettings
from controllers.safety.reasons import StopRule
from controllers.safety.unproven_turn import UnprovenTurn
from tests.controllers.safety.cycles import make_cycle

ROLES = DeviceRoles(wheels="wheels", gyro="imu", required={})
STEP_S = 0.02


def difference(**settings: float) -> GyroDifferenceRule:
    return GyroDifferenceRule(GyroTurnSettings.model_validate(settings), ROLES)


def follows(**settings: float) -> GyroFollowsRule:
    return GyroFollowsRule(GyroTurnSettings.model_validate(settings), ROLES, UnprovenTurn())


def evidence(gyro_rad: float, left_rad: float, right_rad: float) -> TurnEvidence:
    wheels = WheelTurn(duration_s=STEP_S, left_rad=left_rad, right_rad=right_rad)
    return TurnEvidence(gyro_rad=gyro_rad, wheels=wheels)


def check(rule: StopRule, found: TurnEvidence | None, *, is_still: bool = False) -> list[Fault]:
    return list(rule.check(make_cycle(now_ns=0, turn=found, is_still=is_still)))


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_gyro_beyond_what_spinning_and_dragged_wheels_explain_is_named(side: float) -> None:
    rule = difference()
    wheels = (0.5, 0.25) if side > 0.0 else (0.25, 0.5)
    # Bound 1.2 * 0.5 = 0.6; of 0.64 rad 0.04 remain, of 0.65 exactly the limit.
    assert check(rule, evidence(side * 0.64, *wheels)) == []
    (reason,) = check(rule, evidence(side * 0.02, 0.0, 0.0))
    direction = "left" if side > 0.0 else "right"
    assert reason.name == "gyro difference"
    assert reason.severity is Severity.STOP
    assert reason.text == (
        f"imu: yaw rate contradicts the wheels: 0.41 rad more to the {direction}, "
        "0.05 rad more than slip can explain"
    )
    assert reason.bound.gyro_rad == pytest.approx(0.66 - 0.25)


def test_what_is_within_the_bound_takes_off_the_excess_but_not_below_zero() -> None:
    rule = difference(gyro_difference_rad=0.1)
    for _ in range(100):
        assert check(rule, evidence(0.0, 0.5, 0.5)) == []
    assert check(rule, evidence(0.09, 0.0, 0.0)) == []
    assert check(rule, evidence(0.0, 0.05, 0.0)) == []
    assert check(rule, evidence(0.06, 0.0, 0.0)) == []
    (reason,) = check(rule, evidence(0.02, 0.0, 0.0))
    # The difference counts from where there was no excess: 0.09 - 0.05 + 0.06 + 0.02.
    assert reason.bound.gyro_rad == pytest.approx(0.12)


def test_the_excess_is_exact_at_its_limit() -> None:
    rule = difference(gyro_difference_rad=0.5, gyro_drag_share=0.5)
    assert check(rule, evidence(1.25, 0.5, 0.0)) == []
    assert check(rule, evidence(0.01, 0.0, 0.0)) != []


def test_an_excess_that_is_used_up_forgets_its_difference() -> None:
    rule = difference()
    check(rule, evidence(0.04, 0.0, 0.0))
    check(rule, evidence(0.0, 0.04 / 1.2, 0.0))
    (reason,) = check(rule, evidence(0.06, 0.0, 0.0))
    assert reason.bound.gyro_rad == pytest.approx(0.06)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_rest_forgets_the_excess(side: float) -> None:
    rule = difference()
    assert check(rule, evidence(side * 0.1, 0.0, 0.0)) != []
    assert check(rule, None) != []
    assert check(rule, None, is_still=True) == []
    assert check(rule, None) == []


def cycles(
    rule: GyroFollowsRule, share: float, duration_s: float, amplitude_rad_s: float = 0.3
) -> list[list[Fault]]:
    """Let the wheels swing at 2 Hz around a steady turn; the gyro, biased, measures a share of it."""
    rates_rad_s = [
        0.4 + amplitude_rad_s * math.sin(math.tau * 2.0 * index * STEP_S)
        for index in range(round(duration_s / STEP_S))
    ]
    return [
        check(rule, evidence((share * rate_rad_s + 0.1) * STEP_S, rate_rad_s * STEP_S, 0.0))
        for rate_rad_s in rates_rad_s
    ]


def turn(rule: GyroFollowsRule, share: float, duration_s: float, amplitude_rad_s: float = 0.3) -> list[Fault]:
    """Return the last reasons of `cycles`."""
    return cycles(rule, share, duration_s, amplitude_rad_s)[-1]


@pytest.mark.parametrize("share", [0.15, 0.5, 1.0, 1.3])
def test_a_gyro_that_follows_is_right_however_much_the_wheels_slip(share: float) -> None:
    assert [reason for reasons in cycles(follows(), share, 5.0) for reason in reasons] == []


@pytest.mark.parametrize(("share", "percent"), [(0.0, 0), (-1.0, -100), (0.05, 5)])
def test_a_gyro_that_does_not_follow_is_named_after_less_than_a_second(share: float, percent: int) -> None:
    found = cycles(follows(), share, 3.0)
    severities = [reason.severity for reasons in found for reason in reasons]
    begin = len(found) - len(severities)
    # 0.7 s: 35 cycles, the first one included.
    last = Severity.FINAL if share < 0.0 else Severity.UNCERTAIN
    assert severities == [Severity.SYMPTOM] * 34 + [last] * (150 - begin - 34)
    assert begin < 12
    (reason,) = found[-1]
    assert reason.name == "gyro follows"
    name, measured, rest = re.split(r" follows (\S+) % ", reason.text)
    assert (name, rest) == (
        "imu: yaw rate",
        "of the changes of the wheels' turn rate for 0.7 s: no signal, wrong axis, wrong sign, or wheels "
        "without grip" + ("" if share < 0.0 else "; the yaw is uncertain by both, yaw unwatched"),
    )
    assert int(measured) == percent
    # As far as the two differ: the steady turn, and the gyro's bias the other way.
    # And 0.3 of the motion on which the gyro was not seen to be alive.
    differs_rad = ((1.0 - share) * 0.4 - 0.1) * STEP_S * len(severities)
    assert reason.bound.gyro_rad == pytest.approx(differs_rad + 0.3 * 0.4 * 3.0, rel=0.1)


def noisy(rule: GyroFollowsRule, share: float, noise: float, duration_s: float) -> list[Fault]:
    """Return the last reasons where the gyro measures a share of the changes, and noise."""
    rng = np.random.default_rng(1)
    found: list[Fault] = []
    for index in range(round(duration_s / STEP_S)):
        rate_rad_s = 0.3 * math.sin(math.tau * 2.0 * index * STEP_S)
        gyro_rad_s = share * rate_rad_s + noise * rng.standard_normal()
        found = check(rule, evidence(gyro_rad_s * STEP_S, rate_rad_s * STEP_S, 0.0))
    return found


@pytest.mark.parametrize(
    ("share", "noise", "severity"),
    [
        (0.0, 0.05, Severity.UNCERTAIN),
        (-0.1, 0.1, Severity.UNCERTAIN),
        (-0.3, 0.0, Severity.UNCERTAIN),
        (-0.36, 0.0, Severity.FINAL),
        (-0.5, 0.02, Severity.FINAL),
    ],
)
def test_only_a_gyro_that_turns_against_the_wheels_stops_for_good(
    share: float, noise: float, severity: Severity
) -> None:
    (reason,) = noisy(follows(), share, noise, 3.0)
    assert reason.severity is severity


def test_a_gyro_must_turn_against_the_wheels_for_as_long_as_it_does_not_follow_them() -> None:
    rule = follows()
    turn(rule, 0.0, 0.5)
    assert [reason.severity for reason in turn(rule, -1.0, 0.7)] == [Severity.UNCERTAIN]
    assert [reason.severity for reason in turn(rule, -1.0, 0.5)] == [Severity.FINAL]
    turn(rule, 0.0, 0.5)
    assert [reason.severity for reason in turn(rule, -1.0, 0.5)] == [Severity.UNCERTAIN]


def test_a_gyro_that_follows_again_has_not_turned_against_the_wheels() -> None:
    rule = follows()
    turn(rule, -1.0, 0.8)
    assert turn(rule, 1.0, 2.0) == []
    severities = [reason.severity for reasons in cycles(rule, -1.0, 0.9) for reason in reasons]
    assert Severity.FINAL not in severities[:34]


def test_while_fixes_agree_with_the_yaw_a_gyro_that_does_not_follow_is_a_suspicion() -> None:
    rule = GyroFollowsRule(GyroTurnSettings(), replace(ROLES, fixes=("overhead",)), UnprovenTurn())

    def fix(residual_rad: float) -> None:
        innovation = Innovation(
            measured=Measured("overhead", "yaw"),
            residual=residual_rad,
            variance=1.0,
            nis=residual_rad**2,
            outcome=Outcome.ACCEPTED,
        )
        list(rule.check(make_cycle(now_ns=0, innovations=(innovation,))))

    fix(0.0)
    assert [reason.severity for reason in turn(rule, 0.0, 2.0)] == [Severity.WARNING]
    assert [reason.severity for reason in turn(rule, -1.0, 2.0)] == [Severity.FINAL]
    fix(3.0)
    turn(rule, 1.0, 2.0)
    assert [reason.severity for reason in turn(rule, 0.0, 2.0)] == [Severity.UNCERTAIN]
    fix(4.0)
    (reason,) = turn(rule, 0.0, 2.0)
    assert reason.severity is Severity.STOP
    assert reason.text.endswith("wheels without grip; the rover turns otherwise than the gyro measures")


def test_small_changes_are_no_evidence() -> None:
    assert turn(follows(), 0.0, 5.0, amplitude_rad_s=0.06) == []
    assert turn(follows(gyro_follow_rad_s=0.02), 0.0, 5.0, amplitude_rad_s=0.06) != []


def test_following_again_and_rest_clear() -> None:
    rule = follows()
    assert turn(rule, 0.0, 0.8) != []
    assert turn(rule, 1.0, 2.0) == []
    found = turn(rule, 0.0, 0.8)
    assert [reason.severity for reason in found] == [Severity.SYMPTOM]
    assert check(rule, None) == found
    assert check(rule, None, is_still=True) == []
    assert [reason.severity for reason in turn(rule, 0.0, 0.6)] == [Severity.SYMPTOM]


def test_a_pause_of_the_changes_neither_counts_nor_clears() -> None:
    rule = follows()
    assert [reason.severity for reason in turn(rule, 0.0, 0.3)] == [Severity.SYMPTOM]
    assert [reason.severity for reason in turn(rule, 0.0, 5.0, amplitude_rad_s=0.0)] == [Severity.SYMPTOM]
    assert [reason.severity for reason in turn(rule, 0.0, 0.6)] == [Severity.UNCERTAIN]


def test_the_difference_counts_from_the_rest() -> None:
    rule = follows()
    turn(rule, 0.0, 0.8)
    assert check(rule, None, is_still=True) == []
    found = cycles(rule, 0.0, 0.8)
    (reason,) = found[-1]
    # The motion before the rest has not shown that the gyro is alive, either.
    assert reason.bound.gyro_rad == pytest.approx(
        0.3 * STEP_S * sum(map(len, found)) + 0.3 * 0.4 * 1.6, rel=0.2
    )


def test_the_limits_are_exact() -> None:
    def step(rule: GyroFollowsRule, wheels_rad_s: float, gyro_rad_s: float, duration_s: float) -> list[Fault]:
        wheels = WheelTurn(duration_s=duration_s, left_rad=wheels_rad_s * duration_s)
        return check(rule, TurnEvidence(gyro_rad=gyro_rad_s * duration_s, wheels=wheels))

    long_s, half_s = 1024.0, 0.25 * math.log(2.0)
    """After the first two the averages are those of their rates, after the next half-way to its own."""
    rule = follows(gyro_follow_rad_s=0.0625)
    assert step(rule, 0.0, 0.0, long_s) + step(rule, 0.0, 0.0, long_s) == []
    assert step(rule, 0.125, 0.0, half_s) == []  # a standard deviation of 0.0625
    rule = follows(gyro_follow_share=0.125)
    assert step(rule, 0.0, 0.0, long_s) + step(rule, 0.0, 0.0, long_s) == []
    assert step(rule, 0.125, 0.125 * 0.125, half_s) == []
    rule = follows(gyro_follow_share=0.126, gyro_follow_s=2.0 * half_s)
    assert step(rule, 0.0, 0.0, long_s) + step(rule, 0.0, 0.0, long_s) == []
    (sign,) = step(rule, 0.125, 0.125 * 0.125, half_s)
    (stop,) = step(rule, 0.125, 0.125 * 0.125, half_s)
    assert (sign.severity, stop.severity) == (Severity.SYMPTOM, Severity.UNCERTAIN)


def jittered(rule: GyroFollowsRule, duration_s: float, swing_rad_s: float, share: float) -> list[Fault]:
    """Drive at 0.5 m/s with wrong stamps; return the last reasons.

    The stamps of the wheels of both sides, 0.4 m apart, are wrong by 2 ms each. The rover swings at 5 Hz, of
    which the gyro measures a share.
    """
    rng, steps = np.random.default_rng(3), round(duration_s / STEP_S)
    wrong_rad = np.diff(0.5 / 0.4 * 0.002 * rng.standard_normal((steps + 1, 2)), axis=0)
    swing_rad = swing_rad_s * STEP_S * np.sin(math.tau * 5.0 * STEP_S * np.arange(steps))
    found: list[Fault] = []
    for turned_rad, (left_rad, right_rad) in zip(swing_rad.tolist(), wrong_rad.tolist(), strict=True):
        forward_rad = 0.5 / 0.4 * STEP_S
        sides = (forward_rad + turned_rad + left_rad, forward_rad + right_rad)
        found = check(rule, evidence(share * turned_rad, *sides))
        if found:
            break
    return found


def test_wrong_time_stamps_of_the_wheels_are_no_turns() -> None:
    assert jittered(follows(), 300.0, 0.0, 0.0) == []
    assert jittered(follows(), 60.0, 0.5, 0.5) == []


def test_among_wrong_time_stamps_a_gyro_that_does_not_follow_is_named() -> None:
    rule = follows()
    assert jittered(rule, 60.0, 0.0, 0.0) == []
    (sign,) = jittered(rule, 2.0, 0.5, 0.0)
    assert sign.cause == "gyro follows"


def test_noise_counts_three_times_against_changes() -> None:
    """Turn rates of 0, 1, 0, 1, ... have a variance of 1 / 4, but noise of 1 / 2; with 0, 0, 1, 1 none."""
    for period, is_turning in ((1, False), (2, True)):
        rule = follows(gyro_follow_s=60.0)
        for step in range(400):
            found = check(rule, evidence(0.0, STEP_S * (step // period % 2), 0.0))
        assert bool(found) == is_turning
