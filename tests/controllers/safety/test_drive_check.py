"""The rules on a drive that somebody else controls."""

import itertools

import pytest

from controllers.fault import WHEELS_CONTRADICTED, Bound, Cause, Fault, Severity
from controllers.roles import DeviceRoles
from controllers.safety.drive_check import DriveCheck
from controllers.safety.reasons import Cycle, StopRule
from controllers.safety.recorded_rules import StandingWheelsRule, ZeroReadingsRule
from controllers.safety.settings import SafetySettings, make_drive_rules, make_rules
from drivers.clock import nanoseconds
from drivers.samples import AttitudeSample, BumperSample, RateSample, Sample
from rover_hil.recording.findings import FindingList, finding_lines
from tests.controllers.safety.cycles import changed, make_cycle

ROLES = DeviceRoles(wheels="wheels", gyro="imu", required={"wheels": 0.1, "imu": 0.1})

CLOCK_NS = itertools.count()


class Scripted(StopRule):
    """Gives the reasons that a test puts there."""

    def __init__(self) -> None:
        self.reasons: list[Fault] = []

    def check(self, cycle: Cycle) -> list[Fault]:
        return self.reasons


@pytest.fixture
def scripted(monkeypatch: pytest.MonkeyPatch) -> tuple[DriveCheck, Scripted]:
    rule = Scripted()
    monkeypatch.setattr("controllers.safety.drive_check.make_drive_rules", lambda *_: (rule,))
    return DriveCheck(SafetySettings(), ROLES, 2, 0.0), rule


def causes(check: DriveCheck, rule: Scripted, *reasons: Fault) -> list[str]:
    rule.reasons = list(reasons)
    check.update(make_cycle(now_ns=next(CLOCK_NS)))
    return [finding.cause for finding in check.findings]


def test_a_finding_is_told_when_it_begins(scripted: tuple[DriveCheck, Scripted]) -> None:
    check, rule = scripted
    one, other = (
        Fault("imu", Cause.GYRO_JUMP, "1", bound=Bound(gyro_rad=0.5)),
        Fault("imu", Cause.GYRO_BIAS, "2", Severity.FINAL),
    )
    assert causes(check, rule) == []
    assert causes(check, rule, one) == ["gyro jump"]
    assert [fault.bound.gyro_rad for fault in check.faults] == [0.5]
    assert causes(check, rule, one, other) == ["gyro bias"]
    assert causes(check, rule) == []
    assert causes(check, rule, one) == ["gyro jump"]
    assert not check.is_open


def test_a_sign_is_no_finding_until_it_is_more(scripted: tuple[DriveCheck, Scripted]) -> None:
    check, rule = scripted
    sign = Fault("imu", Cause.GYRO_DOES_NOT_FOLLOW, "", Severity.SYMPTOM, Bound(is_motion_unknown=True))
    opened = []
    for reason in (sign, sign._replace(severity=Severity.FINAL), sign):
        found = causes(check, rule, reason)
        opened.append((found, check.is_open))
    assert opened == [([], False), (["gyro follows"], True), ([], True)]


@pytest.mark.parametrize("severity", [Severity.UNCERTAIN, Severity.RECOVERABLE])
def test_what_a_healthy_rover_may_show_once_is_told_the_second_time(
    scripted: tuple[DriveCheck, Scripted], severity: Severity
) -> None:
    check, rule = scripted
    grip = Fault("imu", Cause.MISSED_TURN, "", severity)
    assert causes(check, rule, grip) == []
    assert causes(check, rule, grip) == []
    assert causes(check, rule) == []
    assert causes(check, rule, grip) == ["missed turn"]
    assert causes(check, rule, grip) == []


def test_a_doubt_that_is_no_finding_is_told_while_it_widens(scripted: tuple[DriveCheck, Scripted]) -> None:
    check, rule = scripted
    grip = Fault("imu", Cause.MISSED_TURN, "gyro or grip 1 %", Severity.UNCERTAIN, Bound(gyro_rad=3.0))
    told = FindingList()
    for t_s, reasons in enumerate(([], [grip], [grip._replace(text="gyro or grip 2 %")], [], [grip])):
        causes(check, rule, *reasons)
        told.take(t_s, check.findings, check.unconfirmed)
    assert [finding_lines(each)[0] for each in (*told.doubts, *told.found)] == [
        "doubt at 1.0 s: gyro or grip 1 %",
        "finding at 4.0 s: gyro or grip 1 %",
    ]


def test_a_suspicion_of_the_estimator_is_a_finding_when_it_begins(
    scripted: tuple[DriveCheck, Scripted],
) -> None:
    check, _ = scripted
    gyro = Fault("gyro", Cause.MOTION_AT_STANDSTILL, "by gyro")
    both = Fault("gyro and camera", Cause.MOTION_AT_STANDSTILL, "by both")
    stuck = Fault("1", Cause.STUCK_ENCODER, "wheel 1")
    reported = []
    faults = (None, gyro, gyro, both, gyro, None, gyro, stuck, stuck)
    for now_ns, fault in enumerate(faults):
        check.update(make_cycle(now_ns=now_ns), () if fault is None else (fault,))
        reported.append([(finding.cause, finding.text) for finding in check.findings])
    begun = [
        [(WHEELS_CONTRADICTED, each.text)] if each else []
        for each in (gyro, None, both, gyro, None, gyro, stuck, None)
    ]
    assert reported == [[], *begun]


