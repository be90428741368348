"""When the rover may move."""

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from enum import StrEnum

from controllers.fault import Cause, ClearedBy, Fault, Severity
from controllers.roles import DeviceRoles
from controllers.safety.reasons import Cycle
from controllers.safety.rule_set import RuleSet, stops_of
from controllers.safety.settings import SafetySettings, make_rules
from drivers.clock import nanoseconds
from drivers.safety_event import RESTART, WHEN_GONE, Outcome, SafetyEvent
from drivers.samples import Sample

EVENTS = (
    SafetyEvent(
        Outcome.STOPS,
        "A required device was never fresh.",
        "`…: no … within … s`",
        ("tests/controllers/safety/test_supervisor.py::test_motion_starts_after_the_settling_time",),
        within="no motion before `settle_s`",
        settings=("settle_s", "recover_s"),
        clears=WHEN_GONE,
    ),
    SafetyEvent(
        Outcome.ENDS,
        "The same stop occurs for the third time, and standstill does not show the cause.",
        "`emergency stop`, exit code 1",
        ("tests/controllers/test_stops.py::test_a_jammed_wheel_is_driven_three_times_and_then_no_more",),
        within="one cycle after the stop",
        settings=("identical_stops", "forget_stops_m"),
        clears=RESTART,
    ),
    SafetyEvent(
        Outcome.ENDS,
        "The same stop occurs for the third time, and standstill shows the cause.",
        "`emergency stop`, exit code 1",
        (
            "tests/controllers/test_stops.py::"
            "test_a_link_that_breaks_whenever_the_rover_moves_stops_it_for_good",
        ),
        within="one cycle after the stop",
        settings=("identical_stops", "forget_stops_m"),
        clears=RESTART,
    ),
    SafetyEvent(
        Outcome.ENDS,
        "A stop that a healthy rover may show, too, returns before `forget_stops_m`, for the "
        "same cause or another, or occurs for the third time.",
        "`emergency stop`, exit code 1",
        (
            "tests/controllers/safety/test_supervisor.py::"
            "test_the_second_suspicion_before_a_metre_without_one_is_final",
        ),
        within="one cycle after the stop",
        settings=("forget_stops_m", "suspicion_rest_s"),
        clears=RESTART,
    ),
)
"""Rows of the reference page of safety."""


class Mode(StrEnum):
    """What the controller does; only RUNNING moves the wheels, all other modes send zero setpoints.

    Attributes:
        OBSERVING: No mission: the program only estimates. Never ends.
        SETTLING: Waits until there has been no reason to stop for `settle_s`.
        RUNNING: Drives the mission, until there is a reason to stop or the mission is done.
        PAUSED: The operator has paused the mission on the page of `bench`. Ends at a reason to stop, or when
            the operator resumes the mission. Never the mode of the supervisor.
        FINISHED: The mission is done: the run ends, and the drive is stopped.
        SAFE_STOP: There is a reason to stop. Ends after `recover_s` without one; at the border of `area` when
            an operator has confirmed; after a stop that a healthy rover may show, too, also after
            `suspicion_rest_s` at standstill. Motion resumes from the measured wheel speeds.
        EMERGENCY_STOP: A final reason to stop: the run ends, and the drive is stopped. Lasts until restart.
    """

    OBSERVING = "observing"
    SETTLING = "settling"
    RUNNING = "running"
    PAUSED = "paused"
    FINISHED = "finished"
    SAFE_STOP = "safe_stop"
    EMERGENCY_STOP = "emergency_stop"


MOST_SUSPICIONS = 3
"""This many suspicions of a mission end it, whatever the distance between them."""

SEVERITIES = tuple(Severity)
"""The least severe one first."""


@dataclass(slots=True)
class _Stops:
    """Stops for one cause, and the distance driven since the last of them without a sign of it."""

    count: int = 0
    healthy_m: float = 0.0


@dataclass(slots=True)
class _Suspicions:
    """Suspicions of a mission, whatever their causes, and the distance driven since without a sign of one."""

    count: int = 0
    causes: set[tuple[str, Cause]] = field(default_factory=set)
    healthy_m: float = math.inf


