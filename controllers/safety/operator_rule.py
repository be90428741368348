"""Stop rule about whoever operates the rover."""

from collections.abc import Iterator

from controllers.fault import Cause, Fault
from controllers.safety.reasons import Cycle, StopRule
from drivers.safety_event import Outcome, SafetyEvent


class OperatorRule(StopRule):
    """Stops while the operator's side is lost: whoever is to stop the rover must be able to."""

    observes = ()

    is_for_drives = False

    events = (
        SafetyEvent(
            Outcome.STOPS,
            "The operator's side of a run is lost: see the rows of the page and of ROS 2.",
            "the reason of that side",
            (
                "tests/controllers/safety/test_operator_rule.py::"
                "test_a_lost_operator_stops_at_once_and_motion_resumes_when_it_is_back",
            ),
            within="one cycle",
            clears="see the rows of the page and of ROS 2",
        ),
    )

    def check(self, cycle: Cycle) -> Iterator[Fault]:
        """Return the reason that the operator's side gives."""
        if cycle.operation.stop_reason:
            side, _, _ = cycle.operation.stop_reason.partition(":")
            yield Fault(side, Cause.OPERATOR, cycle.operation.stop_reason)