def test_the_wording_of_a_fault_does_not_decide_whether_it_is_the_same(
    scripted: tuple[DriveCheck, Scripted],
) -> None:
    check, _ = scripted
    found = 0
    for now_ns in range(5):
        check.update(make_cycle(now_ns=now_ns), (Fault("1", Cause.STUCK_ENCODER, f"for {now_ns} s"),))
        found += len(check.findings)
    assert found == 1


def test_rules_that_need_set_points_are_left_out_and_all_others_are_shared() -> None:
    arguments = (SafetySettings(), ROLES, 2, 0.0)
    missions = {type(rule).__name__ for rule in make_rules(*arguments)}
    drives = {type(rule).__name__ for rule in make_drive_rules(*arguments)}
    assert missions - drives == {
        "AreaRule",
        "FreshnessRule",
        "GyroRestRule",
        "DifferentMotionRule",
        "MotionRule",
        "OperatorRule",
        "ResponseRule",
        "SourceCheckRule",
        "StallMonitor",
        "SteeringMonitor",
        "SteeringReportRule",
        "SupplyRule",
        "UnseenMotionRule",
        "YawDoubtRule",
    }
    assert drives - missions == {"StandingWheelsRule", "TurnComparison", "ZeroReadingsRule"}


def test_samples_reach_the_rules() -> None:
    check = DriveCheck(SafetySettings(), ROLES, 2, 0.0)
    check.observe(BumperSample(device="wheels", t_ns=0, pressed=True), 0)
    check.update(make_cycle(now_ns=0))
    assert [finding.cause for finding in check.findings] == ["bumper"]


def zeros_found(readings: list[float], device: str = "imu") -> list[str]:
    rule = ZeroReadingsRule(ROLES)
    found = []
    for reading in readings:
        rule.observe(RateSample(device=device, t_ns=0, rate_z_rad_s=reading), 0)
        found = [reason.text for reason in rule.check(make_cycle(now_ns=0))]
    return found


def test_zeros_between_readings_of_a_turn_are_found() -> None:
    (text,) = zeros_found([0.5, 0.0] * 6 + [0.5])
    assert "6 of 6 readings between others of a turn are exactly 0" in text
    assert zeros_found([0.5, 0.0] * 4 + [0.5]) == []
    assert zeros_found([0.5, 0.0] * 6, device="other") == []
    assert zeros_found([0.01, 0.0] * 50) == []  # a gyro of coarse steps at rest
    assert zeros_found([0.5, 0.0, -0.5, 0.0] * 50) == []  # it swings through zero
    assert zeros_found([0.5, 0.0] * 5 + [0.5] * 60) == []  # lost messages, seldom
    assert zeros_found([0.5, 0.0] * 5 + [0.5] * 250) == []
    rule = ZeroReadingsRule(ROLES)
    other: Sample = AttitudeSample(device="imu", t_ns=0)
    rule.observe(other, 0)
    assert list(rule.check(make_cycle(now_ns=0))) == []


def standing(
    speeds_rad_s: tuple[float, ...], contradiction: float | None, times_s: tuple[float, ...]
) -> list[str]:
    rule = StandingWheelsRule()
    found = []
    for time_s in times_s:
        cycle = make_cycle(
            now_ns=nanoseconds(time_s), measured_rad_s=speeds_rad_s, contradiction=contradiction
        )
        found = [reason.text for reason in rule.check(cycle)]
    return found


def test_wheels_that_stand_while_others_turn_are_found() -> None:
    (text,) = standing((0.0, 0.0, 5.0, -5.0), 3.0, (0.0, 0.5, 1.0))
    assert "wheel 0, 1 stands while wheel 2, 3 turns" in text
    assert standing((0.0, 0.0, 5.0, 5.0), 3.0, (0.0, 0.5, 0.99)) == []
    assert standing((0.0, 0.0, 5.0, 5.0), 1.0, (0.0, 1.0, 2.0)) == []
    assert standing((0.0, 5.0), None, (0.0, 1.0, 2.0)) == []  # a turn about one wheel
    assert standing((0.1, 0.1, 5.0, 5.0), 3.0, (0.0, 1.0, 2.0)) == []
    assert standing((0.0, 0.0, 0.4, 0.4), 3.0, (0.0, 1.0, 2.0)) == []


def test_standing_wheels_are_counted_anew_after_they_have_turned() -> None:
    rule = StandingWheelsRule()
    stood = make_cycle(now_ns=0, measured_rad_s=(0.0, 5.0, 5.0), contradiction=2.0)
    assert list(rule.check(stood)) == []
    turned = changed(stood, now_ns=nanoseconds(0.9), measured_rad_s=(5.0, 5.0, 5.0))
    assert list(rule.check(turned)) == []
    assert list(rule.check(stood._replace(now_ns=nanoseconds(1.1)))) == []
    assert list(rule.check(stood._replace(now_ns=nanoseconds(2.1))))
