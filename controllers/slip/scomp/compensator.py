"""Slip and slip angle while driving, from tilt, gyro and the rear wheel's trace, by the sComp filter."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from controllers.estimation.filter.reader import Reader
from controllers.estimation.filter.slip_states import SlipEstimate
from controllers.estimation.ground.travel import GroundReport
from controllers.estimation.parameters import ESTIMATION
from controllers.estimation.slip_compensator import SlipEstimator, SlipEvidence
from controllers.estimation.wheels.odometry import BodyIncrement
from controllers.ftrace.reading import TraceReading
from controllers.motion.body_motion import BodyMotion
from controllers.motion.crab import DriftSource
from controllers.motion.kinematics import Kinematics
from controllers.motion.steering import mean_steering_rad
from controllers.roles import DeviceRoles
from controllers.slip.scomp.motion_model import expected_drift, tilt_along
from controllers.slip.scomp.parameters import SCOMP
from controllers.slip.scomp.settings import ScompSettings
from controllers.slip.scomp.states import ScompStates
from controllers.slip.scomp.trace_reader import TraceFinder, TraceReader
from drivers.clock import seconds
from drivers.record import record
from drivers.samples import AttitudeSample, RateSample, Sample

NO_TRACE = "no trace"
"""A reason that leaves the motion sure: without a trace the slip angle's own variance grows."""

NO_MOTION = (
    "no trace, and the camera sees no motion of the ground: turned against its rig, covered, too dark or too "
    "bright, or the rover is stuck"
)
"""The same after a travel of the wheels on which no frame gave a direction at all."""


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
        self._settings = settings
        self._roles = roles
        self._kinematics = kinematics
        self._states = states or ScompStates(settings.parameters)
        self._traces = TraceReader(settings, roles.camera, finder, self._states)
        self._skidding = _Skidding(settings.parameters.rover.track_m)
        self._since_rate_s = 0.0
        self._is_backwards = False
        self._tilt = _Tilt()
        self._readings_rad_s: list[float] = []
        self._slip = self._wheel_slip_angle_rad = 0.0
        self._steering_rad: tuple[float, ...] = ()
        self._pending = _Pending()

    @property
    def readers(self) -> tuple[Reader[Any], ...]:
        """That of the trace."""
        return (self._traces,)

    @property
    def drift_rad(self) -> float:
        """Angle of the velocity from the direction in which the wheels roll, left positive."""
        return self._wheel_slip_angle_rad

    @property
    def evidence(self) -> SlipEvidence:
        """What the frames of the camera show."""
        return SlipEvidence(unmoved_m=self._traces.unmoved_m)

    @property
    def drift_source(self) -> DriftSource:
        """What the slip angle comes from."""
        if self._traces.has_trace:
            return DriftSource.TRACE
        return DriftSource.TILT if self._tilt.is_known else DriftSource.NONE

    @property
    def states(self) -> ScompStates:
        """The states in the pose filter."""
        return self._states

    def feed(self, sample: Sample, t_ns: int) -> None:
        """Take a sample of the gyro as of `t_ns`; other samples have no effect."""
        greatest_rad_s = ESTIMATION.pose.greatest_rate_rad_s
        if sample.device != self._roles.gyro:
            return
        if isinstance(sample, AttitudeSample):
            self._tilt.feed(sample, t_ns)
        elif isinstance(sample, RateSample) and abs(sample.rate_z_rad_s) <= greatest_rad_s:
            self._readings_rad_s.append(sample.rate_z_rad_s)
            x, y = sample.rate_x_rad_s, sample.rate_y_rad_s
            known = x is not None and y is not None and abs(x) + abs(y) <= greatest_rad_s
            known = known and not self._traces.is_gyro_doubted
            self._traces.rates_rad_s = (x or 0.0, y or 0.0, sample.rate_z_rad_s) if known else None

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
        self._traces.is_gyro_doubted = True
        self._traces.rates_rad_s = None

    def follow(self, estimate: SlipEstimate) -> None:
        """Report the slip by the corrected states, see `SlipCompensator`."""
        if self._report is None and not self._pending.duration_s:
            return
        trace = None
        if self._pending.duration_s >= SCOMP.motion.step_s:
            trace = self._step(estimate.gyro_bias_rad_s)
            self._slip, self._wheel_slip_angle_rad = self._states.slip_and_angle(estimate.slip_values)
        self._report = ScompReport(
            slip=self._slip,
            slip_angle_rad=mean_steering_rad(self._steering_rad) + self._wheel_slip_angle_rad,
            trace=trace,
            reason=self._uncertainty(),
        )

    def _step(self, gyro_bias_rad_s: float) -> TraceReading | None:
        """Follow the motion since the last step; return the trace in the frame evaluated since then."""
        pending, self._pending = self._pending, _Pending()
        readings, self._readings_rad_s = self._readings_rad_s, []
        slowest_m = SCOMP.correction.slowest_m_s * pending.duration_s
        if abs(pending.rim_m) < slowest_m:
            self._traces.is_gyro_doubted = False
        if self._traces.is_gyro_doubted:
            readings = []
        self._is_backwards = pending.rim_m < -slowest_m
        self._since_rate_s = 0.0 if readings else self._since_rate_s + pending.duration_s
        if readings:
            self._skidding.follow(pending, sum(readings) / len(readings) - gyro_bias_rad_s)
        elif self._since_rate_s > SCOMP.correction.rate_age_s:
            self._skidding.follow(pending, 0.0)  # the whole turn of the wheels may be skidding
        return self._traces.pass_motion(pending.duration_s, pending.rim_m)

    def _is_sure(self) -> bool:
        """Return whether slip and slip angle are right within the variances of their states."""
        return self._uncertainty() in ("", NO_TRACE, NO_MOTION)

    def _uncertainty(self) -> str:
        if self._states.needs_tilt and not self._tilt.is_known:
            return "no tilt"
        if self._traces.contradiction:
            return self._traces.contradiction
        if self._is_backwards:
            return "backwards: outside the slip law"
        if self._skidding.is_skidding:
            return "no gyro" if self._since_rate_s > SCOMP.correction.rate_age_s else "skidding in a turn"
        if not self._traces.is_confirmed:
            return "slip angle taken from the trace anew"
        if not self._traces.lacks_trace:
            return ""
        return NO_MOTION if self._traces.unmoved_m else NO_TRACE


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
