"""Slip and slip angle while driving, from tilt, gyro and the rear wheel's trace, by the sComp filter."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

from controllers.estimation.filter.guarded_filter import Innovation
from controllers.estimation.filter.slip_states import SlipEstimate
from controllers.estimation.ground.travel import GroundReport
from controllers.estimation.parameters import ESTIMATION
from controllers.estimation.slip_compensator import SlipEstimator, SlipEvidence
from controllers.estimation.wheels.odometry import BodyIncrement
from controllers.ftrace.reading import Rates, TraceReading
from controllers.motion.body_motion import BodyMotion
from controllers.motion.crab import DriftSource
from controllers.motion.kinematics import Kinematics
from controllers.motion.steering import mean_steering_rad
from controllers.roles import DeviceRoles
from controllers.slip.scomp.motion_model import (
    RESIDUAL,
    expected_drift,
    tilt_along,
)
from controllers.slip.scomp.parameters import SCOMP
from controllers.slip.scomp.settings import ScompSettings
from controllers.slip.scomp.states import ScompStates
from controllers.slip.scomp.trace_model import TraceAngle
from drivers.clock import nanoseconds, seconds
from drivers.record import record
from drivers.samples import AttitudeSample, FrameSample, RateSample, Sample

NO_TRACE = "no trace"
"""A reason that leaves the motion sure: without a trace the slip angle's own variance grows."""

NO_MOTION = (
    "no trace, and the camera sees no motion of the ground: turned against its rig, covered, too dark or too "
    "bright, or the rover is stuck"
)
"""The same after a travel of the wheels on which no frame gave a direction at all."""


class TraceFinder(Protocol):
    """Finds the trace of the rear left wheel in frames, one after the other."""

    def find(
        self, frame: FrameSample, wheel_speed_m_s: float, rates_rad_s: Rates | None
    ) -> TraceReading | None:
        """Return the trace in a frame; None for a frame that cannot be evaluated.

        Args:
            frame: Newer than the one before.
            wheel_speed_m_s: Of the rim.
            rates_rad_s: Turn rates of the body about x, y, z; None where unknown.
        """
        ...


@record(frozen=True, slots=True, kw_only=True)
class ScompReport:
    """Slip of the rover.

    Attributes:
        slip: Slip ratio of the rover, eq 3 of paper 000, in the direction in which its wheels roll.
        slip_angle_rad: Angle of its velocity from its axis, left positive, eq 1.
        trace: The trace in the frame evaluated in this cycle; None without one.
        reason: Why slip and slip angle are uncertain; empty where they are not.
    """

    slip: float
    slip_angle_rad: float
    trace: TraceReading | None
    reason: str


