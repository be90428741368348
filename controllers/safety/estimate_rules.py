"""Stop rules about the estimate: motion that is known, numbers that are finite."""

import math
from collections.abc import Iterator
from typing import Annotated

from pydantic import Field

from controllers.estimation.positions.frames import DISPLACED, TURNED
from controllers.fault import Cause, Fault, Severity
from controllers.roles import DeviceRoles
from controllers.safety.reasons import Cycle, StopRule
from drivers.clock import nanoseconds
from drivers.safety_event import WHEN_GONE, Outcome, SafetyEvent
from drivers.settings import Settings


class UnseenSettings(Settings):
    """How much of the rover's motion may be unknown.

    Attributes:
        unseen_position_m: The rover stays stopped while motion that was not measured leaves the position with
            a standard deviation above this.
        unseen_yaw_rad: The same for the yaw.

    The rover also stops when it takes a pose fix that is displaced by more against the estimate.
    """

    unseen_position_m: Annotated[float, Field(ge=0.001, le=1000.0)] = 0.15
    unseen_yaw_rad: Annotated[float, Field(ge=0.001, le=1000.0)] = 0.1


class UnseenMotionRule(StopRule):
    """Stops when too much motion was not measured, until a fix or a heading gives the pose again.

    Where no device can, only the user knows: the stop is final.
    """

    is_for_drives = False

    events = (
        SafetyEvent(
            Outcome.STOPS,
            "Too much motion was not measured, and a device measures the pose.",
            "`pose filter: … uncertain by …, motion was not measured: needs …`",
            (
                "tests/controllers/test_unseen_motion.py::"
                "test_after_too_much_unseen_motion_a_fix_lets_the_rover_go_on",
            ),
            within="with the first sample after it",
            settings=("unseen_position_m", "unseen_yaw_rad"),
            clears="a pose measurement, for the yaw also a heading, that reduces the uncertainty below "
            "the limit",
        ),
        SafetyEvent(
            Outcome.ENDS,
            "Too much motion was not measured, and no device measures the pose.",
            "`pose filter: … uncertain by …, motion was not measured: needs …`; "
            "`emergency stop`, exit code 1",
            (
                "tests/controllers/test_unseen_motion.py::"
                "test_after_too_much_unseen_motion_the_run_ends_where_no_device_can_find_the_"
                "rover",
            ),
            within="with the first sample after it",
            settings=("unseen_position_m", "unseen_yaw_rad"),
            clears="restart at a known pose; higher limits let the rover drive on",
        ),
    )

    def __init__(self, settings: UnseenSettings, roles: DeviceRoles) -> None:
        self._settings = settings
        self._position_severity = Severity.STOP if roles.fixes else Severity.FINAL
        self._yaw_severity = Severity.STOP if roles.fixes or roles.headings else Severity.FINAL

    def check(self, cycle: Cycle) -> Iterator[Fault]:
        """Return a reason for position and yaw where they are too uncertain."""
        if cycle.uncertainty.unobserved_m > self._settings.unseen_position_m:
            yield _unseen("position", f"{cycle.uncertainty.unobserved_m:.2f} m", self._position_severity)
        if cycle.uncertainty.unobserved_rad > self._settings.unseen_yaw_rad:
            yield _unseen("yaw", f"{cycle.uncertainty.unobserved_rad:.2f} rad", self._yaw_severity)


def _unseen(what: str, by: str, severity: Severity) -> Fault:
    needed = "a fix" if severity is Severity.STOP else "a restart at a known pose"
    text = f"pose filter: {what} uncertain by {by}, motion was not measured: needs {needed}"
    return Fault(what, Cause.UNOBSERVED_MOTION, text, severity)


