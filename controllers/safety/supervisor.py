"""When the rover may move."""

import math
from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple

from controllers.roles import DeviceRoles
from controllers.safety.reasons import Cycle, Severity, StopReason, StopRule
from controllers.safety.settings import SafetySettings, make_rules
from drivers.clock import nanoseconds
from drivers.samples import Sample


class Mode(StrEnum):
    """What the controller does; only RUNNING moves the wheels, everywhere else they get zero set-points.

    OBSERVING: no mission; estimates only.
    SETTLING: waiting until every required device has been fresh for a while.
    RUNNING: driving the mission.
    PAUSED: would be RUNNING, but the operator has paused the mission; never the mode of the supervisor.
    FINISHED: mission done.
    SAFE_STOP: there is a reason to stop; resumes by itself when it is gone.
    EMERGENCY_STOP: a bumper was pressed, or the same stop happened too often; stays until restart.
    """

    OBSERVING = "observing"
    SETTLING = "settling"
    RUNNING = "running"
    PAUSED = "paused"
    FINISHED = "finished"
    SAFE_STOP = "safe_stop"
    EMERGENCY_STOP = "emergency_stop"


class Doubt(NamedTuple):
    """What a stop adds to the doubt in the estimate.

    Attributes:
        wheel_rad: Greatest error of the angle of each wheel, signed; empty for none.
        yaw_rad: Greatest error of the yaw.
        is_unseen: Whether it may keep the rover stopped, as motion that was not measured.
    """

    wheel_rad: tuple[float, ...]
    yaw_rad: float
    is_unseen: bool


RECOVERIES = 2
"""A mission recovers from this many stops for one suspicion, given `forget_stops_m` between them."""


@dataclass(slots=True)
class _Stops:
    """Stops for one cause, and the distance driven since the last of them without a sign of it."""

    count: int = 0
    healthy_m: float = 0.0


class SafetySupervisor:
    """Asks the stop rules and decides the mode of a mission.

    A recoverable stop lasts `suspicion_rest_s` and lets the rover go on once: the second for the same cause
    before `forget_stops_m` without a sign of it, and the third in a mission, is final.

    Args:
        settings: Thresholds and waiting times.
        roles: Which devices are required, and as what.
        wheel_count: Number of wheels.
        heading_lag_s: Time constant of the heading devices.

    Attributes:
        mode: The mode after the last `update`.
        reason: Why the rover is stopped; empty while nothing is wrong.
        suspicion: What may be wrong although it stops nothing; empty for nothing.
        doubts: What the stops of this cycle add to the doubt in the estimate.
    """

    def __init__(
        self, settings: SafetySettings, roles: DeviceRoles, wheel_count: int, heading_lag_s: float = 0.0
    ) -> None:
        self._settings = settings
        self._rules = make_rules(settings, roles, wheel_count, heading_lag_s)
        self._observers: dict[type[Sample], list[StopRule]] = {}
        self._stops: dict[str, _Stops] = {}
        self._recoveries = Counter[str]()
        self._rest_s = 0.0
        self._healthy_since_ns: int | None = None
        self._doubted_rad: dict[str, float] = {}
        self.mode = Mode.SETTLING
        self.reason = self.suspicion = ""
        self.doubts: list[Doubt] = []

    def observe(self, sample: Sample, t_ns: int) -> None:
        """Take one sample as of `t_ns`."""
        kind = type(sample)
        if kind not in self._observers:
            # Most rules need no samples or only some, and there are many samples.
            self._observers[kind] = [
                rule
                for rule in self._rules
                if type(rule).observe is not StopRule.observe
                if issubclass(kind, rule.observes)
            ]
        for rule in self._observers[kind]:
            rule.observe(sample, t_ns)

    def update(self, cycle: Cycle) -> None:
        """Decide the mode of this cycle."""
        reasons = [reason for rule in self._rules for reason in rule.check(cycle)]
        stops = [reason for reason in reasons if reason.severity not in (Severity.SIGN, Severity.SUSPICION)]
        self.suspicion = next((each.text for each in reasons if each.severity is Severity.SUSPICION), "")
        self.doubts = list(self._doubts(stops))
        if self.mode is Mode.EMERGENCY_STOP:
            return
        stop = next(iter(stops), None)
        if self.mode is Mode.RUNNING:
            self._forget_stops(cycle.distance_m, {reason.cause for reason in reasons})
            stop = self._count(stop)
        if stop is None:
            self._resume(cycle.now_ns)
        else:
            self._stop(stop)

    def _doubts(self, stops: Sequence[StopReason]) -> Iterator[Doubt]:
        """Yield the doubt of each stop when it begins, and what is added to the yaw's while it lasts."""
        before, self._doubted_rad = self._doubted_rad, {}
        for stop in stops:
            known = {**before, **self._doubted_rad}
            before_rad = known.get(stop.cause, 0.0)
            self._doubted_rad[stop.cause] = max(before_rad, stop.yaw_rad)
            # Variances add up.
            added_rad = math.sqrt(max(0.0, stop.yaw_rad**2 - before_rad**2))
            wheel_rad = () if stop.cause in known else stop.wheel_rad
            yield Doubt(wheel_rad, added_rad, is_unseen=stop.severity is not Severity.RECOVERABLE)

    def finish(self) -> None:
        """End the mission."""
        self.mode = Mode.FINISHED

    def _stop(self, stop: StopReason) -> None:
        self._healthy_since_ns = None
        self.reason = stop.text
        if stop.severity is Severity.FINAL:
            self.mode = Mode.EMERGENCY_STOP
        elif self.mode is Mode.RUNNING:
            self.mode = Mode.SAFE_STOP
            is_suspicion = stop.severity is Severity.RECOVERABLE
            self._rest_s = self._settings.suspicion_rest_s if is_suspicion else self._settings.recover_s

    def _resume(self, now_ns: int) -> None:
        if self._healthy_since_ns is None:
            self._healthy_since_ns = now_ns
        healthy_ns = now_ns - self._healthy_since_ns
        if self.mode is Mode.SETTLING or self.mode is Mode.SAFE_STOP:
            wait_s = self._settings.settle_s if self.mode is Mode.SETTLING else self._rest_s
            if healthy_ns >= nanoseconds(wait_s):
                self.mode = Mode.RUNNING
        if self.mode is not Mode.SAFE_STOP:
            self.reason = ""

    def _forget_stops(self, distance_m: float, signs: Collection[str]) -> None:
        """Forget the stops of every cause that has shown no sign for long enough."""
        for cause, stops in list(self._stops.items()):
            if cause not in signs:
                stops.healthy_m += distance_m
            if stops.healthy_m >= self._settings.forget_stops_m:
                del self._stops[cause]

    def _count(self, stop: StopReason | None) -> StopReason | None:
        """Count a stop; return it, final where it is one too many for its cause."""
        if stop is None:
            return None
        stops = self._stops.setdefault(stop.cause, _Stops())
        stops.count += 1
        stops.healthy_m = 0.0
        count, most = stops.count, self._settings.identical_stops
        if stop.severity is Severity.RECOVERABLE:
            self._recoveries[stop.cause] += 1
            most = RECOVERIES
            if self._recoveries[stop.cause] > RECOVERIES:
                count = self._recoveries[stop.cause]
        if count < most or stop.severity is Severity.FINAL:
            return stop
        text = f"{stop.text}; stopped {count} times for this, stays stopped until restart"
        return stop._replace(text=text, severity=Severity.FINAL)
