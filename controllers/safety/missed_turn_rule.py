"""Stop rule about a turn of the wheels that the gyro has not measured."""

import operator
from collections.abc import Iterator

from controllers.estimation.wheels.turn_evidence import TurnEvidence, WheelTurn
from controllers.fault import Bound, Cause, Fault, Severity
from controllers.roles import DeviceRoles
from controllers.safety.gyro_turn_rules import AGAINST, AVERAGE_S, WHY_NO_TURN, GyroTurnSettings
from controllers.safety.reasons import Cycle, StopRule
from controllers.safety.unproven_turn import UnprovenTurn
from controllers.safety.yaw_watch import YawWatch
from drivers.safety_event import RESTART, Outcome, SafetyEvent

ON_THE_SPOT = 0.9
"""Least share of the turn in what the wheels of both senses add up to. On the spot all wheels turn the rover
in the same sense, which gives 1; a rover that drives on and holds its heading on slippery ground stays below.
Chosen by hand: with 0.5 the rule stopped 5 of 100 healthy missions of the simulated Robotino, with 0.9 none.
"""

NO_TURN = TurnEvidence(0.0, WheelTurn())


class MissedTurnRule(StopRule):
    """Notices that the wheels have turned the rover and the gyro has not measured it.

    A steady turn does not change the turn rate, so `GyroFollowsRule` does not see it. Straight ahead uneven
    slip lets the wheels turn while the rover keeps its heading: only turns on the spot or nearly so count.

    Args:
        settings: Thresholds.
        roles: Gyro, devices that give fixes, camera.
        unproven: Shared with `GyroFollowsRule`, which adds to it and is checked before.
    """

    events = (
        SafetyEvent(
            Outcome.STOPS,
            "The wheels turn the rover on the spot, the gyro measures less than "
            "`gyro_follow_share` of it, and pose measurements or a ground camera contradict it.",
            "`…: measures … % of a turn of … rad by the wheels: …; the rover turns otherwise "
            "than the gyro measures`",
            (
                "tests/controllers/safety/test_missed_turn_rule.py::"
                "test_where_fixes_contradict_the_yaw_the_gyro_is_dead",
            ),
            within="`gyro_turn_rad`; the next pose measurement",
            settings=("gyro_turn_rad", "gyro_follow_share"),
            clears="by a signal of the gyro, as for `…: no signal, although the rover turned: …`",
        ),
        SafetyEvent(
            Outcome.ENDS,
            "The gyro measures a rotation on the spot in the opposite direction, by more than half of it.",
            "`…: measures -… %`; `emergency stop`, exit code 1",
            (
                "tests/controllers/safety/test_gyro_turn_rules.py::"
                "test_only_a_gyro_that_turns_against_the_wheels_stops_for_good",
            ),
            within="the rotation",
            settings=("gyro_turn_rad",),
            clears=RESTART,
        ),
    )

    def __init__(self, settings: GyroTurnSettings, roles: DeviceRoles, unproven: UnprovenTurn) -> None:
        self._settings = settings
        self._gyro = str(roles.gyro)
        self._watch = YawWatch(roles)
        self._part = self._turn = NO_TURN
        self._unproven = unproven

    def check(self, cycle: Cycle) -> Iterator[Fault]:
        """Take the evidence of a cycle; return a reason when a turn is missing."""
        self._watch.take(cycle)
        if cycle.gyro.turn is None:
            return
        self._part = _sum(self._part, cycle.gyro.turn)
        if self._part.wheels.duration_s < AVERAGE_S:
            return
        part, self._part = self._part, NO_TURN
        is_turning = abs(part.wheels.turn_rad) >= ON_THE_SPOT * (part.wheels.left_rad + part.wheels.right_rad)
        self._turn = _sum(self._turn, part) if is_turning else NO_TURN
        turn_rad = self._turn.wheels.turn_rad
        if abs(turn_rad) < self._settings.gyro_turn_rad:
            return
        share, self._turn = self._turn.gyro_rad / turn_rad, NO_TURN
        if share < self._settings.gyro_follow_share:
            text = (
                f"{self._gyro}: measures {100.0 * share:.0f} % of a turn of {abs(turn_rad):.2f} rad by the "
                f"wheels: {WHY_NO_TURN}"
            )
            severity = Severity.FINAL if share < AGAINST else self._watch.severity(cycle.now_ns)
            text += self._watch.consequence(severity)
            self._unproven.is_dead |= severity is Severity.STOP
            yaw_rad = self._unproven.error_rad((1.0 - share) * abs(turn_rad))
            is_final = severity is Severity.FINAL
            bound = Bound(gyro_rad=yaw_rad, path_m=self._unproven.path_m, is_motion_unknown=is_final)
            yield Fault(self._gyro, Cause.MISSED_TURN, text, severity, bound)
        else:
            self._unproven.prove()


def _sum(first: TurnEvidence, second: TurnEvidence) -> TurnEvidence:
    wheels = WheelTurn(*map(operator.add, first.wheels, second.wheels))
    return TurnEvidence(first.gyro_rad + second.gyro_rad, wheels)
