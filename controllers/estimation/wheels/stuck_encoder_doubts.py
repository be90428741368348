"""Widens the estimate by wheels that stay although the gyro contradicts it."""

import math

from controllers.estimation.filter.error_budget import added
from controllers.estimation.filter.pose_filter import PoseFilter
from controllers.estimation.settings import FilterSettings
from controllers.estimation.wheels.bounds import WheelReach
from controllers.estimation.wheels.odometry import BodyIncrement
from controllers.estimation.wheels.stuck_encoder import StuckEncoders
from controllers.estimation.wheels.turn_evidence import TurnEvidence
from controllers.fault import Cause, Fault, Severity


class StuckEncoderDoubts:
    """Widens by what the encoders that are stuck may hide.

    Args:
        settings: Noise of the turns.
        pose_filter: Is widened.
        reach: How far the wheels can have moved the body.

    Attributes:
        fault: Why the wheels may not measure the motion; None without a contradiction in this cycle.
    """

    def __init__(self, settings: FilterSettings, pose_filter: PoseFilter, reach: WheelReach) -> None:
        count = len(reach.effects)
        self._stuck = StuckEncoders(settings, count)
        self._filter, self._reach = pose_filter, reach
        self._doubted_rad = (0.0,) * count
        self.fault: Fault | None = None

    def follow(self, increment: BodyIncrement, evidence: TurnEvidence | None) -> None:
        """Take an increment, and the turn by gyro and wheels in its time; None where one is unknown."""
        self._stuck.note(increment.turned_rad)
        if evidence is None:
            return
        unknown_rad = self._stuck.unknown_rad(
            evidence,
            math.hypot(increment.x_m, increment.y_m),
            self._reach.effects,
            self._filter.gyro_bias_rad2_s2,
        )
        before_rad = self._doubted_rad
        self._doubted_rad = tuple(
            math.copysign(max(abs(now), abs(before)), now) if now else 0.0
            for now, before in zip(unknown_rad, before_rad, strict=True)
        )
        added_rad = [
            math.copysign(added(now, before), now)
            for now, before in zip(self._doubted_rad, before_rad, strict=True)
        ]
        if any(added_rad):
            self._filter.widen(*self._reach.beside_gyro(added_rad))
        stuck = tuple(str(wheel) for wheel, unknown in enumerate(unknown_rad) if unknown)
        if stuck:
            wheels = ", ".join(stuck)
            text = (
                f"wheel {wheels} does not turn, but the gyro contradicts the turn by the others; "
                "the estimate is wider"
            )
            self.fault = Fault(wheels, Cause.STUCK_ENCODER, text, Severity.UNCERTAIN)