class YawDoubtSettings(Settings):
    """How uncertain the yaw may be while gyro and wheels exclude each other.

    Attributes:
        yaw_doubt_rad: Where pose fixes or headings can decide, the rover stops when two standard deviations
            of the yaw by this exceed this angle, and they decide at standstill.
        unwatched_yaw_rad: Where nothing can decide, it stops until restart beyond this angle; None for never.
        turn_to_find_out: Where nothing can decide, it interrupts its mission once for a slow rotation on the
            spot by at most 10 deg in both directions: a gyro that measures it has a signal. A rover that
            cannot turn on the spot does not.
    """

    yaw_doubt_rad: Annotated[float, Field(ge=0.01, le=10.0)] = 0.15
    unwatched_yaw_rad: Annotated[float | None, Field(ge=0.01, le=10.0)] = None
    turn_to_find_out: bool = False


TWO_SD = 2.0

DECIDE_S = 3.0
"""Fixes and headings have this time at rest to decide: one period and a half of fixes at 0.5 Hz."""


class YawDoubtRule(StopRule):
    """Stops where the yaw is uncertain because gyro and wheels exclude each other, so that others decide.

    What is left after `DECIDE_S` at rest is accepted: fixes without a yaw show it only while the rover moves.
    A camera decides while the rover drives, or not at all.
    """

    is_for_drives = False

    events = (
        SafetyEvent(
            Outcome.STOPS,
            "Gyro and wheels exclude each other, pose measurements or headings exist, and two "
            "standard deviations of the yaw exceed the limit.",
            "`pose filter: yaw uncertain by … rad, gyro and wheels exclude each other: waits for "
            "fixes or headings`",
            (
                "tests/controllers/safety/test_yaw_doubt_rule.py::"
                "test_where_something_can_decide_the_rover_stops_at_two_deviations",
            ),
            within="one cycle",
            settings=("yaw_doubt_rad", "suspicion_rest_s"),
            clears="once, after `suspicion_rest_s` at standstill. The sensors have 3 s to decide; the "
            "uncertainty that is left is accepted",
        ),
        SafetyEvent(
            Outcome.CONTINUES,
            "Gyro and wheels exclude each other, and nothing can decide.",
            "Warning; yaw and position are uncertain by both hypotheses. With "
            "`unwatched_yaw_rad` the run ends at that limit. With `turn_to_find_out` the mission "
            "is interrupted once for a slow rotation on the spot by up to 10 deg in both "
            "directions: a gyro that measures it has a signal, and the uncertainty grows no "
            "further.",
            (
                "tests/controllers/test_wrong_sensors.py::"
                "test_a_gyro_without_a_signal_is_named_and_the_run_goes_on_with_a_yaw_wide_"
                "enough_for_both",
                "tests/controllers/safety/test_yaw_doubt_rule.py::"
                "test_where_nothing_can_decide_there_is_a_limit_only_if_it_is_set",
            ),
            settings=("unwatched_yaw_rad", "turn_to_find_out"),
        ),
    )

    def __init__(self, settings: YawDoubtSettings, roles: DeviceRoles) -> None:
        self._settings = settings
        self._can_decide = bool(roles.fixes or roles.headings)
        self._accepted_rad = 0.0
        self._rests_since_ns: int | None = None

    def check(self, cycle: Cycle) -> Iterator[Fault]:
        """Return a reason while the yaw is too uncertain."""
        two_sd_rad, limit_rad = TWO_SD * cycle.uncertainty.undecided_rad, self._settings.yaw_doubt_rad
        if not self._can_decide:
            limit_rad = self._settings.unwatched_yaw_rad or math.inf
            if two_sd_rad > limit_rad:
                yield _doubted(two_sd_rad, "put the rover on a known pose and restart", Severity.FINAL)
            return
        self._accepted_rad = min(self._accepted_rad, two_sd_rad)
        is_over = two_sd_rad - self._accepted_rad > limit_rad
        if not (is_over and cycle.wheels.is_still):
            self._rests_since_ns = None
        elif self._rests_since_ns is None:
            self._rests_since_ns = cycle.now_ns
        elif cycle.now_ns - self._rests_since_ns >= nanoseconds(DECIDE_S):
            self._accepted_rad = two_sd_rad
            return
        if is_over:
            yield _doubted(two_sd_rad, "waits for fixes or headings", Severity.RECOVERABLE)


