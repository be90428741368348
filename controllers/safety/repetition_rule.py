"""Stop rule about a device that repeats readings which it has sent before."""

import math
from collections.abc import Hashable, Iterator
from typing import NamedTuple

from controllers.fault import Bound, Cause, Fault
from controllers.motion.planar import wrap_angle
from controllers.roles import DeviceRoles
from controllers.safety.reasons import Cycle, StopRule
from controllers.safety.repeated_readings import KEY, RepeatedReadings
from drivers.clock import seconds
from drivers.safety_event import AFTER_A_WAIT, Outcome, SafetyEvent
from drivers.samples import HeadingSample, PoseFixSample, RateSample, Sample, WheelSample

DIGITS = 9
"""Of an increment in m or rad that count."""


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
    """Readings of one quantity of a device.

    Attributes:
        readings: Compared with earlier ones.
        newest: The newest number whose increments show the noise.
    """

    def __init__(self) -> None:
        self.readings: RepeatedReadings[_Travel] = RepeatedReadings()
        self.newest: float | None = None


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
        self._wraps_rad = dict(enumerate(roles.wheel_wraps_rad))
        self._sources: dict[tuple[type[Sample], str, Hashable], _Source] = {}
        self._travel = _Travel(0)

    def observe(self, sample: Sample, t_ns: int) -> None:
        """Take a reading of a device that the estimate uses."""
        if isinstance(sample, RateSample) and sample.device == self._roles.gyro:
            value = (sample.rate_x_rad_s, sample.rate_y_rad_s, sample.rate_z_rad_s)
            self._source(sample).readings.add(value, sample.rate_z_rad_s, self._travel)
        elif isinstance(sample, HeadingSample) and sample.device in self._roles.headings:
            self._add(self._source(sample, sample.reference), sample.heading_rad, math.tau)
        elif isinstance(sample, PoseFixSample) and sample.device in self._roles.fixes:
            for axis, place_m in enumerate((sample.x_m, sample.y_m)):
                self._add(self._source(sample, axis), place_m)
        elif isinstance(sample, WheelSample) and sample.device == self._roles.wheels:
            wraps_rad = self._wraps_rad.get(sample.wheel)
            if sample.position_rad is not None:
                self._add(self._source(sample, sample.wheel), sample.position_rad, wraps_rad)

    def _add(self, source: _Source, number: float, wraps: float | None = None) -> None:
        """Take a reading whose increments show its noise; after `wraps` it begins anew."""
        increment = 0.0 if source.newest is None else number - source.newest
        if wraps is not None and math.isfinite(wraps):
            increment = wrap_angle(increment * math.tau / wraps) * wraps / math.tau
        source.newest = number
        # What rounding leaves of equal increments is no noise.
        source.readings.add(number, round(increment, DIGITS), self._travel)

    def _source(self, sample: Sample, part: Hashable = None) -> _Source:
        key = type(sample), sample.device, part
        source = self._sources.get(key)
        if source is None:
            source = self._sources[key] = _Source()
        return source

    def check(self, cycle: Cycle) -> Iterator[Fault]:
        """Return a reason for each device that repeats itself."""
        self._follow(cycle)
        named: set[str] = set()
        for (kind, device, _), source in self._sources.items():
            readings = source.readings
            if device in named or readings.length < KEY or not readings.is_repetition:
                continue
            if kind is WheelSample and not readings.has_jump:
                continue
            named.add(device)
            text = (
                f"{device}: repeats {readings.length} readings that it sent {readings.lag} readings "
                "before: look at the device, its buffer and its driver"
            )
            yield Fault(device, Cause.REPEATS, text, bound=self._bound(kind, readings))

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

    def _bound(self, kind: type[Sample], readings: RepeatedReadings[_Travel]) -> Bound:
        """Return what a device may have made wrong since the first repeated reading.

        Rates and increments are wrong from there on; headings and positions are as old as what they copy. The
        true turn is between that by gyro, that by wheels and none.
        """
        now = self._travel
        is_absolute = kind in (HeadingSample, PoseFixSample)
        begin = (readings.copied if is_absolute else readings.first) or now
        by_gyro_rad, by_wheels_rad = now.gyro_rad - begin.gyro_rad, now.wheels_rad - begin.wheels_rad
        if kind is RateSample:
            return Bound(gyro_rad=max(abs(by_gyro_rad), abs(by_gyro_rad - by_wheels_rad)))
        if kind is HeadingSample:
            return Bound(yaw_rad=max(abs(by_gyro_rad), abs(by_wheels_rad)))
        if kind is PoseFixSample:
            return Bound(position_m=now.path_m - begin.path_m)
        begin_rad = begin.wheel_rad or (0.0,) * len(now.wheel_rad)
        return Bound(wheel_rad=tuple(a - b for a, b in zip(now.wheel_rad, begin_rad, strict=True)))
