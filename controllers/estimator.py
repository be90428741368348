"""Estimate of the pose from samples."""

import cmath
import math
from dataclasses import replace

from controllers.doubts import Doubts, added
from controllers.estimation.dead_reckoning import DeadReckoned, DeadReckoning
from controllers.estimation.ground_travel import GroundPair, GroundReport, GroundTravel, contradicting
from controllers.estimation.guarded_filter import Innovation
from controllers.estimation.gyro import GyroIntegrator
from controllers.estimation.measurements.listed import LISTED
from controllers.estimation.measurements.reader import Situation
from controllers.estimation.odometry import BodyIncrement, WheelOdometry
from controllers.estimation.parameters import ESTIMATION
from controllers.estimation.pauses import SilenceWatch
from controllers.estimation.pose_estimate import PoseEstimate, YawSource
from controllers.estimation.pose_filter import PoseFilter
from controllers.estimation.pose_fixes import FixQueue, Step, late
from controllers.estimation.rest import Rest, RestWatch, Witness
from controllers.estimation.settings import FilterSettings
from controllers.estimation.stuck_encoder import StuckEncoders
from controllers.estimation.transition import Turn
from controllers.estimation.turn_evidence import TurnEvidence
from controllers.estimation.turn_source import TurnSource
from controllers.estimation.unseen_motion import UnseenMotion
from controllers.estimation.waiting_samples import WaitingSamples
from controllers.estimation.wheel_angle import WheelAngle
from controllers.estimation.wheel_contradiction import WheelContradiction
from controllers.motion.body_motion import BodyMotion
from controllers.motion.kinematics import Kinematics, greatest_motion, wheel_effects
from controllers.motion.planar import wrap_angle
from controllers.motion.steering import SteeringAngles
from controllers.roles import DeviceRoles
from controllers.slip.protocol import SlipCompensator
from drivers.clock import nanoseconds, seconds
from drivers.samples import (
    AccelerationSample,
    FrameSample,
    LinkSample,
    PoseFixSample,
    RateSample,
    Sample,
    WheelSample,
)

LINEAR_RAD = 0.5
"""A yaw that is more uncertain turns the path by more than its tangent."""


