"""Estimate of the pose from samples."""

import math
from collections.abc import Sequence
from dataclasses import replace

from controllers.estimation.body_velocity import BodyVelocity
from controllers.estimation.dead_reckoning import DeadReckoned, DeadReckoning
from controllers.estimation.filter.error_budget import Category, ErrorBudget
from controllers.estimation.filter.guarded_filter import Innovation
from controllers.estimation.filter.late_readings import LateReadings
from controllers.estimation.filter.motion_history import MotionHistory, Step
from controllers.estimation.filter.pose_filter import PoseFilter
from controllers.estimation.filter.reader import Situation, late
from controllers.estimation.filter.skid import SkidBound
from controllers.estimation.filter.transition import Turn
from controllers.estimation.ground.follower import GroundFollower
from controllers.estimation.ground.travel import GroundTravel
from controllers.estimation.ground_assumption.assumption import SlipAssumption
from controllers.estimation.ground_assumption.follower import AssumptionFollower
from controllers.estimation.gyro.gyro_noise import GyroNoise
from controllers.estimation.gyro.integrator import GyroIntegrator
from controllers.estimation.gyro.standstill import StandstillWatch
from controllers.estimation.gyro.standstill_follower import StandstillFollower
from controllers.estimation.gyro.turn_source import GyroEvidence, TurnSource
from controllers.estimation.gyro.unwatched_turn import UNWATCHED_YAW, UnwatchedTurn
from controllers.estimation.listed import make_readers
from controllers.estimation.measurement_evidence import MeasurementEvidence
from controllers.estimation.parameters import ESTIMATION
from controllers.estimation.pose_estimate import PoseEstimate, YawSource
from controllers.estimation.pose_report import PoseReport
from controllers.estimation.positions.frames import PositionFrames
from controllers.estimation.sample_intake import SampleIntake
from controllers.estimation.settings import FilterSettings
from controllers.estimation.slip_compensator import SlipCompensator
from controllers.estimation.slip_prior import UNKNOWN
from controllers.estimation.wheels.bounds import WheelBounds
from controllers.estimation.wheels.contradiction import WheelContradiction
from controllers.estimation.wheels.evidence import WheelEvidence, WheelSetpoints, wheel_evidence
from controllers.estimation.wheels.odometry import BodyIncrement
from controllers.estimation.wheels.stuck_encoder import StuckEncoders
from controllers.estimation.wheels.unobserved_motion import UnobservedMotion
from controllers.fault import Bound, Cause, Fault
from controllers.motion.kinematics import Kinematics
from controllers.motion.steering import SteeringAngles
from controllers.roles import DeviceRoles
from drivers.clock import nanoseconds
from drivers.samples import Sample


