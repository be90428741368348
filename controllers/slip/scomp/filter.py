"""Pose of a slipping rover from wheels, gyro, compass, trace and tilt: an extended Kalman filter."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from controllers.estimation.guarded_filter import GuardedFilter, Innovation
from controllers.motion.planar import wrap_angle
from controllers.slip.scomp.motion_model import (
    ANGLES,
    BIAS,
    CERTAIN,
    DEVIATION,
    GAIN,
    LAGGED,
    OFFSET,
    RESIDUAL,
    STATES,
    TRACE_NOISE,
    TRACE_OFFSET,
    YAW,
    Motion,
    MotionModel,
    X,
    Y,
)
from controllers.slip.scomp.parameters import SCOMP, ScompParameters
from controllers.slip.scomp.slip_laws import SlipLaw

Array = NDArray[np.float64]

UNKNOWN_RAD2 = 10.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FilterStep:
    """One step of a filter; n states.

    Attributes:
        transition: From the estimate of the step before to the prediction, (n, n).
        predicted: State before the corrections of this step, and its covariance.
        estimate: State after them, and its covariance.
    """

    transition: Array
    predicted: tuple[Array, Array]
    estimate: tuple[Array, Array]


@dataclass(frozen=True, slots=True, kw_only=True)
class StartHeading:
    """Heading at start; with `standard_deviation_rad` None it is taken from the compass."""

    heading_rad: float
    standard_deviation_rad: float | None


class ScompFilter:
    """The filter; its state is described at `motion_model.STATES`. It starts at the origin.

    The trace is alpha_r = beta - b r / V_x (eq 2), the direction of the rear wheel's velocity in the body:
    steering turns beta, not the relation. A position fix corrects all states that are correlated with the
    position, among them the parameters of the slip law: they adapt on-line.

    Args:
        parameters: Rover, ground and sensors.
        law: Slip over slip angle and pitch.
        start: Heading at the start.
        follows_roll: False when there is no roll.
    """

    def __init__(
        self, parameters: ScompParameters, law: SlipLaw, start: StartHeading, *, follows_roll: bool
    ) -> None:
        self._parameters = parameters
        self._compass_sign = parameters.compass.sign or 1
        self._reference_waves = _waves(parameters.compass.reference_rad)
        self._heading_is_unknown = start.standard_deviation_rad is None
        self._offset_is_unknown = not self._heading_is_unknown
        self.model = MotionModel(parameters, law, follows_roll=follows_roll)
        self.motion = Motion(duration_s=1.0, wheel_rad=0.0, rate_rad_s=0.0, is_gyro=False)
        self._velocity_x_m_s = self._yaw_rate_rad_s = 0.0
        self._trace_rejections = self._compass_rejections = 0
        state, variances = self._start(start, follows_roll=follows_roll)
        self._filter = GuardedFilter(state.tolist(), variances.tolist(), ANGLES, SCOMP.correction.gate)
        # Heading and lagged heading are equal at start, however uncertain.
        self._transition = np.eye(STATES)
        self._transition[LAGGED, [LAGGED, YAW]] = 0.0, 1.0
        self._filter.predict(0.0, state.tolist(), self._transition, np.diag([CERTAIN] * STATES))
        self._predicted = self._snapshot()

    @property
    def step(self) -> FilterStep:
        """State and covariance before and after the corrections since the last `move`."""
        return FilterStep(transition=self._transition, predicted=self._predicted, estimate=self._snapshot())

    def move(self, motion: Motion) -> None:
        """Predict to the end of a step."""
        self.motion = motion
        prediction = self.model.predict(self._filter.state, motion)
        self._velocity_x_m_s = prediction.velocity_x_m_s
        share = -math.expm1(-motion.duration_s / SCOMP.correction.rate_memory_s)
        self._yaw_rate_rad_s += share * (prediction.yaw_rate_rad_s - self._yaw_rate_rad_s)
        self._filter.predict(motion.duration_s, prediction.state, prediction.transition, prediction.noise)
        self._transition, self._predicted = prediction.transition, self._snapshot()

    def correct_standstill(self) -> Innovation | None:
        """Correct the gyro's bias by its reading while the wheels are at rest; None while they turn."""
        motion = self.motion
        greatest_rad = SCOMP.correction.standstill_rad_s * motion.duration_s
        if not motion.is_gyro or abs(motion.wheel_rad) > greatest_rad:
            return None
        row = np.zeros(STATES)
        row[BIAS] = 1.0
        # The rate is the mean of two readings.
        noise_rad_s = self._parameters.gyro.walk_rad_sqrt_s / math.sqrt(2.0 * motion.duration_s)
        residual = motion.rate_rad_s - self._filter.state[BIAS]
        return self._filter.update("gyro standstill", residual, row, noise_rad_s**2)

    def correct_compass(self, reading_rad: float) -> Innovation:
        """Correct by a compass reading, in the compass' own sense of rotation.

        After more than `most_compass_rejections` rejections in a row the gyro's bias becomes less certain.
        """
        reading_rad *= self._compass_sign
        if math.isfinite(reading_rad):
            self._initialise(reading_rad)
        state = self._filter.state
        heading = state[LAGGED]
        waves = _waves(heading) - self._reference_waves
        row = np.zeros(STATES)
        row[LAGGED] = row[OFFSET] = 1.0
        row[DEVIATION : DEVIATION + 4] = waves
        deviation = float(waves @ np.array(state[DEVIATION : DEVIATION + 4]))
        residual = wrap_angle(reading_rad - heading - state[OFFSET] - deviation)
        innovation = self._filter.update("compass", residual, row, self._parameters.compass.noise_rad**2)
        self._compass_rejections = 0 if innovation.accepted else self._compass_rejections + 1
        if self._compass_rejections > SCOMP.correction.most_compass_rejections:
            self._widen(BIAS, SCOMP.correction.widened_bias_rad_s**2)
            self._compass_rejections = 0
        return innovation

    def correct_trace(self, angle_rad: float, sd_rad: float = 0.0) -> Innovation | None:
        """Correct by a new trace angle; None at a standstill, where a trace has no direction of velocity.

        `sd_rad` is the additional standard deviation of a direction measured without the trace.

        After more than `most_trace_rejections` rejections in a row the ground has changed: the slip angle
        then becomes as uncertain as its difference from the reading.
        """
        if abs(self._velocity_x_m_s) < SCOMP.correction.slowest_m_s:
            return None
        settings, state = self._parameters.trace, self._filter.state
        arm_s = self._parameters.rover.rear_axle_m / self._velocity_x_m_s
        course = self.model.course(state, self.motion)
        expected = math.atan(math.tan(course) - arm_s * self._yaw_rate_rad_s)
        error_rad = state[TRACE_NOISE] + state[TRACE_OFFSET]
        residual = wrap_angle(settings.sign * angle_rad - expected - error_rad)
        row = np.zeros(STATES)
        row[[RESIDUAL, TRACE_NOISE, TRACE_OFFSET]] = 1.0
        row[GAIN] = self.motion.expected_drift_rad
        rate_sd_rad_s = SCOMP.motion.wheel_walk_rad_sqrt_s
        if self.motion.is_gyro:
            row[BIAS] = arm_s
            rate_sd_rad_s = self._parameters.gyro.walk_rad_sqrt_s / math.sqrt(SCOMP.correction.rate_memory_s)
        variance = SCOMP.correction.trace_grain_rad**2 + sd_rad**2 + (arm_s * rate_sd_rad_s) ** 2
        innovation = self._filter.update("trace", residual, row, variance)
        self._trace_rejections = 0 if innovation.accepted else self._trace_rejections + 1
        if self._trace_rejections > SCOMP.correction.most_trace_rejections and math.isfinite(residual):
            self._widen(RESIDUAL, residual**2)
            self._trace_rejections = 0
            innovation = self._filter.update("trace", residual, row, variance)
        return innovation

    def correct_position(self, x_m: float, y_m: float, standard_deviation_m: float) -> tuple[Innovation, ...]:
        """Correct by an absolute position in the frame of the pose at start."""
        state = self._filter.state
        rows = np.zeros((2, STATES))
        rows[0, X] = rows[1, Y] = 1.0
        away = np.array([x_m - state[X], y_m - state[Y]])
        return self._filter.update_together(
            ("fix x", "fix y"), away, rows, np.full(2, standard_deviation_m**2)
        )

    def _start(self, start: StartHeading, *, follows_roll: bool) -> tuple[Array, Array]:
        """Return the first state and its variances."""
        parameters = self._parameters
        compass, spread = parameters.compass, start.standard_deviation_rad
        state, variances = np.zeros(STATES), np.full(STATES, CERTAIN)
        state[[YAW, LAGGED]] = start.heading_rad
        variances[YAW] = UNKNOWN_RAD2 if spread is None else spread**2
        variances[BIAS] = parameters.gyro.bias_rad_s**2
        state[OFFSET] = compass.offset_rad or 0.0
        variances[OFFSET] = UNKNOWN_RAD2 if self._offset_is_unknown else compass.offset_sd_rad**2
        variances[DEVIATION : DEVIATION + 4] = compass.deviation_rad**2
        state[RESIDUAL:], variances[RESIDUAL:] = self.model.start(follows_roll=follows_roll)
        return state, variances

    def _initialise(self, reading_rad: float) -> None:
        """Set the offset or the heading that is still unknown by the first reading."""
        state = self._filter.state
        if self._offset_is_unknown:
            self._filter.assign(OFFSET, wrap_angle(reading_rad - state[LAGGED]))
        elif self._heading_is_unknown:
            for index in (YAW, LAGGED):
                self._filter.assign(index, wrap_angle(reading_rad - state[OFFSET]))
        self._offset_is_unknown = self._heading_is_unknown = False

    def _snapshot(self) -> tuple[Array, Array]:
        return np.array(self._filter.state), np.array(self._filter.covariance)

    def _widen(self, index: int, variance: float) -> None:
        """Increase the variance of a state, as if the last step had done so."""
        self._filter.widen(index, variance)
        self._predicted[1][index, index] += variance


def _waves(heading_rad: float) -> Array:
    angles = np.array([heading_rad, heading_rad, 2.0 * heading_rad, 2.0 * heading_rad])
    angles[[1, 3]] += 0.5 * math.pi
    waves: Array = np.sin(angles)
    return waves
