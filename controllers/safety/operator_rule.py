"""Stop rule about whoever operates the rover."""

from collections.abc import Iterator

from controllers.safety.reasons import Cycle, StopReason, StopRule


class OperatorRule(StopRule):
    """Stops while the operator's side is lost: whoever is to stop the rover must be able to."""

    observes = ()

    is_for_drives = False

    def check(self, cycle: Cycle) -> Iterator[StopReason]:
        """Return the reason that the operator's side gives."""
        if cycle.operator_reason:
            yield StopReason(cycle.operator_reason, cycle.operator_reason)
