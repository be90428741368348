"""The pose of a cycle, as uncertain as all that has not yet reached the filter makes it."""

import cmath

from controllers.estimation.body_velocity import BodyVelocity
from controllers.estimation.filter.pose_filter import PoseFilter
from controllers.estimation.gyro.turn_source import TurnSource
from controllers.estimation.pose_estimate import PoseEstimate, YawSource
from controllers.estimation.positions.frames import PositionFrames
from controllers.estimation.positions.relation import APART_SD
from controllers.estimation.settings import FilterSettings
from controllers.estimation.slip_compensator import SlipCompensator
from controllers.estimation.wheels.bounds import WheelBounds
from controllers.motion.planar import wrap_angle
from controllers.roles import DeviceRoles
from drivers.clock import seconds


class PoseReport:
    """Adds to the filter's pose the turn that waits, and to its covariance what no state holds.

    That is the age of the motion, the slip that is not settled, fixes that jump or do not move as the wheels
    do, wheels that are silent, and the delay of the gyro.

    Args:
        settings: Noise of the gyro's delay.
        roles: Ages of the devices.
        pose_filter: Pose and covariance.
        positions: By how much measured positions have jumped, or may be wrong.
        turns: Turn that waits for motion of the wheels or a reading of the gyro.
        velocity: Of the body.
        reach: How far the wheels can have moved the body.
        slip: Knows what is not settled; None without a compensator.
    """

    def __init__(
        self,
        settings: FilterSettings,
        roles: DeviceRoles,
        pose_filter: PoseFilter,
        positions: PositionFrames,
        turns: TurnSource,
        velocity: BodyVelocity,
        reach: WheelBounds,
        slip: SlipCompensator | None,
    ) -> None:
        self._gyro_delay_sd_s = settings.gyro_delay_sd_s
        self._wheel_age_s = roles.max_age_s(roles.wheels)
        self._filter, self._positions = pose_filter, positions
        self._turns, self._velocity = turns, velocity
        self._reach, self._slip = reach, slip

    def estimate(
        self, now_ns: int, motion_ns: int | None, *, is_at_standstill: bool, is_commanded: bool
    ) -> PoseEstimate:
        """Return the estimate of a cycle.

        Args:
            now_ns: Time of the cycle.
            motion_ns: Time of the filter's pose; None before the first motion: then it is that of the start.
            is_at_standstill: Whether the rover is taken to be at standstill.
            is_commanded: Whether the setpoints of the wheels are known.
        """
        pose = self._filter.pose
        velocity_x_m_s, velocity_y_m_s, _ = self._velocity.by_wheels()
        yaw_rate_rad_s = self._velocity.yaw_rate_rad_s
        xx, xy, x_yaw, yy, y_yaw, yaw_rad2 = self._filter.covariance
        waiting_rad, waiting_rad2 = self._turns.waiting(
            self._filter.gyro_bias_rad_s, is_at_standstill=is_at_standstill
        )
        yaw_rad = wrap_angle(pose.yaw_rad + waiting_rad)
        yaw_rad2 += waiting_rad2
        age_s = 0.0 if motion_ns is None else seconds(now_ns - motion_ns)
        toward = cmath.rect(1.0, yaw_rad)
        since_m = age_s * complex(velocity_x_m_s, velocity_y_m_s) * toward
        unsettled_m = 0j if self._slip is None else self._slip.unsettled_m * toward
        # The region contains both places, that by the device and that by dead reckoning.
        apart_m = (*self._positions.jumped_m.values(), *self._positions.doubted_m.values())
        for along_m in (since_m, unsettled_m, *(each_m / APART_SD for each_m in apart_m)):
            xx, xy, yy = xx + along_m.real**2, xy + along_m.real * along_m.imag, yy + along_m.imag**2
        if not is_commanded and age_s > self._wheel_age_s:  # the wheels are silent, and somebody else drives
            x_m, y_m, turn_rad = self._reach.beside_gyro(self._reach.at_limit_rad(age_s))
            silent_m2 = (x_m**2 + y_m**2) / 3.0
            xx, yy, yaw_rad2 = xx + silent_m2, yy + silent_m2, yaw_rad2 + turn_rad**2 / 3.0
        if self._turns.yaw_source is YawSource.GYRO:
            yaw_rad2 += (yaw_rate_rad_s * self._gyro_delay_sd_s) ** 2
        return PoseEstimate(
            t_ns=now_ns if motion_ns is None else motion_ns,
            x_m=pose.x_m,
            y_m=pose.y_m,
            yaw_rad=yaw_rad,
            velocity_x_m_s=velocity_x_m_s,
            velocity_y_m_s=velocity_y_m_s,
            yaw_rate_rad_s=yaw_rate_rad_s,
            gyro_bias_rad_s=self._filter.gyro_bias_rad_s,
            covariance=(xx, xy, x_yaw, yy, y_yaw, yaw_rad2),
            yaw_source=self._turns.yaw_source,
        )