class ScompCompensator(SlipEstimator[ScompReport]):
    """Slip and slip angle of a rover as states of the pose filter, corrected by the trace.

    Args:
        settings: Parameters of the estimator.
        roles: Names the gyro, which also measures the tilt, and the rearward camera.
        kinematics: Of the wheels.
        finder: Of the trace; None without a camera.
        states: Of slip and trace; None for those of a rover with pitch and roll.

    Attributes:
        trace_innovation: Of the trace at the last `correct`; None without a new one.
    """

    def __init__(
        self,
        settings: ScompSettings,
        roles: DeviceRoles,
        kinematics: Kinematics,
        finder: TraceFinder | None,
        states: ScompStates | None = None,
    ) -> None:
        self._report: ScompReport | None = None
        self.trace_innovation: Innovation | None = None
        self._settings = settings
        self._roles = roles
        self._kinematics = kinematics
        self._finder = finder
        self._states = states or ScompStates(settings.parameters)
        self._yaw_rate_rad_s = 0.0
        self._trust = _TraceTrust(settings.trace_age_s)
        self._skidding = _Skidding(settings.parameters.rover.track_m)
        self._since_rate_s = 0.0
        self._is_backwards = False
        self._is_gyro_doubted = False
        self._tilt = _Tilt()
        self._frame: FrameSample | None = None
        self._frame_ns: int | None = None
        self._rates: Rates | None = None
        self._readings_rad_s: list[float] = []
        self._since_trace_s = math.inf
        self._blind_m = 0.0
        self._blind_s = 0.0
        self._blind_from_ns: int | None = None
        self._slip = self._wheel_slip_angle_rad = 0.0
        self._steering_rad: tuple[float, ...] = ()
        self._pending = _Pending()

    @property
    def drift_rad(self) -> float:
        """Angle of the velocity from the direction in which the wheels roll, left positive."""
        return self._wheel_slip_angle_rad

    @property
    def evidence(self) -> SlipEvidence:
        """What the frames of the camera show."""
        return SlipEvidence(unmoved_m=self.unmoved_m)

    @property
    def drift_source(self) -> DriftSource:
        """What the slip angle comes from."""
        if self._has_trace():
            return DriftSource.TRACE
        return DriftSource.TILT if self._tilt.is_known else DriftSource.NONE

    @property
    def unmoved_m(self) -> float:
        """Travel of the wheels on which frames have shown no motion of the ground; 0 where that is little."""
        blind = SCOMP.correction
        is_blind = self._blind_m >= blind.blind_m and self._blind_s >= blind.blind_s
        return self._blind_m if self._finder is not None and is_blind else 0.0

    @property
    def states(self) -> ScompStates:
        """The states in the pose filter."""
        return self._states

    def feed(self, sample: Sample, t_ns: int) -> None:
        """Take a sample of gyro or camera as of `t_ns`; other samples have no effect."""
        greatest_rad_s = ESTIMATION.pose.greatest_rate_rad_s
        if isinstance(sample, FrameSample):
            if self._finder is not None and sample.device == self._roles.camera:
                self._take_frame(sample)
        elif sample.device != self._roles.gyro:
            return
        elif isinstance(sample, AttitudeSample):
            self._tilt.feed(sample, t_ns)
        elif isinstance(sample, RateSample) and abs(sample.rate_z_rad_s) <= greatest_rad_s:
            self._readings_rad_s.append(sample.rate_z_rad_s)
            x, y = sample.rate_x_rad_s, sample.rate_y_rad_s
            known = x is not None and y is not None and abs(x) + abs(y) <= greatest_rad_s
            self._rates = (x or 0.0, y or 0.0, sample.rate_z_rad_s) if known else None

    def report(self, ground: GroundReport | None = None) -> ScompReport | None:
        """Return the newest slip; None before the first increment. A frame is reported once."""
        report = self._report
        if report is None:
            return None
        self._report = replace(report, trace=None)
        return report if ground is None or ground.slip is None else replace(report, slip=ground.slip)

    def body_motion(self, wheel_values: Sequence[float]) -> BodyMotion:
        """Return the body's motion for wheel speeds or angles, by the newest slip."""
        rolled_x, rolled_y, turn = self._kinematics.body_motion(wheel_values, self._steering_rad)
        ahead, aside = rolled_x * (1.0 - self._slip), rolled_y * (1.0 - self._slip)
        drift = math.tan(self._wheel_slip_angle_rad)
        return ahead - drift * aside, aside + drift * ahead, turn

    def compensate(
        self, increment: BodyIncrement, set_speed_rad_s: Sequence[float], gyro_rate_rad_s: float | None
    ) -> BodyIncrement:
        """Return the increment, flagged where the slip is unknown; the states turn it into the body's.

        Setpoints and gyro rate have no effect: `feed` takes the samples of the gyro.
        """
        self._steering_rad = increment.steering_rad
        self._tilt.pass_time(increment.duration_s)
        self._pending.add(increment)
        if self._pending.duration_s >= SCOMP.motion.step_s:
            parameters, tilt = self._settings.parameters, self._tilt
            pitch_rad, roll_rad = tilt_along(
                parameters, tilt.pitch_rad, tilt.roll_rad, self._pending.steering_rad
            )
            self._states.take_tilt(pitch_rad, expected_drift(parameters, pitch_rad, roll_rad))
        return replace(increment, is_sure=self._is_sure())

    @property
    def unsettled_m(self) -> complex:
        """0: no later increment corrects the travel."""
        return 0j

    def forget_gyro(self) -> None:
        """Do without the gyro until the rover has stopped; the pose filter doubts the states."""
        self._is_gyro_doubted = True

    def correct(self, estimate: SlipEstimate) -> None:
        """Correct the states by the trace of the newest frame, and report the slip, see `SlipCompensator`."""
        trace = self.trace_innovation = None
        if self._pending.duration_s >= SCOMP.motion.step_s:
            trace = self._step(estimate)
            self._slip, self._wheel_slip_angle_rad = self._states.slip_and_angle(estimate.slip_values)
        self._report = ScompReport(
            slip=self._slip,
            slip_angle_rad=mean_steering_rad(self._steering_rad) + self._wheel_slip_angle_rad,
            trace=trace,
            reason=self._uncertainty(),
        )

    def _take_frame(self, sample: FrameSample) -> None:
        exposed_ns = _exposed_ns(sample)
        if self._frame_ns is None or exposed_ns - self._frame_ns >= nanoseconds(
            self._settings.frame_period_s
        ):
            self._frame = sample

    def _step(self, estimate: SlipEstimate) -> TraceReading | None:
        """Follow the yaw rate, and correct by the trace of the newest frame."""
        pending, self._pending = self._pending, _Pending()
        readings, self._readings_rad_s = self._readings_rad_s, []
        if abs(pending.rim_m) < SCOMP.correction.slowest_m_s * pending.duration_s:
            self._is_gyro_doubted = False
        if self._is_gyro_doubted:
            readings, self._rates = [], None
        self._is_backwards = pending.rim_m < -SCOMP.correction.slowest_m_s * pending.duration_s
        rate_rad_s = pending.turn_rad / pending.duration_s
        self._since_rate_s = 0.0 if readings else self._since_rate_s + pending.duration_s
        if readings:
            rate_rad_s = sum(readings) / len(readings) - estimate.gyro_bias_rad_s
            self._skidding.follow(pending, rate_rad_s)
        elif self._since_rate_s > SCOMP.correction.rate_age_s:
            self._skidding.follow(pending, 0.0)  # the whole turn of the wheels may be skidding
        share = -math.expm1(-pending.duration_s / SCOMP.correction.rate_memory_s)
        self._yaw_rate_rad_s += share * (rate_rad_s - self._yaw_rate_rad_s)
        self._since_trace_s += pending.duration_s
        self._blind_m += abs(pending.rim_m)
        frame, self._frame = self._frame, None
        if frame is None or self._finder is None:
            return None
        self._frame_ns = _exposed_ns(frame)
        reading = self._finder.find(frame, pending.rim_m / pending.duration_s, self._rates)
        self._follow_sight(reading, self._frame_ns)
        if reading is None or reading.theta_rad is None:
            return reading
        innovation = None
        if reading.detected or (reading.source == "flow" and reading.theta_sd_rad is not None):
            innovation = self._correct_trace(estimate, reading, reading.theta_rad, pending, bool(readings))
        self.trace_innovation = innovation
        if innovation is not None and innovation.accepted:
            self._since_trace_s = 0.0
        return reading

    def _follow_sight(self, reading: TraceReading | None, frame_ns: int) -> None:
        """Follow travel and time since a frame last showed a direction, by trace or ground."""
        if reading is not None and reading.source in ("trace", "flow"):
            self._blind_m, self._blind_s, self._blind_from_ns = 0.0, 0.0, None
            return
        if self._blind_from_ns is None:
            self._blind_from_ns = frame_ns
        self._blind_s = seconds(frame_ns - self._blind_from_ns)

    def _has_trace(self) -> bool:
        return self._finder is not None and self._since_trace_s <= self._settings.trace_age_s

    def _correct_trace(
        self,
        estimate: SlipEstimate,
        reading: TraceReading,
        angle_rad: float,
        pending: "_Pending",
        is_gyro: bool,
    ) -> Innovation | None:
        """Correct by a trace angle, eq 2; None at a standstill.

        Args:
            estimate: The pose filter.
            reading: In the newest frame.
            angle_rad: Of the trace, or of the motion of the ground.
            pending: Motion of the wheels since the last step.
            is_gyro: Whether the yaw rate is the gyro's.

        After `trace_rejected_s` with rejections alone the ground has changed: the slip angle
        then becomes as uncertain as its difference from the reading. The gyro may be what is wrong instead:
        the slip angle stays flagged until traces were accepted for `confirming_s`.
        """
        motion_m = complex(pending.x_m, pending.y_m) * self._states.motion_per_m
        velocity_x_m_s = motion_m.real / pending.duration_s
        if abs(velocity_x_m_s) < SCOMP.correction.slowest_m_s:
            return None
        parameters = self._settings.parameters
        arm_s = parameters.rover.rear_axle_m / velocity_x_m_s
        rate_sd_rad_s = SCOMP.motion.wheel_walk_rad_sqrt_s
        if is_gyro:
            rate_sd_rad_s = parameters.gyro.walk_rad_sqrt_s / math.sqrt(SCOMP.correction.rate_memory_s)
        # The states hold the usual error of a trace; one that reports a larger deviation, or a direction
        # without a trace, has more.
        usual_rad = parameters.trace.noise_rad if reading.detected else 0.0
        more_rad2 = max(0.0, (reading.theta_sd_rad or 0.0) ** 2 - usual_rad**2)
        model = TraceAngle(
            model=self._states.model,
            tilt=self._states.tilt,
            block=estimate.layout.block,
            steering_rad=pending.steering_rad,
            arm_s=arm_s,
            yaw_rate_rad_s=self._yaw_rate_rad_s,
            bias_slope_s=arm_s if is_gyro else 0.0,
            variance_rad2=SCOMP.correction.trace_grain_rad**2 + more_rad2 + (arm_s * rate_sd_rad_s) ** 2,
        )
        measured = (parameters.trace.sign * angle_rad,)
        (innovation,) = estimate.correct(model, measured)
        residual = innovation.residual
        if innovation.accepted:
            self._trust.accept(reading.t_ns)
        elif residual is not None and self._trust.is_rejected_for_long(reading.t_ns):
            estimate.add_slip_variance(RESIDUAL, residual**2)
            (innovation,) = estimate.correct(model, measured)
            self._trust.begin_anew(reading.t_ns)
        return innovation

    def _is_sure(self) -> bool:
        """Return whether slip and slip angle are right within the variances of their states."""
        return self._uncertainty() in ("", NO_TRACE, NO_MOTION)

    def _uncertainty(self) -> str:
        if self._states.needs_tilt and not self._tilt.is_known:
            return "no tilt"
        if self._is_backwards:
            return "backwards: outside the slip law"
        if self._skidding.is_skidding:
            return "no gyro" if self._since_rate_s > SCOMP.correction.rate_age_s else "skidding in a turn"
        if self._trust.to_confirm_s > 0.0:
            return "slip angle taken from the trace anew"
        if self._finder is None or self._has_trace():
            return ""
        return NO_MOTION if self.unmoved_m else NO_TRACE


