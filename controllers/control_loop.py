"""One cycle of the controller: samples in, wheel setpoints out. Pure: time is an argument."""

import operator
from collections.abc import Sequence

from controllers.check_manoeuvre.manoeuvre import CheckManoeuvre
from controllers.check_manoeuvre.plan import plan
from controllers.check_manoeuvre.verdict import SourceCheck
from controllers.estimation.dead_reckoning import DeadReckoned
from controllers.estimation.filter.guarded_filter import Innovation
from controllers.estimation.filter.pose_filter import PoseFilter
from controllers.estimation.ground.travel import GroundMeter, GroundReport, GroundTravel
from controllers.estimation.ground_assumption.assumption import SlipAssumption
from controllers.estimation.headings.motor_field import MotorFieldCorrection
from controllers.estimation.parameters import ESTIMATION
from controllers.estimation.pauses import PauseWatch
from controllers.estimation.pose_estimate import PoseEstimate
from controllers.estimation.slip_compensator import NO_SLIP_EVIDENCE
from controllers.estimation.wheels.contradiction import ContradictionReport
from controllers.estimation.wheels.evidence import WheelSetpoints
from controllers.estimator import Estimator
from controllers.maneuvers import Maneuvers
from controllers.motion.crab import CrabDrift, CrabReport
from controllers.motion.kinematics import make_kinematics
from controllers.motion.limits import Limit, WheelLimiter
from controllers.motion.missions.by_hand import ByHand
from controllers.motion.missions.mission import Guidance
from controllers.motion.planar import Pose
from controllers.operator import OperatorInput, check_gains, gain_ranges
from controllers.roles import DeviceRoles
from controllers.safety import Mode, SafetySupervisor
from controllers.safety.border import Border
from controllers.safety.drive_check import DriveCheck, Finding
from controllers.safety.reasons import Cycle, Operation
from controllers.settings import ControlSettings, find_area_conflicts
from controllers.slip.effort.compensator import SlipReport
from controllers.slip.scomp.compensator import ScompReport
from controllers.slip.scomp.trace_reader import TraceFinder
from controllers.slip_estimators import make_slip_estimator
from controllers.unwatched_yaw import find_unwatched_yaw
from drivers.clock import nanoseconds, seconds
from drivers.errors import ConfigError
from drivers.record import record
from drivers.samples import HeadingSample, PoseFixSample, Sample, WheelCommand


@record(frozen=True, slots=True, kw_only=True)
class StepOutput:
    """Output of one cycle.

    Attributes:
        t_ns: Time of the cycle.
        mode: State of the controller.
        reason: Why the rover is stopped; empty while it may move.
        suspicion: What may be wrong although it stops nothing, or what the rover does beside its mission;
            empty for nothing.
        estimate: Pose of the filter.
        odometry: Pose of the wheels alone.
        odometry_rebases: Number of times the odometry lost its base, together with the motion in between.
        innovations: Innovation of each measurement of this cycle.
        command: Wheel setpoints to send; unless the mode is RUNNING, zero speeds and steering angles that
            stay.
        limit: Limit that the setpoints reached.
        cross_track_m: Distance to the left of the path; None unless the mode is RUNNING or just FINISHED.
        slip: Slip of the wheels by effort; None without this compensation, or without fresh motion.
        scomp: Slip of the rover by sComp; None without it, or without fresh motion.
        contradiction: How far the wheels contradict each other; None where they are not redundant, or
            without fresh motion.
        steering_rad: Present steering angles of the wheels; None where none steers.
        crab: Slip angle against which a rover that crabs turns its wheels; None while it does not crab.
        ground: Motion over the ground by the camera; None without.
        dead_reckoned: Pose without the corrections by pose fixes, which never jumps; None without fixes.
        findings: What begins to be wrong in this cycle with a drive that somebody else controls; None for
            nothing.
        waits_for_operator: Whether the rover stays stopped until an operator confirms that it may move.
        is_ground_contradicted: Whether a sensor has contradicted what [ground] assumes: the slip is unknown.
        checks: Result of the check manoeuvre, in the cycle that ends it; else None.
    """

    t_ns: int
    mode: Mode
    reason: str
    estimate: PoseEstimate
    odometry: Pose
    odometry_rebases: int
    innovations: tuple[Innovation, ...]
    command: WheelCommand
    limit: Limit
    cross_track_m: float | None
    slip: SlipReport | None = None
    scomp: ScompReport | None = None
    contradiction: ContradictionReport | None = None
    steering_rad: tuple[float, ...] | None = None
    crab: CrabReport | None = None
    ground: GroundReport | None = None
    suspicion: str = ""
    dead_reckoned: DeadReckoned | None = None
    findings: tuple[Finding, ...] | None = None
    waits_for_operator: bool = False
    is_ground_contradicted: bool = False
    checks: tuple[SourceCheck, ...] | None = None


