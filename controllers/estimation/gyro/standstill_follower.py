"""A standstill of the wheels: what it shows of the gyro, and what is unknown where it is contradicted."""

import math
from collections.abc import Callable

from controllers.estimation.filter.error_budget import Category, ErrorBudget
from controllers.estimation.filter.guarded_filter import Innovation
from controllers.estimation.filter.pose_filter import PoseFilter
from controllers.estimation.gyro.gyro_noise import GyroNoise
from controllers.estimation.gyro.integrator import GyroIntegrator
from controllers.estimation.gyro.standstill import Standstill, StandstillWatch, Witness
from controllers.estimation.gyro.standstill_reading import GyroAtStandstill
from controllers.estimation.settings import FilterSettings
from controllers.estimation.wheels.bounds import WheelBounds
from controllers.estimation.wheels.odometry import WheelOdometry
from controllers.fault import Bound, Cause, Fault, Severity
from controllers.motion.planar import Pose
from drivers.clock import nanoseconds

LINEAR_RAD = 0.5
"""A yaw that is more uncertain turns the path by more than its tangent."""


class StandstillFollower:
    """Compares a standstill of the wheels with the other sensors; inflates the covariance at a contradiction.

    A standstill that holds shows the bias of the gyro.

    Args:
        settings: Noise and times.
        watch: Judges a standstill by gyro, accelerometer and the others.
        pose_filter: Holds the bias of the gyro.
        budget: Inflates the covariance.
        odometry: Knows when the wheels stopped.
        gyro: Its newest reading.
        noise: Of the gyro.
        moved_m: Motion over the ground in a time that a camera has seen.
        reach: How far the wheels can have moved the body.

    Attributes:
        is_still: Whether the wheels have been at standstill for a while, as commanded, in the last cycle.
        is_at_standstill: Whether the rover is taken to be at known.
        fault: Why the wheels may not measure the motion; None without a contradiction.
    """

    def __init__(
        self,
        settings: FilterSettings,
        watch: StandstillWatch,
        pose_filter: PoseFilter,
        budget: ErrorBudget,
        odometry: WheelOdometry,
        gyro: GyroIntegrator,
        noise: GyroNoise,
        moved_m: Callable[[int, int], float],
        reach: WheelBounds,
    ) -> None:
        self._settings, self._watch, self._filter, self._budget = settings, watch, pose_filter, budget
        self._odometry, self._gyro, self._noise = odometry, gyro, noise
        self._moved_m, self._reach = moved_m, reach
        self._is_bias_known = self._has_inflated_bias = False
        self._bias_seen_ns: int | None = None
        self._bias_readings = 0
        self._driven_ns: int | None = None
        self.is_still = self.is_at_standstill = False
        self.fault: Fault | None = None

    def note_drive(self, now_ns: int) -> None:
        """Take that the wheels are commanded to turn."""
        self._driven_ns = now_ns

    def follow(self, now_ns: int, path_m: float, *, reports_speed: bool, is_commanded: bool) -> None:
        """Update `is_still`, `is_at_standstill` and `fault`.

        Args:
            now_ns: Time of the cycle.
            path_m: Distance driven since the start.
            reports_speed: Whether a drive reports a speed although its position stays.
            is_commanded: Whether the setpoints of the wheels are known.
        """
        self.is_still = self._are_wheels_still(now_ns)
        known = self._watch.follow(
            now_ns,
            self._odometry.still_since_ns if self.is_still else None,
            self._odometry.t_ns or 0,
            (
                self._filter.gyro_bias_rad_s,
                # An uncertain bias is no reason to take any turn for one.
                min(self._filter.gyro_bias_rad2_s2, self._settings.gyro_bias_rad_s**2),
            ),
            reports_speed=reports_speed,
            is_commanded=is_commanded,
            sees_motion=self._seen_m(now_ns) > 0.0,
        )
        self.fault = None
        if known.is_contradicted:
            self._take_contradiction(known, now_ns, path_m, is_commanded=is_commanded)
        else:
            self._budget.clear(Cause.MOTION_AT_STANDSTILL)
            self._has_inflated_bias = False
        # The gyro alone does not contradict a command.
        is_offset = known.is_offset and not self._is_bias_known
        self.is_at_standstill = self.is_still and (
            known.holds or (is_commanded and not known.is_turning) or is_offset
        )
        still_ns = self._odometry.still_since_ns
        if self._odometry.pose != Pose():  # the body swings after its wheels have stopped
            still_ns += nanoseconds(2.0 * self._settings.standstill_s)
        self._noise.follow(still_ns if self.is_at_standstill else None)

    def correct_bias(self, device: str | None) -> list[Innovation]:
        """Correct the bias by a new reading at standstill; return the innovation.

        It is never known better than what the readings hide.

        Args:
            device: The gyro; None without one.
        """
        gyro, noise = self._gyro, self._noise
        least_rad2_s2 = noise.hidden_rad_s**2
        innovations: list[Innovation] = []
        if self.is_at_standstill and gyro.t_ns != self._bias_seen_ns and device is not None:
            self._bias_seen_ns = gyro.t_ns
            sd_rad_s = noise.scatter_rad_s(self._watch.readings.rates_rad_s(self._odometry.still_since_ns))
            variance, bias_rad2_s2 = sd_rad_s**2, self._filter.gyro_bias_rad2_s2
            if bias_rad2_s2 * variance / (bias_rad2_s2 + variance) >= least_rad2_s2:
                model = GyroAtStandstill(device=device, sd_rad_s=sd_rad_s)
                innovations += self._filter.correct(model, (gyro.rate_rad_s,))
                self._is_bias_known |= innovations[0].accepted
                self._bias_readings += innovations[0].accepted
            least_rad2_s2 = max(least_rad2_s2, self._by_late_noise_rad2_s2())
        excess_rad2_s2 = least_rad2_s2 - self._filter.gyro_bias_rad2_s2
        if excess_rad2_s2 > 0.0:
            self._filter.inflate_with_bias(math.sqrt(excess_rad2_s2))
        return innovations

    def _by_late_noise_rad2_s2(self) -> float:
        """Return the variance of the bias if all readings had been as noisy as known now; 0 as configured."""
        reading_rad_s = self._noise.reading_rad_s
        if reading_rad_s == self._settings.gyro_rate_noise_rad_s:
            return 0.0
        known_before = (reading_rad_s / self._settings.gyro_bias_rad_s) ** 2
        return reading_rad_s**2 / (self._bias_readings + known_before)

    def _are_wheels_still(self, now_ns: int) -> bool:
        """Return whether the wheels have been at standstill for a while, as commanded.

        Encoders that are stuck must not pass for a standstill: the gyro's bias would be what the rover turns.
        """
        standstill_s = self._settings.standstill_s
        is_driven = self._driven_ns is not None and now_ns - self._driven_ns < nanoseconds(standstill_s)
        return not is_driven and self._odometry.is_still(now_ns, standstill_s)

    def _seen_m(self, now_ns: int) -> float:
        """Return how far a camera has seen the rover move although its wheels stand."""
        if not self.is_still:
            return 0.0
        # The body swings after its wheels have stopped.
        swung_ns = nanoseconds(2.0 * self._settings.standstill_s)
        return self._moved_m(self._odometry.still_since_ns + swung_ns, now_ns)

    def _take_contradiction(
        self, known: Standstill, now_ns: int, path_m: float, *, is_commanded: bool
    ) -> None:
        """Inflate the covariance by the possible motion in a standstill that is contradicted."""
        moving = " and ".join(known.moving)
        text = f"the wheels are at rest, but motion is reported by {moving}; the estimate is wider"
        is_by_gyro = known.moving == (Witness.GYRO,)
        if is_by_gyro and not (self._has_inflated_bias or self._is_bias_known or is_commanded):
            # A gyro that has never been seen at standstill may have an offset.
            self._has_inflated_bias = True
            yaw_rad = self._filter.inflate_with_bias(self._gyro.rate_rad_s - self._filter.gyro_bias_rad_s)
            if yaw_rad > LINEAR_RAD:
                # The covariance does not hold the chord of the path turned by so much.
                chord_m = 2.0 * path_m * math.sin(0.5 * min(yaw_rad, math.pi))
                self._budget.add((chord_m, chord_m, 0.0))
        reach_m = math.hypot(*self._reach.greatest(self._reach.at_limit_rad(known.unknown_s))[:2])
        if is_commanded and is_by_gyro:  # a nudge, or a wrong gyro
            reach_m = 0.0
        if known.moving == (Witness.CAMERA,):  # the motion is measured
            reach_m = self._seen_m(now_ns)
        bound = Bound(position_m=reach_m, yaw_rad=abs(known.turned_rad))
        self.fault = Fault(moving, Cause.MOTION_AT_STANDSTILL, text, Severity.UNCERTAIN, bound)
        self._budget.raise_to(self.fault.cause, bound, Category.UNOBSERVED)