@dataclass(slots=True)
class _Pending:
    """Motion of the rolling wheels since the last step."""

    duration_s: float = 0.0
    x_m: float = 0.0
    y_m: float = 0.0
    turn_rad: float = 0.0
    steered_rad_s: float = 0.0

    @property
    def steering_rad(self) -> float:
        """Mean steering angle."""
        return self.steered_rad_s / self.duration_s

    @property
    def rim_m(self) -> float:
        """Distance that the wheels have rolled, negative backwards."""
        return math.copysign(math.hypot(self.x_m, self.y_m), self.x_m)

    def add(self, increment: BodyIncrement) -> None:
        self.duration_s += increment.duration_s
        self.x_m += increment.x_m
        self.y_m += increment.y_m
        self.turn_rad += increment.turn_rad
        self.steered_rad_s += mean_steering_rad(increment.steering_rad) * increment.duration_s


class _TraceTrust:
    """How long traces were rejected alone, and how long they confirm a slip angle taken from them anew.

    Args:
        greatest_gap_s: Longer times without a trace confirm nothing.

    Attributes:
        to_confirm_s: Time of accepted traces that is left.
    """

    def __init__(self, greatest_gap_s: float) -> None:
        self._greatest_gap_s = greatest_gap_s
        self._rejected_from_ns: int | None = None
        self._accepted_ns: int | None = None
        self.to_confirm_s = 0.0

    def accept(self, t_ns: int) -> None:
        """Take an accepted trace: the time since the one before confirms, if none was rejected."""
        if self._accepted_ns is not None and self._rejected_from_ns is None:
            since_s = seconds(t_ns - self._accepted_ns)
            if since_s <= self._greatest_gap_s:
                self.to_confirm_s = max(0.0, self.to_confirm_s - since_s)
        self._accepted_ns, self._rejected_from_ns = t_ns, None

    def is_rejected_for_long(self, t_ns: int) -> bool:
        """Take a rejected trace; return whether they have been rejected for `trace_rejected_s`."""
        if self._rejected_from_ns is None:
            self._rejected_from_ns = t_ns
        return seconds(t_ns - self._rejected_from_ns) >= SCOMP.correction.trace_rejected_s

    def begin_anew(self, t_ns: int) -> None:
        """Require traces that confirm what was taken from one."""
        self._accepted_ns, self._rejected_from_ns = t_ns, None
        self.to_confirm_s = SCOMP.correction.confirming_s


