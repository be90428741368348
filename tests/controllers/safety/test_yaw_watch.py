"""Pose fixes and a camera that watch the yaw, and for how long."""

import pytest

from controllers.estimation.filter.guarded_filter import Innovation, Outcome
from controllers.estimation.filter.measurement_model import Measured
from controllers.fault import Severity
from controllers.roles import DeviceRoles
from controllers.safety.yaw_watch import YawWatch
from tests.controllers.safety.cycles import make_cycle

SECOND_NS = 1_000_000_000
ROLES = DeviceRoles(wheels="wheels", fixes=("overhead",), camera="rear", required={})


def said(name: str, residual_rad: float, variance: float = 0.01, *, accepted: bool = True) -> Innovation:
    nis = residual_rad**2 / variance
    return Innovation(
        measured=Measured(*name.split(" ", 1)),
        residual=residual_rad,
        variance=variance,
        nis=nis,
        outcome=Outcome.ACCEPTED if accepted else Outcome.REJECTED,
    )


def watch(*innovations: Innovation, doubted_rad: float = 0.0) -> YawWatch:
    found = YawWatch(ROLES)
    found.take(make_cycle(now_ns=SECOND_NS, innovations=innovations, undecided_rad=doubted_rad))
    return found


def test_a_fix_watches_the_yaw_for_three_seconds() -> None:
    watching = watch(said("overhead yaw", 0.0))
    assert watching.severity(4 * SECOND_NS) is Severity.WARNING
    assert watching.severity(4 * SECOND_NS + 1) is Severity.UNCERTAIN


def test_without_a_yaw_nothing_watches() -> None:
    unusable = Innovation(
        measured=Measured("overhead", "yaw"), residual=None, variance=None, nis=None, outcome=Outcome.REJECTED
    )
    for watching in (watch(), watch(said("overhead x", 0.0), said("marks yaw", 0.0)), watch(unusable)):
        assert watching.severity(SECOND_NS) is Severity.UNCERTAIN


@pytest.mark.parametrize(
    ("residual_rad", "severity"),
    [
        (0.19, Severity.WARNING),
        (0.21, Severity.UNCERTAIN),
        (0.34, Severity.UNCERTAIN),
        (0.36, Severity.STOP),
        (-0.36, Severity.STOP),
    ],
)
def test_a_fix_agrees_within_two_deviations_and_contradicts_beyond_three_and_a_half(
    residual_rad: float, severity: Severity
) -> None:
    assert watch(said("overhead yaw", residual_rad)).severity(SECOND_NS) is severity


def test_a_yaw_that_is_wide_enough_for_both_does_not_agree_with_the_gyro() -> None:
    """The fix is accepted, as the estimate contains it: what counts is what the gyro alone leaves open."""
    watching = watch(said("overhead yaw", 0.4, variance=1.01), doubted_rad=1.0)
    assert watching.severity(SECOND_NS) is Severity.STOP
    watching = watch(said("overhead yaw", 0.4, variance=1.0), doubted_rad=1.0)
    assert watching.severity(SECOND_NS) is Severity.UNCERTAIN


def test_the_newest_one_counts() -> None:
    watching = watch(said("overhead yaw", 0.0))
    watching.take(make_cycle(now_ns=SECOND_NS, innovations=(said("overhead yaw", 0.3),)))
    assert watching.severity(SECOND_NS) is Severity.UNCERTAIN


@pytest.mark.parametrize(
    ("accepted", "severity"),
    [
        ([True], Severity.WARNING),
        ([False], Severity.UNCERTAIN),
        ([True, False], Severity.UNCERTAIN),
        ([False, True, False], Severity.UNCERTAIN),
        ([False, False], Severity.STOP),
        ([False, False, True], Severity.WARNING),
    ],
)
def test_a_camera_contradicts_the_gyro_by_two_turns_in_a_row(
    accepted: list[bool], severity: Severity
) -> None:
    watching = watch()
    for each in accepted:
        innovations = (said("rear turn", 0.0, accepted=each),)
        watching.take(make_cycle(now_ns=SECOND_NS, innovations=innovations))
    assert watching.severity(SECOND_NS) is severity


def test_a_doubt_says_what_it_means() -> None:
    assert watch().consequence(Severity.UNCERTAIN) == "; the yaw is uncertain by both"
    assert watch().consequence(Severity.FINAL) == ""
    alone = YawWatch(DeviceRoles(wheels="wheels", gyro="imu", required={}))
    assert alone.consequence(Severity.UNCERTAIN) == "; the yaw is uncertain by both, yaw unwatched"
