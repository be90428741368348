"""When the rover may move."""

import math
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum

from controllers.fixes import HISTORY_NS
from controllers.roles import DeviceRoles
from controllers.safety.innovation_monitor import StopReason
from controllers.safety.settings import SafetySettings
from drivers.clock import nanoseconds
from drivers.samples import (
    BumperSample,
    FaultSample,
    HeadingSample,
    LinkSample,
    PoseFixSample,
    RateSample,
    Sample,
    WheelSample,
)

Part = tuple[str, type[Sample], int]
"""What must stay fresh: of which device, which kind of sample, of which wheel (0 for other kinds)."""


class Mode(StrEnum):
    """What the controller does; only RUNNING moves the wheels, everywhere else they get zero set-points.

    OBSERVING: no mission; estimates only.
    SETTLING: waiting until every required device has been fresh for a while.
    RUNNING: driving the mission.
    FINISHED: mission done.
    SAFE_STOP: something speaks against moving; resumes by itself when it is gone.
    EMERGENCY_STOP: a bumper was pressed, or the same stop happened too often; stays until restart.
    """

    OBSERVING = "observing"
    SETTLING = "settling"
    RUNNING = "running"
    FINISHED = "finished"
    SAFE_STOP = "safe_stop"
    EMERGENCY_STOP = "emergency_stop"


class SafetySupervisor:
    """Watches the required devices and decides the mode of a mission.

    Args:
        settings: Waiting times.
        roles: Which devices are required, and as what.
        wheel_count: Each of these wheels must give fresh positions.

    Attributes:
        mode: The mode after the last `update`.
        reason: Why the rover stands, naming the device; empty while nothing is wrong.
    """

    def __init__(self, settings: SafetySettings, roles: DeviceRoles, wheel_count: int) -> None:
        self._settings = settings
        self._roles = roles
        self._required = frozenset(roles.required)
        self._limits = _freshness_limits(roles, wheel_count)
        self._heard_ns: dict[Part, int] = {}
        self._down: dict[str, StopReason] = {}
        self._faults: dict[tuple[str, int | None], StopReason] = {}
        self._incident: StopReason | None = None
        self._emergency = ""
        self._stops: dict[str, _Stops] = {}
        self._healthy_since_ns: int | None = None
        self.mode = Mode.SETTLING
        self.reason = ""

    def observe(self, sample: Sample, t_ns: int) -> None:
        """Take one sample as of `t_ns`."""
        if isinstance(sample, LinkSample):
            self._observe_link(sample)
        elif isinstance(sample, FaultSample):
            self._observe_fault(sample)
        else:
            if isinstance(sample, BumperSample) and sample.pressed and self._settings.bumper_stops:
                self._emergency = f"{sample.device}: bumper pressed"
            for part in _parts(sample):
                if part in self._limits:
                    self._heard_ns[part] = max(t_ns, self._heard_ns.get(part, t_ns))

    def update(
        self,
        now_ns: int,
        estimate_is_finite: bool,
        motion_ns: int | None,
        suspicions: Sequence[StopReason] = (),
        distance_m: float = 0.0,
    ) -> None:
        """Decide the mode at `now_ns`.

        Args:
            now_ns: Time of the cycle.
            estimate_is_finite: Whether the estimate is made of numbers.
            motion_ns: When the motion of the wheels was last known.
            suspicions: What else speaks against moving, or may soon.
            distance_m: Driven since the last update.
        """
        reasons = [*self._find_reasons(now_ns, estimate_is_finite, motion_ns), *suspicions]
        self._incident = None
        stop = next((reason for reason in reasons if reason.must_stop), None)
        if self.mode is Mode.RUNNING:
            self._count(stop, {reason.cause for reason in reasons}, distance_m)
        if self._emergency:
            self.mode, self.reason = Mode.EMERGENCY_STOP, self._emergency
        elif stop is not None:
            self._healthy_since_ns = None
            self.reason = stop.text
            if self.mode is Mode.RUNNING:
                self.mode = Mode.SAFE_STOP
        else:
            self._resume(now_ns)

    def _count(self, stop: StopReason | None, signs: Collection[str], distance_m: float) -> None:
        """Count the stop, and forget what has not shown itself for long enough."""
        for cause, stops in list(self._stops.items()):
            stops.healthy_m += 0.0 if cause in signs else distance_m
            if stops.healthy_m >= self._settings.forget_stops_m:
                del self._stops[cause]
        if stop is not None:
            stops = self._stops.setdefault(stop.cause, _Stops())
            stops.count += 1
            stops.healthy_m = 0.0
            if stops.count >= self._settings.identical_stops:
                self._emergency = (
                    f"{stop.text}; stopped {stops.count} times for this, stays stopped until restart"
                )

    def finish(self) -> None:
        """End the mission."""
        self.mode = Mode.FINISHED

    def _resume(self, now_ns: int) -> None:
        if self._healthy_since_ns is None:
            self._healthy_since_ns = now_ns
        healthy_ns = now_ns - self._healthy_since_ns
        waits_s = {Mode.SETTLING: self._settings.settle_s, Mode.SAFE_STOP: self._settings.recover_s}
        if self.mode in waits_s and healthy_ns >= nanoseconds(waits_s[self.mode]):
            self.mode = Mode.RUNNING
        if self.mode is not Mode.SAFE_STOP:
            self.reason = ""

    def _find_reasons(
        self, now_ns: int, estimate_is_finite: bool, motion_ns: int | None
    ) -> Iterator[StopReason]:
        if self._incident is not None:
            yield self._incident
        yield from self._down.values()
        yield from self._faults.values()
        for part, (limit_ns, reason) in self._limits.items():
            heard_ns = self._heard_ns.get(part)
            if heard_ns is None or now_ns - heard_ns > limit_ns:
                yield StopReason(reason, reason)
        motion_age_s = self._roles.motion_age_s
        if motion_ns is None or now_ns - motion_ns > nanoseconds(motion_age_s):
            # Fresh positions that jump so much that none is a motion: the pose would stay where it is.
            text = f"{self._roles.wheels}: no wheel motion measured for {motion_age_s:g} s"
            yield StopReason(text, text)
        if not estimate_is_finite:
            yield StopReason("not finite", "pose filter: the estimate is not finite")

    def _observe_link(self, sample: LinkSample) -> None:
        if sample.device not in self._required:
            return
        if sample.up:
            self._down.pop(sample.device, None)
        else:
            # Kept for one update even if the link is back within the same cycle: the device may have
            # restarted.
            text = f"{sample.device}: link down ({sample.reason})"
            self._incident = self._down[sample.device] = StopReason(f"{sample.device}: link down", text)

    def _observe_fault(self, sample: FaultSample) -> None:
        if sample.device not in self._required:
            return
        if sample.code:
            where = sample.device if sample.wheel is None else f"{sample.device} wheel {sample.wheel}"
            text = f"{where}: fault {sample.code} ({sample.text})"
            self._incident = self._faults[sample.device, sample.wheel] = StopReason(f"{where}: fault", text)
        elif sample.wheel is not None:
            self._faults.pop((sample.device, sample.wheel), None)
        else:
            self._faults = {key: reason for key, reason in self._faults.items() if key[0] != sample.device}