class _Skidding:
    """Speed at which the wheels of a side skid, as the rover turns less than they do.

    Args:
        track_m: Between left and right wheels.
    """

    def __init__(self, track_m: float) -> None:
        self._track_m = track_m
        self._skid_m_s = self._rim_m_s = 0.0

    @property
    def is_skidding(self) -> bool:
        """Whether they skid by more than the slip law allows."""
        least_m_s = max(SCOMP.correction.greatest_skid * self._rim_m_s, SCOMP.correction.slowest_m_s)
        return self._skid_m_s > least_m_s

    def follow(self, pending: _Pending, rate_rad_s: float) -> None:
        """Take a motion of the wheels, and the yaw rate of the rover."""
        share = -math.expm1(-pending.duration_s / SCOMP.correction.turn_memory_s)
        missing_rad_s = pending.turn_rad / pending.duration_s - rate_rad_s
        self._skid_m_s += share * (0.5 * self._track_m * abs(missing_rad_s) - self._skid_m_s)
        self._rim_m_s += share * (abs(pending.rim_m) / pending.duration_s - self._rim_m_s)


class _Tilt:
    """Pitch, raised nose positive, and roll, raised left side positive, through a low-pass."""

    def __init__(self) -> None:
        self.pitch_rad = self.roll_rad = 0.0
        self._t_ns: int | None = None
        self._age_s = math.inf
        self._is_new = False

    @property
    def is_known(self) -> bool:
        """Whether there is a tilt, and it is not old."""
        return self._age_s <= SCOMP.motion.tilt_age_s

    def pass_time(self, duration_s: float) -> None:
        """Let the tilt age by an increment of the wheels, unless it was measured during the increment."""
        self._age_s = 0.0 if self._is_new else self._age_s + duration_s
        self._is_new = False

    def feed(self, sample: AttitudeSample, t_ns: int) -> None:
        if sample.pitch_rad is None or sample.roll_rad is None:
            return
        pitch_rad, roll_rad = -sample.pitch_rad, sample.roll_rad
        if not abs(pitch_rad) + abs(roll_rad) <= math.pi:
            return
        share = 1.0
        if self._t_ns is not None:
            share = -math.expm1(-max(0.0, seconds(t_ns - self._t_ns)) / SCOMP.motion.tilt_memory_s)
        self.pitch_rad += share * (pitch_rad - self.pitch_rad)
        self.roll_rad += share * (roll_rad - self.roll_rad)
        self._t_ns = t_ns
        self._is_new = True


def _exposed_ns(frame: FrameSample) -> int:
    return frame.t_ns if frame.t_capture_ns is None else frame.t_capture_ns