def _doubted(two_sd_rad: float, remedy: str, severity: Severity) -> Fault:
    text = f"pose filter: yaw uncertain by {two_sd_rad:.2f} rad, gyro and wheels exclude each other: {remedy}"
    return Fault("pose filter", Cause.UNCERTAIN_YAW, text, severity)


class DisplacedFixRule(StopRule):
    """Stops when fixes that contradict the estimate by much were taken after all.

    The estimate follows them, as after slip that was greater than its uncertainty. But as well the rover may
    have been carried, or the device that gives the fixes may have been moved: only the user sees which.
    """

    events = (
        SafetyEvent(
            Outcome.STOPS,
            "Pose measurements that contradict the estimate are used after two rejections, and "
            "lie farther from it than the limit: they are `displaced` (position) or `turned` (yaw).",
            "`…: fixes … by … against the estimate: rover carried, device moved, or "
            "wheels slipped more than [filter] expects`",
            (
                "tests/controllers/test_fixes.py::"
                "test_a_rover_that_follows_displaced_fixes_stops_and_names_their_device",
            ),
            within="the third measurement",
            settings=("unseen_position_m", "unseen_yaw_rad", "ground.slip_sd"),
            clears="when the estimate has followed them; the third time it is final. On very slippery "
            "ground raise `ground.slip_sd`",
        ),
    )

    def __init__(self, settings: UnseenSettings) -> None:
        self._limits = {
            DISPLACED: (settings.unseen_position_m, "m"),
            TURNED: (settings.unseen_yaw_rad, "rad"),
        }

    def check(self, cycle: Cycle) -> Iterator[Fault]:
        """Return a reason for each fix of this cycle that is displaced by too much."""
        for innovation in cycle.measurements.innovations:
            device, quantity = innovation.measured
            limit, unit = self._limits.get(quantity, (math.inf, ""))
            if (innovation.residual or 0.0) > limit:
                text = f"{device}: fixes {quantity} by {innovation.residual:.2f} {unit} against the estimate"
                cause = "rover carried, device moved, or wheels slipped more than [filter] expects"
                yield Fault(device, Cause.DISPLACED_POSITION, f"{text}: {cause}")


class FixJumpRule(StopRule):
    """Stops while the places of a device are off by more than the rover can have moved.

    They may be wrong, or somebody has carried the rover: nothing on board shows which, and the uncertainty
    contains both. They decide by returning; else the user does.
    """

    events = (
        SafetyEvent(
            Outcome.STOPS,
            "Positions without a yaw (GNSS) jump by more than the wheels have rolled since the "
            "last one, and by more than the limit. The region of the estimate then contains both "
            "places.",
            "`…: its places jumped by … m, further than the wheels rolled: wrong places, or the "
            "rover was carried; waits until they return; …`",
            (
                "tests/rover_hil/test_gnss_run.py::test_after_a_jump_the_rover_waits_until_the_places_return",
                "tests/rover_hil/test_gnss_run.py::"
                "test_after_a_lasting_step_the_rover_stays_stopped_and_its_region_holds_both_"
                "places",
            ),
            within="the third position",
            settings=("unseen_position_m",),
            clears="when the positions return; else restart at a known pose",
        ),
    )

    def __init__(self, settings: UnseenSettings) -> None:
        self._limit_m = settings.unseen_position_m

    def check(self, cycle: Cycle) -> Iterator[Fault]:
        """Return a reason for each device that has jumped by too much."""
        for device, offset_m in cycle.measurements.jumped_m.items():
            if abs(offset_m) > self._limit_m:
                text = (
                    f"{device}: its places jumped by {abs(offset_m):.2f} m, further than the wheels rolled: "
                    "wrong places, or the rover was carried; waits until they return; "
                    "if they do not, put the rover on a known pose and restart"
                )
                yield Fault(device, Cause.JUMPED_POSITION, text)


