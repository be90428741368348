"""Stop rule about a device that sends many more readings than at first."""

from collections.abc import Iterator

from controllers.fault import Cause, Fault
from controllers.roles import DeviceRoles
from controllers.safety.reasons import Cycle, StopRule
from drivers.clock import NANOSECONDS_PER_SECOND
from drivers.safety_event import WHEN_GONE, Outcome, SafetyEvent
from drivers.samples import HeadingSample, PoseFixSample, RateSample, Sample, WheelSample

FACTOR = 6
"""So many times the readings of the first second are too many: 3 s that arrive at once, and as many again."""

LEAST = 20
"""Fewer readings in a second are never too many."""


class _Count:
    """Readings of a device in its first second, and in the present one.

    Attributes:
        begin_ns: Begin of the present second.
        count: Readings in it.
        first: Readings in the first second; None until it is over.
        is_flooded: Whether the second before had too many.
    """

    def __init__(self, begin_ns: int) -> None:
        self.begin_ns = begin_ns
        self.count = 0
        self.first: int | None = None
        self.is_flooded = False

    def add(self, t_ns: int) -> None:
        """Count a reading."""
        self.advance(t_ns)
        self.count += 1

    def advance(self, now_ns: int) -> None:
        """Begin another second when the present one is over."""
        if now_ns - self.begin_ns < NANOSECONDS_PER_SECOND:
            return
        self.is_flooded = self.has_too_many
        if self.first is None:
            self.first = self.count
        self.begin_ns, self.count = now_ns, 0

    @property
    def has_too_many(self) -> bool:
        """Whether the present second has too many."""
        return self.first is not None and self.count > max(LEAST, FACTOR * self.first)


class FloodRule(StopRule):
    """Stops while a device sends many more readings than in the first second.

    Every reading corrects the estimate as if its error were its own: a thousand copies of one heading make
    the yaw as certain as a thousand headings.
    """

    observes = (RateSample, WheelSample, HeadingSample, PoseFixSample)

    events = (
        SafetyEvent(
            Outcome.STOPS,
            "A gyro, wheels, a compass or a receiver sends more than six times as many readings as in the "
            "first second.",
            "`…: more than … readings in a second, … in the first: …`",
            (
                "tests/controllers/safety/test_flood_rule.py::"
                "test_a_device_that_sends_many_times_as_often_is_named",
            ),
            within="as soon as there are so many, less than a second",
            clears=WHEN_GONE,
        ),
    )

    def __init__(self, roles: DeviceRoles) -> None:
        self._used = {
            RateSample: (roles.gyro,),
            WheelSample: (roles.wheels,),
            HeadingSample: roles.headings,
            PoseFixSample: roles.fixes,
        }
        self._counts: dict[tuple[str, type[Sample]], _Count] = {}

    def observe(self, sample: Sample, t_ns: int) -> None:
        """Count a reading of a device that the estimate uses."""
        kind = type(sample)
        if sample.device not in self._used.get(kind, ()):
            return
        count = self._counts.get((sample.device, kind))
        if count is None:
            count = self._counts[sample.device, kind] = _Count(t_ns)
        count.add(t_ns)

    def check(self, cycle: Cycle) -> Iterator[Fault]:
        """Return a reason for each device that sends too many readings."""
        for (device, _), count in self._counts.items():
            count.advance(cycle.now_ns)
            if count.has_too_many or count.is_flooded:
                text = (
                    f"{device}: more than {max(LEAST, FACTOR * (count.first or 0))} readings in a second, "
                    f"{count.first} in the first: look at the device and its settings"
                )
                yield Fault(device, Cause.FLOOD, text)
