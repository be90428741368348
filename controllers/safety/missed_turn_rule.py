"""Stop rule about a turn of the wheels that the gyro has not measured."""

import operator
from collections.abc import Iterator

from controllers.estimation.parameters import ESTIMATION
from controllers.estimation.turn_evidence import TurnEvidence, WheelTurn
from controllers.roles import DeviceRoles
from controllers.safety.gyro_turn_rules import AGAINST, AVERAGE_S, GyroTurnSettings
from controllers.safety.reasons import Cycle, Severity, StopReason, StopRule
from controllers.safety.yaw_fixes import YawFixes

TURNING = 0.5
"""Least share of the turn in what the wheels of both senses add up to: they turn the rover on the spot, and
slip explains a missing turn only where they lose half of their motion. Straight ahead it is near zero."""

NO_TURN = TurnEvidence(0.0, WheelTurn())


class MissedTurnRule(StopRule):
    """Stops when the wheels have turned the rover and the gyro has not measured it.

    A steady turn does not change the turn rate, so `GyroFollowsRule` does not see it. Straight ahead uneven
    slip lets the wheels turn while the rover keeps its heading: only turns on the spot or nearly so count.
    """

    def __init__(self, settings: GyroTurnSettings, roles: DeviceRoles) -> None:
        self._settings = settings
        self._gyro = roles.gyro
        self._fixes = YawFixes(roles)
        self._part = self._turn = NO_TURN
        self._unproven_rad = 0.0

    def check(self, cycle: Cycle) -> Iterator[StopReason]:
        """Take the evidence of a cycle; return a reason when a turn is missing."""
        self._fixes.take(cycle)
        if cycle.evidence is None:
            return
        self._part = _sum(self._part, cycle.evidence)
        if self._part.wheels.duration_s < AVERAGE_S:
            return
        part, self._part = self._part, NO_TURN
        is_turning = abs(part.wheels.turn_rad) >= TURNING * (part.wheels.left_rad + part.wheels.right_rad)
        self._turn = _sum(self._turn, part) if is_turning else NO_TURN
        self._unproven_rad += part.wheels.both_ways_rad
        turn_rad = self._turn.wheels.turn_rad
        if abs(turn_rad) < self._settings.gyro_turn_rad:
            return
        share, self._turn = self._turn.gyro_rad / turn_rad, NO_TURN
        if share < self._settings.gyro_follow_share:
            text = (
                f"{self._gyro}: measures {100.0 * share:.0f} % of a turn of {abs(turn_rad):.2f} rad by the "
                "wheels: no signal, wrong axis, wrong sign, or wheels without grip"
            )
            severity = Severity.FINAL if share < AGAINST else self._fixes.severity(cycle.now_ns)
            # Nobody knows since when the gyro has no signal: the turn is that of the wheels, as uncertain.
            yaw_rad = (1.0 - share) * abs(turn_rad) + ESTIMATION.pose.gap_turn_error * self._unproven_rad
            yield StopReason("missed turn", text, severity, yaw_rad=yaw_rad)
        else:
            self._unproven_rad = 0.0


def _sum(first: TurnEvidence, second: TurnEvidence) -> TurnEvidence:
    wheels = WheelTurn(*map(operator.add, first.wheels, second.wheels))
    return TurnEvidence(first.gyro_rad + second.gyro_rad, wheels)
