"""Stop rules about the readings of the gyro: stuck, too great, and at rest."""

import math
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from statistics import fmean, stdev
from typing import Annotated

from pydantic import Field

from controllers.fault import Bound, Cause, Fault
from controllers.roles import DeviceRoles
from controllers.safety.reasons import Cycle, StopRule
from drivers.clock import nanoseconds, seconds
from drivers.safety_event import AFTER_A_WAIT, WHEN_GONE, Outcome, SafetyEvent
from drivers.samples import RateSample, Sample
from drivers.settings import Settings


class GyroReadingSettings(Settings):
    """Which readings of the gyro are implausible.

    Attributes:
        gyro_stuck_s: The rover stops when the reading has not changed at all for this long while the wheels
            turned; longer for a gyro that sends a fixed zero at slow turns.
        gyro_jump_rad_s: The rover stops when the reading changes by more than this within 0.05 s and stays
            there: inertia does not allow it.
        gyro_rest_s: At standstill the readings are averaged over this time; shorter than `recover_s` less the
            `standstill_s` of the filter, so that motion does not resume before.
        gyro_rest_rad_s: At standstill the rover stays stopped while the average differs by more than this
            from the estimated bias.
        gyro_step_rad_s: A bias that has changed by more than this between two standstills has made the yaw
            wrong.
    """

    gyro_stuck_s: Annotated[float, Field(ge=0.1, le=3600.0)] = 1.0
    gyro_jump_rad_s: Annotated[float, Field(ge=0.01, le=100.0)] = 0.35
    gyro_rest_s: Annotated[float, Field(ge=0.05, le=10.0)] = 0.15
    gyro_rest_rad_s: Annotated[float, Field(ge=0.001, le=3.0)] = 0.05
    gyro_step_rad_s: Annotated[float, Field(ge=0.0005, le=3.0)] = 0.006


CYCLES = 3
"""After so many cycles the wheels show a jump of their own; chosen by hand."""

AT_REST = (0.0, 0.0)
"""Turn rates by gyro and wheels, rad/s."""

JUMP_NS = nanoseconds(0.05)
"""Readings that are further apart may differ by any amount."""

STAYS = 0.5
"""A jump stays when the next reading differs by this share of the limit; chosen by hand."""

STANDARD_ERRORS = 4.0
"""The average at rest counts with this many of its standard errors; chosen by hand."""


@dataclass(slots=True)
class _Stuck:
    """Time for which the wheels have turned since the reading changed, and their difference to the gyro."""

    duration_s: float = 0.0
    difference_rad: float = 0.0


class StuckGyroRule(StopRule):
    """Stops when the gyro repeats one reading while the wheels turn: noise changes every reading.

    It is dead until the reading changes, also at rest.
    """

    observes = (RateSample,)

    events = (
        SafetyEvent(
            Outcome.STOPS,
            "The gyro repeats one reading, zero or another, while the wheels turn.",
            "`…: yaw rate stuck at … rad/s for … s while the wheels turned`",
            ("tests/controllers/test_wrong_sensors.py::test_a_wrong_gyro_is_named_within_the_bar",),
            within="`gyro_stuck_s` and one cycle",
            settings=("gyro_stuck_s",),
            clears="when the reading changes",
        ),
    )

    def __init__(self, settings: GyroReadingSettings, roles: DeviceRoles) -> None:
        self._settings = settings
        self._gyro, self._wheels_age_s = str(roles.gyro), roles.max_age_s(roles.wheels)
        self._reading_rad_s: float | None = None
        self._stuck = _Stuck()

    def observe(self, sample: Sample, t_ns: int) -> None:
        """Take a reading of the gyro."""
        if isinstance(sample, RateSample) and sample.device == self._gyro:
            if sample.rate_z_rad_s != self._reading_rad_s:
                self._stuck = _Stuck()
            self._reading_rad_s = sample.rate_z_rad_s

    def check(self, cycle: Cycle) -> Iterator[Fault]:
        """Count the time while wheels turned and the reading stayed; return a reason when it is too long."""
        is_dead = self._stuck.duration_s > self._settings.gyro_stuck_s
        if cycle.wheels.is_still and not is_dead:
            self._stuck = _Stuck()
        elif not cycle.wheels.is_still and cycle.gyro.turn is not None and self._reading_rad_s is not None:
            turn = cycle.gyro.turn
            if turn.wheels.duration_s <= self._wheels_age_s:  # silent wheels may have come to rest meanwhile
                self._stuck.duration_s += turn.wheels.duration_s
            self._stuck.difference_rad += abs(turn.wheels.turn_rad - turn.gyro_rad)
        if self._stuck.duration_s > self._settings.gyro_stuck_s:
            text = (
                f"{self._gyro}: yaw rate stuck at {self._reading_rad_s:g} rad/s for "
                f"{self._settings.gyro_stuck_s:g} s while the wheels turned"
            )
            yield Fault(self._gyro, Cause.GYRO_STUCK, text, bound=Bound(gyro_rad=self._stuck.difference_rad))


