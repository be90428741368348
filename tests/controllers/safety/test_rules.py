"""The stop rules about devices and the estimate, one by one: causes, texts and edges."""

import math
from dataclasses import replace

import pytest

from controllers.fault import Cause, Fault, Severity
from controllers.roles import DeviceRoles
from controllers.safety.device_rules import BumperRule, BumperSettings, FaultRule, FreshnessRule, LinkRule
from controllers.safety.estimate_rules import FiniteEstimateRule, MotionRule
from controllers.safety.reasons import Cycle, StopRule
from controllers.safety.settings import SafetySettings
from controllers.safety.supervisor import Mode, SafetySupervisor
from drivers.samples import (
    BumperSample,
    FaultSample,
    LinkSample,
    PoseFixSample,
    RateSample,
    Sample,
    WheelSample,
)
from tests.controllers.safety.cycles import changed, make_cycle

MS = 1_000_000
ROLES = DeviceRoles(
    wheels="wheels", fixes=("overhead",), required={"wheels": 0.1, "overhead": 0.5, "imu": 0.2}
)
CYCLE = make_cycle(now_ns=10_000 * MS)


def check(rule: StopRule, *samples: Sample, cycle: Cycle = CYCLE) -> list[Fault]:
    for sample in samples:
        rule.observe(sample, sample.t_ns)
    return list(rule.check(cycle))


def test_a_bumper_is_final_and_reported_once() -> None:
    rule = BumperRule(BumperSettings())
    pressed = BumperSample(device="board", t_ns=0, pressed=True)
    assert check(rule, pressed) == [Fault("bumper", Cause.BUMPER, "board: bumper pressed", Severity.FINAL)]
    assert check(rule) == []


def test_a_link_has_a_cause_without_the_words_of_its_break() -> None:
    rule = LinkRule(ROLES)
    down = LinkSample(device="imu", t_ns=0, up=False, reason="unplugged")
    reason = Fault("imu", Cause.LINK_DOWN, "imu: link down (unplugged)")
    assert check(rule, down) == [reason, reason]
    assert check(rule) == [reason]
    assert check(rule, replace(down, device="overhead", up=True)) == [reason]
    assert check(rule, replace(down, up=True)) == []


def test_a_fault_has_a_cause_without_its_code() -> None:
    rule = FaultRule(ROLES)
    fault = FaultSample(device="wheels", t_ns=0, wheel=1, code=4, text="over current")
    reason = Fault("wheels wheel 1", Cause.DEVICE_FAULT, "wheels wheel 1: fault 4 (over current)")
    assert check(rule, fault) == [reason, reason]
    assert check(rule) == [reason]
    assert check(rule, replace(fault, wheel=0, code=0)) == [reason]
    assert check(rule, replace(fault, code=0)) == []


def test_every_part_that_is_too_old_is_reported() -> None:
    reasons = check(FreshnessRule(ROLES, 2))
    assert [reason.text for reason in reasons] == [
        "wheels: no position of wheel 0 within 0.1 s",
        "wheels: no position of wheel 1 within 0.1 s",
        "overhead: no pose fix in time within 0.5 s",
        "imu: no sample within 0.2 s",
    ]
    assert len({reason.name for reason in reasons}) == 4


@pytest.mark.parametrize(
    "sample",
    [
        RateSample(device="imu", t_ns=CYCLE.now_ns, rate_z_rad_s=0.1),
        RateSample(device="imu", t_ns=CYCLE.now_ns, rate_z_rad_s=math.nan),
        WheelSample(device="imu", t_ns=CYCLE.now_ns, wheel=1, position_rad=0.1),
    ],
)
def test_any_sample_keeps_a_device_without_a_role_of_its_own_fresh(sample: Sample) -> None:
    assert "imu: no sample within 0.2 s" not in [
        reason.text for reason in check(FreshnessRule(ROLES, 1), sample)
    ]


@pytest.mark.parametrize(
    "sample",
    [
        LinkSample(device="imu", t_ns=CYCLE.now_ns, up=True, reason="reopened"),
        FaultSample(device="imu", t_ns=CYCLE.now_ns, wheel=0, code=0, text="ok"),
    ],
)
def test_what_the_host_or_the_drive_says_of_a_device_is_no_measurement(sample: Sample) -> None:
    assert "imu: no sample within 0.2 s" in [reason.text for reason in check(FreshnessRule(ROLES, 1), sample)]


def fix(age_ms: int = 0) -> PoseFixSample:
    return PoseFixSample(
        device="overhead",
        t_ns=CYCLE.now_ns,
        x_m=0.0,
        y_m=0.0,
        yaw_rad=0.0,
        position_std_m=0.01,
        yaw_std_rad=0.01,
        t_capture_ns=CYCLE.now_ns - age_ms * MS,
    )


def keeps_camera_fresh(sample: Sample) -> bool:
    texts = [reason.text for reason in check(FreshnessRule(ROLES, 1), sample)]
    return "overhead: no pose fix in time within 0.5 s" not in texts


@pytest.mark.parametrize(("age_ms", "is_in_time"), [(0, True), (2000, True), (2001, False)])
def test_a_fix_counts_as_long_as_the_motion_since_is_remembered(age_ms: int, is_in_time: bool) -> None:
    assert keeps_camera_fresh(fix(age_ms)) == is_in_time


@pytest.mark.parametrize("key", ["x_m", "y_m", "yaw_rad"])
def test_every_number_of_a_fix_must_be_finite(key: str) -> None:
    assert not keeps_camera_fresh(replace(fix(), **{key: math.nan}))  # type: ignore[arg-type]


@pytest.mark.parametrize(("motion_ms", "stops"), [(None, True), (9799, True), (9800, False), (10_000, False)])
def test_the_motion_may_be_unknown_for_twice_the_age_limit_of_the_wheels(
    motion_ms: int | None, stops: bool
) -> None:
    motion_ns = None if motion_ms is None else motion_ms * MS
    found = check(MotionRule(ROLES), cycle=changed(CYCLE, motion_ns=motion_ns))
    reason = Fault("wheels", Cause.NO_MOTION, "wheels: no wheel motion measured for 0.2 s")
    assert found == ([reason] if stops else [])


def test_the_estimate_must_be_finite() -> None:
    rule = FiniteEstimateRule()
    assert check(rule) == []
    reason = Fault("pose filter", Cause.NOT_FINITE, "pose filter: the estimate is not finite")
    assert check(rule, cycle=changed(CYCLE, x_m=math.inf)) == [reason]


def test_before_the_first_cycle_the_supervisor_has_no_reason() -> None:
    supervisor = SafetySupervisor(SafetySettings(), ROLES, 1)
    assert (supervisor.mode, supervisor.reason) == (Mode.SETTLING, "")