class SafetySupervisor:
    """Asks the stop rules and decides the mode of a mission.

    The most severe reason of a cycle decides, the first of several. Where another comes before it, that is
    the likelier cause, and both are reported.

    A recoverable stop is a suspicion: the rover goes on after `suspicion_rest_s` with its wheels at rest. The
    second suspicion before `forget_stops_m` without a sign of one, and the third in a mission, is final,
    whatever their causes. A stop counts as one suspicion, however many rules have it.

    Args:
        settings: Thresholds and waiting times.
        roles: Which devices are required, and as what.
        wheel_count: Number of wheels.
        heading_lag_s: Time constant of the heading devices.

    Attributes:
        mode: The mode after the last `update`.
        reason: Why the rover is stopped; empty while nothing is wrong.
        suspicion: What may be wrong although it stops nothing; empty for nothing.
        stop_cause: Cause of the newest stop; None before the first.
        is_gyro_undecided: Whether gyro and wheels exclude each other, and nothing decides.
        faults: What the rules have found in this cycle.
        waits_for_operator: Whether the rover stays stopped until an operator confirms that it may move.
    """

    def __init__(
        self, settings: SafetySettings, roles: DeviceRoles, wheel_count: int, heading_lag_s: float = 0.0
    ) -> None:
        self._settings = settings
        self._rules = RuleSet(make_rules(settings, roles, wheel_count, heading_lag_s))
        self._stops: dict[tuple[str, Cause], _Stops] = {}
        self._suspicions = _Suspicions()
        self._is_suspected = False
        self._healthy_since_ns: int | None = None
        self.mode = Mode.SETTLING
        self.reason = self.suspicion = ""
        self.stop_cause: Cause | None = None
        self.is_gyro_undecided = False
        self.faults: list[Fault] = []
        self.waits_for_operator = False

    def observe(self, sample: Sample, t_ns: int) -> None:
        """Take one sample as of `t_ns`."""
        self._rules.observe(sample, t_ns)

    def update(self, cycle: Cycle) -> None:
        """Decide the mode of this cycle."""
        faults = self.faults = self._rules.faults(cycle)
        stops = stops_of(faults)
        shown = (Severity.WARNING, Severity.UNCERTAIN)
        self.suspicion = next((each.text for each in faults if each.severity in shown), "")
        self.is_gyro_undecided = any(
            each.severity is Severity.UNCERTAIN and each.cause is not Cause.LOST_RESPONSE for each in faults
        )
        self.waits_for_operator = False
        if self.mode is Mode.EMERGENCY_STOP:
            return
        if self.mode is Mode.RUNNING:
            self._forget_stops(cycle.wheels.distance_m, {fault.key for fault in faults})
        if stops:
            stop = self._count(_most_severe(stops))
            self._stop(stop)
            waiting = any(each.cleared_by is ClearedBy.OPERATOR for each in stops)
            self.waits_for_operator = waiting and stop.severity is not Severity.FINAL
        else:
            self._resume(cycle)

    def finish(self) -> None:
        """End the mission."""
        self.mode = Mode.FINISHED

    def _stop(self, stop: Fault) -> None:
        self._healthy_since_ns = None
        self.reason, self.stop_cause = stop.text, stop.cause
        if stop.severity is Severity.FINAL:
            self.mode = Mode.EMERGENCY_STOP
        elif self.mode is Mode.RUNNING:
            self.mode = Mode.SAFE_STOP

    def _resume(self, cycle: Cycle) -> None:
        if self._healthy_since_ns is None or (self._is_suspected and not cycle.wheels.is_still):
            self._healthy_since_ns = cycle.now_ns
        is_waiting = self.mode is Mode.SETTLING or self.mode is Mode.SAFE_STOP
        if is_waiting and cycle.now_ns - self._healthy_since_ns >= nanoseconds(self._wait_s()):
            self.mode = Mode.RUNNING
            self._is_suspected = False
        if self.mode is not Mode.SAFE_STOP:
            self.reason = ""

    def _wait_s(self) -> float:
        """Return for how long there must be no reason to stop before motion begins or resumes."""
        settings = self._settings
        if self.mode is Mode.SETTLING:
            return settings.settle_s
        return max(settings.recover_s, settings.suspicion_rest_s if self._is_suspected else 0.0)

    def _forget_stops(self, distance_m: float, signs: Collection[tuple[str, Cause]]) -> None:
        """Forget the stops of every cause that has shown no sign for long enough."""
        if self._suspicions.causes.isdisjoint(signs):
            self._suspicions.healthy_m += distance_m
        for cause, stops in list(self._stops.items()):
            if cause not in signs:
                stops.healthy_m += distance_m
            if stops.healthy_m >= self._settings.forget_stops_m:
                del self._stops[cause]

    def _count(self, stop: Fault) -> Fault:
        """Count a stop; return it, final where it is one too many."""
        if stop.severity is Severity.RECOVERABLE:
            return self._suspect(stop)
        if (
            self.mode is not Mode.RUNNING or stop.cleared_by is ClearedBy.OPERATOR
        ):  # it cannot repeat by itself
            return stop
        stops = self._stops.setdefault(stop.key, _Stops())
        stops.count += 1
        stops.healthy_m = 0.0
        if stops.count < self._settings.identical_stops or stop.severity is Severity.FINAL:
            return stop
        return _last(stop, f"stopped {stops.count} times for this")

    def _suspect(self, stop: Fault) -> Fault:
        """Count a suspicion, once while the rover is stopped; return it, final where it is one too many.

        It may arise after another reason has stopped the rover, while it brakes.
        """
        if self._is_suspected or self.mode not in (Mode.RUNNING, Mode.SAFE_STOP):
            return stop
        suspicions = self._suspicions
        is_early = suspicions.healthy_m < self._settings.forget_stops_m
        suspicions.count += 1
        suspicions.causes.add(stop.key)
        suspicions.healthy_m = 0.0
        self._is_suspected = True
        if not is_early and suspicions.count < MOST_SUSPICIONS:
            return stop
        return _last(stop, f"stopped {suspicions.count} times on suspicion")


def _most_severe(stops: Sequence[Fault]) -> Fault:
    """Return the most severe stop; its text begins with that of the first, which is the likelier cause."""
    stop = max(stops, key=lambda stop: SEVERITIES.index(stop.severity))
    return stop if stop is stops[0] else stop._replace(text=f"{stops[0].text}; {stop.text}")


def _last(stop: Fault, why: str) -> Fault:
    """Return the stop as a final one."""
    return stop._replace(text=f"{stop.text}; {why}, stays stopped until restart", severity=Severity.FINAL)