class GyroJumpRule(StopRule):
    """Stops when the reading jumps and stays there, until the wheels are at rest.

    Afterwards steering hides an offset: it turns the rover until the gyro reads what it should.
    """

    observes = (RateSample,)

    events = (
        SafetyEvent(
            Outcome.STOPS,
            "The gyro jumps and stays there, for example when an offset of 0.5 rad/s begins.",
            "`…: yaw rate jumped by … rad/s within 0.05 s`",
            ("tests/controllers/test_wrong_sensors.py::test_a_wrong_gyro_is_named_within_the_bar",),
            within="two readings and three cycles",
            settings=("gyro_jump_rad_s",),
            clears=AFTER_A_WAIT,
        ),
    )

    def __init__(self, settings: GyroReadingSettings, roles: DeviceRoles) -> None:
        self._settings = settings
        self._gyro = str(roles.gyro)
        self._steady: tuple[int, float] | None = None
        self._sudden: tuple[int, float] | None = None
        self._jump: tuple[int, float] | None = None
        self._rates_rad_s = deque([AT_REST], maxlen=CYCLES + 2)
        self._cycles = 0

    def observe(self, sample: Sample, t_ns: int) -> None:
        """Take a reading of the gyro and compare it with the last one that others confirm."""
        if not isinstance(sample, RateSample) or sample.device != self._gyro:
            return
        rate_rad_s = sample.rate_z_rad_s
        steady_ns, steady_rad_s = (t_ns, rate_rad_s) if self._steady is None else self._steady
        change_rad_s = rate_rad_s - steady_rad_s
        is_sudden = self._sudden is not None or t_ns - steady_ns <= JUMP_NS
        # The rover goes on turning: by the next reading a part of the jump may be gone.
        share = 1.0 if self._sudden is None else STAYS
        if not is_sudden or abs(change_rad_s) <= share * self._settings.gyro_jump_rad_s:
            self._steady, self._sudden = (t_ns, rate_rad_s), None
            return
        if self._sudden is None or math.copysign(1.0, self._sudden[1]) != math.copysign(1.0, change_rad_s):
            self._sudden = (t_ns, change_rad_s)
            return
        if self._jump is None:
            self._jump = self._sudden
        self._steady, self._sudden = (t_ns, rate_rad_s), None

    def check(self, cycle: Cycle) -> Iterator[Fault]:
        """Return a reason after a jump, until the wheels are at rest."""
        if cycle.wheels.is_still:
            self._jump = None
            self._rates_rad_s.clear()
            self._rates_rad_s.append(AT_REST)
        if cycle.gyro.turn is not None:
            gyro_rad, wheels = cycle.gyro.turn.gyro_rad, cycle.gyro.turn.wheels
            self._rates_rad_s.append((gyro_rad / wheels.duration_s, wheels.turn_rad / wheels.duration_s))
            self._cycles = 0 if self._jump is None else self._cycles + 1
            if self._cycles == CYCLES and self._is_of_wheels():
                self._jump = None
        if self._jump is not None and self._cycles >= CYCLES:
            jump_ns, change_rad_s = self._jump
            turned_rad = abs(change_rad_s) * seconds(cycle.now_ns - jump_ns)
            text = f"{self._gyro}: yaw rate jumped by {change_rad_s:.2f} rad/s within {seconds(JUMP_NS):g} s"
            yield Fault(self._gyro, Cause.GYRO_JUMP, text, bound=Bound(gyro_rad=turned_rad))

    def _is_of_wheels(self) -> bool:
        """Return whether the wheels' turn rate has changed alike: a wheel has jammed.

        What counts is the difference of both changes over the same cycles: the rover turned before, too.
        """
        (gyro_rad_s, wheels_rad_s), newest_rad_s = self._rates_rad_s[0], self._rates_rad_s[-1]
        difference_rad_s = (newest_rad_s[0] - gyro_rad_s) - (newest_rad_s[1] - wheels_rad_s)
        return self._jump is not None and difference_rad_s / self._jump[1] < 0.5


class GreatestRateRule(StopRule):
    """Stops when the gyro sends nothing but rates at which the rover cannot turn."""

    events = (
        SafetyEvent(
            Outcome.STOPS,
            "The gyro reads more than 1.5 times the rate at which the wheels can turn the rover."
            " The readings are not used.",
            "`…: yaw rate … rad/s: the rover cannot turn that fast`",
            (
                "tests/controllers/safety/test_gyro_reading_rules.py::"
                "test_rates_that_are_too_great_stop_when_no_other_has_come_for_the_age_limit",
            ),
            within="`max_age_s` of the gyro and one cycle, or as a jump",
            settings=("devices.NAME.max_age_s",),
            clears=WHEN_GONE,
        ),
    )

    def __init__(self, roles: DeviceRoles) -> None:
        self._roles = roles
        self._since_ns: int | None = None

    def check(self, cycle: Cycle) -> Iterator[Fault]:
        """Return a reason when the readings are too great for longer than the gyro's age limit."""
        rate_rad_s = cycle.gyro.rejected_rad_s
        if rate_rad_s is None:
            self._since_ns = None
            return
        if self._since_ns is None:
            self._since_ns = cycle.now_ns
        if cycle.now_ns - self._since_ns >= nanoseconds(self._roles.max_age_s(self._roles.gyro)):
            text = f"{self._roles.gyro}: yaw rate {rate_rad_s:.1f} rad/s: the rover cannot turn that fast"
            yield Fault(str(self._roles.gyro), Cause.GYRO_RATE, text)


