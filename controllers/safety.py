"""When the rover may move."""

import math
from enum import StrEnum

from controllers.roles import DeviceRoles
from controllers.settings import SafetySettings
from drivers.clock import nanoseconds
from drivers.samples import (
    BumperSample,
    FaultSample,
    HeadingSample,
    LinkSample,
    RateSample,
    Sample,
    WheelSample,
)

Part = tuple[str, type[Sample], int]
"""What must stay fresh: of which device, which kind of sample, of which wheel (0 for other kinds)."""


class Mode(StrEnum):
    """What the controller does; only RUNNING moves the wheels, everywhere else they get zero set-points.

    OBSERVING: no mission; estimates only.
    SETTLING: waiting until every required device has been heard for a while.
    RUNNING: driving the mission.
    FINISHED: mission done.
    SAFE_STOP: a required device is silent, broken or faulty; resumes by itself.
    EMERGENCY_STOP: a bumper was pressed; stays until restart.
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
        self._down: dict[str, str] = {}
        self._faults: dict[tuple[str, int | None], str] = {}
        self._incident = ""
        self._emergency = ""
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

    def update(self, now_ns: int, estimate_is_finite: bool, motion_ns: int | None, doubt: str = "") -> None:
        """Decide the mode at `now_ns`.

        Args:
            now_ns: Time of the cycle.
            estimate_is_finite: Whether the estimate is made of numbers.
            motion_ns: When the motion of the wheels was last known.
            doubt: What else speaks against moving; empty when nothing does.
        """
        problem = self._incident or self._problem(now_ns, estimate_is_finite, motion_ns) or doubt
        self._incident = ""
        if self._emergency:
            self.mode, self.reason = Mode.EMERGENCY_STOP, self._emergency
        elif problem:
            self._healthy_since_ns = None
            self.reason = problem
            if self.mode is Mode.RUNNING:
                self.mode = Mode.SAFE_STOP
        else:
            self._resume(now_ns)

    def finish(self) -> None:
        """Tell that the mission is done."""
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

    def _problem(self, now_ns: int, estimate_is_finite: bool, motion_ns: int | None) -> str:
        if self._down or self._faults:
            return next(iter((*self._down.values(), *self._faults.values())))
        for part, (limit_ns, reason) in self._limits.items():
            heard_ns = self._heard_ns.get(part)
            if heard_ns is None or now_ns - heard_ns > limit_ns:
                return reason
        motion_age_s = self._roles.motion_age_s
        if motion_ns is None or now_ns - motion_ns > nanoseconds(motion_age_s):
            # Fresh positions that jump so much that none is a motion: the pose would stay where it is.
            return f"{self._roles.wheels}: no motion to be made out within {motion_age_s:g} s"
        return "" if estimate_is_finite else "pose filter: the estimate is not finite"

    def _observe_link(self, sample: LinkSample) -> None:
        if sample.device not in self._required:
            return
        if sample.up:
            self._down.pop(sample.device, None)
        else:
            # Kept for one update even if the link is back within the same cycle: the device may have
            # restarted.
            self._incident = self._down[sample.device] = f"{sample.device}: link down ({sample.reason})"

    def _observe_fault(self, sample: FaultSample) -> None:
        if sample.device not in self._required:
            return
        if sample.code:
            where = sample.device if sample.wheel is None else f"{sample.device} wheel {sample.wheel}"
            self._incident = f"{where}: fault {sample.code} ({sample.text})"
            self._faults[sample.device, sample.wheel] = self._incident
        elif sample.wheel is not None:
            self._faults.pop((sample.device, sample.wheel), None)
        else:
            self._faults = {key: text for key, text in self._faults.items() if key[0] != sample.device}


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
    if usable is None or not math.isfinite(usable):
        return ((device, Sample, 0),)
    return ((device, Sample, 0), (device, type(sample), wheel))
