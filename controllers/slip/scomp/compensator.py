"""Slip and slip angle while driving, from tilt, gyro and the rear wheel's trace, by the sComp filter."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

from controllers.estimation.odometry import BodyIncrement
from controllers.estimation.parameters import ESTIMATION
from controllers.motion.body_motion import BodyMotion
from controllers.motion.crab import DriftSource
from controllers.motion.kinematics import Kinematics
from controllers.motion.steering import mean_steering_rad
from controllers.roles import DeviceRoles
from controllers.slip.scomp.filter import ScompFilter, StartHeading
from controllers.slip.scomp.motion_model import Motion, expected_drift, tilt_along
from controllers.slip.scomp.parameters import SCOMP
from controllers.slip.scomp.settings import ScompSettings
from controllers.slip.scomp.slip_laws import PitchLaw
from drivers.clock import nanoseconds, seconds
from drivers.samples import AttitudeSample, FrameSample, RateSample, Sample

Rates = tuple[float, float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class TraceReading:
    """The trace in one frame.

    Attributes:
        t_ns: Time of exposure.
        detected: The trace is in the frame.
        theta_rad: Direction of the rear left wheel's velocity in the body, left positive; None where unknown.
        confidence: 0..1, probability that the trace is in the frame and `theta_rad` is right within 5 deg.
        source: Where `theta_rad` comes from: `trace`; `flow`, the motion of the ground without a trace;
            `held`, predicted from earlier frames; `none`.
        theta_sd_rad: Standard deviation of `theta_rad`; None where unknown.
    """

    t_ns: int
    detected: bool
    theta_rad: float | None
    confidence: float
    source: str
    theta_sd_rad: float | None


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


@dataclass(frozen=True, slots=True, kw_only=True)
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


class ScompCompensator:
    """Turns wheel increments into body increments of a rover that slips and drifts.

    Args:
        settings: Parameters of the estimator.
        roles: Names the gyro, which also measures the tilt, and the rearward camera.
        kinematics: Of the wheels.
        finder: Of the trace; None without a camera.
    """

    def __init__(
        self,
        settings: ScompSettings,
        roles: DeviceRoles,
        kinematics: Kinematics,
        finder: TraceFinder | None,
    ) -> None:
        self._report: ScompReport | None = None
        self._settings = settings
        self._roles = roles
        self._kinematics = kinematics
        self._finder = finder
        start = StartHeading(heading_rad=0.0, standard_deviation_rad=SCOMP.motion.start_certain_rad)
        parameters = settings.parameters
        self._filter = ScompFilter(parameters, PitchLaw(parameters), start, follows_roll=True)
        self._tilt = _Tilt()
        self._frame: FrameSample | None = None
        self._frame_ns: int | None = None
        self._rates: Rates | None = None
        self._readings_rad_s: list[float] = []
        self._since_trace_s = math.inf
        self._slip = self._wheel_slip_angle_rad = 0.0
        self._steering_rad: tuple[float, ...] = ()
        self._pending = _Pending()

    @property
    def wheel_slip_angle_rad(self) -> float:
        """Angle of the velocity from the direction in which the wheels roll, left positive."""
        return self._wheel_slip_angle_rad

    @property
    def source(self) -> DriftSource:
        """What the slip angle comes from."""
        if self._has_trace():
            return DriftSource.TRACE
        return DriftSource.TILT if self._tilt.is_known else DriftSource.NONE

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

    def report(self) -> ScompReport | None:
        """Return the newest slip; None before the first increment. A frame is reported once."""
        report = self._report
        if report is not None:
            self._report = replace(report, trace=None)
        return report

    def body_motion(self, wheel_values: Sequence[float]) -> BodyMotion:
        """Return the body's motion for wheel speeds or angles, by the newest slip."""
        rolled_x, rolled_y, turn = self._kinematics.body_motion(wheel_values, self._steering_rad)
        ahead, aside = rolled_x * (1.0 - self._slip), rolled_y * (1.0 - self._slip)
        drift = math.tan(self._wheel_slip_angle_rad)
        return ahead - drift * aside, aside + drift * ahead, turn

    def compensate(
        self, increment: BodyIncrement, set_speed_rad_s: Sequence[float], gyro_rate_rad_s: float | None
    ) -> BodyIncrement:
        """Return the increment of the body for an increment of rolling wheels, see `SlipCompensator`.

        Set-points and gyro rate have no effect: `feed` takes the samples of the gyro.
        """
        trace = None
        self._steering_rad = increment.steering_rad
        self._pending.add(increment)
        if self._pending.duration_s >= SCOMP.motion.step_s:
            trace = self._step()
        x_m, y_m, _ = self.body_motion(increment.turned_rad)
        reason = self._uncertainty()
        self._report = ScompReport(
            slip=self._slip,
            slip_angle_rad=mean_steering_rad(increment.steering_rad) + self._wheel_slip_angle_rad,
            trace=trace,
            reason=reason,
        )
        return replace(increment, x_m=x_m, y_m=y_m, is_sure=not reason)

    def _take_frame(self, sample: FrameSample) -> None:
        exposed_ns = _exposed_ns(sample)
        if self._frame_ns is None or exposed_ns - self._frame_ns >= nanoseconds(
            self._settings.frame_period_s
        ):
            self._frame = sample

    def _step(self) -> TraceReading | None:
        """Predict and correct the filter, the trace of the newest frame included."""
        pending, self._pending = self._pending, _Pending()
        readings, self._readings_rad_s = self._readings_rad_s, []
        parameters = self._settings.parameters
        steering_rad = pending.steered_rad_s / pending.duration_s
        pitch_rad, roll_rad = tilt_along(parameters, self._tilt.pitch_rad, self._tilt.roll_rad, steering_rad)
        scomp_filter = self._filter
        scomp_filter.move(
            Motion(
                duration_s=pending.duration_s,
                wheel_rad=pending.rim_m / parameters.rover.wheel_radius_m,
                rate_rad_s=sum(readings) / len(readings)
                if readings
                else pending.turn_rad / pending.duration_s,
                is_gyro=bool(readings),
                pitch_rad=pitch_rad,
                expected_drift_rad=expected_drift(parameters, pitch_rad, roll_rad),
                steering_rad=steering_rad,
            )
        )
        scomp_filter.correct_standstill()
        self._since_trace_s += pending.duration_s
        trace = self._measure_trace(pending.rim_m / pending.duration_s)
        state = scomp_filter.step.estimate[0]
        self._slip = scomp_filter.model.slip(state, scomp_filter.motion)
        self._wheel_slip_angle_rad = scomp_filter.model.drift(state, scomp_filter.motion)
        return trace

    def _measure_trace(self, rim_m_s: float) -> TraceReading | None:
        """Find the trace in the newest frame and correct the filter with it.

        Without a trace, the direction of the motion of the ground is used with its own standard deviation.
        """
        frame, self._frame = self._frame, None
        if frame is None or self._finder is None:
            return None
        self._frame_ns = _exposed_ns(frame)
        reading = self._finder.find(frame, rim_m_s, self._rates)
        if reading is None or reading.theta_rad is None:
            return reading
        innovation = None
        if reading.detected:
            innovation = self._filter.correct_trace(reading.theta_rad)
        elif reading.source == "flow" and reading.theta_sd_rad is not None:
            innovation = self._filter.correct_trace(reading.theta_rad, reading.theta_sd_rad)
        if innovation is not None and innovation.accepted:
            self._since_trace_s = 0.0
        return reading

    def _has_trace(self) -> bool:
        return self._finder is not None and self._since_trace_s <= self._settings.trace_age_s

    def _uncertainty(self) -> str:
        if not self._tilt.is_known:
            return "no tilt"
        return "" if self._finder is None or self._has_trace() else "no trace"


@dataclass(slots=True)
class _Pending:
    """Motion of the rolling wheels since the last step."""

    duration_s: float = 0.0
    x_m: float = 0.0
    y_m: float = 0.0
    turn_rad: float = 0.0
    steered_rad_s: float = 0.0

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


class _Tilt:
    """Pitch, raised nose positive, and roll, raised left side positive, through a low-pass."""

    def __init__(self) -> None:
        self.pitch_rad = self.roll_rad = 0.0
        self._t_ns: int | None = None

    @property
    def is_known(self) -> bool:
        return self._t_ns is not None

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


def _exposed_ns(frame: FrameSample) -> int:
    return frame.t_ns if frame.t_capture_ns is None else frame.t_capture_ns