class GyroRestRule(StopRule):
    """At rest, stops while the gyro does not read its bias, and once when the bias has changed on the way.

    A change while driving is within what slip explains. At rest it is seen: the yaw is then wrong by the
    change times the time since the last rest, at most.
    """

    is_for_drives = False  # the estimator compares the rests of such drives
    observes = (RateSample,)

    events = (
        SafetyEvent(
            Outcome.STOPS,
            "The gyro has an offset at standstill.",
            "`…: reads … rad/s at rest, its bias was … rad/s`",
            (
                "tests/controllers/test_wrong_sensors.py::"
                "test_a_gyro_that_is_off_at_rest_keeps_the_rover_stopped",
            ),
            within="`standstill_s` of `[filter]` and `gyro_rest_s`",
            settings=("gyro_rest_s", "gyro_rest_rad_s", "filter.standstill_s"),
            clears=WHEN_GONE,
        ),
        SafetyEvent(
            Outcome.STOPS,
            "The bias of the gyro has changed during the drive. The yaw becomes uncertain by the "
            "change times the time since the last standstill.",
            "`…: bias changed by … rad/s while driving for … s: …`, once",
            (
                "tests/controllers/test_wrong_sensors.py::"
                "test_a_step_of_the_bias_is_named_at_the_next_rest_and_the_yaw_becomes_"
                "uncertain",
            ),
            within="`gyro_rest_s` after the next standstill is detected",
            settings=("gyro_step_rad_s", "gyro_rest_s"),
            clears=WHEN_GONE,
        ),
    )

    def __init__(self, settings: GyroReadingSettings, roles: DeviceRoles) -> None:
        self._settings = settings
        self._gyro = str(roles.gyro)
        self._readings_rad_s: list[float] = []
        self._began_ns: int | None = None
        self._left: tuple[int, float] | None = None
        self._mean_rad_s: float | None = None

    def observe(self, sample: Sample, t_ns: int) -> None:
        """Take a reading of the gyro."""
        if (
            isinstance(sample, RateSample)
            and sample.device == self._gyro
            and math.isfinite(sample.rate_z_rad_s)
        ):
            self._readings_rad_s.append(sample.rate_z_rad_s)

    def check(self, cycle: Cycle) -> Iterator[Fault]:
        """Average over the time at rest; return a reason where the average is not the bias."""
        if not cycle.wheels.is_still:
            self._drive(cycle)
            return
        if self._began_ns is None:
            self._began_ns = cycle.now_ns
            self._readings_rad_s.clear()
        is_over = cycle.now_ns - self._began_ns >= nanoseconds(self._settings.gyro_rest_s)
        if is_over and len(self._readings_rad_s) > 1:
            mean_rad_s = self._mean_rad_s = fmean(self._readings_rad_s)
            error_rad_s = stdev(self._readings_rad_s) / math.sqrt(len(self._readings_rad_s))
            self._began_ns = cycle.now_ns
            self._readings_rad_s.clear()
            yield from self._find_step(cycle.now_ns, mean_rad_s, error_rad_s)
        if self._mean_rad_s is not None:
            yield from self._find_offset(self._mean_rad_s, cycle.estimate.gyro_bias_rad_s)

    def _drive(self, cycle: Cycle) -> None:
        """Remember when the last rest ended, and with which bias."""
        if self._began_ns is not None:
            self._left = (cycle.now_ns, cycle.estimate.gyro_bias_rad_s)
        self._began_ns = self._mean_rad_s = None
        self._readings_rad_s.clear()

    def _find_step(self, now_ns: int, mean_rad_s: float, error_rad_s: float) -> Iterator[Fault]:
        if self._left is None:
            return
        (left_ns, left_rad_s), self._left = self._left, None
        step_rad_s = mean_rad_s - left_rad_s
        if abs(step_rad_s) > self._settings.gyro_step_rad_s + STANDARD_ERRORS * error_rad_s:
            driven_s = seconds(now_ns - left_ns)
            text = (
                f"{self._gyro}: bias changed by {step_rad_s:.4f} rad/s while driving for {driven_s:.1f} s: "
                f"the yaw may be {abs(step_rad_s) * driven_s:.2f} rad wrong"
            )
            yield Fault(self._gyro, Cause.GYRO_BIAS, text, bound=Bound(gyro_rad=abs(step_rad_s) * driven_s))

    def _find_offset(self, mean_rad_s: float, bias_rad_s: float) -> Iterator[Fault]:
        if abs(mean_rad_s - bias_rad_s) > self._settings.gyro_rest_rad_s:
            text = f"{self._gyro}: reads {mean_rad_s:.3f} rad/s at rest, its bias was {bias_rad_s:.3f} rad/s"
            yield Fault(self._gyro, Cause.GYRO_OFFSET, text)
