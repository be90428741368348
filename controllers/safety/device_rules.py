"""Stop rules about required devices: bumper, link, fault, and samples that stay fresh."""

import math
from collections.abc import Iterable, Iterator

from controllers.estimation.filter.motion_history import HISTORY_NS
from controllers.fault import Cause, Fault, Severity
from controllers.roles import DeviceRoles
from controllers.safety.reasons import Cycle, StopRule
from drivers.clock import nanoseconds
from drivers.safety_event import AFTER_A_WAIT, RESTART, WHEN_GONE, Outcome, SafetyEvent
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

    events = (
        SafetyEvent(
            Outcome.ENDS,
            "A bumper is pressed.",
            "`…: bumper pressed`; `emergency stop`, exit code 1",
            ("tests/rover_hil/test_virtual_run.py::test_the_bumper_ends_the_run_and_the_wheels_stand",),
            within="one cycle",
            settings=("bumper_stops",),
            clears=RESTART,
        ),
    )

    def __init__(self, settings: BumperSettings) -> None:
        self._settings = settings
        self._pressed: list[Fault] = []

    def observe(self, sample: Sample, t_ns: int) -> None:
        """Take a bumper's state."""
        if isinstance(sample, BumperSample) and sample.pressed and self._settings.bumper_stops:
            text = f"{sample.device}: bumper pressed"
            self._pressed.append(Fault("bumper", Cause.BUMPER, text, Severity.FINAL))

    def check(self, cycle: Cycle) -> Iterable[Fault]:
        """Return the bumpers that were pressed since the last cycle."""
        pressed, self._pressed = self._pressed, []
        return pressed


class LinkRule(StopRule):
    """Stops while the link of a required device is down, and for one cycle when it broke for less.

    A link that is back within the same cycle may mean that the device has restarted.
    """

    observes = (LinkSample,)

    events = (
        SafetyEvent(
            Outcome.STOPS,
            "The link of a required device breaks.",
            "`…: link down (…)`",
            ("tests/controllers/test_faults.py::test_links_and_faults_stop_within_the_same_step",),
            within="one cycle",
            clears=WHEN_GONE,
        ),
        SafetyEvent(
            Outcome.STOPS,
            "The link of a required device breaks for less than a cycle.",
            "`…: link down (…)`",
            ("tests/controllers/safety/test_supervisor.py::test_a_break_within_one_cycle_stops_too",),
            within="one cycle",
            clears=AFTER_A_WAIT,
        ),
        SafetyEvent(
            Outcome.CONTINUES,
            "A device without a role, a GNSS receiver or a camera fails and is not required.",
            "It is recorded, and `run` shows `warning: … lost since … s of the run`. `required` "
            "in `[roles]` makes it stop the rover.",
            ("tests/controllers/safety/test_supervisor.py::test_devices_that_are_not_required_do_not_stop",),
            settings=("roles.required",),
        ),
    )

    def __init__(self, roles: DeviceRoles) -> None:
        self._roles = roles
        self._broken: list[Fault] = []
        self._down: dict[str, Fault] = {}

    def observe(self, sample: Sample, t_ns: int) -> None:
        """Take a link's state."""
        if not isinstance(sample, LinkSample) or sample.device not in self._roles.required:
            return
        if sample.up:
            self._down.pop(sample.device, None)
        else:
            reason = Fault(sample.device, Cause.LINK_DOWN, f"{sample.device}: link down ({sample.reason})")
            self._down[sample.device] = reason
            self._broken.append(reason)

    def check(self, cycle: Cycle) -> Iterable[Fault]:
        """Return the links that broke since the last cycle or are down."""
        broken, self._broken = self._broken, []
        return (*broken, *self._down.values())


class FaultRule(StopRule):
    """Stops while a required device reports a fault, and for one cycle when it did so for less."""

    observes = (FaultSample,)

    events = (
        SafetyEvent(
            Outcome.STOPS,
            "A required device reports a fault.",
            "`…: fault … (…)`",
            (
                "tests/controllers/safety/test_supervisor.py::"
                "test_link_and_fault_stop_at_once_and_hold_until_cleared",
            ),
            within="one cycle",
            clears=WHEN_GONE,
        ),
        SafetyEvent(
            Outcome.STOPS,
            "A drive on CAN no longer obeys setpoints and reports no error (state of its "
            "heartbeat, statusword, timeout or kill switch).",
            "`…: fault … (… does not obey setpoints …)`, `…: fault … (VESC … status: …)`",
            (
                "tests/drivers/test_can_wheels_field_reports.py::"
                "test_a_drive_of_ones_own_that_stops_obeying_is_a_fault_until_it_obeys",
            ),
            within="one cycle after the message; a drive that never begins to obey: 1 s",
            clears=WHEN_GONE,
        ),
    )

    def __init__(self, roles: DeviceRoles) -> None:
        self._roles = roles
        self._reported: list[Fault] = []
        self._faults: dict[tuple[str, int | None], Fault] = {}

    def observe(self, sample: Sample, t_ns: int) -> None:
        """Take a fault or its end; code 0 without a wheel ends all faults of its device."""
        if not isinstance(sample, FaultSample) or sample.device not in self._roles.required:
            return
        if sample.code:
            where = sample.device if sample.wheel is None else f"{sample.device} wheel {sample.wheel}"
            reason = Fault(where, Cause.DEVICE_FAULT, f"{where}: fault {sample.code} ({sample.text})")
            self._faults[sample.device, sample.wheel] = reason
            self._reported.append(reason)
        elif sample.wheel is not None:
            self._faults.pop((sample.device, sample.wheel), None)
        else:
            self._faults = {key: reason for key, reason in self._faults.items() if key[0] != sample.device}

    def check(self, cycle: Cycle) -> Iterable[Fault]:
        """Return the faults that were reported since the last cycle or still hold."""
        reported, self._reported = self._reported, []
        return (*reported, *self._faults.values())