class ControlLoop:
    """Estimates, guides, limits and stops.

    The same inputs give the same outputs, bit for bit. No sample makes `step` raise.

    Args:
        settings: Rover, noise, mission, limits and safety. Without a mission the controller observes: no
            device is required and the setpoints are zero.
        roles: Roles of the devices.
        finder: Finds the trace in the frames of `roles.camera`; None without a camera.
        meter: Measures the motion over the ground in these frames; None where that is not wanted.

    Raises:
        ConfigError: The mission does not fit the rover or its area, or the wheel device is not required
            although there is a mission.
    """

    def __init__(
        self,
        settings: ControlSettings,
        roles: DeviceRoles,
        finder: TraceFinder | None = None,
        meter: GroundMeter | None = None,
    ) -> None:
        kinematics = make_kinematics(settings.rover)
        mission = settings.mission
        if mission is not None and roles.wheels not in roles.required:
            raise ConfigError(f"required: a mission needs the wheel device {roles.wheels!r}, add it")
        for conflict in find_area_conflicts(settings.rover, mission, settings.safety):
            raise ConfigError(conflict)
        self._kinematics = kinematics
        self._expiry_ns = nanoseconds(settings.safety.expiry_s)
        self._motion_age_ns = nanoseconds(roles.motion_age_s)
        scomp = settings.scomp
        self._steers_against_drift = scomp is not None and scomp.steer_against_drift
        is_crabbing = mission is not None and mission.heading == "crab"
        self._crab = CrabDrift() if is_crabbing else None
        self._slip = make_slip_estimator(settings, kinematics, roles, finder)
        ground = settings.ground_motion
        self._estimator = Estimator(
            kinematics,
            settings.filter,
            settings.limits.wheel_speed_rad_s,
            roles,
            self._slip,
            None if meter is None or ground is None else GroundTravel(ground, meter),
            assumption=SlipAssumption(
                settings.ground.prior(),
                settings.ground.unknown(),
                share_sd=settings.filter.slip_sd_share or 1.0,
                compares_turns=not kinematics.skids_in_rotations,
            ),
            is_yaw_watched=find_unwatched_yaw(settings, roles) is None,
        )
        watched = (settings.safety, roles, kinematics.wheel_count, settings.filter.heading_lag_s)
        self._supervisor = SafetySupervisor(*watched)
        self._check = DriveCheck(*watched) if mission is None else None
        fields, lag_s = settings.filter.motor_fields, settings.filter.heading_lag_s
        self._motor_field = (
            None
            if fields is None
            else MotorFieldCorrection(fields, roles.wheels, lag_s, roles.max_age_s(roles.wheels))
        )
        self._limiter = WheelLimiter(settings.limits, settings.safety.expiry_s)
        shortest_age_s = min(roles.max_age_s(roles.wheels), roles.max_age_s(roles.gyro))
        self._pauses = PauseWatch(ESTIMATION.pose.pause_ages * shortest_age_s)
        self._commanded_rad_s = (0.0,) * kinematics.wheel_count
        self._travel_rad_s = self._excitation_rad_s = self._commanded_rad_s
        self._steering_rad: tuple[float, ...] = ()
        self._held_rad: tuple[float, ...] = ()
        self._standing_rad: tuple[float, ...] = ()
        self._is_paused = self._is_confirmed = self._is_led_out = False
        self._operator_reason = ""
        self._border = Border(settings.safety.area, settings.safety.body_m(settings.rover))
        self._gain_ranges = gain_ranges(settings)
        self._manoeuvre = CheckManoeuvre(
            plan(settings, kinematics, roles),
            roles,
            settings.filter,
            skids=kinematics.skids_in_rotations,
        )
        self._follower = None if mission is None else mission.follower(kinematics)
        rim_arm_m = settings.rover.wheel_radius_m * max(map(abs, kinematics.wheel_speeds(0.0, 0.0, 1.0)))
        self._maneuvers = (
            None if mission is None else Maneuvers(settings.safety, mission.speed_m_s, kinematics, rim_arm_m)
        )

    @property
    def pose_filter(self) -> PoseFilter:
        """The filter of the estimator, for a smoother of a recorded drive."""
        return self._estimator.pose_filter

    def operate(self, now_ns: int, wanted: OperatorInput) -> None:
        """Take what an operator wants, before the `step` at the same time.

        Raises:
            ConfigError: A gain is unknown or outside its range; nothing is changed.
        """
        check_gains(self._gain_ranges, wanted.gains)
        if wanted.is_paused is not None:
            self._is_paused = wanted.is_paused
        if wanted.stop_reason is not None:
            self._operator_reason = wanted.stop_reason
        self._is_confirmed |= wanted.is_confirmed
        if wanted.motion is not None and self._follower is not None:
            self._follower.command(now_ns, wanted.motion)
        if wanted.gains and self._follower is not None:
            self._follower.change_gains(wanted.gains)

    def follow_log(self, command: WheelCommand) -> None:
        """Replace the setpoints of the last `step` by those that the rover was given then.

        For a replay with other parameters: the rover drove as it was commanded, not as it would have been.
        """
        self._commanded_rad_s = command.speed_rad_s
        self._travel_rad_s = tuple(map(operator.sub, command.speed_rad_s, self._excitation_rad_s))
        self._steering_rad = command.steering_rad or ()

    def step(self, now_ns: int, samples: Sequence[Sample]) -> StepOutput:
        """Run one cycle at `now_ns` with the samples that arrived since the last one, in order of arrival."""
        are_stamps_known = self._pauses.begin_cycle(now_ns)
        for sample in samples:
            # A stamp from the future must neither stay fresh for long nor block the samples that follow.
            t_ns = min(sample.t_ns, now_ns)
            used = sample if self._motor_field is None else self._motor_field.correct(sample, t_ns)
            if used is None:
                continue
            (self._check or self._supervisor).observe(used, t_ns)
            if are_stamps_known or not isinstance(used, HeadingSample | PoseFixSample):
                self._estimator.take(used, t_ns)
            self._manoeuvre.take(used, t_ns)
        # Without a mission somebody else drives: zero is then no command.
        commanded_rad_s = () if self._follower is None else self._commanded_rad_s
        innovations = self._estimator.advance(now_ns, commanded_rad_s, self._steering_rad)
        if self._slip is not None:
            for pair in self._estimator.ground.pairs:
                self._slip.take_ground(pair)
        estimate = self._estimator.estimate(now_ns)
        self._border.measure(estimate)
        cycle = self._cycle(now_ns, estimate, innovations)
        if self._check is not None:
            is_inflated = self._judge(self._check, cycle)
            estimate = self._estimator.estimate(now_ns) if is_inflated else estimate
        guidance = self._guide(now_ns, estimate, cycle)
        estimate = self._estimator.budget.with_symptoms(estimate)
        speed_rad_s, limit = self._set_points(now_ns, guidance)
        self._commanded_rad_s = speed_rad_s
        # A wheel that only the excitation turns is always behind its setpoint: the travel shows a stall.
        self._travel_rad_s = tuple(map(operator.sub, speed_rad_s, self._excitation_rad_s))
        odometry = self._estimator.odometry
        is_fresh = self._is_motion_fresh(now_ns)
        ground, faults = self._estimator.ground.report(now_ns), self._estimator.faults
        report = self._slip.report(ground) if self._slip is not None and is_fresh else None
        return StepOutput(
            t_ns=now_ns,
            mode=self._mode(),
            reason="" if self._follower is None else self._reason,
            estimate=estimate,
            odometry=odometry.pose,
            odometry_rebases=odometry.rebases,
            innovations=innovations,
            command=WheelCommand(
                t_ns=now_ns,
                expires_ns=now_ns + self._expiry_ns,
                speed_rad_s=speed_rad_s,
                steering_rad=self._steering_rad or None,
            ),
            limit=limit,
            cross_track_m=None if guidance is None else guidance.cross_track_m,
            slip=report if isinstance(report, SlipReport) else None,
            scomp=report if isinstance(report, ScompReport) else None,
            contradiction=self._estimator.contradiction.report if is_fresh else None,
            steering_rad=self._estimator.steering.angles_rad or None,
            crab=None if guidance is None or self._crab is None else self._crab.report,
            ground=ground,
            suspicion=self._announcement
            or (self._supervisor.suspicion if self._check is None else self._check.unconfirmed)
            or "; ".join(fault.text for fault in faults),
            dead_reckoned=self._estimator.dead_reckoned(),
            findings=None if self._check is None else self._check.findings or None,
            waits_for_operator=self._supervisor.waits_for_operator,
            is_ground_contradicted=self._estimator.assumption.fault is not None,
            checks=self._manoeuvre.take_result(),
        )

    def _judge(self, check: DriveCheck, cycle: Cycle) -> bool:
        """Look for faults of a drive that somebody else controls; return whether they add uncertainty."""
        check.update(cycle, self._estimator.faults)
        self._estimator.take_faults(check.faults)
        if check.is_open:
            self._estimator.leave_open()
        return check.is_open or bool(check.faults)

    @property
    def _announcement(self) -> str:
        is_over = self._supervisor.mode in (Mode.FINISHED, Mode.EMERGENCY_STOP)
        return "" if self._maneuvers is None or is_over else self._maneuvers.announcement

    @property
    def _reason(self) -> str:
        """Why the rover is stopped; with what the check manoeuvre shows where another stop has ended it."""
        reason, failure = self._supervisor.reason, self._manoeuvre.failure
        is_over = self._supervisor.mode is Mode.EMERGENCY_STOP
        return f"{reason}; {failure}" if is_over and failure not in reason else reason

    def _mode(self) -> Mode:
        if self._follower is None:
            return Mode.OBSERVING
        mode = self._supervisor.mode
        return Mode.PAUSED if self._is_paused and mode is Mode.RUNNING else mode

    def _is_motion_fresh(self, now_ns: int) -> bool:
        motion_ns = self._estimator.motion_ns
        return motion_ns is not None and now_ns - motion_ns <= self._motion_age_ns

    def _cycle(self, now_ns: int, estimate: PoseEstimate, innovations: tuple[Innovation, ...]) -> Cycle:
        """Return what the stop rules see of this cycle."""
        estimator = self._estimator
        setpoints = WheelSetpoints(self._travel_rad_s, self._steering_rad)
        return Cycle(
            now_ns=now_ns,
            estimate=estimate,
            wheels=estimator.wheel_evidence(estimate, setpoints),
            gyro=estimator.gyro_evidence,
            measurements=estimator.measurement_evidence(innovations),
            uncertainty=estimator.budget.evidence,
            slip=NO_SLIP_EVIDENCE if self._slip is None else self._slip.evidence,
            operation=Operation(
                self._operator_reason,
                self._border.over_m,
                self._is_led_out,
                self._is_confirmed,
                self._manoeuvre.failure,
            ),
        )

    def _guide(self, now_ns: int, estimate: PoseEstimate, cycle: Cycle) -> Guidance | None:
        if self._follower is None or self._maneuvers is None:
            return None
        supervisor, maneuvers = self._supervisor, self._maneuvers
        was_running = supervisor.mode is Mode.RUNNING
        supervisor.update(cycle)
        self._is_confirmed = self._is_led_out = False
        self._estimator.take_faults(supervisor.faults)
        if was_running and supervisor.mode is Mode.SAFE_STOP and self._manoeuvre.is_over:
            maneuvers.back_out.stop(supervisor.stop_cause)
        if supervisor.mode is Mode.EMERGENCY_STOP:
            self._manoeuvre.judge()
        elif supervisor.mode is Mode.SAFE_STOP:
            self._manoeuvre.wait(now_ns)
        if supervisor.mode is not Mode.RUNNING or self._is_paused:
            return None
        guidance = self._lead(now_ns, estimate, cycle.wheels.distance_m, maneuvers)
        if guidance is None or not self._border.is_crossed_by(guidance):
            return guidance
        self._is_led_out = not isinstance(self._follower, ByHand)
        return Guidance(waits=True, cross_track_m=guidance.cross_track_m)

    def _lead(
        self, now_ns: int, estimate: PoseEstimate, distance_m: float, maneuvers: Maneuvers
    ) -> Guidance | None:
        """Return where mission, maneuvers or hand lead the rover; None for standstill."""
        if self._follower is None:
            return None
        supervisor, odometry = self._supervisor, self._estimator.odometry
        if not self._manoeuvre.is_over:
            return self._manoeuvre.guide(now_ns, odometry.pose, odometry.t_ns, self._estimator.ground.pairs)
        pose = Pose(x_m=estimate.x_m, y_m=estimate.y_m, yaw_rad=estimate.yaw_rad)
        way_back = maneuvers.back_out.guide(pose, distance_m)
        if way_back is not None:
            return way_back
        drift_rad = 0.0
        if self._slip is not None and self._steers_against_drift:
            drift_rad = self._slip.drift_rad
            if self._crab is not None:
                drift_rad = self._crab.take(now_ns, drift_rad, self._slip.drift_source)
        guidance = self._follower.guide(pose, now_ns, drift_rad)
        if guidance is None:
            return None
        if guidance.finished:
            supervisor.finish()
        return maneuvers.turn.guide(now_ns, guidance, is_undecided=supervisor.is_gyro_undecided)

    def _set_points(self, now_ns: int, guidance: Guidance | None) -> tuple[tuple[float, ...], Limit]:
        self._excitation_rad_s = (0.0,) * self._kinematics.wheel_count
        if guidance is None or guidance.finished or guidance.waits:
            self._limiter.stop()
            held_rad = self._estimator.steering.hold()
            if held_rad != self._held_rad:
                self._held_rad = held_rad
                self._standing_rad = self._kinematics.set_points(0.0, 0.0, 0.0, held_rad).steering_rad
            self._steering_rad = self._standing_rad
            return (0.0,) * self._kinematics.wheel_count, Limit.NONE
        self._estimator.steering.release()
        twist = guidance.velocity_x_m_s, guidance.velocity_y_m_s, guidance.yaw_rate_rad_s
        excitation_rad_s, changes_rad_s = 0.0, None
        if self._slip is not None:
            is_finding_out = self._maneuvers is not None and bool(self._maneuvers.turn.announcement)
            is_turning = self._manoeuvre.is_driving or is_finding_out
            is_measured = self._estimator.ground.is_measured
            twist, excitation_rad_s = self._slip.excite(
                seconds(now_ns), twist, is_turning=is_turning, is_measured=is_measured
            )
            changes_rad_s = self._slip.set_point_changes(twist)
        wanted_rad_s, self._steering_rad = self._kinematics.set_points(
            *twist, self._estimator.steering.angles_rad
        )
        if changes_rad_s is not None:
            wanted_rad_s = tuple(map(operator.add, wanted_rad_s, changes_rad_s))
        limited_rad_s, limit = self._limiter.limit(
            now_ns, wanted_rad_s, self._estimator.odometry.wheel_speed_rad_s
        )
        if excitation_rad_s:
            self._excitation_rad_s = self._kinematics.wheel_speeds(0.0, 0.0, excitation_rad_s)
        return limited_rad_s, limit
