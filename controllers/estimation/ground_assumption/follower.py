"""Applies what is assumed about the ground to the motion of the wheels, and lets every sensor test it."""

import cmath
import math
from dataclasses import replace

from controllers.estimation.filter.motion_history import Step
from controllers.estimation.filter.pose_filter import PoseFilter
from controllers.estimation.ground.follower import GroundFollower
from controllers.estimation.ground_assumption.assumption import SlipAssumption, TurnNoise
from controllers.estimation.gyro.gyro_noise import GyroNoise
from controllers.estimation.gyro.turn_source import TurnSource
from controllers.estimation.positions.frames import PositionFrames
from controllers.estimation.settings import FilterSettings
from controllers.estimation.slip_compensator import SlipCompensator
from controllers.estimation.wheels.contradiction import WheelContradiction
from controllers.estimation.wheels.odometry import BodyIncrement

LATE_S = 0.02
"""Standard deviation of the time between the readings of wheels and gyro: a cycle of 50 Hz."""


class AssumptionFollower:
    """What is assumed about the ground, as a part of the estimate.

    Args:
        assumption: What is assumed, and its test.
        settings: Delay of the gyro.
        gyro_noise: Its noise.
        pose_filter: Holds the assumed slip as states.
        slip: Compensator of the slip; None without one.
        turns: Rotations by gyro and wheels.
        ground: Motion over the ground by a camera.
        positions: Measured positions.
        contradiction: Compares the wheels with each other.

    Attributes:
        kept: Share of the wheels' travel that the rover moves, as it was last assumed; None where a
            compensator gives the motion.
    """

    def __init__(
        self,
        assumption: SlipAssumption,
        settings: FilterSettings,
        gyro_noise: GyroNoise,
        pose_filter: PoseFilter,
        slip: SlipCompensator | None,
        turns: TurnSource,
        ground: GroundFollower,
        positions: PositionFrames,
        contradiction: WheelContradiction,
    ) -> None:
        self._assumption, self._settings, self._filter = assumption, settings, pose_filter
        self._noise = gyro_noise
        self._slip, self._turns, self._ground = slip, turns, ground
        self._positions, self._contradiction = positions, contradiction
        self._tested_m = self._rate_rad_s = 0.0
        self.kept: float | None = None if slip is not None else 1.0 - assumption.prior.mean

    def apply(self, rolled: BodyIncrement, increment: BodyIncrement) -> BodyIncrement:
        """Return the increment of the body.

        Args:
            rolled: Motion of rolling wheels.
            increment: Of the compensator; the same without one.
        """
        prior = self._assumption.prior
        is_assumed = self._is_better(increment) and (prior.is_informative or prior.mean != 0.0)
        kept = 1.0 - prior.mean
        self.kept = kept if is_assumed or self._slip is None else None
        if not is_assumed:
            return increment
        return replace(
            rolled,
            x_m=kept * rolled.x_m,
            y_m=kept * rolled.y_m,
            rolled_m=complex(rolled.x_m, rolled.y_m),
            is_sure=False,
        )

    def drive(self, increment: BodyIncrement, step: Step) -> None:
        """Take a motion of the filter."""
        if step.duration_s > 0.0:
            self._rate_rad_s = step.turn_rad / step.duration_s
        if not increment.is_measured and (self._slip is None or not increment.is_sure):
            toward = cmath.rect(1.0, self._filter.pose.yaw_rad - 0.5 * step.turn_rad)
            self._assumption.drive(step.rolled_m * toward)

    def test(self, rolled_m: float) -> float:
        """Compare what is assumed with what this cycle has measured.

        Args:
            rolled_m: Travel of the wheels since the start.

        Returns:
            Standard deviation that the position has gained by a contradiction, in m.
        """
        assumption = self._assumption
        if not assumption.is_tested:
            return 0.0
        since_m, self._tested_m = rolled_m - self._tested_m, rolled_m
        assumption.compare_wheels(self._contradiction.report)
        assumption.compare_ground(self._ground.pairs)
        turn = self._turns.turn
        if turn is not None:
            assumption.compare_turn(turn, self._gyro_noise(turn.wheels.duration_s), since_m)
        for device, deviations, apart_m in self._positions.compare(assumption.prior):
            assumption.compare_positions(device, deviations, apart_m)
        if self._slip is not None:
            assumption.compare_slip(self._slip.evidence, since_m)
        if assumption.fault is None:
            return 0.0
        self._filter.assume(assumption.prior, assumption.path_m)
        self._positions.inflate_origins()
        return assumption.prior.sd * abs(assumption.path_m)

    def _is_better(self, increment: BodyIncrement) -> bool:
        """Return whether what is assumed is more certain than a compensator that has no states."""
        if self._slip is None:
            return True
        is_measured = increment.is_sure and increment.slip_sd is not None
        return self._slip.states is None and not (
            is_measured and (increment.slip_sd or math.inf) < self._assumption.prior.sd
        )

    def _gyro_noise(self, duration_s: float) -> TurnNoise:
        bias_rad_s = math.hypot(math.sqrt(self._filter.gyro_bias_rad2_s2), self._noise.hidden_rad_s)
        return TurnNoise(
            self._noise.noise_rad_sqrt_s**2 * duration_s,
            bias_rad_s * duration_s,
            max(LATE_S, self._settings.gyro_delay_sd_s) * abs(self._rate_rad_s),
        )
