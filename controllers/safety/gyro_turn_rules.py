"""Stop rules that compare the gyro with the wheels while the rover drives."""

import math
from collections.abc import Iterator
from typing import Annotated

from pydantic import Field

from controllers.estimation.wheels.turn_evidence import TurnEvidence
from controllers.fault import Bound, Cause, Fault, Severity
from controllers.roles import DeviceRoles
from controllers.safety.reasons import Cycle, StopRule
from controllers.safety.unproven_turn import UnprovenTurn
from controllers.safety.yaw_watch import YawWatch
from drivers.safety_event import AFTER_A_WAIT, RESTART, Outcome, SafetyEvent
from drivers.settings import Settings


class GyroTurnSettings(Settings):
    """Which differences between gyro and wheels slip can explain.

    Attributes:
        gyro_difference_rad: The rover stops when the turn by the gyro exceeds what the wheels can explain by
            this much. What they can explain: each wheel loses up to the whole of its motion, or is dragged
            further by up to `gyro_drag_share` of it.
        gyro_drag_share: Greatest motion of the ground under a dragged wheel beyond that of its rim, as a
            share of the latter.
        gyro_follow_s: Gyro and wheels exclude each other when the gyro has not followed the changes of the
            wheels' turn rate for this long.
        gyro_follow_share: Least share of these changes that the gyro measures.
        gyro_follow_rad_s: Standard deviation of the turn rate from which on its changes count.
        gyro_turn_rad: They also do when the wheels have turned the rover by this much, on the spot or nearly,
            and the gyro has measured less than `gyro_follow_share` of the turn.
    """

    gyro_difference_rad: Annotated[float, Field(ge=0.005, le=3.0)] = 0.05
    gyro_drag_share: Annotated[float, Field(ge=0.0, le=1.0)] = 0.2
    gyro_follow_s: Annotated[float, Field(ge=0.1, le=60.0)] = 0.7
    gyro_follow_share: Annotated[float, Field(ge=0.0, le=1.0)] = 0.1
    gyro_follow_rad_s: Annotated[float, Field(ge=0.001, le=10.0)] = 0.05
    gyro_turn_rad: Annotated[float, Field(ge=0.02, le=10.0)] = 0.5


class GyroDifferenceRule(StopRule):
    """Stops when the gyro turns further than the wheels can explain, however they slip.

    Two sums, one for each direction, grow by what the gyro measures beyond the bound of the wheels and
    shrink by what is missing to it, but not below zero.
    """

    events = (
        SafetyEvent(
            Outcome.STOPS,
            "The gyro measures more rotation than slip can explain: each wheel may lose its "
            "whole motion, or be dragged further by `gyro_drag_share` of it.",
            "`…: yaw rate contradicts the wheels: …`",
            (
                "tests/controllers/safety/test_gyro_turn_rules.py::"
                "test_a_gyro_beyond_what_spinning_and_dragged_wheels_explain_is_named",
            ),
            within="`gyro_difference_rad` over the bound",
            settings=("gyro_difference_rad", "gyro_drag_share"),
            clears=AFTER_A_WAIT,
        ),
    )

    def __init__(self, settings: GyroTurnSettings, roles: DeviceRoles) -> None:
        self._settings = settings
        self._gyro = str(roles.gyro)
        self._left = _Excess()
        self._right = _Excess()

    def check(self, cycle: Cycle) -> Iterator[Fault]:
        """Take the evidence of a cycle; return a reason where the gyro cannot be right."""
        if cycle.wheels.is_still:
            self._left, self._right = _Excess(), _Excess()
        if cycle.gyro.turn is not None:
            gyro_rad, wheels = cycle.gyro.turn.gyro_rad, cycle.gyro.turn.wheels
            drag = 1.0 + self._settings.gyro_drag_share
            self._left.add(gyro_rad - drag * wheels.left_rad, gyro_rad - wheels.turn_rad)
            self._right.add(-gyro_rad - drag * wheels.right_rad, wheels.turn_rad - gyro_rad)
        limit_rad = self._settings.gyro_difference_rad
        for excess, side in ((self._left, "left"), (self._right, "right")):
            if excess.beyond_rad > limit_rad:
                text = (
                    f"{self._gyro}: yaw rate contradicts the wheels: {excess.difference_rad:.2f} rad more to "
                    f"the {side}, {limit_rad:g} rad more than slip can explain"
                )
                yield Fault(
                    self._gyro,
                    Cause.GYRO_BEYOND_WHEELS,
                    text,
                    bound=Bound(gyro_rad=excess.difference_rad, is_motion_unknown=True),
                )


