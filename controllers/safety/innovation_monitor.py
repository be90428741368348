"""Stop rule about measurements that contradict the estimate."""

from collections.abc import Iterator
from typing import Annotated

from pydantic import Field

from controllers.fault import Cause, Fault, Severity
from controllers.safety.reasons import Cycle, StopRule
from drivers.clock import nanoseconds
from drivers.safety_event import WHEN_GONE, Outcome, SafetyEvent
from drivers.settings import Settings


class InnovationSettings(Settings):
    """When a rejected measurement stops the rover.

    Attributes:
        contradiction_s: The rover stops when every value of a measurement has been rejected for this long.
            A gap between two rejections counts for at most half of it, so three rejections are needed.
    """

    contradiction_s: Annotated[float, Field(ge=0.1, le=60.0)] = 2.0


class InnovationMonitor(StopRule):
    """Measures for how long the filter has rejected every value of each measurement.

    A filter that is sure of itself and wrong rejects every good reading: it would go on driving, blind. A
    measurement that could not be compared, e.g. a late one, is no evidence either way.
    """

    events = (
        SafetyEvent(
            Outcome.STOPS,
            "A sensor contradicts the estimate.",
            "`…: contradicts the estimate, rejected for … s`",
            (
                "tests/controllers/test_stops.py::"
                "test_a_contradiction_stops_after_seconds_whatever_the_rate_of_the_sensor",
            ),
            within="`contradiction_s` after the first rejection, or the third rejection",
            settings=("contradiction_s",),
            clears=f"{WHEN_GONE}; the motors may disturb the sensor again",
        ),
    )

    def __init__(self, settings: InnovationSettings) -> None:
        self._settings = settings
        self._longest_gap_ns = nanoseconds(0.5 * settings.contradiction_s)
        self._rejected: dict[str, tuple[int, int]] = {}

    def check(self, cycle: Cycle) -> Iterator[Fault]:
        """Take the innovations of a cycle; return a reason for every measurement that was rejected last."""
        for innovation in cycle.measurements.innovations:
            if innovation.accepted:
                self._rejected.pop(innovation.name, None)
            elif innovation.residual is not None:
                last_ns, rejected_ns = self._rejected.get(innovation.name, (cycle.now_ns, 0))
                gap_ns = min(cycle.now_ns - last_ns, self._longest_gap_ns)
                self._rejected[innovation.name] = (cycle.now_ns, rejected_ns + gap_ns)
        for name, (_, rejected_ns) in self._rejected.items():
            text = f"{name}: contradicts the estimate, rejected for {self._settings.contradiction_s:g} s"
            is_contradiction = rejected_ns >= 2 * self._longest_gap_ns
            yield Fault(
                name,
                Cause.CONTRADICTED_ESTIMATE,
                text,
                Severity.STOP if is_contradiction else Severity.SYMPTOM,
            )
