"""The trace of the rear left wheel corrects the slip angle, by the motion before the exposure of its frame.

Tilt and slip are those of the cycle: they change slowly.
"""

import cmath
import math
from collections.abc import Iterator
from typing import ClassVar, NamedTuple, Protocol

from controllers.estimation.filter.guarded_filter import Innovation
from controllers.estimation.filter.motion_history import MotionHistory
from controllers.estimation.filter.reader import Situation
from controllers.ftrace.reading import Rates, TraceReading
from controllers.slip.scomp.motion_model import RESIDUAL
from controllers.slip.scomp.parameters import SCOMP
from controllers.slip.scomp.settings import ScompSettings
from controllers.slip.scomp.states import ScompStates
from controllers.slip.scomp.trace_model import TraceAngle
from drivers.clock import nanoseconds, seconds
from drivers.samples import FrameSample, Sample


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


class TraceReader:
    """Corrects the slip angle by the traces in the frames of a camera.

    Args:
        settings: Parameters of the estimator.
        camera: Device that sends the frames.
        finder: Of the trace; None without a camera: nothing is then corrected.
        states: Of slip and trace.

    Attributes:
        rates_rad_s: Turn rates of the body about x, y, z; None where unknown.
        is_gyro_doubted: Whether the yaw rate may be wrong: no trace can then be compared.
    """

    kind: ClassVar[type[Sample]] = FrameSample

    def __init__(
        self, settings: ScompSettings, camera: str | None, finder: TraceFinder | None, states: ScompStates
    ) -> None:
        self._settings, self._camera, self._finder, self._states = settings, camera or "", finder, states
        self._trust = _TraceTrust(settings.trace_age_s)
        self._sight = _Sight()
        self._frame_ns: int | None = None
        self._newest: TraceReading | None = None
        self._contradiction = ""
        self._is_accepted = False
        self._since_trace_s = math.inf
        self.rates_rad_s: Rates | None = None
        self.is_gyro_doubted = False

    @property
    def has_trace(self) -> bool:
        """Whether a trace was accepted of late."""
        return self._finder is not None and self._since_trace_s <= self._settings.trace_age_s

    @property
    def lacks_trace(self) -> bool:
        """Whether there is a camera, and no trace was accepted of late."""
        return self._finder is not None and not self.has_trace

    @property
    def is_confirmed(self) -> bool:
        """Whether enough traces have confirmed a slip angle taken from them anew."""
        return self._trust.to_confirm_s <= 0.0

    @property
    def contradiction(self) -> str:
        """What the newest frame shows to be wrong about the camera's rig; "" for nothing."""
        return self._contradiction

    @property
    def unmoved_m(self) -> float:
        """Travel of the wheels on which frames have shown no motion of the ground; 0 where that is little."""
        return 0.0 if self._finder is None else self._sight.unmoved_m

    def pass_motion(self, duration_s: float, rim_m: float) -> TraceReading | None:
        """Let the wheels roll on; return the trace in the frame evaluated since the last call."""
        self._since_trace_s = 0.0 if self._is_accepted else self._since_trace_s + duration_s
        self._sight.roll(abs(rim_m))
        newest, self._newest, self._is_accepted = self._newest, None, False
        return newest

    def source(self, sample: FrameSample) -> str | None:
        """Return the camera; None for other cameras, and where nothing finds the trace."""
        return self._camera if self._finder is not None and sample.device == self._camera else None

    def measured_ns(self, sample: FrameSample, t_ns: int) -> int:
        """Return the time of the exposure."""
        return t_ns if sample.t_capture_ns is None else min(sample.t_capture_ns, t_ns)

    def correct(self, sample: FrameSample, now: Situation) -> Iterator[Innovation]:
        """Correct by the trace; yield its innovation. Frames that come too fast are passed over."""
        frame_ns = now.measured_ns
        period_ns = nanoseconds(self._settings.frame_period_s)
        if self._finder is None or (self._frame_ns is not None and frame_ns - self._frame_ns < period_ns):
            return
        motion = _motion_before(now.history, frame_ns, SCOMP.motion.step_s)
        if motion is None:
            return
        self._frame_ns = frame_ns
        reading = self._finder.find(sample, motion.rim_m_s, self.rates_rad_s)
        self._newest = reading
        self._contradiction = "" if reading is None else reading.contradiction
        self._sight.look(reading, frame_ns)
        if reading is None or reading.theta_rad is None or self.is_gyro_doubted:
            return
        if reading.detected or (reading.source == "flow" and reading.theta_sd_rad is not None):
            yield from self._correct_angle(reading, reading.theta_rad, now)

    def miss(self, sample: FrameSample) -> None:
        """Nothing: the next trace is as good."""

    def _correct_angle(self, reading: TraceReading, angle_rad: float, now: Situation) -> Iterator[Innovation]:
        """Correct by a trace angle, eq 2; without effect at a standstill.

        Args:
            reading: In the newest frame.
            angle_rad: Of the trace, or of the motion of the ground.
            now: The pose filter and the motion before the exposure.

        After `trace_rejected_s` with rejections alone the ground has changed: the slip angle
        then becomes as uncertain as its difference from the reading. The gyro may be what is wrong instead:
        the slip angle stays flagged until traces were accepted for `confirming_s`.
        """
        estimate = now.pose_filter
        motion = _motion_before(now.history, now.measured_ns, SCOMP.correction.rate_memory_s)
        if motion is None or motion.biased_rad_s is None:
            return
        if abs(motion.velocity_m_s.real) < SCOMP.correction.slowest_m_s:
            return
        parameters = self._settings.parameters
        arm_s = parameters.rover.rear_axle_m / motion.velocity_m_s.real
        # The states hold the usual error of a trace; one that reports a larger deviation, or a direction
        # without a trace, has more.
        usual_rad = parameters.trace.noise_rad if reading.detected else 0.0
        more_rad2 = max(0.0, (reading.theta_sd_rad or 0.0) ** 2 - usual_rad**2)
        model = TraceAngle(
            model=self._states.model,
            tilt=self._states.tilt,
            block=estimate.layout.block,
            steering_rad=motion.steering_rad,
            arm_s=arm_s,
            yaw_rate_rad_s=motion.biased_rad_s - estimate.gyro_bias_rad_s * motion.gyro_share,
            bias_slope_s=arm_s * motion.gyro_share,
            variance_rad2=SCOMP.correction.trace_grain_rad**2 + more_rad2 + arm_s**2 * motion.rate_rad2_s2,
        )
        measured = (parameters.trace.sign * angle_rad,)
        (innovation,) = estimate.correct(model, measured)
        residual = innovation.residual
        if innovation.accepted:
            self._trust.accept(now.measured_ns)
        elif residual is not None and self._trust.is_rejected_for_long(now.measured_ns):
            estimate.add_slip_variance(RESIDUAL, residual**2)
            (innovation,) = estimate.correct(model, measured)
            self._trust.begin_anew(now.measured_ns)
        self._is_accepted |= innovation.accepted
        yield innovation


