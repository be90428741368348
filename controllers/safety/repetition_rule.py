"""Stop rule about a device that repeats readings which it has sent before."""

from collections import deque
from collections.abc import Iterator
from typing import NamedTuple

from controllers.fault import Bound, Cause, Fault
from controllers.roles import DeviceRoles
from controllers.safety.reasons import Cycle, StopRule
from controllers.safety.repeated_readings import KEY, RepeatedReadings
from drivers.clock import nanoseconds, seconds
from drivers.safety_event import AFTER_A_WAIT, Outcome, SafetyEvent
from drivers.samples import HeadingSample, PoseFixSample, RateSample, Sample, WheelSample

BEGUN_NS = nanoseconds(2.0)
"""A repetition is noticed so late at most, by the readings that begin it."""


class _Travel(NamedTuple):
    """What devices have measured since the start.

    Attributes:
        t_ns: Of the cycle.
        path_m: By the wheels.
        gyro_rad: Turn by the gyro.
        wheels_rad: Turn by the wheels.
        wheel_rad: What each wheel was to turn; empty where that is not known.
    """

    t_ns: int
    path_m: float = 0.0
    gyro_rad: float = 0.0
    wheels_rad: float = 0.0
    wheel_rad: tuple[float, ...] = ()


class _Source:
    """Readings of one device, of a wheel where it has several.

    Attributes:
        device: Name.
        readings: Repeated ones.
        begin: What was measured before the repetition.
    """

    def __init__(self, device: str) -> None:
        self.device = device
        self.readings = RepeatedReadings()
        self.begin: _Travel | None = None


class RepetitionRule(StopRule):
    """Stops while a noisy device sends again what it has sent before.

    A buffer that is read again, and an interface that lives while the sensor behind it does not, look like a
    healthy device in every single reading. Readings that are constant are not judged here.
    """

    observes = (RateSample, WheelSample, HeadingSample, PoseFixSample)

    events = (
        SafetyEvent(
            Outcome.STOPS,
            "A gyro, wheels, a compass or a receiver sends again what it has sent before: a buffer is read "
            "twice.",
            "`…: repeats … readings that it sent … readings before: …`",
            (
                "tests/controllers/safety/test_repetition_rule.py::"
                "test_a_device_that_repeats_its_readings_is_named",
            ),
            within="the readings that rule out chance: 16, more where readings are coarse",
            clears=AFTER_A_WAIT,
        ),
    )

    def __init__(self, roles: DeviceRoles) -> None:
        self._roles = roles
        self._sources: dict[tuple[type[Sample], str, int], _Source] = {}
        self._positions_rad: dict[int, float] = {}
        self._travel = _Travel(0)
        self._recent: deque[_Travel] = deque((self._travel,))

    def observe(self, sample: Sample, t_ns: int) -> None:
        """Take a reading of a device that the estimate uses."""
        if isinstance(sample, RateSample) and sample.device == self._roles.gyro:
            value = (sample.rate_x_rad_s, sample.rate_y_rad_s, sample.rate_z_rad_s)
            self._source(sample).readings.add(value, sample.rate_z_rad_s)
        elif isinstance(sample, HeadingSample) and sample.device in self._roles.headings:
            self._source(sample).readings.add(sample.heading_rad, sample.heading_rad)
        elif isinstance(sample, PoseFixSample) and sample.device in self._roles.fixes:
            self._source(sample).readings.add((sample.x_m, sample.y_m), sample.x_m)
        elif isinstance(sample, WheelSample) and sample.device == self._roles.wheels:
            self._take_wheel(sample)

    def _take_wheel(self, sample: WheelSample) -> None:
        position_rad = sample.position_rad
        if position_rad is None:
            return
        increment_rad = position_rad - self._positions_rad.get(sample.wheel, position_rad)
        self._positions_rad[sample.wheel] = position_rad
        self._source(sample, sample.wheel).readings.add(position_rad, increment_rad)

    def _source(self, sample: Sample, part: int = 0) -> _Source:
        key = (type(sample), sample.device, part)
        source = self._sources.get(key)
        if source is None:
            source = self._sources[key] = _Source(sample.device)
        return source

    def check(self, cycle: Cycle) -> Iterator[Fault]:
        """Return a reason for each source that repeats itself."""
        self._follow(cycle)
        for (kind, device, _), source in self._sources.items():
            readings = source.readings
            if readings.length < KEY:
                source.begin = None
                continue
            source.begin = source.begin or self._recent[0]
            if readings.is_repetition and (kind is not WheelSample or readings.has_jump):
                text = (
                    f"{device}: repeats {readings.length} readings that it sent {readings.lag} readings "
                    "before: look at the device, its buffer and its driver"
                )
                yield Fault(device, Cause.REPEATS, text, bound=self._bound(kind, source.begin))

    def _follow(self, cycle: Cycle) -> None:
        """Sum up what the devices measure."""
        before, turn = self._travel, cycle.gyro.turn
        duration_s = seconds(cycle.now_ns - before.t_ns) if before.t_ns else 0.0
        speeds_rad_s = cycle.wheels.set.speed_rad_s or cycle.wheels.measured_rad_s
        turned_rad = before.wheel_rad or (0.0,) * len(speeds_rad_s)
        self._travel = _Travel(
            t_ns=cycle.now_ns,
            path_m=before.path_m + cycle.wheels.distance_m,
            gyro_rad=before.gyro_rad + (0.0 if turn is None else turn.gyro_rad),
            wheels_rad=before.wheels_rad + (0.0 if turn is None else turn.wheels.turn_rad),
            wheel_rad=tuple(a + duration_s * b for a, b in zip(turned_rad, speeds_rad_s, strict=False)),
        )
        self._recent.append(self._travel)
        while cycle.now_ns - self._recent[0].t_ns > BEGUN_NS:
            self._recent.popleft()

    def _bound(self, kind: type[Sample], begin: _Travel) -> Bound:
        """Return what a device may have made wrong since then; the truth is between gyro, wheels and rest."""
        now = self._travel
        by_gyro_rad, by_wheels_rad = now.gyro_rad - begin.gyro_rad, now.wheels_rad - begin.wheels_rad
        if kind is RateSample:
            return Bound(gyro_rad=max(abs(by_gyro_rad), abs(by_gyro_rad - by_wheels_rad)))
        if kind is HeadingSample:
            return Bound(yaw_rad=max(abs(by_gyro_rad), abs(by_wheels_rad)))
        if kind is PoseFixSample:
            return Bound(position_m=now.path_m - begin.path_m)
        begin_rad = begin.wheel_rad or (0.0,) * len(now.wheel_rad)
        return Bound(wheel_rad=tuple(a - b for a, b in zip(now.wheel_rad, begin_rad, strict=True)))
