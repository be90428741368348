"""Where the samples of the devices go."""

from dataclasses import replace

from controllers.estimation.filter.late_readings import LateReadings
from controllers.estimation.ground.travel import GroundTravel
from controllers.estimation.gyro.gyro_noise import GyroNoise
from controllers.estimation.gyro.integrator import GyroIntegrator
from controllers.estimation.gyro.standstill import InertialReadings
from controllers.estimation.parameters import ESTIMATION
from controllers.estimation.pauses import SilenceWatch
from controllers.estimation.slip_compensator import SlipCompensator
from controllers.estimation.wheels.angle import WheelAngle
from controllers.estimation.wheels.odometry import WheelOdometry
from controllers.motion.kinematics import Kinematics
from controllers.motion.steering import SteeringAngles
from controllers.roles import DeviceRoles
from drivers.samples import (
    AccelerationSample,
    LinkSample,
    RateSample,
    Sample,
    WheelSample,
)


class SampleIntake:
    """Passes each sample to what is made of it, by the role of its device.

    What a device sends at once after a silence has waited in a buffer: its time is unknown, it is dropped.

    Args:
        kinematics: Geometry of the wheels.
        roles: Which device is what.
        speed_limit_rad_s: Greatest setpoint of a wheel.
        steering: Takes the steering angles.
        gyro: Takes the yaw rates.
        noise: Takes those that are plausible.
        inertial: Takes the readings of gyro and accelerometer that may be those of a standstill.
        readings: Takes what corrects the pose filter.
        slip: Takes all samples; None without a compensator.
        ground: Takes rates; None without a camera that measures the motion over the ground.

    Attributes:
        odometry: Is fed with the continuous angles of the wheels.
    """

    def __init__(
        self,
        kinematics: Kinematics,
        roles: DeviceRoles,
        speed_limit_rad_s: float,
        steering: SteeringAngles,
        gyro: GyroIntegrator,
        noise: GyroNoise,
        inertial: InertialReadings,
        readings: LateReadings,
        slip: SlipCompensator | None,
        ground: GroundTravel | None,
    ) -> None:
        self._roles, self._steering = roles, steering
        self._gyro, self._noise = gyro, noise
        self._inertial, self._readings = inertial, readings
        self._slip, self._ground = slip, ground
        self.odometry = WheelOdometry(kinematics, speed_limit_rad_s)
        wraps_rad = roles.wheel_wraps_rad or (None,) * kinematics.wheel_count
        self._angles = [
            WheelAngle(speed_limit_rad_s, roles.max_age_s(roles.wheels), wrap_rad) for wrap_rad in wraps_rad
        ]
        self._speed_error_rad = [0.0] * kinematics.wheel_count
        self._silences = {
            device: SilenceWatch(ESTIMATION.pose.pause_ages * roles.max_age_s(device))
            for device in (roles.wheels, roles.gyro)
            if device
        }

    @property
    def reports_speed(self) -> bool:
        """Whether a drive reports a speed although its position stays."""
        return any(angle.contradicts_rest for angle in self._angles)

    def take(self, sample: Sample, t_ns: int) -> None:
        """Take one sample as of `t_ns`; samples of other devices and kinds have no effect."""
        device = sample.device
        if not self._has_known_time(sample, t_ns):
            return
        if isinstance(sample, WheelSample) and device == self._roles.wheels:
            sample = self._take_wheel(sample, t_ns)
        if self._slip is not None:
            self._slip.feed(sample, t_ns)
        if isinstance(sample, RateSample | AccelerationSample):
            if device == self._roles.gyro:
                self._take_inertial(sample, t_ns)
        elif isinstance(sample, LinkSample) and device == self._roles.wheels:
            # After a break the codec counts turns from zero.
            self.odometry.rebase()
            for angle in self._angles:
                angle.reset()
        self._readings.add(sample, t_ns)

    def take_speed_errors_rad(self) -> list[float] | None:
        """Return the error since the last call of each angle that integrates a speed; None without one."""
        if not any(self._speed_error_rad):
            return None
        errors_rad, self._speed_error_rad = self._speed_error_rad, [0.0] * len(self._angles)
        return errors_rad

    def _has_known_time(self, sample: Sample, t_ns: int) -> bool:
        silence = self._silences.get(sample.device)
        if silence is None:
            return True
        if isinstance(sample, WheelSample | RateSample):
            return silence.take(t_ns)
        if isinstance(sample, LinkSample):
            silence.begin_anew()
        return True

    def _take_inertial(self, sample: RateSample | AccelerationSample, t_ns: int) -> None:
        self._inertial.take(sample, t_ns)
        if isinstance(sample, RateSample):
            if self._gyro.feed(t_ns, sample.rate_z_rad_s):
                self._noise.take(t_ns, sample.rate_z_rad_s)
            if self._ground is not None:
                self._ground.take_rates(sample)

    def _take_wheel(self, sample: WheelSample, t_ns: int) -> WheelSample:
        """Take a sample of a wheel; return it with the continuous angle as its position."""
        wheel = sample.wheel
        if sample.steering_rad is not None:
            self._steering.measure(wheel, t_ns, sample.steering_rad)
        if not 0 <= wheel < len(self._angles):
            return sample
        angle = self._angles[wheel].take(t_ns, sample.position_rad, sample.speed_rad_s)
        if angle is None:
            return sample
        if angle.is_new_base and self.odometry.t_ns is not None:  # the first wheel says it for all
            self.odometry.rebase()
        self._speed_error_rad[wheel] += angle.error_rad
        self.odometry.feed(wheel, t_ns, angle.angle_rad)
        return (
            sample
            if angle.angle_rad == sample.position_rad
            else replace(sample, position_rad=angle.angle_rad)
        )
