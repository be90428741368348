"""Compares whole turns by gyro and by wheels, and says what would explain a difference."""

import math
from collections.abc import Iterator
from operator import add

from controllers.estimation.wheels.turn_evidence import TurnEvidence, WheelTurn
from controllers.fault import Bound, Cause, Fault
from controllers.roles import DeviceRoles
from controllers.safety.reasons import Cycle, StopRule
from drivers.safety_event import Outcome, SafetyEvent

LEAST_TURN_RAD = 0.5
"""Smaller turns are not compared: uneven slip may make them."""

GREATEST_TURN_RAD = 1.75
"""A longer turn is compared in parts, so that it is reported while it lasts."""

STRAIGHT_S = 0.5
STRAIGHT_RAD_S = 0.05
"""A turn ends when neither gyro nor wheels have turned faster than this for so long."""

LEAST_SHARE = 0.1
"""Least turn of the wheels as a share of what they turn both ways: below it different radii may make it."""

SAME = 0.25
"""Turns that differ by this share of the greater one may be equal: wheels slip, tracks are not exact."""

BACKWARDS = 0.1
"""A wheel counts backwards where the turn with its part reversed is as the gyro's, but for this share."""

NONE_LEFT = 0.3
"""A gyro that measures less than this share of a turn misses it: no ground lets wheels slip so much."""

MORE = 1.5
"""A gyro that measures this many times the turn of the wheels is not explained by their slip."""


class TurnComparison(StopRule):
    """Finds turns whose sizes or senses by gyro and by wheels exclude each other.

    For a drive that somebody else controls: a rover in a mission has long stopped. Each turn is compared as a
    whole, so the reason can say which one error would explain it. Where two errors would, it reports that the
    drive does not show which.
    """

    is_for_missions = False

    events = (
        SafetyEvent(
            Outcome.FINDING,
            "A whole rotation by gyro and by wheels: opposite directions, deg/s for rad/s, less "
            "than 0.3 or more than 1.5 times, or a wheel that counts backwards. Where two errors "
            "explain it, it states that the drive cannot show which.",
            "`turn`",
            (
                "tests/controllers/safety/test_turn_comparison.py::"
                "test_a_turn_that_cannot_be_is_told_with_what_would_explain_it",
            ),
        ),
    )

    def __init__(self, roles: DeviceRoles) -> None:
        self._gyro = str(roles.gyro)
        self._begin()

    def _begin(self) -> None:
        self._gyro_rad = self._straight_s = 0.0
        self._wheels = WheelTurn()
        self._parts_rad: tuple[float, ...] = ()

    def check(self, cycle: Cycle) -> Iterator[Fault]:
        """Take the evidence of a cycle; return a reason at the end of a turn that cannot be."""
        evidence = cycle.gyro.turn
        if evidence is not None:
            self._take(evidence)
        greatest_rad = max(abs(self._gyro_rad), abs(self._wheels.turn_rad))
        if cycle.wheels.is_still or self._straight_s >= STRAIGHT_S or greatest_rad >= GREATEST_TURN_RAD:
            why = self._explain() if greatest_rad >= LEAST_TURN_RAD else ""
            text = (
                f"{self._gyro}: wheels {self._wheels.turn_rad:+.3f} rad, "
                f"gyro {self._gyro_rad:+.3f} rad in this turn: {why}"
            )
            self._begin()
            if why:
                yield Fault(self._gyro, Cause.TURN, text, bound=Bound(is_motion_unknown=True))

    def _take(self, evidence: TurnEvidence) -> None:
        """Add up a turn; what lies straight before and behind it is no part of it."""
        wheels = evidence.wheels
        fastest_rad = max(abs(evidence.gyro_rad), abs(wheels.turn_rad))
        if fastest_rad <= STRAIGHT_RAD_S * wheels.duration_s:
            self._straight_s += wheels.duration_s
            return
        self._straight_s = 0.0
        self._gyro_rad += evidence.gyro_rad
        self._wheels = WheelTurn(*map(add, self._wheels, wheels))
        parts_rad = self._parts_rad or (0.0,) * len(evidence.by_wheel_rad)
        self._parts_rad = tuple(map(add, parts_rad, evidence.by_wheel_rad))

    def _explain(self) -> str:
        """Return what would explain the difference; "" where slip does."""
        wheels_rad, gyro_rad = self._wheels.turn_rad, self._gyro_rad
        both_ways_rad = self._wheels.left_rad + self._wheels.right_rad
        if _are_same(wheels_rad, gyro_rad):
            return ""
        reversed_wheels = [
            str(wheel)
            for wheel, part_rad in enumerate(self._parts_rad)
            if abs(wheels_rad - 2.0 * part_rad - gyro_rad) <= BACKWARDS * max(abs(wheels_rad), abs(gyro_rad))
            if abs(part_rad) > SAME * abs(wheels_rad)
        ]
        if _are_same(wheels_rad, -gyro_rad):
            others = f", or wheel {' or '.join(reversed_wheels)} counts backwards" if reversed_wheels else ""
            return f"sign of the gyro, or left and right exchanged{others}; this drive does not show which"
        if reversed_wheels:
            which = "" if len(reversed_wheels) == 1 else "; this drive does not show which"
            return f"wheel {' or '.join(reversed_wheels)} counts backwards{which}"
        if abs(wheels_rad) < LEAST_SHARE * both_ways_rad:
            return ""
        return _explain_size(gyro_rad / wheels_rad)


def _are_same(one_rad: float, other_rad: float) -> bool:
    return abs(one_rad - other_rad) <= SAME * max(abs(one_rad), abs(other_rad))


def _explain_size(share: float) -> str:
    if _are_same(math.radians(share), 1.0):
        return "the gyro sends deg/s that are taken for rad/s"
    if _are_same(math.degrees(share), 1.0):
        return "the gyro sends rad/s that are taken for deg/s"
    if abs(share) < NONE_LEFT:
        return (
            f"the gyro measures {100.0 * share:.0f} % of it: no signal, "
            "wrong axis or scale, or wheels without grip"
        )
    if abs(share) > MORE:
        return (
            f"the gyro measures {share:.2g} times as much: scale or unit of the gyro, "
            "ticks, radius or track of the wheels"
        )
    if share < 0.0:
        return "opposite senses: sign or axis of the gyro, or wheels that slip"
    return ""
