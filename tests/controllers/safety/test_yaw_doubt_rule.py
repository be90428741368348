"""A yaw that is uncertain because gyro and wheels exclude each other."""

import pytest

from controllers.fault import Fault, Severity
from controllers.roles import DeviceRoles
from controllers.safety.estimate_rules import DECIDE_S, YawDoubtRule, YawDoubtSettings
from tests.controllers.safety.cycles import make_cycle

SECOND_NS = 1_000_000_000
ALONE = DeviceRoles(wheels="wheels", gyro="imu", required={})
FIXES = DeviceRoles(wheels="wheels", gyro="imu", fixes=("overhead",), required={})
COMPASS = DeviceRoles(wheels="wheels", gyro="imu", headings=("compass",), required={})


def check(rule: YawDoubtRule, doubted_rad: float, t_s: float = 0.0, *, is_still: bool = False) -> list[Fault]:
    return list(
        rule.check(make_cycle(now_ns=round(t_s * SECOND_NS), undecided_rad=doubted_rad, is_still=is_still))
    )


@pytest.mark.parametrize("roles", [FIXES, COMPASS])
def test_where_something_can_decide_the_rover_stops_at_two_deviations(roles: DeviceRoles) -> None:
    rule = YawDoubtRule(YawDoubtSettings(), roles)
    assert check(rule, 0.074) == []
    (reason,) = check(rule, 0.076)
    assert reason.severity is Severity.RECOVERABLE
    assert reason.text == (
        "pose filter: yaw uncertain by 0.15 rad, gyro and wheels exclude each other: waits for fixes or "
        "headings"
    )
    assert check(rule, 0.01) == []


def test_what_is_not_decided_at_rest_is_accepted_and_counts_from_there() -> None:
    rule = YawDoubtRule(YawDoubtSettings(), FIXES)
    assert check(rule, 0.2, 0.0) != []
    assert check(rule, 0.2, 1.0, is_still=True) != []
    assert check(rule, 0.2, 1.0 + DECIDE_S - 0.01, is_still=True) != []
    assert check(rule, 0.2, 1.0 + DECIDE_S, is_still=True) == []
    assert check(rule, 0.27, 10.0) == []
    assert check(rule, 0.28, 10.0) != []
    assert check(rule, 0.05, 11.0) == []
    assert check(rule, 0.13, 12.0) != []


def test_the_rest_begins_anew_when_the_rover_moves() -> None:
    rule = YawDoubtRule(YawDoubtSettings(), FIXES)
    check(rule, 0.2, 0.0, is_still=True)
    check(rule, 0.2, 1.0)
    check(rule, 0.2, 2.0, is_still=True)
    assert check(rule, 0.2, 1.9 + DECIDE_S, is_still=True) != []


def test_where_nothing_can_decide_there_is_a_limit_only_if_it_is_set() -> None:
    assert check(YawDoubtRule(YawDoubtSettings(), ALONE), 3.0) == []
    rule = YawDoubtRule(YawDoubtSettings(unwatched_yaw_rad=0.5), ALONE)
    assert check(rule, 0.24) == []
    (reason,) = check(rule, 0.26)
    assert reason.severity is Severity.FINAL
    assert "put the rover on a known pose and restart" in reason.text