class Estimator:
    """Feeds odometry, gyro and pose filter with the samples of their devices.

    Args:
        kinematics: Geometry of the wheels.
        settings: Noise of the pose filter.
        wheel_speed_limit_rad_s: Greatest wheel set-point.
        roles: Which device is what.
        slip: Removes slip from the wheels' motion; None where the wheels are assumed to roll.
        ground: Measures the motion over the ground in the frames of the camera; None without one. Where it
            is valid it takes the place of `slip`.

    Attributes:
        odometry: Wheel odometry.
        steering: Steering angles of the wheels.
        contradiction: How far the wheels contradict each other.
        motion_ns: Time of the wheel positions that the pose is based on; None before the first motion.
        is_still: Whether the wheels have been at rest for a while, as commanded, at the last `advance`.
        suspicion: Why the wheels may not measure the motion of the rover; empty without a contradiction.
        ground_pairs: Motions over the ground that the last cycle took.
        doubted_rad: Standard deviation of the yaw by doubts that are no unseen motion, before the corrections
            of the last cycle.
    """

    def __init__(
        self,
        kinematics: Kinematics,
        settings: FilterSettings,
        wheel_speed_limit_rad_s: float,
        roles: DeviceRoles,
        slip: SlipCompensator[object] | None = None,
        ground: GroundTravel | None = None,
    ) -> None:
        self._slip = slip
        self._ground = ground
        self._is_measured = False
        self._lost_m = self._doubted_rig_m = 0.0
        self.ground_pairs: tuple[GroundPair, ...] = ()
        self._kinematics = kinematics
        self.steering = SteeringAngles(kinematics.steering_rates_rad_s)
        self.contradiction = WheelContradiction(kinematics)
        self.odometry = WheelOdometry(kinematics, wheel_speed_limit_rad_s)
        self._settings = settings
        self._roles = roles
        wraps_rad = roles.wheel_wraps_rad or (None,) * kinematics.wheel_count
        self._angles = [
            WheelAngle(wheel_speed_limit_rad_s, roles.max_age_s(roles.wheels), wrap_rad)
            for wrap_rad in wraps_rad
        ]
        self._speed_error_rad = [0.0] * kinematics.wheel_count
        self._speed_limit_rad_s = wheel_speed_limit_rad_s
        self._rest = RestWatch(settings)
        self._stuck = StuckEncoders(settings, kinematics.wheel_count)
        self._doubted = (0.0, 0.0)
        self._doubted_rad = (0.0,) * kinematics.wheel_count
        self._is_bias_known = False
        self._has_doubted_bias = False
        self._path_m = 0.0
        self._is_commanded = False
        self.suspicion = ""
        self._effects = wheel_effects(kinematics)
        self._effects_at_rad = self.steering.angles_rad
        fastest_turn_rad_s = wheel_speed_limit_rad_s * sum(abs(effect[2]) for effect in self._effects)
        if kinematics.steering_rates_rad_s:  # straight wheels do not turn the rover
            fastest_turn_rad_s = wheel_speed_limit_rad_s / max(
                map(abs, kinematics.wheel_speeds(0.0, 0.0, 1.0))
            )
        self._gyro = GyroIntegrator(
            roles.max_age_s(roles.gyro), ESTIMATION.odometry.plausible_speed * fastest_turn_rad_s
        )
        self._filter = PoseFilter(
            settings,
            roles.headings,
            roles.fixes,
            is_compensated=slip is not None,
            has_ground=ground is not None,
            slip=None if slip is None else slip.states,
        )
        self._silences = {
            device: SilenceWatch(ESTIMATION.pose.pause_ages * roles.max_age_s(device))
            for device in (roles.wheels, roles.gyro)
            if device
        }
        self._fixes = FixQueue(roles.fixes, has_camera=ground is not None)
        self._dead_reckoning = DeadReckoning() if roles.fixes else None
        self._waiting = WaitingSamples(LISTED)
        self._turns = TurnSource(self._gyro, kinematics.wheel_count)
        self._rolled_m = 0.0
        self._driven_ns: int | None = None
        self._unseen = UnseenMotion(self._effects)
        self._doubts = Doubts(self._filter, self._unseen, slip)
        self.doubted_rad = 0.0
        self.is_still = False
        self._is_resting = False
        self._bias_seen_ns: int | None = None
        self.motion_ns: int | None = None

    @property
    def evidence(self) -> TurnEvidence | None:
        """Turn of the last cycle by gyro and by wheels; None where one of them did not measure it."""
        return self._turns.evidence

    @property
    def pose_filter(self) -> PoseFilter:
        """The filter that it feeds."""
        return self._filter

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
        elif isinstance(sample, PoseFixSample | FrameSample):
            self._take_reference(sample, t_ns)
        elif isinstance(sample, LinkSample) and device == self._roles.wheels:
            # After a break the codec counts turns from zero.
            self.odometry.rebase()
            for angle in self._angles:
                angle.reset()
        self._waiting.add(sample, t_ns)

    def _take_reference(self, sample: PoseFixSample | FrameSample, t_ns: int) -> None:
        if isinstance(sample, PoseFixSample):
            self._fixes.add(sample, t_ns)
        elif self._ground is not None and sample.device == self._roles.camera:
            self._ground.add(sample, t_ns)

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
        self._rest.readings.take(sample, t_ns)
        if isinstance(sample, RateSample):
            self._gyro.feed(t_ns, sample.rate_z_rad_s)
            if self._ground is not None:
                self._ground.take_rates(sample)

    def _take_wheel(self, sample: WheelSample, t_ns: int) -> WheelSample:
        """Take a sample of a wheel; return it with the continuous angle as its position."""
        wheel = sample.wheel
        if sample.steering_rad is not None:
            self.steering.measure(wheel, t_ns, sample.steering_rad)
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

    def advance(
        self,
        now_ns: int,
        set_speed_rad_s: tuple[float, ...] = (),
        set_steering_rad: tuple[float, ...] = (),
    ) -> tuple[Innovation, ...]:
        """Update the estimate with the samples taken; return the innovations of the corrections.

        Args:
            now_ns: Time of the cycle.
            set_speed_rad_s: Set-points of the wheels since the last cycle; empty for none.
            set_steering_rad: Steering set-points since the last cycle; empty for none.
        """
        self.doubted_rad = self._doubts.undecided_rad
        self._steer(now_ns, set_steering_rad)
        increment = self.odometry.take(self.steering.angles_rad)
        self._turns.evidence = None
        self._is_commanded = bool(set_speed_rad_s)
        set_speed_rad_s = set_speed_rad_s or (0.0,) * len(self._effects)
        if any(set_speed_rad_s):
            self._driven_ns = now_ns
        self._account_for_lost_motion(set_speed_rad_s)
        if increment is not None:
            increment = self._compare_wheels(self._compensate(increment, now_ns, set_speed_rad_s))
            self._account_for_speeds()
        self.is_still = self._is_still(now_ns)
        rest = self._follow_rest(now_ns)
        is_still = self._is_at_rest(rest)
        if increment is not None and self.odometry.t_ns is not None:
            self.motion_ns = self.odometry.t_ns
            self._turns.add(self._effects, increment)
            self._rolled_m += math.hypot(*greatest_motion(self._effects, increment.turned_rad)[:2])
            step = self._move(
                increment, self._turns.take(now_ns, self._filter.gyro_bias_rad_s, is_still=is_still)
            )
            self._fixes.move(self.motion_ns, step)
            if self._dead_reckoning is not None:
                self._dead_reckoning.add(step, math.sqrt(self._filter.gyro_bias_rad2_s2))
            self._path_m += math.hypot(increment.x_m, increment.y_m)
            self._doubt_stuck_wheels(increment)
        innovations = self._correct_by_samples()
        innovations += self._follow_ground(now_ns)
        for fix, way_back in self._fixes.take():
            innovations += (late(fix),) if way_back is None else self._filter.correct_pose(fix, way_back)
        gyro = self._gyro
        if is_still and gyro.t_ns != self._bias_seen_ns and self._roles.gyro is not None:
            self._bias_seen_ns = gyro.t_ns
            innovations.append(self._filter.correct_bias(self._roles.gyro, gyro.rate_rad_s))
            self._is_bias_known |= innovations[-1].accepted
        if self.unseen_m or self.unseen_rad or self.doubted_rad:
            self._doubts.limit()
        return tuple(innovations)

    def _compensate(
        self, rolled: BodyIncrement, now_ns: int, set_speed_rad_s: tuple[float, ...]
    ) -> BodyIncrement:
        """Return the increment of the wheels without slip; with it where the slip is measured.

        A compensator that is sure of a wrong slip must not spoil what is measured.
        """
        increment = rolled
        if self._slip is not None:
            gyro_rate_rad_s = self._gyro.rate_rad_s - self._filter.gyro_bias_rad_s
            increment = self._slip.compensate(
                rolled, set_speed_rad_s, gyro_rate_rad_s if self._gyro.is_fresh(now_ns) else None
            )
        if self._is_measured:
            increment = replace(rolled, is_measured=True)
        self._doubts.note_compensation(
            rolled.duration_s, rolled.x_m - increment.x_m, rolled.y_m - increment.y_m
        )
        return increment

    def _follow_ground(self, now_ns: int) -> list[Innovation]:
        """Correct by the motion over the ground between frames; return the innovations."""
        if self._ground is None:
            return []
        innovations: list[Innovation] = []
        pairs: list[GroundPair] = []
        camera = self._roles.camera or ""
        for way_back, pair, is_begin, doubted_m in self._ground.take(
            self._fixes.known_ns, self._fixes.way_back
        ):
            added_m, self._doubted_rig_m = added(doubted_m, self._doubted_rig_m), doubted_m
            if added_m:
                self._filter.widen(added_m, added_m, 0.0)
            if pair is not None and pair.contradiction:
                innovations.append(contradicting(camera, pair))
                # One after the other they err in one direction: the errors add up, not their variances.
                before_m, self._lost_m = self._lost_m, self._lost_m + abs(pair.ground_m - pair.rolled_m)
                added_m = added(self._lost_m, before_m)
                self._filter.widen(added_m, added_m, 0.0)
            elif pair is not None:
                self._lost_m = 0.0
                corrects_yaw = self._turns.yaw_source is not YawSource.GYRO
                innovations += self._filter.correct_ground(
                    camera, pair.motion, way_back, corrects_yaw=corrects_yaw
                )
                pairs.append(pair)
            if is_begin:
                self._filter.mark_frame(way_back)
        is_gyro = self._turns.yaw_source is YawSource.GYRO or self._is_resting
        innovations += self._ground.compare_turns(camera, is_gyro=is_gyro)
        self.ground_pairs = tuple(pairs)
        self._is_measured = self._ground.is_valid(now_ns)
        return innovations

    def ground_report(self, now_ns: int) -> GroundReport | None:
        """Return the motion over the ground; None without a camera that measures it."""
        return None if self._ground is None else self._ground.report(now_ns)

    @property
    def is_measured(self) -> bool:
        """Whether the motion over the ground is measured, so that the slip need not be inferred."""
        return self._is_measured

    def _compare_wheels(self, increment: BodyIncrement) -> BodyIncrement:
        """Return the increment, unsure where the wheels contradict each other."""
        contradiction = self.contradiction.add(increment)
        if contradiction is None or contradiction.wheel is None:
            return increment
        return replace(increment, is_sure=False)

    def _steer(self, now_ns: int, set_steering_rad: tuple[float, ...]) -> None:
        self.steering.follow(now_ns, set_steering_rad)
        if self.steering.angles_rad != self._effects_at_rad:
            self._effects_at_rad = self.steering.angles_rad
            self._effects = wheel_effects(self._kinematics, self._effects_at_rad)
            self._unseen.turn_wheels(self._effects)

    def doubt(
        self, wheel_rad: tuple[float, ...], yaw_rad: float, is_unseen: bool = True, path_m: float = 0.0
    ) -> None:
        """Widen the estimate by motion that was measured wrongly, see `Doubts.add`.

        A gyro that was wrong has also misled the slip compensation: a gyro without a signal looks like wheels
        that slip wholly. So a doubt of the yaw also widens the position by the travel that compensation has
        removed, and the slip states; the compensator forgets what the gyro has taught.

        Args:
            wheel_rad: Greatest error of the angle of each wheel, signed; empty for none.
            yaw_rad: Greatest error of the yaw.
            is_unseen: Whether the doubt counts as motion that was not measured, which may keep the rover
                stopped; else the estimate only becomes as uncertain as it is.
            path_m: Distance driven before, on which the yaw may have become wrong: its end may be off by the
                chord of that path turned by the yaw.
        """
        x_m, y_m, by_wheels_rad = greatest_motion(self._effects, wheel_rad or (0.0,) * len(self._effects))
        self._doubts.add(
            complex(x_m, y_m),
            yaw_rad,
            by_wheels_rad if self._roles.gyro is None else 0.0,
            is_unseen=is_unseen,
            driven_m=self._path_m,
            path_m=path_m,
        )

    def leave_open(self) -> None:
        """Widen the estimate to all that is left where a sensor of the motion may be wrong all the time."""
        self._doubts.leave_open(self._rolled_m)

    @property
    def unseen_m(self) -> float:
        """Standard deviation of the position from motion that was not measured; fixes reduce it."""
        return self._unseen.position_m

    @property
    def unseen_rad(self) -> float:
        """Standard deviation of the yaw from motion that was not measured; headings reduce it, too."""
        return self._unseen.yaw_rad

    def _is_still(self, now_ns: int) -> bool:
        """Return whether the wheels have been at rest for a while, as commanded.

        Encoders that are stuck must not pass for rest: the gyro's bias would be what the rover turns.
        """
        standstill_s = self._settings.standstill_s
        is_driven = self._driven_ns is not None and now_ns - self._driven_ns < nanoseconds(standstill_s)
        return not is_driven and self.odometry.is_still(now_ns, standstill_s)

    def _follow_rest(self, now_ns: int) -> Rest:
        """Compare a rest of the wheels with the other sensors; widen the estimate at a contradiction."""
        rest = self._rest.follow(
            now_ns,
            self.odometry.still_since_ns if self.is_still else None,
            self.odometry.t_ns or 0,
            (
                self._filter.gyro_bias_rad_s,
                # A bias that is doubted is no reason to take any turn for one.
                min(self._filter.gyro_bias_rad2_s2, self._settings.gyro_bias_rad_s**2),
            ),
            reports_speed=any(angle.contradicts_rest for angle in self._angles),
            is_commanded=self._is_commanded,
            sees_motion=self._seen_at_rest_m(now_ns) > 0.0,
        )
        self.suspicion = ""
        if not rest.is_contradicted:
            self._doubted, self._has_doubted_bias = (0.0, 0.0), False
            return rest
        self.suspicion = (
            f"the wheels are at rest, but motion is reported by {' and '.join(rest.moving)}; "
            "the estimate is wider"
        )
        if not self._has_doubted_bias and self._is_perhaps_offset(rest):
            self._has_doubted_bias = True
            yaw_rad = self._filter.doubt_bias(self._gyro.rate_rad_s - self._filter.gyro_bias_rad_s)
            if yaw_rad > LINEAR_RAD:
                # The covariance does not hold the chord of the path turned by so much.
                chord_m = 2.0 * self._path_m * math.sin(0.5 * min(yaw_rad, math.pi))
                self._filter.widen(chord_m, chord_m, 0.0)
        wheel_rad = [self._speed_limit_rad_s * rest.unknown_s] * len(self._effects)
        reach_m = math.hypot(*greatest_motion(self._effects, wheel_rad)[:2])
        if self._is_commanded and rest.moving == (Witness.GYRO,):  # a nudge, or a wrong gyro
            reach_m = 0.0
        if rest.moving == (Witness.CAMERA,):  # the motion is measured
            reach_m = max(self._doubted[0], self._seen_at_rest_m(now_ns))
        before_m, before_rad = self._doubted
        self._doubted = max(before_m, reach_m), max(before_rad, abs(rest.turned_rad))
        added_m, added_rad = map(added, self._doubted, (before_m, before_rad))
        if added_m or added_rad:
            self._doubts.widen((added_m, added_m, added_rad))
        return rest

    def _seen_at_rest_m(self, now_ns: int) -> float:
        """Return how far a camera has seen the rover move although its wheels rest."""
        if self._ground is None or not self.is_still:
            return 0.0
        # The body swings after its wheels have stopped.
        swung_ns = nanoseconds(2.0 * self._settings.standstill_s)
        return self._ground.moved_m(self.odometry.still_since_ns + swung_ns, now_ns)

    def _is_perhaps_offset(self, rest: Rest) -> bool:
        """Return whether only the gyro contradicts a rest, and has never been seen at rest."""
        return rest.moving == (Witness.GYRO,) and not self._is_bias_known and not self._is_commanded

    def _is_at_rest(self, rest: Rest) -> bool:
        """Return whether the rover is taken to be at rest; the gyro alone does not contradict a command."""
        is_offset = rest.is_offset and not self._is_bias_known
        is_commanded = self._is_commanded and not rest.is_turning
        self._is_resting = self.is_still and (rest.holds or is_commanded or is_offset)
        return self._is_resting

    def _doubt_stuck_wheels(self, increment: BodyIncrement) -> None:
        self._stuck.note(increment.turned_rad)
        if self.evidence is None:
            return
        unknown_rad = self._stuck.unknown_rad(
            self.evidence,
            math.hypot(increment.x_m, increment.y_m),
            self._effects,
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
            self._filter.widen(*self._in_gyro_frame(greatest_motion(self._effects, added_rad)))
        stuck = [str(wheel) for wheel, unknown in enumerate(unknown_rad) if unknown]
        if stuck and not self.suspicion:
            self.suspicion = (
                f"wheel {', '.join(stuck)} does not turn, but the gyro contradicts the turn by the others; "
                "the estimate is wider"
            )

    def _in_gyro_frame(self, greatest: BodyMotion) -> BodyMotion:
        """Return how far the body can have moved; its turn is known where there is a gyro."""
        x_m, y_m, yaw_rad = greatest
        return x_m, y_m, yaw_rad if self._roles.gyro is None else 0.0

    @property
    def rejected_rate_rad_s(self) -> float | None:
        """Newest reading of the gyro if the rover cannot turn that fast; else None."""
        return self._gyro.rejected_rad_s

    def estimate(self, now_ns: int) -> PoseEstimate:
        """Return the estimate; before the first motion of the wheels is known it is the start, `now_ns`."""
        pose = self._filter.pose
        velocity_x_m_s, velocity_y_m_s, _ = self._body_velocity()
        yaw_rate_rad_s = self._yaw_rate_rad_s()
        xx, xy, x_yaw, yy, y_yaw, yaw_rad2 = self._filter.covariance
        waiting_rad, waiting_rad2 = self._turns.waiting(
            self._filter.gyro_bias_rad_s, is_resting=self._is_resting
        )
        yaw_rad = wrap_angle(pose.yaw_rad + waiting_rad)
        yaw_rad2 += waiting_rad2
        age_s = 0.0 if self.motion_ns is None else seconds(now_ns - self.motion_ns)
        toward = cmath.rect(1.0, yaw_rad)
        since_m = age_s * complex(velocity_x_m_s, velocity_y_m_s) * toward
        unsettled_m = 0j if self._slip is None else self._slip.unsettled_m * toward
        for along_m in (since_m, unsettled_m, *self.jumped_m.values()):
            xx, xy, yy = xx + along_m.real**2, xy + along_m.real * along_m.imag, yy + along_m.imag**2
        silent_m2, silent_rad2 = self._silent(age_s)
        xx, yy, yaw_rad2 = xx + silent_m2, yy + silent_m2, yaw_rad2 + silent_rad2
        if self._turns.yaw_source is YawSource.GYRO:
            yaw_rad2 += (yaw_rate_rad_s * self._settings.gyro_delay_sd_s) ** 2
        return PoseEstimate(
            t_ns=now_ns if self.motion_ns is None else self.motion_ns,
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

    def _silent(self, age_s: float) -> tuple[float, float]:
        """Return the variances of position and yaw while the wheels are silent and somebody else drives."""
        if self._is_commanded or age_s <= self._roles.max_age_s(self._roles.wheels):
            return 0.0, 0.0
        x_m, y_m, yaw_rad = self._in_gyro_frame(
            greatest_motion(self._effects, [self._speed_limit_rad_s * age_s] * len(self._effects))
        )
        return (x_m**2 + y_m**2) / 3.0, yaw_rad**2 / 3.0

    def dead_reckoned(self) -> DeadReckoned | None:
        """Return the pose without corrections; None without fixes, where the estimate does not jump."""
        if self._dead_reckoning is None:
            return None
        waiting = self._turns.waiting(self._filter.gyro_bias_rad_s, is_resting=self._is_resting)
        return self._dead_reckoning.report(*waiting)

    @property
    def jumped_m(self) -> dict[str, complex]:
        """By how much the places of each device have jumped, in the local frame; see `FixJumps`."""
        return self._filter.jumped_m

    def _account_for_lost_motion(self, set_speed_rad_s: tuple[float, ...]) -> None:
        """Widen the estimate when the wheels have a new base: what they did since the last one is unknown."""
        odometry = self.odometry
        if odometry.lost_s:
            self._turns.has_lost_motion = True
            turn_unknown_s = max(0.0, odometry.lost_s - self._gyro.turn.covered_s)
            if turn_unknown_s <= self._roles.max_age_s(self._roles.gyro) and self._roles.gyro is not None:
                turn_unknown_s = 0.0  # the readings to come reach back
            # Where the set-points are not known, the rover may have driven in any part of its turn.
            turned_rad = 0.0 if self._is_commanded else self._gyro.turn.angle_rad
            self._doubts.widen(
                self._unseen.greatest_motion(odometry.lost_s + odometry.frozen_s, turn_unknown_s, turned_rad)
            )
        is_measured = odometry.t_ns is not None
        if not self._is_commanded:  # the set-points of another controller are not known
            set_speed_rad_s = (self._speed_limit_rad_s,) * len(self._effects)
        self._unseen.note_speeds(odometry.wheel_speed_rad_s, set_speed_rad_s, is_measured=is_measured)

    def _account_for_speeds(self) -> None:
        """Widen the estimate by the errors of wheels whose angles are integrals of their speeds."""
        if any(self._speed_error_rad):
            self._filter.widen(*self._in_gyro_frame(greatest_motion(self._effects, self._speed_error_rad)))
            self._speed_error_rad = [0.0] * len(self._effects)

    def _move(self, increment: BodyIncrement, turn: Turn) -> Step:
        """Move the estimate; after a gap of the samples the path between is unknown."""
        step = self._filter.predict(increment, turn)
        if self._slip is not None:
            if self._slip.states is not None:  # they remove their share in the prediction
                self._doubts.note_compensation(0.0, increment.x_m - step.x_m, increment.y_m - step.y_m)
            self._slip.correct(self._filter)
        if turn.source is YawSource.GYRO and turn.by_wheels_rad is not None:
            self._unseen.add(0.0, step.yaw_rad2)
            self._doubts.widen((0.0, 0.0, turn.gap_error_rad))
        if increment.duration_s > self._roles.max_age_s(self._roles.wheels):
            aside_m = 0.5 * math.hypot(increment.x_m, increment.y_m) * min(abs(step.turn_rad), 1.0)
            self._doubts.widen((aside_m, aside_m, 0.0))
        return step

    def _yaw_rate_rad_s(self) -> float:
        if self._turns.yaw_source is YawSource.GYRO:
            return self._gyro.rate_rad_s - self._filter.gyro_bias_rad_s
        return self._body_velocity()[2]

    def _body_velocity(self) -> BodyMotion:
        rolled = self.odometry.velocity
        if self._is_measured:
            velocity_m_s = complex(*rolled[:2]) * (1.0 + self._filter.measured_slip)
            return velocity_m_s.real, velocity_m_s.imag, rolled[2]
        if self._slip is None:
            return rolled
        return self._slip.body_motion(self.odometry.wheel_speed_rad_s)

    def _correct_by_samples(self) -> list[Innovation]:
        """Correct by the samples that wait, if the motion is known recently enough to compare them."""
        innovations: list[Innovation] = []
        limit_ns = nanoseconds(self._roles.motion_age_s)
        for reader, sample, t_ns in self._waiting.take():
            if self.motion_ns is not None and t_ns - self.motion_ns > limit_ns:
                continue
            now = Situation(
                settings=self._settings,
                layout=self._filter.layout,
                yaw_rate_rad_s=self._yaw_rate_rad_s(),
                age_s=0.0 if self.motion_ns is None else seconds(self.motion_ns - t_ns),
            )
            measurement = reader.read(sample, now)
            if measurement is not None:
                innovations += self._filter.correct(*measurement)
        return innovations
