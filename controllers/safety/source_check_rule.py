"""Stop rule about the check manoeuvre before the mission."""

from collections.abc import Iterator

from controllers.fault import Cause, Fault, Severity
from controllers.safety.reasons import Cycle, StopRule
from drivers.safety_event import RESTART, Outcome, SafetyEvent
from drivers.settings import Settings


class SourceCheckSettings(Settings):
    """Whether the sources are checked before a mission.

    Attributes:
        check_manoeuvre: `run` begins with a short motion that ends where it began, and compares direction,
            sign and coarse scale of all sources: rotation by 20 deg to both sides and 0.3 m forth and back;
            an S of two arcs where the rover cannot rotate on the spot. A person confirms the room at the
            terminal; without one it is not driven, and the sources stay unconfirmed. No other command drives
            it.
    """

    check_manoeuvre: bool = False


class SourceCheckRule(StopRule):
    """Ends the run before its mission where a source contradicts the others in the check manoeuvre."""

    observes = ()
    is_for_drives = False

    events = (
        SafetyEvent(
            Outcome.ENDS,
            "In the check manoeuvre a source has the opposite sign of the others, mirrored axes, or does not "
            "follow them; or the manoeuvre is not completed.",
            "`emergency stop`, `check manoeuvre: …`, exit code 1; the mission does not begin",
            (
                "tests/controllers/check_manoeuvre/test_loop.py::test_a_wrong_source_is_named_and_ends_the_run",
            ),
            within="one cycle after the manoeuvre",
            settings=("check_manoeuvre",),
            clears=RESTART,
        ),
    )

    def check(self, cycle: Cycle) -> Iterator[Fault]:
        """Return why the mission must not begin."""
        if cycle.operation.check_failure:
            yield Fault("rover", Cause.SOURCE_CHECK, cycle.operation.check_failure, Severity.FINAL)