class _Excess:
    """Turn beyond the bound, and difference to the wheels since there was none beyond it."""

    def __init__(self) -> None:
        self.beyond_rad = 0.0
        self.difference_rad = 0.0

    def add(self, beyond_rad: float, difference_rad: float) -> None:
        self.beyond_rad += beyond_rad
        self.difference_rad += difference_rad
        if self.beyond_rad <= 0.0:
            self.beyond_rad = self.difference_rad = 0.0


AVERAGE_S = 0.25
"""Time over which changes of the turn rate are averaged; chosen by hand."""

NOISE_AVERAGE_S = 2.0
"""Time over which the noise of the wheels' turn rate is averaged; chosen by hand."""

LEAST_NOISE_WEIGHT = 0.1
"""The noise is known from this weight of its average on, after 0.2 s; chosen by hand."""

NOISE_SHARE = 3.0
"""Changes count beyond this multiple of the noise's variance, whose averages scatter; chosen by hand."""


AGAINST = -0.5
"""Correlation of gyro and wheels below which the gyro turns against them: slip does not change a sign."""


WHY_NO_TURN = "no signal, wrong axis, wrong sign, or wheels without grip"


RESONANCE = 1.0 / 3.0
"""A contact near its resonance lets the rover swing against its wheels by up to 0.3 of their turn, on the
floors of `benchmarks.safety.healthy_missions`: a gyro that turns back no further may be right."""


class GyroFollowsRule(StopRule):
    """Notices a gyro that does not follow the changes of the wheels' turn rate: dead, wrong axis or sign.

    Slip takes away part of a change, never the sign. The regression of the gyro on the wheels over a moving
    average is free of the bias and of steady slip.

    Wheels that sweep without grip look like a gyro without a signal. While pose fixes or a camera agree with
    the yaw it is a suspicion; where they contradict it the gyro is dead. Where they say neither, the yaw
    becomes uncertain enough for both. A gyro that has turned against the wheels all the time is wrong: that
    stop is final.

    Wheels with time stamps of their own seem to turn the rover when a stamp is wrong, and back again in the
    next increment: such noise is known by successive turn rates that go opposite ways, and does not count.

    Args:
        settings: Thresholds.
        roles: Gyro, devices that give fixes, camera.
        unproven: Shared with `MissedTurnRule` and `DeadGyroRule`; this rule adds to it.
    """

    events = (
        SafetyEvent(
            Outcome.STOPS,
            "The gyro does not follow the changes of the wheels' yaw rate (wrong axis, or noise "
            "without signal), and pose measurements with a yaw contradict it beyond 3.5 standard "
            "deviations, or a ground camera does twice in a row.",
            "`…: yaw rate follows … % of the changes of the wheels' turn rate for … s: …; the "
            "rover turns otherwise than the gyro measures`",
            (
                "tests/controllers/safety/test_missed_turn_rule.py::"
                "test_where_fixes_contradict_the_yaw_the_gyro_is_dead",
            ),
            within="`gyro_follow_s` and 0.5 s of such changes; the next pose measurement",
            settings=("gyro_follow_s", "gyro_follow_share", "gyro_follow_rad_s"),
            clears="by a signal of the gyro, as for `…: no signal, although the rover turned: …`",
        ),
        SafetyEvent(
            Outcome.ENDS,
            "The gyro turns against the wheels: a correlation below -0.5, and back by more than "
            "a third of their rotation. Slip does not change a sign.",
            "`…: yaw rate follows -… %`; `emergency stop`, exit code 1",
            (
                "tests/controllers/safety/test_gyro_turn_rules.py::"
                "test_only_a_gyro_that_turns_against_the_wheels_stops_for_good",
            ),
            within="`gyro_follow_s` and 0.5 s",
            settings=("gyro_follow_s",),
            clears=RESTART,
        ),
        SafetyEvent(
            Outcome.CONTINUES,
            "The gyro does not follow the wheels, and pose measurements or a ground camera agree "
            "with the yaw within two standard deviations.",
            "Warning; no uncertainty is added.",
            (
                "tests/controllers/safety/test_gyro_turn_rules.py::"
                "test_while_fixes_agree_with_the_yaw_a_gyro_that_does_not_follow_is_a_suspicion",
            ),
        ),
    )

    def __init__(self, settings: GyroTurnSettings, roles: DeviceRoles, unproven: UnprovenTurn) -> None:
        self._settings = settings
        self._gyro = str(roles.gyro)
        self._watch = YawWatch(roles)
        self._unproven = unproven
        self._begin_anew()

    def _begin_anew(self) -> None:
        self._moments, self._noise = _Moments(), _WheelNoise()
        self._lost_s = self._against_s = self._wheels_rad = 0.0

    def check(self, cycle: Cycle) -> Iterator[Fault]:
        """Take the evidence of a cycle; return a reason while the gyro does not follow."""
        if cycle.wheels.is_still:
            self._begin_anew()
        if cycle.gyro.turn is not None:
            self._unproven.add(cycle.gyro.turn.wheels, cycle.wheels.distance_m)
            self._take(cycle.gyro.turn)
        self._watch.take(cycle)
        if self._lost_s:
            share = self._moments.covariance / self._moments.wheel_variance
            text = (
                f"{self._gyro}: yaw rate follows {100.0 * share:.0f} % of the changes of the wheels' turn "
                f"rate for {self._settings.gyro_follow_s:g} s: {WHY_NO_TURN}"
            )
            yaw_rad = self._unproven.error_rad(self._wheels_rad)
            severity = self._severity(cycle.now_ns)
            text += self._watch.consequence(severity)
            self._unproven.is_dead |= severity is Severity.STOP
            is_final = severity is Severity.FINAL
            bound = Bound(gyro_rad=yaw_rad, path_m=self._unproven.path_m, is_motion_unknown=is_final)
            yield Fault(self._gyro, Cause.GYRO_DOES_NOT_FOLLOW, text, severity, bound)

    def _severity(self, now_ns: int) -> Severity:
        follow_s = self._settings.gyro_follow_s
        if self._lost_s < follow_s:
            return Severity.SYMPTOM
        return Severity.FINAL if self._against_s >= follow_s else self._watch.severity(now_ns)

    def _take(self, evidence: TurnEvidence) -> None:
        settings, moments, wheels = self._settings, self._moments, evidence.wheels
        moments.add(wheels.duration_s, wheels.turn_rad, evidence.gyro_rad)
        self._noise.add(wheels.duration_s, wheels.turn_rad)
        wheel_variance = moments.wheel_variance
        least_variance = settings.gyro_follow_rad_s**2 + NOISE_SHARE * self._noise.variance
        is_turning = wheel_variance > least_variance
        least_covariance = settings.gyro_follow_share * wheel_variance
        if is_turning and moments.covariance < least_covariance:
            self._lost_s += wheels.duration_s
            turns_back = moments.covariance < -RESONANCE * wheel_variance
            is_against = moments.correlation < AGAINST and turns_back
            self._against_s = self._against_s + wheels.duration_s if is_against else 0.0
            self._wheels_rad += abs(wheels.turn_rad - evidence.gyro_rad)
        elif is_turning:
            self._lost_s = self._against_s = self._wheels_rad = 0.0
            self._unproven.prove()


