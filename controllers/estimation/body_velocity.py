"""Velocity of the body, by the wheels and what corrects them."""

from controllers.estimation.filter.pose_filter import PoseFilter
from controllers.estimation.ground.follower import GroundFollower
from controllers.estimation.ground_assumption.follower import AssumptionFollower
from controllers.estimation.gyro.integrator import GyroIntegrator
from controllers.estimation.gyro.turn_source import TurnSource
from controllers.estimation.pose_estimate import YawSource
from controllers.estimation.slip_compensator import SlipCompensator
from controllers.estimation.wheels.odometry import WheelOdometry
from controllers.motion.body_motion import BodyMotion


class BodyVelocity:
    """The newest velocity of the body.

    Args:
        odometry: Velocity of rolling wheels.
        gyro: Turn rate where the turn comes from it.
        turns: Where the turn comes from.
        pose_filter: Bias of the gyro, and the slip that a camera measured.
        slip: Removes the slip where no camera measures it; None without.
        ground: Whether a camera measures the slip.
        assumed: Slip that is assumed where nothing measures it.
    """

    def __init__(
        self,
        odometry: WheelOdometry,
        gyro: GyroIntegrator,
        turns: TurnSource,
        pose_filter: PoseFilter,
        slip: SlipCompensator | None,
        ground: GroundFollower,
        assumed: AssumptionFollower,
    ) -> None:
        self._assumed = assumed
        self._odometry, self._gyro, self._turns = odometry, gyro, turns
        self._filter, self._slip, self._ground = pose_filter, slip, ground

    @property
    def yaw_rate_rad_s(self) -> float:
        """Turn rate by the gyro, without its bias; by the wheels where the turn comes from them."""
        if self._turns.yaw_source is YawSource.GYRO:
            return self._gyro.rate_rad_s - self._filter.gyro_bias_rad_s
        return self.by_wheels()[2]

    def by_wheels(self) -> BodyMotion:
        """Return velocity x, y in m/s and turn rate in rad/s by the wheels without slip."""
        rolled = self._odometry.velocity
        if self._ground.is_measured:
            velocity_m_s = complex(*rolled[:2]) * (1.0 + self._ground.measured_slip)
            return velocity_m_s.real, velocity_m_s.imag, rolled[2]
        kept = self._assumed.kept
        if kept is not None or self._slip is None:
            share = kept or 1.0
            return share * rolled[0], share * rolled[1], rolled[2]
        return self._slip.body_motion(self._odometry.wheel_speed_rad_s)
