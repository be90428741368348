"""Stop rules about required devices: bumper, link, fault, and samples that stay fresh."""

import math
from collections.abc import Iterable, Iterator

from controllers.estimation.pose_fixes import HISTORY_NS
from controllers.roles import DeviceRoles
from controllers.safety.reasons import Cycle, Severity, StopReason, StopRule
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
from drivers.settings import Settings

Part = tuple[str, type[Sample], int]
"""What must stay fresh: of which device, which kind of sample, of which wheel (0 for other kinds)."""


class BumperSettings(Settings):
    """When the bumper stops the rover.

    Attributes:
        bumper_stops: A pressed bumper stops the rover until restart.
    """

    bumper_stops: bool = True


class BumperRule(StopRule):
    """Stops for good when a bumper is pressed, of any device."""

    observes = (BumperSample,)

    def __init__(self, settings: BumperSettings) -> None:
        self._settings = settings
        self._pressed: list[StopReason] = []

    def observe(self, sample: Sample, t_ns: int) -> None:
        """Take a bumper's state."""
        if isinstance(sample, BumperSample) and sample.pressed and self._settings.bumper_stops:
            text = f"{sample.device}: bumper pressed"
            self._pressed.append(StopReason("bumper", text, Severity.FINAL))

    def check(self, cycle: Cycle) -> Iterable[StopReason]:
        """Return the bumpers that were pressed since the last cycle."""
        pressed, self._pressed = self._pressed, []
        return pressed


class LinkRule(StopRule):
    """Stops while the link of a required device is down, and for one cycle when it broke for less.

    A link that is back within the same cycle may mean that the device has restarted.
    """

    observes = (LinkSample,)

    def __init__(self, roles: DeviceRoles) -> None:
        self._roles = roles
        self._broken: list[StopReason] = []
        self._down: dict[str, StopReason] = {}

    def observe(self, sample: Sample, t_ns: int) -> None:
        """Take a link's state."""
        if not isinstance(sample, LinkSample) or sample.device not in self._roles.required:
            return
        if sample.up:
            self._down.pop(sample.device, None)
        else:
            reason = StopReason(
                f"{sample.device}: link down", f"{sample.device}: link down ({sample.reason})"
            )
            self._down[sample.device] = reason
            self._broken.append(reason)

    def check(self, cycle: Cycle) -> Iterable[StopReason]:
        """Return the links that broke since the last cycle or are down."""
        broken, self._broken = self._broken, []
        return (*broken, *self._down.values())


class FaultRule(StopRule):
    """Stops while a required device reports a fault, and for one cycle when it did so for less."""

    observes = (FaultSample,)

    def __init__(self, roles: DeviceRoles) -> None:
        self._roles = roles
        self._reported: list[StopReason] = []
        self._faults: dict[tuple[str, int | None], StopReason] = {}

    def observe(self, sample: Sample, t_ns: int) -> None:
        """Take a fault or its end; code 0 without a wheel ends all faults of its device."""
        if not isinstance(sample, FaultSample) or sample.device not in self._roles.required:
            return
        if sample.code:
            where = sample.device if sample.wheel is None else f"{sample.device} wheel {sample.wheel}"
            reason = StopReason(f"{where}: fault", f"{where}: fault {sample.code} ({sample.text})")
            self._faults[sample.device, sample.wheel] = reason
            self._reported.append(reason)
        elif sample.wheel is not None:
            self._faults.pop((sample.device, sample.wheel), None)
        else:
            self._faults = {key: reason for key, reason in self._faults.items() if key[0] != sample.device}

    def check(self, cycle: Cycle) -> Iterable[StopReason]:
        """Return the faults that were reported since the last cycle or still hold."""
        reported, self._reported = self._reported, []
        return (*reported, *self._faults.values())


class FreshnessRule(StopRule):
    """Stops when what a required device must give is older than its `max_age_s`.

    A sample counts when its number is usable: finite, and for a pose fix not too late to be used.
    """

    is_for_drives = False

    def __init__(self, roles: DeviceRoles, wheel_count: int) -> None:
        self._devices = frozenset(roles.required)
        self._limits = _freshness_limits(roles, wheel_count)
        self._received_ns: dict[Part, int] = {}

    def observe(self, sample: Sample, t_ns: int) -> None:
        """Take one sample as of `t_ns`."""
        if sample.device not in self._devices or isinstance(sample, LinkSample | FaultSample):
            return
        for part in _parts(sample):
            if part in self._limits:
                self._received_ns[part] = max(t_ns, self._received_ns.get(part, t_ns))

    def check(self, cycle: Cycle) -> Iterator[StopReason]:
        """Return what is too old or was never received."""
        for part, (limit_ns, text) in self._limits.items():
            received_ns = self._received_ns.get(part)
            if received_ns is None or cycle.now_ns - received_ns > limit_ns:
                device, kind, wheel = part
                yield StopReason(f"{device} not fresh: {kind.__name__} {wheel}", text)


def _freshness_limits(roles: DeviceRoles, wheel_count: int) -> dict[Part, tuple[int, str]]:
    """Return for every part that must stay fresh its age limit and the reason when it is older."""
    limits: dict[Part, tuple[int, str]] = {}
    for device, max_age_s in roles.required.items():
        parts: list[tuple[Part, str]] = []
        if device == roles.wheels:
            measured = (i for i in range(wheel_count) if i not in roles.unmeasured_wheels)
            parts.extend(((device, WheelSample, i), f"position of wheel {i}") for i in measured)
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
        if usable is None or not math.isfinite(usable):
            usable = sample.speed_rad_s  # it is integrated
    elif isinstance(sample, RateSample):
        usable = sample.rate_z_rad_s
    elif isinstance(sample, HeadingSample):
        usable = sample.heading_rad
    elif isinstance(sample, PoseFixSample) and sample.t_ns - sample.t_capture_ns <= HISTORY_NS:
        usable = math.hypot(sample.x_m, sample.y_m, sample.yaw_rad)
    if usable is None or not math.isfinite(usable):
        return ((device, Sample, 0),)
    return ((device, Sample, 0), (device, type(sample), wheel))