class Estimator:
    """Runs the parts of the estimate in the order of a cycle.

    `SampleIntake` passes the samples on. Here the wheels' increments become a prediction of the `PoseFilter`,
    and measurements its corrections. `LateReadings` keeps these until the recorded motion reaches them.
    `ErrorBudget` inflates the covariance where a motion may be measured wrongly. `PoseReport` gives the pose.

    Args:
        kinematics: Geometry of the wheels.
        settings: Noise of the pose filter.
        wheel_speed_limit_rad_s: Greatest wheel setpoint.
        roles: Which device is what.
        slip: Removes slip from the wheels' motion; None where the wheels are assumed to roll.
        ground: Measures the motion over the ground in the frames of the camera; None without one. Where it
            is valid it takes the place of `slip`.
        assumption: What is assumed about slip that nothing measures; None for `UNKNOWN`.
        is_yaw_watched: Whether something would notice a wrong yaw, see `unwatched_yaw`.

    Attributes:
        odometry: Wheel odometry.
        steering: Steering angles of the wheels.
        gyro: Its readings.
        contradiction: How far the wheels contradict each other.
        pose_filter: The filter that it feeds.
        positions: Frames of the devices that measure positions.
        assumption: Slip that is assumed where nothing measures it, and its test.
        budget: The account of added uncertainty.
        ground: Motion over the ground that a camera measures.
        standstill: Whether the rover stands.
        motion_ns: Time of the wheel positions that the pose is based on; None before the first motion.
    """

    def __init__(
        self,
        kinematics: Kinematics,
        settings: FilterSettings,
        wheel_speed_limit_rad_s: float,
        roles: DeviceRoles,
        slip: SlipCompensator | None = None,
        ground: GroundTravel | None = None,
        *,
        assumption: SlipAssumption | None = None,
        is_yaw_watched: bool = True,
    ) -> None:
        self.assumption = assumption or SlipAssumption(UNKNOWN, UNKNOWN)
        self._slip, self._settings, self._roles = slip, settings, roles
        self._speed_limit_rad_s = wheel_speed_limit_rad_s
        self.steering = SteeringAngles(kinematics.steering_rates_rad_s)
        self._reach = WheelBounds(
            kinematics, self.steering.angles_rad, wheel_speed_limit_rad_s, has_gyro=roles.gyro is not None
        )
        self.contradiction = WheelContradiction(kinematics)
        self.gyro = GyroIntegrator(
            roles.max_age_s(roles.gyro),
            ESTIMATION.odometry.plausible_speed * self._reach.fastest_turn_rad_s,
        )
        self.gyro_noise = GyroNoise(settings)
        self.pose_filter = PoseFilter(
            settings,
            roles.headings,
            roles.fixes,
            is_compensated=slip is not None,
            has_ground=ground is not None,
            slip=None if slip is None else slip.states,
            prior=self.assumption.prior,
        )
        self.positions = PositionFrames(self.pose_filter, settings, self.assumption.unknown)
        self._turns = TurnSource(self.gyro, self.gyro_noise, kinematics.wheel_count)
        self.budget = ErrorBudget(self.pose_filter, self._reach, None if slip is None else slip.forget_gyro)
        self.ground = GroundFollower(ground, roles.camera, self.pose_filter, self.budget, self._turns)
        self._history = MotionHistory()
        self._motion_age_ns = nanoseconds(roles.motion_age_s)
        self._readings = LateReadings(make_readers(self.positions, self.ground, slip))
        watch = StandstillWatch(settings)
        self._intake = SampleIntake(
            kinematics,
            roles,
            wheel_speed_limit_rad_s,
            self.steering,
            self.gyro,
            self.gyro_noise,
            watch.readings,
            self._readings,
            slip,
            ground,
        )
        self.odometry = self._intake.odometry
        self._unobserved = UnobservedMotion(self._reach.effects)
        self.standstill = StandstillFollower(
            settings,
            watch,
            self.pose_filter,
            self.budget,
            self.odometry,
            self.gyro,
            self.gyro_noise,
            self.ground.moved_m,
            self._reach,
        )
        self._assumed = AssumptionFollower(
            self.assumption,
            settings,
            self.gyro_noise,
            self.pose_filter,
            slip,
            self._turns,
            self.ground,
            self.positions,
            self.contradiction,
        )
        self._skid = SkidBound(self.budget, self._reach) if kinematics.skids_in_rotations else None
        self._stuck = StuckEncoders(settings, kinematics.wheel_count)
        self._stuck_fault: Fault | None = None
        # Poses and a camera decide between gyro and wheels themselves, see `YawWatch`.
        self._unwatched = (
            UnwatchedTurn(settings.slip_distance_m, is_watched=is_yaw_watched)
            if roles.headings or not is_yaw_watched
            else None
        )
        self._velocity = BodyVelocity(
            self.odometry, self.gyro, self._turns, self.pose_filter, slip, self.ground, self._assumed
        )
        self._report = PoseReport(
            settings, roles, self.pose_filter, self.positions, self._turns, self._velocity, self._reach, slip
        )
        self._dead_reckoning = DeadReckoning() if roles.fixes else None
        self._path_m = self._rolled_m = 0.0
        self._is_commanded = False
        self._driven_from = self.odometry.pose
        self.motion_ns: int | None = None

    def wheel_evidence(self, estimate: PoseEstimate, setpoints: WheelSetpoints) -> WheelEvidence:
        """Return what the stop rules see of the wheels in this cycle; `setpoints` are of the one before."""
        return wheel_evidence(
            self.odometry,
            self._driven_from,
            estimate,
            self.contradiction,
            self.steering,
            setpoints,
            self.motion_ns,
            is_still=self.standstill.is_still,
        )

    @property
    def gyro_evidence(self) -> GyroEvidence:
        """What the stop rules see of the gyro in this cycle."""
        return self._turns.evidence

    def measurement_evidence(self, innovations: tuple[Innovation, ...]) -> MeasurementEvidence:
        """Return what the stop rules see of the measurements in this cycle."""
        return MeasurementEvidence(
            innovations, self.positions.jumped_m, self.ground.pairs, self.positions.unexpected_m
        )

    @property
    def faults(self) -> tuple[Fault, ...]:
        """Why the wheels may not measure the motion of the rover, and what else is wrong."""
        found = (self.standstill.fault or self._stuck_fault, self.assumption.fault, self.gyro_noise.fault)
        return tuple(fault for fault in found if fault is not None)

    def take(self, sample: Sample, t_ns: int) -> None:
        """Take one sample as of `t_ns`; samples of other devices and kinds have no effect."""
        self._intake.take(sample, t_ns)

    def advance(
        self,
        now_ns: int,
        set_speed_rad_s: tuple[float, ...] = (),
        set_steering_rad: tuple[float, ...] = (),
    ) -> tuple[Innovation, ...]:
        """Update the estimate with the samples taken; return the innovations of the corrections.

        Args:
            now_ns: Time of the cycle.
            set_speed_rad_s: Setpoints of the wheels since the last cycle; empty for none.
            set_steering_rad: Steering setpoints since the last cycle; empty for none.
        """
        self.budget.begin_cycle()
        self._driven_from = self.odometry.pose
        self._steer(now_ns, set_steering_rad)
        increment = self.odometry.take(self.steering.angles_rad)
        self._turns.turn = None
        self._stuck_fault = None
        self._is_commanded = bool(set_speed_rad_s)
        set_speed_rad_s = set_speed_rad_s or (0.0,) * len(self._reach.effects)
        if any(set_speed_rad_s):
            self.standstill.note_drive(now_ns)
        self._account_for_lost_motion(set_speed_rad_s)
        if increment is not None:
            increment = self._compare_wheels(self._compensate(increment, now_ns, set_speed_rad_s))
            errors_rad = self._intake.take_speed_errors_rad()
            if errors_rad is not None:
                self.budget.add(self._reach.beside_gyro(errors_rad))
        self.standstill.follow(
            now_ns, self._path_m, reports_speed=self._intake.reports_speed, is_commanded=self._is_commanded
        )
        if increment is not None and self.odometry.t_ns is not None:
            self.motion_ns = self.odometry.t_ns
            self._move_to(self.motion_ns, now_ns, increment)
        innovations = self._correct()
        if self._slip is not None:
            self._slip.follow(self.pose_filter)
        turns = tuple(self.ground.compare(now_ns, is_at_standstill=self.standstill.is_at_standstill))
        if self._unwatched is not None and any(turn.accepted for turn in turns):
            self._unwatched.agree(is_rotation=self.ground.sees_rotation)
            self.budget.clear(UNWATCHED_YAW)
        innovations += turns
        innovations += self.standstill.correct_bias(self._roles.gyro)
        gained_m = self._assumed.test(self._rolled_m)
        if self._dead_reckoning is not None:
            self._dead_reckoning.add_slip(gained_m)
        self.budget.limit()
        return tuple(innovations)

    def take_faults(self, faults: Sequence[Fault]) -> None:
        """Inflate the covariance by what the stop rules have found in this cycle, see `ErrorBudget.take`."""
        self.budget.take(faults, self._path_m)

    def leave_open(self) -> None:
        """Inflate the covariance where a sensor of the motion may be wrong all the time.

        The yaw may be any, and the rover anywhere within what its wheels have rolled.
        """
        bound = Bound(position_m=self._rolled_m, yaw_rad=math.pi, is_motion_unknown=True)
        self.budget.raise_to(Cause.UNKNOWN_MOTION, bound)

    def estimate(self, now_ns: int) -> PoseEstimate:
        """Return the estimate; before the first motion of the wheels is known it is the start, `now_ns`."""
        return self._report.estimate(
            now_ns,
            self.motion_ns,
            is_at_standstill=self.standstill.is_at_standstill,
            is_commanded=self._is_commanded,
        )

    def dead_reckoned(self) -> DeadReckoned | None:
        """Return the pose without corrections; None without fixes, where the estimate does not jump."""
        if self._dead_reckoning is None:
            return None
        waiting = self._turns.waiting(
            self.pose_filter.gyro_bias_rad_s, is_at_standstill=self.standstill.is_at_standstill
        )
        return self._dead_reckoning.report(*waiting)

    def _steer(self, now_ns: int, set_steering_rad: tuple[float, ...]) -> None:
        self.steering.follow(now_ns, set_steering_rad)
        if self._reach.steer(self.steering.angles_rad):
            self._unobserved.turn_wheels(self._reach.effects)

    def _account_for_lost_motion(self, set_speed_rad_s: tuple[float, ...]) -> None:
        """Inflate the covariance when the wheels have a new base: their motion since the last is unknown."""
        odometry = self.odometry
        if odometry.lost_s:
            self._turns.has_lost_motion = True
            turn_unknown_s = max(0.0, odometry.lost_s - self.gyro.turn.covered_s)
            if turn_unknown_s <= self._roles.max_age_s(self._roles.gyro) and self._roles.gyro is not None:
                turn_unknown_s = 0.0  # the readings to come reach back
            # Where the setpoints are not known, the rover may have driven in any part of its turn.
            turned_rad = 0.0 if self._is_commanded else self.gyro.turn.angle_rad
            self.budget.add(
                self._unobserved.greatest_motion(
                    odometry.lost_s + odometry.frozen_s, turn_unknown_s, turned_rad
                ),
                Category.UNOBSERVED,
            )
        is_measured = odometry.t_ns is not None
        if not self._is_commanded:  # the setpoints of another controller are not known
            set_speed_rad_s = (self._speed_limit_rad_s,) * len(self._reach.effects)
        self._unobserved.note_speeds(odometry.wheel_speed_rad_s, set_speed_rad_s, is_measured=is_measured)

    def _compensate(
        self, rolled: BodyIncrement, now_ns: int, set_speed_rad_s: tuple[float, ...]
    ) -> BodyIncrement:
        """Return the increment of the wheels without slip; with it where the slip is measured.

        A compensator that is sure of a wrong slip must not spoil what is measured.
        """
        increment = rolled
        if self._slip is not None:
            gyro_rate_rad_s = self.gyro.rate_rad_s - self.pose_filter.gyro_bias_rad_s
            increment = self._slip.compensate(
                rolled, set_speed_rad_s, gyro_rate_rad_s if self.gyro.is_fresh(now_ns) else None
            )
        increment = self._assumed.apply(rolled, increment)
        if self.ground.is_measured:
            increment = replace(rolled, is_measured=True)
        self.budget.note_compensation(
            rolled.duration_s, rolled.x_m - increment.x_m, rolled.y_m - increment.y_m
        )
        return increment

    def _compare_wheels(self, increment: BodyIncrement) -> BodyIncrement:
        """Return the increment, unsure where the wheels contradict each other."""
        contradiction = self.contradiction.add(increment)
        if contradiction is None or contradiction.wheel is None:
            return increment
        return replace(increment, is_sure=False)

    def _move_to(self, motion_ns: int, now_ns: int, increment: BodyIncrement) -> None:
        """Move the estimate and all that goes along with it to the time of the newest wheel positions."""
        self._turns.add(self._reach.effects, increment)
        self._rolled_m += math.hypot(*self._reach.greatest(increment.turned_rad)[:2])
        turn = self._turns.take(
            now_ns, self.pose_filter.gyro_bias_rad_s, is_still=self.standstill.is_at_standstill
        )
        step = self._move(increment, turn)
        self._history.move(motion_ns, step)
        if self._dead_reckoning is not None:
            # What the filter itself takes off as slip is not in the increment.
            has_slip = increment.is_measured or (self._slip is not None and self._slip.states is not None)
            moved = step if has_slip else increment
            self.positions.drive(complex(moved.x_m, moved.y_m), step.turn_rad)
            self._dead_reckoning.add(step, math.sqrt(self.pose_filter.gyro_bias_rad2_s2))
        self._path_m += math.hypot(increment.x_m, increment.y_m)
        if self._skid is not None:
            self._skid.drive(increment, self.assumption.prior.sd)
        self._find_stuck_encoders(increment)
        self._account_for_unwatched_yaw(increment)

    def _find_stuck_encoders(self, increment: BodyIncrement) -> None:
        self._stuck.note(increment.turned_rad)
        turn = self._turns.turn
        if turn is None:
            return
        fault = self._stuck_fault = self._stuck.find(
            increment, turn, self._reach.effects, self.pose_filter.gyro_bias_rad2_s2
        )
        if fault is None:
            self.budget.clear(Cause.STUCK_ENCODER)
        else:
            self.budget.raise_to(fault.cause, fault.bound)

    def _account_for_unwatched_yaw(self, increment: BodyIncrement) -> None:
        if self._unwatched is None:
            return
        self._unwatched.drive(math.hypot(increment.x_m, increment.y_m))
        turn = self._turns.turn
        if turn is None or self._stuck_fault is not None:  # wheels known to be wrong are no alternative
            return
        if self._unwatched.add(turn):
            self.budget.clear(UNWATCHED_YAW)
        elif self._unwatched.error_rad and self.pose_filter.covariance[-1] < math.pi**2 / 3.0:
            # No yaw is more uncertain than any.
            self.budget.raise_to(UNWATCHED_YAW, Bound(yaw_rad=self._unwatched.error_rad))

    def _move(self, increment: BodyIncrement, turn: Turn) -> Step:
        """Move the estimate; after a gap of the samples the path between is unknown."""
        step = self.pose_filter.predict(increment, turn)
        self._assumed.drive(increment, step)
        if self._slip is not None and self._slip.states is not None:  # they remove their share there
            self.budget.note_compensation(0.0, increment.x_m - step.x_m, increment.y_m - step.y_m)
        if turn.source is YawSource.GYRO and turn.by_wheels_rad is not None:
            self.budget.count(0.0, step.yaw_rad2)
            self.budget.add((0.0, 0.0, turn.gap_error_rad), Category.UNOBSERVED)
        if increment.duration_s > self._roles.max_age_s(self._roles.wheels):
            aside_m = 0.5 * math.hypot(increment.x_m, increment.y_m) * min(abs(step.turn_rad), 1.0)
            self.budget.add((aside_m, aside_m, 0.0), Category.UNOBSERVED)
        return step

    def _correct(self) -> list[Innovation]:
        """Correct by the readings that the recorded motion has reached."""
        innovations: list[Innovation] = []
        self.ground.pairs = ()
        start_ns = self._history.start_ns
        for t_ns, reader, sample in self._readings.take(self._history.known_ns):
            is_at_start = start_ns is not None and 0 < start_ns - t_ns <= self._motion_age_ns
            way_back = self._history.way_back(start_ns if is_at_start and start_ns is not None else t_ns)
            if way_back is None:
                reader.miss(sample)
                innovations.append(late(sample))
                continue
            now = Situation(
                pose_filter=self.pose_filter,
                settings=self._settings,
                history=self._history,
                measured_ns=t_ns,
                way_back=way_back,
                yaw_rate_rad_s=self._velocity.yaw_rate_rad_s,
            )
            innovations += reader.correct(sample, now)
        return innovations
