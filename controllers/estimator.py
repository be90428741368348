"""Estimate of the pose from samples."""

from controllers.estimation.guarded_filter import Innovation
from controllers.estimation.gyro import GyroIntegrator
from controllers.estimation.odometry import BodyIncrement, WheelOdometry
from controllers.estimation.pose_filter import PoseEstimate, PoseFilter, Turn, YawSource
from controllers.estimation.pose_fixes import FixQueue, late
from controllers.estimation.settings import FilterSettings
from controllers.motion.kinematics import BodyMotion, Kinematics
from controllers.roles import DeviceRoles
from controllers.slip.protocol import SlipCompensator
from drivers.clock import nanoseconds, seconds
from drivers.samples import (
    HeadingReference,
    HeadingSample,
    LinkSample,
    PoseFixSample,
    RateSample,
    Sample,
    WheelSample,
)


class Estimator:
    """Feeds odometry, gyro and pose filter with the samples of their devices.

    Args:
        kinematics: Geometry of the wheels.
        settings: Noise of the pose filter.
        wheel_speed_limit_rad_s: Greatest wheel set-point.
        roles: Which device is what.
        slip: Removes slip from the wheels' motion; None where the wheels are assumed to roll.

    Attributes:
        odometry: Wheel odometry.
        motion_ns: Time of the wheel positions that the pose is based on; None before the first motion.
    """

    def __init__(
        self,
        kinematics: Kinematics,
        settings: FilterSettings,
        wheel_speed_limit_rad_s: float,
        roles: DeviceRoles,
        slip: SlipCompensator[object] | None = None,
    ) -> None:
        self._slip = slip
        self.odometry = WheelOdometry(kinematics, wheel_speed_limit_rad_s)
        self._settings = settings
        self._roles = roles
        self._gyro = GyroIntegrator(roles.max_age_s(roles.gyro))
        self._filter = PoseFilter(settings, roles.headings, roles.fixes)
        self._fixes = FixQueue(roles.fixes)
        self._headings: list[tuple[HeadingSample, int]] = []
        self._heading_ns: dict[tuple[str, HeadingReference], int] = {}
        self._wheel_turn_rad = 0.0
        self._yaw_source = YawSource.WHEELS
        self._bias_seen_ns: int | None = None
        self.motion_ns: int | None = None

    def take(self, sample: Sample, t_ns: int) -> None:
        """Take one sample as of `t_ns`; samples of other devices and kinds have no effect."""
        device = sample.device
        if self._slip is not None:
            self._slip.feed(sample, t_ns)
        if isinstance(sample, WheelSample):
            if device == self._roles.wheels and sample.position_rad is not None:
                self.odometry.feed(sample.wheel, t_ns, sample.position_rad)
        elif isinstance(sample, RateSample):
            if device == self._roles.gyro:
                self._gyro.feed(t_ns, sample.rate_z_rad_s)
        elif isinstance(sample, HeadingSample):
            self._take_heading(sample, t_ns)
        elif isinstance(sample, PoseFixSample):
            self._fixes.add(sample, t_ns)
        elif isinstance(sample, LinkSample) and device == self._roles.wheels:
            # After a break the codec counts turns from zero.
            self.odometry.rebase()

    def advance(self, now_ns: int, set_speed_rad_s: tuple[float, ...] = ()) -> tuple[Innovation, ...]:
        """Update the estimate with the samples taken; return the innovations of the corrections.

        Args:
            now_ns: Time of the cycle.
            set_speed_rad_s: Set-points of the wheels since the last cycle; needed with slip only.
        """
        increment = self.odometry.take()
        if increment is not None and self._slip is not None:
            gyro_rate_rad_s = self._gyro.rate_rad_s - self._filter.gyro_bias_rad_s
            increment = self._slip.compensate(
                increment, set_speed_rad_s, gyro_rate_rad_s if self._gyro.is_fresh(now_ns) else None
            )
        is_still = self.odometry.is_still(now_ns, self._settings.standstill_s)
        if increment is not None and self.odometry.t_ns is not None:
            self.motion_ns = self.odometry.t_ns
            step = self._filter.predict(increment, self._turn(increment, now_ns, is_still))
            self._fixes.move(self.motion_ns, step)
        innovations = [
            self._correct_heading(sample, t_ns) for sample, t_ns in self._headings if self._is_usable(t_ns)
        ]
        self._headings.clear()
        for fix, way_back in self._fixes.take():
            innovations += (late(fix),) if way_back is None else self._filter.correct_pose(fix, way_back)
        gyro = self._gyro
        if is_still and gyro.t_ns != self._bias_seen_ns and self._roles.gyro is not None:
            self._bias_seen_ns = gyro.t_ns
            innovations.append(self._filter.correct_bias(self._roles.gyro, gyro.rate_rad_s))
        return tuple(innovations)

    def estimate(self, now_ns: int) -> PoseEstimate:
        """Return the estimate; before the first motion of the wheels is known it is the start, `now_ns`."""
        pose = self._filter.pose
        velocity_x_m_s, velocity_y_m_s, _ = self._body_velocity()
        return PoseEstimate(
            t_ns=now_ns if self.motion_ns is None else self.motion_ns,
            x_m=pose.x_m,
            y_m=pose.y_m,
            yaw_rad=pose.yaw_rad,
            velocity_x_m_s=velocity_x_m_s,
            velocity_y_m_s=velocity_y_m_s,
            yaw_rate_rad_s=self._yaw_rate_rad_s(),
            gyro_bias_rad_s=self._filter.gyro_bias_rad_s,
            covariance=self._filter.covariance,
            yaw_source=self._yaw_source,
        )

    def _turn(self, increment: BodyIncrement, now_ns: int, is_still: bool) -> Turn:
        """Choose the source of the turn.

        While the gyro is fresh but has no new reading since the last increment, the wheels' turn is held
        back: it is not lost if the gyro fails, and not counted twice if it has a reading. At standstill the
        wheels are used: the gyro would only add its noise.
        """
        self._wheel_turn_rad += increment.turn_rad
        angle_rad, covered_s = self._gyro.take()
        if not is_still and covered_s > 0.0:
            self._yaw_source = YawSource.GYRO
            self._wheel_turn_rad = 0.0
            return Turn(angle_rad=angle_rad, source=YawSource.GYRO, covered_s=covered_s)
        if not is_still and self._gyro.is_fresh(now_ns):
            return Turn(angle_rad=0.0, source=YawSource.GYRO)
        self._yaw_source = YawSource.WHEELS
        turn = Turn(angle_rad=self._wheel_turn_rad, source=YawSource.WHEELS)
        self._wheel_turn_rad = 0.0
        return turn

    def _yaw_rate_rad_s(self) -> float:
        if self._yaw_source is YawSource.GYRO:
            return self._gyro.rate_rad_s - self._filter.gyro_bias_rad_s
        return self._body_velocity()[2]

    def _body_velocity(self) -> BodyMotion:
        if self._slip is None:
            return self.odometry.velocity
        return self._slip.body_motion(self.odometry.wheel_speed_rad_s)

    def _take_heading(self, sample: HeadingSample, t_ns: int) -> None:
        source = (sample.device, sample.reference)
        newest_ns = self._heading_ns.get(source)
        if sample.device in self._roles.headings and (newest_ns is None or t_ns > newest_ns):
            self._heading_ns[source] = t_ns
            self._headings.append((sample, t_ns))

    def _is_usable(self, heading_ns: int) -> bool:
        """Return whether the motion is known recently enough to compare a heading with the yaw."""
        if self.motion_ns is None:
            return True
        return heading_ns - self.motion_ns <= nanoseconds(self._roles.motion_age_s)

    def _correct_heading(self, sample: HeadingSample, t_ns: int) -> Innovation:
        age_s = 0.0 if self.motion_ns is None else seconds(self.motion_ns - t_ns)
        lag_s = self._settings.heading_lag_s + age_s
        return self._filter.correct_heading(
            sample.device, sample.reference, sample.heading_rad, self._yaw_rate_rad_s() * lag_s
        )