class DifferentMotionRule(StopRule):
    """Shows that positions and wheels move differently: more slip than is expected, or wrong positions."""

    is_for_drives = False

    events = (
        SafetyEvent(
            Outcome.CONTINUES,
            "Positions without a yaw (GNSS) move otherwise than the wheels, by more than the slip that the "
            "filter expects.",
            "Warning; the region of the estimate contains both places until both move alike again.",
            (
                "tests/controllers/test_position_relation.py::"
                "test_a_scale_of_the_positions_is_reported_and_the_region_contains_both_places",
            ),
            settings=("ground.slip", "ground.slip_sd", "ground.slip_distance_m"),
        ),
    )

    def check(self, cycle: Cycle) -> Iterator[Fault]:
        """Return a warning for each device whose positions differ by too much."""
        for device, apart_m in cycle.measurements.unexpected_m.items():
            text = (
                f"{device} and the wheels: their ways differ by {abs(apart_m):.2f} m, more than the slip "
                "that [filter] expects: wheels that slip more, or wrong positions"
            )
            yield Fault(device, Cause.DIFFERENT_MOTION, text, Severity.WARNING)


class MotionRule(StopRule):
    """Stops when no motion of the wheels has been measured for `motion_age_s` of the roles.

    Positions may be fresh and jump so much that none is a motion: the pose would stay where it is.
    """

    is_for_drives = False

    events = (
        SafetyEvent(
            Outcome.STOPS,
            "Wheel positions jump, so that no difference is a motion.",
            "`…: no wheel motion measured for … s`",
            (
                "tests/controllers/test_faults.py::"
                "test_positions_that_jump_to_and_fro_stop_the_rover_although_they_are_fresh",
            ),
            within="twice the `max_age_s` of the wheels and one cycle",
            settings=("devices.NAME.max_age_s",),
            clears=f"{WHEN_GONE}; motion may disturb the encoders again",
        ),
        SafetyEvent(
            Outcome.STOPS,
            "The program is paused (stopped, or without processor time).",
            "`…: no wheel motion measured for … s`. Data that waited in buffers are not used.",
            (
                "tests/controllers/test_unseen_motion.py::"
                "test_what_waited_in_buffers_during_a_pause_does_not_turn_the_rover",
            ),
            within="one cycle after the pause",
            clears="when its data are new again, if the motion in between leaves little uncertainty",
        ),
    )

    def __init__(self, roles: DeviceRoles) -> None:
        self._limit_ns = nanoseconds(roles.motion_age_s)
        self._wheels = roles.wheels
        self._text = f"{roles.wheels}: no wheel motion measured for {roles.motion_age_s:g} s"

    def check(self, cycle: Cycle) -> Iterator[Fault]:
        """Return a reason when the motion is unknown for too long."""
        if cycle.wheels.motion_ns is None or cycle.now_ns - cycle.wheels.motion_ns > self._limit_ns:
            yield Fault(self._wheels, Cause.NO_MOTION, self._text)


class FiniteEstimateRule(StopRule):
    """Stops when a number of the estimate is not finite."""

    events = (
        SafetyEvent(
            Outcome.STOPS,
            "The estimate is not finite.",
            "`pose filter: the estimate is not finite`",
            ("tests/controllers/safety/test_supervisor.py::test_an_estimate_that_is_not_finite_stops",),
            within="one cycle",
            clears=WHEN_GONE,
        ),
    )

    def check(self, cycle: Cycle) -> Iterator[Fault]:
        """Return a reason when the estimate is not finite."""
        if not cycle.estimate.is_finite:
            yield Fault("pose filter", Cause.NOT_FINITE, "pose filter: the estimate is not finite")
