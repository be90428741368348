"""The result of the check manoeuvre as a stop rule."""

from controllers.fault import Cause, Fault, Severity
from controllers.safety.reasons import Operation
from controllers.safety.settings import SafetySettings
from controllers.safety.source_check_rule import SourceCheckRule
from tests.controllers.safety.cycles import make_cycle

FAILURE = "check manoeuvre: gyro: rotation has the opposite sign of the wheels (board)"


def test_a_source_that_contradicts_the_others_ends_the_run() -> None:
    cycle = make_cycle(now_ns=0)
    assert list(SourceCheckRule().check(cycle)) == []
    wrong = cycle._replace(operation=Operation(check_failure=FAILURE))
    assert list(SourceCheckRule().check(wrong)) == [
        Fault("rover", Cause.SOURCE_CHECK, FAILURE, Severity.FINAL)
    ]
    assert SourceCheckRule.observes == ()  # no sample is its business
    assert not SourceCheckRule.is_for_drives


def test_it_is_off_unless_a_configuration_wants_it() -> None:
    assert not SafetySettings().check_manoeuvre