class _Moments:
    """Moving averages of two rates, their product and their squares."""

    def __init__(self) -> None:
        self._weight = self._wheels = self._gyro = 0.0
        self._square = self._gyro_square = self._product = 0.0

    def add(self, duration_s: float, wheels_rad: float, gyro_rad: float) -> None:
        wheels, gyro = wheels_rad / duration_s, gyro_rad / duration_s
        share = -math.expm1(-duration_s / AVERAGE_S)
        self._weight += share * (1.0 - self._weight)
        self._wheels += share * (wheels - self._wheels)
        self._gyro += share * (gyro - self._gyro)
        self._square += share * (wheels * wheels - self._square)
        self._gyro_square += share * (gyro * gyro - self._gyro_square)
        self._product += share * (wheels * gyro - self._product)

    @property
    def wheel_variance(self) -> float:
        return self._square / self._weight - (self._wheels / self._weight) ** 2

    @property
    def covariance(self) -> float:
        return (self._product - self._wheels / self._weight * self._gyro) / self._weight

    @property
    def correlation(self) -> float:
        """Of both rates, -1 to 1; 0 for a gyro that does not change at all."""
        gyro_variance = self._gyro_square / self._weight - (self._gyro / self._weight) ** 2
        size = math.sqrt(max(0.0, gyro_variance * self.wheel_variance))
        return self.covariance / size if size > 0.0 else 0.0


class _WheelNoise:
    """Noise of a rate, by the moving average of the covariance of its successive values."""

    def __init__(self) -> None:
        self._weight = self._mean = self._mean_before = self._product = 0.0
        self._before: float | None = None

    def add(self, duration_s: float, wheels_rad: float) -> None:
        rate, before = wheels_rad / duration_s, self._before
        if before is not None:
            share = -math.expm1(-duration_s / NOISE_AVERAGE_S)
            self._weight += share * (1.0 - self._weight)
            self._mean += share * (rate - self._mean)
            self._mean_before += share * (before - self._mean_before)
            self._product += share * (rate * before - self._product)
        self._before = rate

    @property
    def variance(self) -> float:
        """Of errors that the next value takes back (covariance: minus half of it); infinite at first."""
        if self._weight < LEAST_NOISE_WEIGHT:
            return math.inf
        covariance = self._product - self._mean * self._mean_before / self._weight
        return max(0.0, -2.0 * covariance / self._weight)
