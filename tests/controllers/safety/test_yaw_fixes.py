"""Fixes that watch the yaw, and for how long."""

from controllers.estimation.guarded_filter import Innovation
from controllers.roles import DeviceRoles
from controllers.safety.reasons import Cycle, Severity
from controllers.safety.yaw_fixes import YawFixes

SECOND_NS = 1_000_000_000
ROLES = DeviceRoles(wheels="wheels", fixes=("overhead",), required={})


def fixes(*names: str, accepted: bool = True) -> YawFixes:
    found = YawFixes(ROLES)
    innovations = tuple(
        Innovation(name=name, residual=0.0, variance=1.0, nis=0.0, accepted=accepted) for name in names
    )
    found.take(Cycle(now_ns=SECOND_NS, innovations=innovations))
    return found


def test_a_fix_watches_the_yaw_for_three_seconds() -> None:
    watching = fixes("overhead yaw")
    assert watching.severity(4 * SECOND_NS) is Severity.SUSPICION
    assert watching.severity(4 * SECOND_NS + 1) is Severity.RECOVERABLE


def test_without_an_accepted_yaw_nothing_watches() -> None:
    for watching in (fixes(), fixes("overhead x", "marks yaw"), fixes("overhead yaw", accepted=False)):
        assert watching.severity(SECOND_NS) is Severity.RECOVERABLE


def test_a_rejected_fix_ends_the_watch() -> None:
    watching = fixes("overhead yaw")
    rejected = Innovation(name="overhead yaw", residual=1.0, variance=1.0, nis=99.0, accepted=False)
    watching.take(Cycle(now_ns=SECOND_NS, innovations=(rejected,)))
    assert watching.severity(SECOND_NS) is Severity.RECOVERABLE
