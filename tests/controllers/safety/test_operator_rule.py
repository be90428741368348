"""The rule about whoever operates the rover, alone and in the supervisor."""

from controllers.fault import Cause, Fault, Severity
from controllers.roles import DeviceRoles
from controllers.safety.operator_rule import OperatorRule
from controllers.safety.settings import SafetySettings
from controllers.safety.supervisor import Mode, SafetySupervisor
from tests.controllers.safety.cycles import make_cycle

LOST = "page: no answer for 0.7 s"
MS = 1_000_000


def test_the_reason_of_the_operator_is_the_stop_and_it_can_recover() -> None:
    assert list(OperatorRule().check(make_cycle(now_ns=0))) == []
    assert list(OperatorRule().check(make_cycle(now_ns=0, stop_reason=LOST))) == [
        Fault(LOST.partition(":")[0], Cause.OPERATOR, LOST, Severity.STOP)
    ]
    assert OperatorRule.observes == ()  # no sample is its business


def test_a_lost_operator_stops_at_once_and_motion_resumes_when_it_is_back() -> None:
    settings = SafetySettings(settle_s=0.0, recover_s=0.5)
    supervisor = SafetySupervisor(settings, DeviceRoles(wheels="wheels", required={}), 1)
    supervisor.update(make_cycle(now_ns=0, motion_ns=0))
    assert supervisor.mode is Mode.RUNNING
    supervisor.update(make_cycle(now_ns=20 * MS, motion_ns=20 * MS, stop_reason=LOST))
    assert (supervisor.mode, supervisor.reason) == (Mode.SAFE_STOP, LOST)
    for t_ms, mode in ((40, Mode.SAFE_STOP), (539, Mode.SAFE_STOP), (540, Mode.RUNNING)):
        supervisor.update(make_cycle(now_ns=t_ms * MS, motion_ns=t_ms * MS))
        assert supervisor.mode is mode
