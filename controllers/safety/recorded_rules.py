"""Rules for drives that others recorded: readings that their programs left out, wheels that stand."""

from collections.abc import Iterator

from controllers.fault import Bound, Cause, Fault
from controllers.roles import DeviceRoles
from controllers.safety.reasons import Cycle, StopRule
from drivers.safety_event import Outcome, SafetyEvent
from drivers.samples import RateSample, Sample

LEAST_RATE_RAD_S = 0.05
"""A gyro that turns faster does not read exactly zero in between."""

ZEROS = 5
ZEROS_SHARE = 0.1
"""So many zeros between such readings, and such a share of them, are none by chance."""

FORGET_READINGS = 200
"""They are counted over so many readings of a turn."""

STANDS_S = 1.0
"""Wheels that stand for so long while others turn have not just begun to move."""

STANDS_RAD_S = 0.01
TURNS_RAD_S = 0.5


class ZeroReadingsRule(StopRule):
    """Finds a gyro whose turn is interrupted by readings of exactly zero: messages that hold no reading."""

    is_for_missions = False
    observes = (RateSample,)

    events = (
        SafetyEvent(
            Outcome.FINDING,
            "Readings of exactly 0 lie between other readings of a rotation.",
            "`gyro zeros`",
            (
                "tests/controllers/safety/test_drive_check.py::"
                "test_zeros_between_readings_of_a_turn_are_found",
            ),
        ),
    )

    def __init__(self, roles: DeviceRoles) -> None:
        self._gyro = str(roles.gyro)
        self._before: list[float] = []
        self._zeros = self._readings = 0

    def observe(self, sample: Sample, t_ns: int) -> None:
        """Take a reading of the gyro."""
        if not isinstance(sample, RateSample) or sample.device != self._gyro:
            return
        self._before = [*self._before[-2:], sample.rate_z_rad_s]
        first, middle, last = self._before if len(self._before) == 3 else (0.0, 0.0, 0.0)
        if min(abs(first), abs(last)) <= LEAST_RATE_RAD_S or first * last < 0.0:
            return
        if self._readings == FORGET_READINGS:
            self._readings = self._zeros = 0
        self._readings += 1
        self._zeros += middle == 0.0

    def check(self, cycle: Cycle) -> Iterator[Fault]:
        """Return a reason while there are too many zeros."""
        if self._zeros >= max(ZEROS, ZEROS_SHARE * self._readings):
            text = (
                f"{self._gyro}: {self._zeros} of {self._readings} readings between others of a turn are "
                "exactly 0: messages without a reading; the turn is measured too small"
            )
            yield Fault(self._gyro, Cause.GYRO_ZEROS, text, bound=Bound(is_motion_unknown=True))


class StandingWheelsRule(StopRule):
    """Finds wheels that stand while others of the same rover turn, and the geometry does not allow it."""

    is_for_missions = False

    events = (
        SafetyEvent(
            Outcome.FINDING,
            "Of redundant wheels, some stand for a second while others turn.",
            "`standing wheels`",
            (
                "tests/controllers/safety/test_drive_check.py::"
                "test_wheels_that_stand_while_others_turn_are_found",
            ),
        ),
    )

    def __init__(self) -> None:
        self._since_ns: int | None = None

    def check(self, cycle: Cycle) -> Iterator[Fault]:
        """Return a reason while some wheels stand and others turn."""
        speeds = list(enumerate(cycle.wheels.measured_rad_s))
        standing = [str(wheel) for wheel, speed in speeds if abs(speed) < STANDS_RAD_S]
        turning = [str(wheel) for wheel, speed in speeds if abs(speed) > TURNS_RAD_S]
        if (
            not (standing and turning)
            or cycle.wheels.contradiction is None
            or cycle.wheels.contradiction <= 1.0
        ):
            self._since_ns = None
            return
        if self._since_ns is None:
            self._since_ns = cycle.now_ns
        if cycle.now_ns - self._since_ns >= STANDS_S * 1e9:
            text = (
                f"wheel {', '.join(standing)} stands while wheel {', '.join(turning)} turns: wheels in the "
                "air or without grip, or encoders that are dead"
            )
            yield Fault("wheels", Cause.STANDING_WHEELS, text, bound=Bound(is_motion_unknown=True))