class FreshnessRule(StopRule):
    """Stops when what a required device must give is older than its `max_age_s`.

    A sample counts when its number is usable: finite, and for a pose fix not too late to be used.
    """

    is_for_drives = False

    events = (
        SafetyEvent(
            Outcome.STOPS,
            "A required device sends nothing.",
            "`…: no … within … s`",
            (
                "tests/controllers/test_faults.py::"
                "test_a_silent_device_stops_the_rover_in_the_step_its_age_is_exceeded_and_"
                "motion_resumes_without_a_jump",
            ),
            within="`max_age_s` and one cycle",
            settings=("devices.NAME.max_age_s",),
            clears=WHEN_GONE,
        ),
        SafetyEvent(
            Outcome.STOPS,
            "The values of a required device are not finite or not usable, or its position "
            "measurements are late.",
            "`…: no … within … s`",
            ("tests/controllers/safety/test_supervisor.py::test_useless_samples_do_not_keep_a_device_alive",),
            within="`max_age_s` and one cycle",
            settings=("devices.NAME.max_age_s",),
            clears=WHEN_GONE,
        ),
        SafetyEvent(
            Outcome.STOPS,
            "The time stamps of a required device repeat or lie in the past.",
            "`…: no … within … s`",
            (
                "tests/controllers/safety/test_supervisor.py::"
                "test_repeated_and_old_stamps_do_not_keep_a_device_alive",
            ),
            within="`max_age_s` and one cycle",
            settings=("devices.NAME.max_age_s",),
            clears=WHEN_GONE,
        ),
        SafetyEvent(
            Outcome.CONTINUES,
            "The time stamps of a required device lie in the future.",
            "They count as now.",
            (
                "tests/controllers/test_faults.py::"
                "test_a_stamp_from_the_future_neither_looks_fresh_nor_blocks_what_follows",
            ),
        ),
        SafetyEvent(
            Outcome.STOPS,
            "A required device is lost and returns during a whole run on the simulated bus.",
            "`…: no … within … s` or `…: link down (…)`",
            (
                "tests/rover_hil/test_virtual_run.py::"
                "test_a_lost_device_stops_the_rover_and_a_returned_one_lets_it_go_on",
            ),
            within="`max_age_s` and one cycle",
            settings=("devices.NAME.max_age_s",),
            clears=WHEN_GONE,
        ),
        SafetyEvent(
            Outcome.STOPS,
            "A procedure (`calibrate`, `commission`) loses a device that it reads, for example "
            "the compass that is calibrated.",
            "`…: no … within … s`. A drive that is stopped for 10 s ends with exit code 1 and "
            "the reason. Only its log is written.",
            (
                "tests/rover_hil/test_lost_devices.py::"
                "test_every_procedure_stops_when_a_device_that_it_needs_is_unplugged",
            ),
            within="`max_age_s` and one cycle",
            settings=("devices.NAME.max_age_s",),
            clears=WHEN_GONE,
        ),
        SafetyEvent(
            Outcome.CONTINUES,
            "Images of an overhead camera arrive too late.",
            "Reported as `… too late`, counted in `summary.json`. It stops the rover only where "
            "these measurements are required.",
            ("tests/controllers/test_stops.py::test_late_fixes_are_reported_and_never_stop_the_rover",),
            settings=("roles.require_fixes",),
        ),
        SafetyEvent(
            Outcome.CONTINUES,
            "An overhead camera is lost.",
            "It stops the rover only with `require_fixes`.",
            (
                "tests/rover_hil/test_overhead_run.py::"
                "test_a_lost_camera_stops_the_rover_only_where_fixes_are_required",
            ),
            settings=("roles.require_fixes",),
        ),
        SafetyEvent(
            Outcome.CONTINUES,
            "The rear camera is lost or breaks.",
            "It stops the rover only with `require_camera`.",
            (
                "tests/rover_hil/test_config.py::"
                "test_the_rear_camera_is_required_only_where_the_configuration_says_so",
            ),
            settings=("roles.require_camera",),
        ),
    )

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

    def check(self, cycle: Cycle) -> Iterator[Fault]:
        """Return what is too old or was never received."""
        for part, (limit_ns, text) in self._limits.items():
            received_ns = self._received_ns.get(part)
            if received_ns is None or cycle.now_ns - received_ns > limit_ns:
                device, kind, wheel = part
                yield Fault(f"{device} {kind.__name__} {wheel}", Cause.NOT_FRESH, text)


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
