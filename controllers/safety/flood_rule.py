"""Stop rule about a device that sends many more readings than at its start."""

from collections.abc import Iterator

from controllers.fault import Cause, Fault
from controllers.roles import DeviceRoles
from controllers.safety.reasons import Cycle, StopRule
from drivers.clock import NANOSECONDS_PER_SECOND
from drivers.safety_event import WHEN_GONE, Outcome, SafetyEvent
from drivers.samples import HeadingSample, LinkSample, PoseFixSample, RateSample, Sample, WheelSample

FACTOR = 6
"""So many times the readings of a second are too many: 3 s that arrive at once, and as many again."""

START_SECONDS = 3
"""The second of these with the most readings is the measure: a device may begin slowly."""

LEAST = 500
"""Fewer readings in a second are never too many: a drive may send the faster the faster its wheels turn."""


class _Count:
    """Readings of a device in a second of its start, and in the present one.

    Attributes:
        begin_ns: Begin of the present second.
        count: Readings in it.
        usual: Greatest number of readings in a second of the start.
        seconds: Of the start, so far.
        is_flooded: Whether the second before had too many.
    """

    def __init__(self, begin_ns: int) -> None:
        self.begin_ns = begin_ns
        self.count = 0
        self.usual = self.seconds = 0
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
        if self.seconds < START_SECONDS:
            self.usual = max(self.usual, self.count)
            self.seconds += 1
        self.begin_ns, self.count = now_ns, 0

    @property
    def has_too_many(self) -> bool:
        """Whether the present second has too many."""
        return self.seconds == START_SECONDS and self.count > self.most

    @property
    def most(self) -> int:
        """Greatest number of readings in a second that is not too large."""
        return max(LEAST, FACTOR * self.usual)


class FloodRule(StopRule):
    """Stops while a device sends many more readings than at its start.

    Every reading corrects the estimate as if its error were its own: a thousand copies of one heading make
    the yaw as certain as a thousand headings. The stop comes before many are used, so nothing is added to the
    covariance.
    """

    observes = (RateSample, WheelSample, HeadingSample, PoseFixSample, LinkSample)

    events = (
        SafetyEvent(
            Outcome.STOPS,
            "A gyro, wheels, a compass or a receiver sends more than six times as many readings in a "
            "second as at its start, and more than 500.",
            "`…: more than … readings in a second, … at its start: …`",
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
        if isinstance(sample, LinkSample):  # another device, or the same one, begins
            for key in [key for key in self._counts if key[0] == sample.device]:
                del self._counts[key]
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
                    f"{device}: more than {count.most} readings in a second, {count.usual} at its start: "
                    "look at the device and its settings"
                )
                yield Fault(device, Cause.FLOOD, text)