@dataclass(slots=True)
class _Stops:
    """Stops for one cause, and the distance driven since the last of them without a sign of it."""

    count: int = 0
    healthy_m: float = 0.0


def _freshness_limits(roles: DeviceRoles, wheel_count: int) -> dict[Part, tuple[int, str]]:
    """Return for every part that must stay fresh its age limit and what to say when it is older."""
    limits: dict[Part, tuple[int, str]] = {}
    for device, max_age_s in roles.required.items():
        parts: list[tuple[Part, str]] = []
        if device == roles.wheels:
            parts += [((device, WheelSample, i), f"position of wheel {i}") for i in range(wheel_count)]
        if device == roles.gyro:
            parts.append(((device, RateSample, 0), "yaw rate"))
        if device in roles.headings:
            parts.append(((device, HeadingSample, 0), "heading"))
        if device in roles.fixes:
            parts.append(((device, PoseFixSample, 0), "pose fix in time"))
        for part, what in parts or [((device, Sample, 0), "sample")]:
            limits[part] = (nanoseconds(max_age_s), f"{device}: no {what} within {max_age_s:g} s")
    return limits


def _parts(sample: Sample) -> tuple[Part, ...]:
    """Return what `sample` keeps fresh: its device as such, and the kind if it holds a usable number."""
    device = sample.device
    usable: float | None = None
    wheel = 0
    if isinstance(sample, WheelSample):
        usable, wheel = sample.position_rad, sample.wheel
    elif isinstance(sample, RateSample):
        usable = sample.rate_z_rad_s
    elif isinstance(sample, HeadingSample):
        usable = sample.heading_rad
    elif isinstance(sample, PoseFixSample) and sample.t_ns - sample.t_capture_ns <= HISTORY_NS:
        usable = sample.x_m + sample.y_m + sample.yaw_rad
    if usable is None or not math.isfinite(usable):
        return ((device, Sample, 0),)
    return ((device, Sample, 0), (device, type(sample), wheel))