class _Motion(NamedTuple):
    """Mean motion of the rover in a time.

    Attributes:
        velocity_m_s: In the body frame, left as imaginary part.
        rim_m_s: Speed at which the wheels roll, negative backwards.
        steering_rad: Direction in which they roll.
        biased_rad_s: Yaw rate, the bias of the gyro included; None where neither gyro nor wheels have
            measured it for half of the time.
        gyro_share: Share of the time in which the gyro measured it.
        rate_rad2_s2: Variance of the yaw rate.
    """

    velocity_m_s: complex
    rim_m_s: float
    steering_rad: float
    biased_rad_s: float | None
    gyro_share: float
    rate_rad2_s2: float


def _motion_before(history: MotionHistory, then_ns: int, duration_s: float) -> _Motion | None:
    """Return the motion in a time before `then_ns`, shorter near the start; None for less than a step."""
    first_ns = then_ns if history.first_ns is None else history.first_ns
    from_ns = max(then_ns - nanoseconds(duration_s), first_ns)
    duration_s = seconds(then_ns - from_ns)
    back = history.way_back(from_ns, then_ns)
    if back is None or duration_s < SCOMP.motion.step_s:
        return None
    # Seen from the pose in the middle of that time.
    middle = cmath.rect(1.0, 0.5 * back.turned_rad)
    rolled_m = back.rolled_m * middle
    # A slow gyro measures the turn of several steps at once, not all of them in this time.
    is_measured = back.measured_s >= 0.5 * duration_s
    turning_s = back.measured_s if is_measured else duration_s
    return _Motion(
        velocity_m_s=-complex(back.x_m, back.y_m) * middle / duration_s,
        rim_m_s=math.copysign(abs(rolled_m), rolled_m.real) / duration_s,
        steering_rad=cmath.phase(rolled_m),
        biased_rad_s=(back.turned_rad + back.bias_rad) / turning_s if is_measured else None,
        gyro_share=back.covered_s / turning_s,
        rate_rad2_s2=back.yaw_rad2 / turning_s**2,
    )


class _Sight:
    """Follows travel and time since a frame last showed a direction, by trace or ground."""

    def __init__(self) -> None:
        self._blind_m = self._blind_s = 0.0
        self._blind_from_ns: int | None = None

    @property
    def unmoved_m(self) -> float:
        """The travel; 0 where that is little."""
        blind = SCOMP.correction
        return self._blind_m if self._blind_m >= blind.blind_m and self._blind_s >= blind.blind_s else 0.0

    def roll(self, rim_m: float) -> None:
        """Let the wheels roll on."""
        self._blind_m += rim_m

    def look(self, reading: TraceReading | None, frame_ns: int) -> None:
        """Take what a frame shows."""
        if reading is not None and reading.source in ("trace", "flow"):
            self._blind_m, self._blind_s, self._blind_from_ns = 0.0, 0.0, None
            return
        if self._blind_from_ns is None:
            self._blind_from_ns = frame_ns
        self._blind_s = seconds(frame_ns - self._blind_from_ns)


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
